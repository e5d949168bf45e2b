//! The files that the scenes read, each in two versions: shadow maps, textures and an environment map. They are made
//! once for all sequences.

use crate::player::render;
use crate::scenes;
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_texture::make::{MakeOptions, Mode, make};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Returns the path of a version of a file.
pub(crate) fn path(name: &str, version: usize) -> PathBuf {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER.get_or_init(made).path().join(format!("{version}-{name}"))
}

/// Puts a version of a file into a folder, as a new file. `number` is different for each file that the same name gets
/// there, and becomes a part of its time stamp.
pub(crate) fn place(name: &str, version: usize, folder: &Path, number: u64) {
    let (new, file) = (folder.join("new"), folder.join(name));
    std::fs::copy(path(name, version), &new).unwrap();
    let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_700_000_000 + 2 * number);
    std::fs::File::options().append(true).open(&new).unwrap().set_modified(time).unwrap();
    std::fs::rename(&new, &file).unwrap();
}

/// Makes all files.
fn made() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    for version in 0..2 {
        let v = version as f32;
        let name = |name: &str| format!("{version}-{name}");
        texture(place, &name("brick.tx"), Mode::Plain, |x, y| {
            let course = (y * 8.0).floor();
            let is_joint = (y * 8.0).fract() < 0.15 || (x * 4.0 + 0.5 * course).fract() < 0.08;
            if is_joint {
                [0.7, 0.7, 0.6 + 0.3 * v]
            } else {
                [0.5 + 0.3 * x, 0.2 + 0.4 * v, 0.1 + 0.02 * course]
            }
        });
        texture(place, &name("holes.tx"), Mode::Plain, |x, y| {
            let n = 5.0 + 2.0 * v;
            let (dx, dy) = ((x * n).fract() - 0.5, (y * n).fract() - 0.5);
            let open = ((dx * dx + dy * dy).sqrt() * 4.0 - 0.8).clamp(0.0, 1.0);
            [open, open, open * (1.0 - 0.3 * v)]
        });
        texture(place, &name("sky.env"), Mode::EnvLatLong, |x, y| {
            let sun = (1.0 - 30.0 * ((x - 0.3 - 0.2 * v).powi(2) + (y - 0.2).powi(2))).max(0.0);
            [0.3 + 4.0 * sun, 0.4 + 3.0 * sun, 0.9 - 0.6 * y + 2.0 * sun]
        });
        map(place, &name("key.sm"), 0, "z", [3.0, 5.0, -3.0], [-45.0, 49.7 + 3.0 * v]);
        map(place, &name("key.vz"), 2, "volz", [-3.0, 4.0, -2.0], [56.3, 48.0 + 4.0 * v]);
        let options = MakeOptions { mode: Mode::VolShad, ..MakeOptions::default() };
        converted(place, &name("key.vz"), &name("key.vsm"), &options);
    }
    folder
}

/// Makes a texture of 64 x 64 texels whose colours are those of `color` at positions of 0 to 1.
fn texture(folder: &Path, name: &str, mode: Mode, color: impl Fn(f32, f32) -> [f32; 3]) {
    const SIDE: u32 = 64;
    let at = |i: u32| (i as f32 + 0.5) / SIDE as f32;
    let texels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
    let values: Vec<f32> = texels.flat_map(|(x, y)| color(at(x), at(y))).collect();
    let source = format!("{name}.tif");
    let spec = ImageSpec::new(SIDE, SIDE, 3, PixelType::Float);
    let formats = granita_plugin::bundled_formats(Limits::default());
    let mut output = formats.create(&folder.join(&source), "tiff", &CreateOptions::new(&spec, 1)).unwrap();
    output.write_rows(&Pixels::Float(values)).unwrap();
    output.close().unwrap();
    converted(folder, &source, name, &MakeOptions { mode, tile_size: (16, 16), ..MakeOptions::default() });
}

fn converted(folder: &Path, from: &str, to: &str, options: &MakeOptions) {
    let formats = granita_plugin::bundled_formats(Limits::default());
    make(&[folder.join(from)], &folder.join(to), options, &formats, &|_, _| ()).unwrap();
}

/// Renders a map of the objects of a scene, as seen from a position with rotations around the y and the x axis.
fn map(folder: &Path, name: &str, scene: usize, data: &str, [x, y, z]: [f32; 3], [turn, tilt]: [f32; 2]) {
    let format = if data == "volz" { "tiff" } else { "shadow" };
    // The objects only cast shadows here, so their shaders need no files.
    let objects: String = scenes::scene(scene)
        .objects
        .lines()
        .filter(|line| !line.starts_with("Shader"))
        .map(|l| format!("{l}\n"))
        .collect();
    let text = format!(
        "Translate ({x}, {y}, {z})\nRotate ({turn}, 0, 1, 0)\nRotate ({tilt}, 1, 0, 0)\n\
         Camera (\"map\", \"string projection\", \"perspective\", \"float fov\", 60, \"int[2] resolution\", (128, 128))\n\
         Output (\"{}\", \"{format}\", \"{data}\", \"map\")\nWorld ()\nAttribute (\"string geometryset\", \"+map\")\n{objects}Render ()\n",
        folder.join(name).display()
    );
    render(&text);
}
