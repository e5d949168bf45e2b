//! Renders the images that the pages show, and checks that they are those of today's renderer and scenes.
//!
//! Each image is a frame of a recipe. A recipe is a scene of `examples/` whose `Command` calls make what its frames
//! need: shaders, textures, maps and other passes. Or it is a page of the manual with files and commands. Everything
//! happens in a copy of the tree in `target/gallery`, where each image is one more `Output` of its frame.
//!
//! `--check` runs the recipes, renders a box of [`BOX`] pixels of each frame at its full settings, and compares it with
//! the stored image.

mod compare;
mod recipe;
mod table;

use compare::Tolerance;
use recipe::Recipe;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use table::{IMAGES, Image};

/// The width and height in pixels of the part of an image that is checked.
const BOX: u32 = 96;

/// The file that a checked part is rendered to.
const CHECKED: &str = "part.png";

/// The arguments of `gallery`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Render 96 x 96 pixels of each image and compare them with the stored image; write nothing.
    #[arg(long)]
    check: bool,
    /// Use this renderer; by default `cargo build --release --bin gelato` builds one.
    #[arg(long, value_name = "PATH")]
    gelato: Option<PathBuf>,
    /// Parts of the images' names; all images without one.
    names: Vec<String>,
}

/// Checks all images with a renderer that was built before. It takes about three minutes of processor time.
pub(crate) fn check_all(gelato: PathBuf) -> Result<(), String> {
    run(&Options { check: true, gelato: Some(gelato), names: Vec::new() })
}

/// Renders or checks the images.
pub(crate) fn run(options: &Options) -> Result<(), String> {
    let selected: Vec<&Image> = IMAGES
        .iter()
        .filter(|p| options.names.is_empty() || options.names.iter().any(|name| p.file.contains(name)))
        .collect();
    if selected.is_empty() {
        let all: Vec<&str> = IMAGES.iter().map(|p| p.file).collect();
        return Err(format!("no image of this name; there are {}", all.join(", ")));
    }
    let root = crate::workspace::Workspace::load()?.root;
    let gelato = match &options.gelato {
        Some(path) => std::path::absolute(path).map_err(|e| format!("{}: {e}", path.display()))?,
        None => build(&root)?,
    };
    let studio = Studio::new(&root, gelato)?;
    let mut by_recipe: BTreeMap<&str, Vec<&Image>> = BTreeMap::new();
    for image in selected {
        by_recipe.entry(image.recipe).or_default().push(image);
    }
    let mut faults = Vec::new();
    for (recipe, images) in by_recipe {
        let recipe = Recipe::read(&root, recipe)?;
        let start = Instant::now();
        studio.prepare(&recipe)?;
        println!("gallery: {} without its frames: {:.1} s", recipe.scene, start.elapsed().as_secs_f64());
        for image in images {
            let start = Instant::now();
            let outcome = if options.check { studio.check(image) } else { studio.make(image) };
            let seconds = start.elapsed().as_secs_f64();
            match outcome {
                Ok(what) => println!("gallery: {}: {what}, {seconds:.1} s", image.file),
                Err(what) => {
                    println!("gallery: {}: {what}, {seconds:.1} s", image.file);
                    faults.push(image.file);
                }
            }
        }
    }
    if faults.is_empty() {
        return Ok(());
    }
    let again = format!("cargo xtask gallery {}", faults.join(" "));
    Err(format!("{} of the images failed; `{again}` renders them again", faults.len()))
}

/// Builds the renderer, and returns its path.
fn build(root: &Path) -> Result<PathBuf, String> {
    let mut cargo = Command::new(crate::workspace::cargo());
    succeeded(cargo.current_dir(root).args(["build", "--release", "--bin", "gelato"]))?;
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
    Ok(target.join("release").join(format!("gelato{}", std::env::consts::EXE_SUFFIX)))
}

fn succeeded(command: &mut Command) -> Result<(), String> {
    let status = command.status().map_err(|e| format!("{command:?}: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("{command:?}: {status}")) }
}

/// The copy of the tree that images are made in.
struct Studio {
    root: PathBuf,
    gelato: PathBuf,
    place: PathBuf,
    /// The number of threads, which does not change the images.
    threads: String,
}

impl Studio {
    /// Copies `examples/` without its results.
    fn new(root: &Path, gelato: PathBuf) -> Result<Self, String> {
        let place = root.join("target").join("gallery");
        if place.exists() {
            std::fs::remove_dir_all(&place).map_err(|e| format!("{}: {e}", place.display()))?;
        }
        copy_folder(&root.join("examples"), &place.join("examples"))?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from).to_string();
        Ok(Self { root: root.to_owned(), gelato, place, threads })
    }

    /// Runs the commands of a recipe, except those that render frames of images.
    fn prepare(&self, recipe: &Recipe) -> Result<(), String> {
        std::fs::create_dir_all(self.place.join(&recipe.out)).map_err(|e| format!("{}: {e}", recipe.out))?;
        for (name, text) in &recipe.files {
            std::fs::write(self.place.join(name), text).map_err(|e| format!("{name}: {e}"))?;
        }
        for words in &recipe.commands {
            let frame = |scene: &str| match recipe.files.is_empty() {
                true => scene.to_owned(),
                false => format!("{}#{scene}", recipe.scene),
            };
            // The frames of images are rendered later. `iv` prints what pages show.
            if words[0] == "iv" {
                continue;
            }
            if let [tool, scene] = &words[..]
                && tool == "gelato"
                && IMAGES.iter().any(|p| p.frame == frame(scene))
            {
                continue;
            }
            let mut command = self.tool();
            match words[0].as_str() {
                "gelato" => command.args(["-threads", &self.threads]),
                other => command.args(["-as", other]),
            };
            succeeded(command.args(&words[1..]))?;
        }
        Ok(())
    }

    /// Renders an image into the tree. Returns what was written.
    fn make(&self, image: &Image) -> Result<String, String> {
        self.render(image, image.file, None)?;
        let mut bytes = 0;
        for file in image.files() {
            let (from, to) = (self.place.join(&file), self.root.join(&file));
            bytes += std::fs::copy(&from, &to).map_err(|e| format!("{} to {}: {e}", from.display(), file))?;
        }
        Ok(format!("{} KB", bytes / 1024))
    }

    /// Renders a part of an image and compares it with the stored one. Returns the difference.
    fn check(&self, image: &Image) -> Result<String, String> {
        let stored = compare::read(&self.root.join(&image.files()[0]))?;
        // Without the losses of JPEG.
        self.render(image, CHECKED, Some(stored.dimensions()))?;
        let mut told = Vec::new();
        for (file, got) in image.files().into_iter().zip(image.files_of(CHECKED)) {
            let stored = compare::read(&self.root.join(&file))?;
            let got = compare::read(&self.place.join(&got))?;
            told.push(compare::part(&stored, &got, image.corner, Tolerance::of(&file))?);
        }
        Ok(told.join(", "))
    }

    /// Renders the frame of an image to `file`, or the checked part of it when the size of the whole is given.
    fn render(&self, image: &Image, file: &str, part_of: Option<(u32, u32)>) -> Result<(), String> {
        let (settings, frame) = recipe::frame(&self.root, image, file)?;
        let write = |name: &str, text: &str| {
            std::fs::write(self.place.join(name), text).map_err(|e| format!("{name}: {e}"))
        };
        write("settings.pyg", &settings)?;
        write("frame.pyg", &frame)?;
        let folder = Path::new(file).parent().unwrap_or(Path::new(""));
        let folder = self.place.join(folder);
        std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let mut command = self.tool();
        if let Some(size) = part_of {
            command.arg("-crop").args(crop(size, image.corner)?);
        }
        command.args(["-threads", &self.threads]).args(image.options);
        succeeded(command.args(["settings.pyg", "frame.pyg"]))
    }

    fn tool(&self) -> Command {
        let mut command = Command::new(&self.gelato);
        command.current_dir(&self.place).env_remove("GELATOHOME");
        command
    }
}

/// Returns the arguments of `-crop` for a box of [`BOX`] pixels at a corner in an image of this size.
fn crop((width, height): (u32, u32), (x, y): (u32, u32)) -> Result<[String; 4], String> {
    if x + BOX > width || y + BOX > height {
        return Err(format!("the box at {x}, {y} is not inside of {width} x {height} pixels"));
    }
    let part = |pixels: u32, of: u32| (f64::from(pixels) / f64::from(of)).to_string();
    Ok([part(x, width), part(x + BOX, width), part(y, height), part(y + BOX, height)])
}

/// Copies a folder and the folders in it, without those named `out`.
fn copy_folder(from: &Path, to: &Path) -> Result<(), String> {
    let told = |path: &Path, e: std::io::Error| format!("{}: {e}", path.display());
    std::fs::create_dir_all(to).map_err(|e| told(to, e))?;
    for entry in std::fs::read_dir(from).map_err(|e| told(from, e))? {
        let entry = entry.map_err(|e| told(from, e))?;
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() {
            if name != "out" {
                copy_folder(&path, &to.join(name))?;
            }
        } else {
            std::fs::copy(&path, to.join(name)).map_err(|e| told(&path, e))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{IMAGES, crop, recipe};

    #[test]
    fn crops_are_fractions() {
        assert_eq!(crop((192, 384), (96, 96)).unwrap(), ["0.5", "1", "0.25", "0.5"]);
        assert!(crop((100, 100), (5, 0)).is_err());
    }

    /// Each image is stored, its recipe and frame can be read, and its changes apply.
    #[test]
    fn the_table_is_of_this_tree() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for image in IMAGES {
            for file in image.files() {
                assert!(root.join(&file).exists(), "{file} is not in the tree");
            }
            recipe::Recipe::read(root, image.recipe).unwrap();
            let (settings, frame) = recipe::frame(root, image, image.file).unwrap();
            assert!(settings.contains(image.file) && frame.contains("Render ()"), "{}", image.file);
            assert!(!frame.contains("Command ("), "{}", image.file);
        }
    }
}
