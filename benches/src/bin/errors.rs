//! Measures how well a requested error is reached: twelve scenes at four requested errors, beside converged images.
//!
//! `cargo run --release -p granita-benches --bin errors
//! [-- --only WORD --converged SECONDS --limit SECONDS --gelato PROGRAM --resolution W,H --asked E,E
//! --denoise LIBRARY]`
//!
//! The converged image of a scene has a quarter of the dicing step, because an image with a requested error may have
//! half, and computes indirect light and occlusion at every point. It takes passes for `--converged` seconds (by
//! default 60), at least 4 passes, and its own error is subtracted. The error of an image is
//! the root of the mean of its squared differences from the converged image, over the mean of that image.
//!
//! `--threads N` is 2 by default. A row has the error and the time of the frame without passes, and for each requested
//! error the error that was reached and the time, which is at most `--limit`. `bias` is the error of the scene as it is
//! that remains with very many passes: what dicing and interpolated records add. In parentheses are the error that an
//! image says that it has, and the part of it that is bias. "below" stands where the noise of the converged image hides
//! an error.
//!
//! With `--denoise` and the library of Open Image Denoise, all images have a box filter of one pixel, and a row has the
//! frame without passes, the same with `-denoise`, the passes that have its time, and four passes with `-denoise`, with
//! the error that the image itself says.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a table for a terminal")]

use granita_benches::{Fur, release_tool, repository};
use granita_image::Limits;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// The requested errors in percent.
const ASKED: [f64; 4] = [8.0, 4.0, 2.0, 1.0];

/// The number of the quality of a scene: as it is, and as the converged image has it.
#[derive(Clone, Copy)]
struct Quality {
    shading: f32,
    maxerror: f32,
}

const ORDINARY: Quality = Quality { shading: 1.0, maxerror: 0.25 };
const CONVERGED: Quality = Quality { shading: 4.0, maxerror: 0.0 };

/// Makes the text of a scene.
type Make = fn(Quality) -> String;

/// The scenes by their names.
const SCENES: [(&str, Make); 12] = [
    ("box", cornell),
    ("room", room),
    ("rabbit", rabbit),
    ("still life", still_life),
    ("fur", fur),
    ("lens", lens),
    ("motion", motion),
    ("glossy", glossy),
    ("penumbra", penumbra),
    ("veils", veils),
    ("displaced", displaced),
    ("hair", hair),
];

/// The statements of all scenes. `before` precedes `World`.
fn scene(quality: Quality, before: &str, after: &str) -> String {
    format!(
        "Attribute (\"string path:input\", \"examples/indirect:examples/data:examples/first:&\")\n\
         Attribute (\"string path:texture\", \"examples/first/out:&\")\n\
         Attribute (\"string path:shader\", \"examples/first/out:&\")\n\
         Attribute (\"int[2] resolution\", (96, 72))\nAttribute (\"string projection\", \"perspective\")\n\
         Attribute (\"float shadingquality\", {})\n{before}\
         World ()\nAttribute (\"string geometryset\", \"+all\")\n{after}Render ()\n",
        quality.shading
    )
}

/// The parameters of indirect light.
fn bounce(quality: Quality, set: &str) -> String {
    format!(
        "Light (\"bounce\", \"indirectlight\", \"string indirectname\", \"{set}\", \"float maxerror\", {})\n",
        quality.maxerror
    )
}

/// The light of the panorama of the first example.
fn panorama(quality: Quality) -> String {
    format!(
        "Light (\"sky\", \"envlight\", \"string envname\", \"room.env\", \"string occlusionname\", \"all\", \
         \"float blur\", 0.5, \"float samples\", 64, \"float maxerror\", {})\n",
        quality.maxerror
    )
}

const SUN: &str = "Light (\"sun\", \"distantlight\", \"float intensity\", 1, \"point from\", (-1, 2, -1.5), \
                   \"point to\", (0, 0, 0), \"string shadowname\", \"all\")\n";
const AMBIENT: &str = "Light (\"fill\", \"ambientlight\", \"float intensity\", 0.1)\n";
const FLOOR: &str =
    "Patch (\"linear\", 2, 2, \"vertex point P\", (-8, -1, 12, 8, -1, 12, -8, -1, -2, 8, -1, -2))\n";

/// A sphere at a place.
fn sphere([x, y, z]: [f64; 3], radius: f64) -> String {
    format!(
        "PushTransform ()\nTranslate ({x:.3}, {y:.3}, {z:.3})\nSphere ({radius}, {}, {radius}, 360)\nPopTransform ()\n",
        -radius
    )
}

fn cornell(q: Quality) -> String {
    let lights = "Light (\"lamp\", \"pointlight\", \"float intensity\", 40000, \"float falloff\", 2, \
                  \"point from\", (278, 450, 279.5), \"string shadowname\", \"all\")\n";
    let before = "Attribute (\"float fov\", 39.3)\nScale (-1, 1, 1)\nTranslate (-278, -273, 800)\n";
    scene(q, before, &format!("{lights}{}Input (\"box.pyg\")\n", bounce(q, "all")))
}

fn room(q: Quality) -> String {
    let path = repository().join("benches/frames/room.pyg");
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let declared = "\"string indirectname\", \"room\"";
    format!("Attribute (\"float shadingquality\", {})\n", q.shading)
        + &text.replace(declared, &format!("{declared}, \"float maxerror\", {}", q.maxerror))
}

fn rabbit(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 30)\nTranslate (0, -4.5, 24)\nRotate (-10, 1, 0, 0)\n";
    let after = "Shader (\"surface\", \"matte\")\nAttribute (\"color C\", (0.8, 0.7, 0.6))\nInput (\"rabbit.pyg\")\n\
                 Patch (\"linear\", 2, 2, \"vertex point P\", (-40, 0, 40, 40, 0, 40, -40, 0, -20, 40, 0, -20))\n";
    scene(q, before, &(panorama(q) + after))
}

/// The world of the first example, in focus and at rest.
fn still_life(q: Quality) -> String {
    let before = "Attribute (\"string units:length\", \"mm\")\nAttribute (\"int ray:maxdepth\", 2)\n\
                  Attribute (\"float fov\", 23.5)\nTranslate (0, 0, 16)\nRotate (-9, 1, 0, 0)\n\
                  Translate (0, -1.75, 0)\n";
    let first = include_str!("../../../examples/first/first.pyg");
    let world = first.split_once("\nWorld ()\n").map_or("", |(_, world)| world);
    scene(q, before, &world.replace("\nRender ()\n", "\n"))
}

fn fur(q: Quality) -> String {
    of_fur(q, Fur { curves: 3000, moves: false, defocus: false, ..Fur::default() })
}

fn of_fur(q: Quality, fur: Fur) -> String {
    let text = fur.scene().replace("(640, 480)", "(96, 72)");
    let text = text.replace("Output (\"out.tif\", \"tiff\", \"rgba\", \"camera\")\n", "");
    format!("Attribute (\"float shadingquality\", {})\n{text}", q.shading)
}

fn lens(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 40)\nAttribute (\"float fstop\", 1.4)\nAttribute (\"float focallength\", 0.4)\n\
                  Attribute (\"float focaldistance\", 6)\n";
    let mut after = format!(
        "{SUN}{AMBIENT}Shader (\"surface\", \"plastic\", \"float roughness\", 0.03, \"float Ks\", 8)\n"
    );
    for k in 0..30 {
        let (i, j) = (f64::from(k % 5), f64::from(k / 5));
        let _ = writeln!(after, "Attribute (\"color C\", (0.{}, 0.3, 0.{}))", 2 + k % 7, 1 + k % 8);
        after += &sphere([i * 1.2 - 2.4, -0.6 + 0.2 * j, 3.0 + 1.8 * j], 0.4);
    }
    scene(q, before, &(after + FLOOR))
}

fn motion(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\nAttribute (\"float[2] shutter\", (0, 1))\n";
    let mut after = format!("{SUN}{AMBIENT}Shader (\"surface\", \"plastic\")\n");
    for k in 0..24 {
        let (x, y) = (f64::from(k % 6) - 2.5, f64::from(k / 6) * 0.8 - 0.8);
        let _ = writeln!(
            after,
            "Attribute (\"color C\", (0.8, 0.{}, 0.3))\nPushTransform ()\nMotion (0, 1)\n\
             Translate ({x}, {y}, 5)\nTranslate ({:.2}, {:.2}, 5)\nSphere (0.35, -0.35, 0.35, 360)\nPopTransform ()",
            1 + k % 8,
            x + 0.1 * f64::from(k % 9),
            y + 0.05 * f64::from(k % 5)
        );
    }
    scene(q, before, &(after + FLOOR))
}

fn glossy(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\nTranslate (0, 0.3, 0)\nRotate (-8, 1, 0, 0)\n";
    let mut after = format!("{SUN}{AMBIENT}Shader (\"surface\", \"plastic\")\n");
    for k in 0..5 {
        let _ = writeln!(after, "Attribute (\"color C\", (0.{}, 0.4, 0.{}))", 9 - k, 1 + k);
        after += &sphere([f64::from(k) * 1.3 - 2.6, -0.5, 6.0 + 0.5 * f64::from(k % 2)], 0.5);
    }
    after += "Attribute (\"color C\", (0.7, 0.7, 0.75))\n\
              Shader (\"surface\", \"shinymetal\", \"string envname\", \"all\", \"float samples\", 8, \"float blur\", 0.15)\n";
    scene(q, before, &(after + FLOOR))
}

fn penumbra(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\nTranslate (0, 0.3, 0)\nRotate (-12, 1, 0, 0)\n";
    let lamp = |set: &str, at: [f64; 3], half: f64| {
        let [x, y, z] = at;
        let (x0, x1, z0, z1) = (x - half, x + half, z - half, z + half);
        format!(
            "PushAttributes ()\nAttribute (\"string geometryset\", \"{set}\")\nShader (\"surface\", \"constant\")\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({x0}, {y}, {z0}, {x1}, {y}, {z0}, {x0}, {y}, {z1}, {x1}, {y}, {z1}))\n\
             PopAttributes ()\n"
        )
    };
    let light = |set: &str, intensity: f64| {
        format!(
            "Attribute (\"int light:nsamples\", 8)\n\
             Light (\"of {set}\", \"arealight\", \"string geometry\", \"{set}\", \"float twosided\", 1, \
             \"float intensity\", {intensity}, \"string shadowname\", \"all\")\n"
        )
    };
    let mut after = lamp("large", [-2.0, 3.0, 5.0], 1.0) + &lamp("small", [2.5, 3.0, 5.0], 0.1);
    after += &(light("large", 8.0) + &light("small", 6.0));
    after += "Shader (\"surface\", \"matte\")\n";
    for k in 0..4 {
        after += &sphere([f64::from(k) * 1.4 - 2.1, -0.4, 5.0 + 0.6 * f64::from(k % 2)], 0.6);
    }
    scene(q, before, &(after + FLOOR))
}

fn veils(q: Quality) -> String {
    let before = "Attribute (\"float fov\", 45)\n";
    let mut after = format!("{AMBIENT}{}Shader (\"surface\", \"matte\")\n", SUN.replace("all", ""));
    for k in 0..40 {
        let (turn, z) = (f64::from(k) * 2.4, 9.0 - 0.15 * f64::from(k));
        let (x, y) = (turn.cos() * 1.6, turn.sin() * 1.1);
        let _ = writeln!(
            after,
            "Attribute (\"color C\", (0.{}, 0.{}, 0.5))\nAttribute (\"color opacity\", (0.3, 0.3, 0.3))\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({:.3}, {:.3}, {z:.3}, {:.3}, {:.3}, {z:.3}, {:.3}, {:.3}, {z:.3}, {:.3}, {:.3}, {z:.3}))",
            1 + k % 9,
            9 - k % 9,
            x - 1.0,
            y - 0.7,
            x + 0.8,
            y - 0.9,
            x - 0.9,
            y + 0.8,
            x + 1.0,
            y + 0.6
        );
    }
    scene(q, before, &after)
}

fn displaced(q: Quality) -> String {
    let before =
        "Attribute (\"float fov\", 30)\nAttribute (\"string units:length\", \"cm\")\nTranslate (0, 0, 4)\n";
    let after = "Light (\"key\", \"distantlight\", \"float intensity\", 1, \"point from\", (-1, 1, -1), \"point to\", (0, 0, 0))\n\
                 Shader (\"surface\", \"plastic\")\nShader (\"displacement\", \"bumpy\")\n\
                 Attribute (\"float displace:maxradius\", 0.2)\nSphere (1, -1, 1, 360)\n";
    scene(q, before, after)
}

fn hair(q: Quality) -> String {
    let text = of_fur(q, Fur { curves: 3000, moves: false, defocus: false, ..Fur::default() });
    let key = text.find("Light (\"key\"").unwrap_or_default();
    let end = text.find("Shader (\"surface\"").unwrap_or(key);
    format!(
        "Attribute (\"string path:texture\", \"examples/first/out:&\")\n{}{}Attribute (\"string geometryset\", \"+all\")\n{}",
        &text[..key],
        panorama(q),
        &text[end..]
    )
}

struct Options {
    only: Option<String>,
    threads: String,
    converged: String,
    /// The program that renders; `None` for the one of this checkout.
    gelato: Option<PathBuf>,
    /// The width and the height.
    resolution: String,
    /// The library of Open Image Denoise; `None` to compare requested errors.
    denoise: Option<String>,
    /// The requested errors in percent.
    asked: Vec<f64>,
    /// The most seconds for a requested error.
    limit: Option<String>,
}

fn main() -> ExitCode {
    granita_benches::exit("errors", run())
}

/// Returns the numbers of a list such as "8,4,2,1".
fn numbers(list: &str) -> Result<Vec<f64>, String> {
    list.split(',').map(|word| word.trim().parse().map_err(|e| format!("{word}: {e}"))).collect()
}

fn options() -> Result<Options, String> {
    let mut words = std::env::args().skip(1);
    let mut options = Options {
        only: None,
        threads: "2".to_owned(),
        converged: "60".to_owned(),
        gelato: None,
        resolution: "96,72".to_owned(),
        denoise: None,
        asked: ASKED.to_vec(),
        limit: None,
    };
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("{word} needs a value"))?;
        match &*word {
            "--only" => options.only = Some(value),
            "--threads" => options.threads = value,
            "--converged" => options.converged = value,
            "--gelato" => options.gelato = Some(value.into()),
            "--resolution" => options.resolution = value,
            "--asked" => options.asked = numbers(&value)?,
            "--denoise" => options.denoise = Some(value),
            "--limit" => options.limit = Some(value),
            _ => return Err(format!("no option {word}")),
        }
    }
    Ok(options)
}

/// The head of the table of denoised images.
const DENOISED: &str = "| scene | without passes | denoised | passes in that time | 4 passes denoised | estimated | converged to |\n|---|---|---|---|---|---|---|";

/// An image, the seconds that it took, and the error that it says that it has, in percent.
struct Rendered {
    pixels: Vec<f32>,
    seconds: f64,
    says: Option<f64>,
    /// The part of it that is bias.
    says_bias: Option<f64>,
    /// The error that it says that it has where it was denoised.
    says_denoised: Option<f64>,
    /// The passes.
    passes: String,
}

/// Renders a scene with these options. `filter` holds the parameters of the pixel filter.
fn render(
    gelato: &Path,
    folder: &Path,
    (text, filter): (&str, &str),
    words: &[&str],
) -> Result<Rendered, String> {
    let (file, image) = (folder.join("scene.pyg"), folder.join("image.exr"));
    let output = format!("Output (\"{}\", \"exr\", \"rgb\", \"camera\"{filter})\nWorld ()", image.display());
    std::fs::write(&file, text.replacen("World ()", &output, 1)).map_err(|e| e.to_string())?;
    let begin = Instant::now();
    let output = Command::new(gelato)
        .current_dir(repository())
        .arg("-silent")
        .args(words)
        .arg(&file)
        .output()
        .map_err(|e| format!("{}: {e}", gelato.display()))?;
    let seconds = begin.elapsed().as_secs_f64();
    if !output.status.success() {
        return Err(format!("gelato: {}: {}", output.status, String::from_utf8_lossy(&output.stderr)));
    }
    let formats = granita_plugin::bundled_formats(Limits::default());
    let input = formats.open(&image).map_err(|e| e.to_string())?;
    let spec = input.spec(0, 0).ok_or("no image")?;
    let said = |name: &str| spec.string(&format!("granita/{name}")).map(str::to_owned);
    let percent = |name: &str| said(name).and_then(|text| Some(100.0 * text.parse::<f64>().ok()?));
    Ok(Rendered {
        pixels: input.read_level(0, 0).map_err(|e| e.to_string())?.to_floats(),
        seconds,
        says: percent("error"),
        says_bias: percent("bias"),
        says_denoised: percent("denoisederror"),
        passes: said("passes").unwrap_or_else(|| "1".to_owned()),
    })
}

/// Returns the error in percent of an image beside a converged one, whose own error in percent is `own`.
fn error(pixels: &[f32], converged: &[f32], own: f64) -> f64 {
    let n = converged.len().max(1) as f64;
    let mean = converged.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let square = pixels.iter().zip(converged).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / n;
    ((100.0 * square.sqrt() / mean).powi(2) - own * own).max(0.0).sqrt()
}

/// Prints a part of a line at once.
fn show(text: &str) -> Result<(), String> {
    print!("{text}");
    std::io::stdout().flush().map_err(|e| e.to_string())
}

fn run() -> Result<(), String> {
    let options = options()?;
    let gelato = options.gelato.clone().map_or_else(|| release_tool("gelato"), Ok)?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    // The maps and shaders of the first example.
    if !repository().join("examples/first/out/room.env").is_file() {
        let mut command = Command::new(&gelato);
        command.current_dir(repository()).args(["-silent", "examples/first/first.pyg"]);
        command.status().map_err(|e| e.to_string())?;
    }
    match options.denoise {
        Some(_) => println!("{DENOISED}"),
        None => {
            let asked: String =
                options.asked.iter().map(|asked| format!(" {asked} %: reached (says, bias) |")).collect();
            println!("| scene | without passes | converged to | bias |{asked}");
            println!("|---|---|---|---|{}", "---|".repeat(options.asked.len()));
        }
    }
    let filter = match options.denoise {
        Some(_) => ", \"string filter\", \"box\", \"float[2] filterwidth\", (1, 1)",
        None => "",
    };
    let is_chosen = |name: &str| options.only.as_ref().is_none_or(|only| name.contains(&**only));
    let (mut cells, mut reached, mut hidden) = (0, 0, 0);
    for (name, make) in SCENES.into_iter().filter(|(name, _)| is_chosen(name)) {
        let draw = |quality: Quality, words: &[&str]| {
            let resolution = format!("resolution={}", options.resolution);
            let words = [&["-threads", &options.threads, "-set", &resolution][..], words].concat();
            render(&gelato, place.path(), (&make(quality), filter), &words)
        };
        let mut converged = draw(CONVERGED, &["-seconds", &options.converged])?;
        if converged.passes.parse::<u32>().is_ok_and(|passes| passes < 4) {
            converged = draw(CONVERGED, &["-passes", "4"])?;
        }
        let own = converged.says.unwrap_or_default();
        let of = |image: &Rendered| error(&image.pixels, &converged.pixels, own);
        let plain = draw(ORDINARY, &[])?;
        // Cells are shown as they become known.
        show(&format!("| {name} | {:.2} s {:.2} % |", plain.seconds, of(&plain)))?;
        if let Some(library) = &options.denoise {
            let library = format!("render:denoiselibrary={library}"); // tidy: attribute: the word of a command line
            let clean = draw(ORDINARY, &["-denoise", "-set", &library])?;
            let passes = draw(ORDINARY, &["-seconds", &format!("{:.3}", clean.seconds)])?;
            show(&format!(" {:.2} s {:.2} % |", clean.seconds, of(&clean)))?;
            let four = draw(ORDINARY, &["-passes", "4", "-denoise", "-set", &library])?;
            show(&format!(" {:.2} s {:.2} % |", passes.seconds, of(&passes)))?;
            show(&format!(" {:.2} s {:.2} % |", four.seconds, of(&four)))?;
            println!(" {:.2} % | {own:.2} % |", four.says_denoised.unwrap_or_default());
            continue;
        }
        let many = draw(ORDINARY, &["-seconds", &options.converged])?;
        let noise = many.says.unwrap_or_default();
        let bias = (of(&many).powi(2) - noise * noise).max(0.0).sqrt();
        show(&format!(" {own:.2} % | {bias:.2} % |"))?;
        for asked in &options.asked {
            let asked_for = format!("{asked}%");
            let limit = options.limit.as_deref().map_or_else(Vec::new, |limit| vec!["-seconds", limit]);
            let image = draw(ORDINARY, &[&["-error", &asked_for][..], &limit].concat())?;
            let found = of(&image);
            // The noise of the converged image is known to about a half.
            let is_hidden = found < 0.5 * own;
            let (most, before) = if is_hidden { (own, " below") } else { (found, "") };
            cells += 1;
            reached += usize::from(most <= 1.2 * *asked);
            hidden += usize::from(is_hidden && most > 1.2 * *asked);
            let bias = image.says_bias.map_or_else(|| "not measured".to_owned(), |bias| format!("{bias:.2}"));
            let says = image.says.unwrap_or_default();
            show(&format!(
                "{before} {most:.2} ({says:.2}, {bias}) {:.2} s, {} passes |",
                image.seconds, image.passes
            ))?;
        }
        println!();
    }
    if options.denoise.is_none() {
        println!("\nat most 1.2 times the requested error: {reached} of {cells}; not known of {hidden}");
    }
    Ok(())
}
