//! Measures how time and memory grow with a scene: with pixels, micropolygons, primitives, lights, textures and rays.
//!
//! `cargo run --release -p granita-benches --bin growth [-- --only WORD --threads N]`
//!
//! Each series renders a scene at several sizes in child processes. The cost of a unit is the time that a size takes
//! beyond the size before it, over the units that it has more. A cost that is at most 1.2 times the smallest cost of
//! the smaller sizes grows linearly.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_benches::{Cost, measure, release_tool};
use std::fmt::Write;
use std::path::Path;
use std::process::{Command, ExitCode};

/// What grows, with its sizes.
struct Series {
    name: &'static str,
    /// The unit of the sizes.
    unit: &'static str,
    sizes: &'static [u64],
    /// Writes the scene of a size, with the files that it needs. Returns the text.
    scene: fn(u64, &Place<'_>) -> Result<String, String>,
}

/// The folder of a series, and programs that make textures and shaders.
struct Place<'a> {
    folder: &'a Path,
    maketx: &'a Path,
    gslc: &'a Path,
}

impl Place<'_> {
    /// Runs a program in the folder.
    fn run(&self, program: &Path, words: &[&str]) -> Result<(), String> {
        let done = Command::new(program).current_dir(self.folder).args(words).output();
        let done = done.map_err(|e| format!("{}: {e}", program.display()))?;
        match done.status.success() {
            true => Ok(()),
            false => Err(String::from_utf8_lossy(&done.stderr).into_owned()),
        }
    }
}

const SERIES: [Series; 8] = [
    Series {
        name: "pixels",
        unit: "pixels",
        sizes: &[1 << 18, 1 << 20, 1 << 22, 1 << 24, 1 << 26],
        scene: pixels,
    },
    Series {
        name: "micropolygons",
        unit: "micropolygons",
        sizes: &[10_000, 100_000, 1_000_000, 10_000_000, 100_000_000],
        scene: micropolygons,
    },
    Series {
        name: "primitives",
        unit: "spheres",
        sizes: &[100, 1000, 10_000, 100_000, 1_000_000],
        scene: primitives,
    },
    Series {
        name: "hidden primitives",
        unit: "spheres",
        sizes: &[100, 1000, 10_000, 100_000, 1_000_000],
        scene: hidden,
    },
    Series { name: "lights", unit: "lights", sizes: &[1, 10, 100, 1000], scene: lights },
    Series {
        name: "texture files",
        unit: "files",
        sizes: &[1, 10, 100, 1000, 10_000],
        scene: |count, place| textures(count, 8, 4, "paintedplastic", place),
    },
    Series { name: "texels", unit: "MiB of tiles, limit 64 MiB", sizes: &[15, 60, 255, 1023], scene: texels },
    Series { name: "rays", unit: "samples per point", sizes: &[16, 64, 256, 1024, 4096], scene: rays },
];

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    granita_benches::exit("growth", run(&words))
}

fn run(words: &[String]) -> Result<(), String> {
    let (mut only, mut threads) = (String::new(), "1".to_owned());
    for pair in words.chunks(2) {
        match pair {
            [name, value] if name == "--only" => only.clone_from(value),
            [name, value] if name == "--threads" => threads.clone_from(value),
            _ => return Err(format!("{}: there are --only WORD and --threads N", pair[0])),
        }
    }
    let [gelato, maketx, gslc] = ["gelato", "maketx", "gslc"].map(release_tool);
    let (gelato, maketx, gslc) = (gelato?, maketx?, gslc?);
    for series in SERIES.iter().filter(|series| series.name.contains(&only)) {
        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
        let place = Place { folder: folder.path(), maketx: &maketx, gslc: &gslc };
        println!("{} ({}), {threads} thread(s)", series.name, series.unit);
        println!("  {:>12} {:>9} {:>10} {:>14} {:>7}", "size", "time", "peak MiB", "cost per unit", "growth");
        let mut before: Option<(u64, f64)> = None;
        let mut least = f64::INFINITY;
        for &size in series.sizes {
            let text = (series.scene)(size, &place)?;
            std::fs::write(folder.path().join("scene.pyg"), text).map_err(|e| e.to_string())?;
            let cost = render(&gelato, &threads, folder.path())?;
            let seconds = cost.wall.as_secs_f64();
            let peak = cost.peak_bytes.map_or(0.0, |bytes| bytes as f64 / f64::from(1 << 20));
            print!("  {size:>12} {seconds:>8.3}s {peak:>10.0}");
            if let Some((units, earlier)) = before {
                let unit = (seconds - earlier) / (size - units) as f64;
                let growth = if least.is_finite() { format!("{:>7.2}", unit / least) } else { String::new() };
                print!(" {:>11.3} us {growth}", unit * 1e6);
                // Differences below a hundredth of a second are noise.
                if seconds - earlier > 0.01 {
                    least = least.min(unit);
                }
            }
            println!();
            before = Some((size, seconds));
        }
    }
    Ok(())
}

/// Renders the scene of a folder. The fastest of several runs counts where they are short.
fn render(gelato: &Path, threads: &str, folder: &Path) -> Result<Cost, String> {
    let command = || {
        let mut command = Command::new(gelato);
        command.current_dir(folder).args(["-silent", "-threads", threads, "scene.pyg"]);
        command
    };
    let first = measure(1, command)?;
    if first.wall.as_secs_f64() > 5.0 {
        return Ok(first);
    }
    let more = measure(3, command)?;
    Ok(if more.wall < first.wall { more } else { first })
}

/// Returns the first lines of a scene of `width` x `height` pixels with `quality` x `quality` samples.
fn head(width: u64, height: u64, quality: u64) -> String {
    format!(
        "Attribute (\"int[2] resolution\", ({width}, {height}))\n\
         Attribute (\"int[2] spatialquality\", ({quality}, {quality}))\n\
         Attribute (\"string projection\", \"perspective\")\nAttribute (\"float fov\", 40)\n\
         Attribute (\"string units:length\", \"cm\")\n"
    )
}

/// The output, and a light.
const WORLD: &str = "Output (\"out.tif\", \"tiff\", \"rgb\", \"camera\")\nWorld ()\n\
     Light (\"key\", \"distantlight\", \"point from\", (-1, 1, -1), \"point to\", (0, 0, 0))\n";

/// Returns a square that fills the frame.
fn square() -> &'static str {
    "Patch (\"linear\", 2, 2, \"vertex point P\", (-6, -6, 5, 6, -6, 5, -6, 6, 5, 6, 6, 5))\n"
}

/// One displaced square over images of more pixels.
fn pixels(count: u64, _: &Place<'_>) -> Result<String, String> {
    let side = count.isqrt();
    Ok(format!(
        "{}{WORLD}Shader (\"surface\", \"plastic\")\nShader (\"displacement\", \"bumpy\")\n\
         Attribute (\"float displace:maxradius\", 0.2)\n{}Render ()\n",
        head(side, side, 1),
        square()
    ))
}

/// One displaced square with more micropolygons in an image of 640 x 480 pixels, which they cover 1.17 times: a square
/// of 12 units at a distance of 5 is 2.47 times as large as the image is wide.
fn micropolygons(count: u64, _: &Place<'_>) -> Result<String, String> {
    let quality = (count as f64 / (640.0 * 480.0)).sqrt();
    Ok(format!(
        "{}{WORLD}Shader (\"surface\", \"plastic\")\nShader (\"displacement\", \"bumpy\")\n\
         Attribute (\"float displace:maxradius\", 0.2)\nAttribute (\"float shadingquality\", {quality})\n{}Render ()\n",
        head(640, 480, 2),
        square()
    ))
}

/// Spheres side by side in an image of 640 x 480 pixels.
fn primitives(count: u64, _: &Place<'_>) -> Result<String, String> {
    let side = (count as f64).sqrt().ceil();
    let radius = 1.6 / side;
    let mut text = format!("{}{WORLD}Shader (\"surface\", \"plastic\")\n", head(640, 480, 2));
    for i in 0..count {
        let (x, y) = ((i as f64 % side).floor(), (i as f64 / side).floor());
        let at = |n: f64| (n + 0.5) / side * 3.2 - 1.6;
        let _ = writeln!(
            text,
            "PushTransform ()\nTranslate ({:.5}, {:.5}, 5)\nSphere ({radius}, -{radius}, {radius}, 360)\nPopTransform ()",
            at(x),
            at(y)
        );
    }
    Ok(text + "Render ()\n")
}

/// The same spheres behind a wall.
fn hidden(count: u64, place: &Place<'_>) -> Result<String, String> {
    let wall =
        "Patch (\"linear\", 2, 2, \"vertex point P\", (-6, -6, 2, 6, -6, 2, -6, 6, 2, 6, 6, 2))\nRender ()\n";
    Ok(primitives(count, place)?.replace("Render ()\n", wall))
}

/// Point lights above a square.
fn lights(count: u64, _: &Place<'_>) -> Result<String, String> {
    let mut text = head(320, 240, 2) + WORLD;
    for i in 0..count {
        let (x, y) = ((i as f64 * 0.618).fract() * 6.0 - 3.0, (i as f64 * 0.414).fract() * 6.0 - 3.0);
        let _ = writeln!(
            text,
            "Light (\"light-{i}\", \"pointlight\", \"float intensity\", {}, \"point from\", ({x:.3}, {y:.3}, 3))",
            1.0 / count as f64
        );
    }
    Ok(text + "Shader (\"surface\", \"matte\")\n" + square() + "Render ()\n")
}

/// Lookups of single texels, evenly over textures of 3 MiB each, in the order of buckets.
fn texels(mib: u64, place: &Place<'_>) -> Result<String, String> {
    let source =
        "surface texel (string texturename = \"\") { C = texture (texturename, u, v, \"width\", 0); }\n";
    std::fs::write(place.folder.join("texel.gsl"), source).map_err(|e| e.to_string())?;
    place.run(place.gslc, &["texel.gsl"])?;
    textures(mib / 3, 1024, 64, "texel", place)
}

/// Squares side by side, each with a texture of its own of `side` x `side` texels, and `lookups` pixels wide.
fn textures(count: u64, side: u64, lookups: u64, shader: &str, place: &Place<'_>) -> Result<String, String> {
    let made = place.folder.join("0.tx");
    if !made.exists() {
        noise(side, &place.folder.join("noise.ppm"))?;
        place.run(place.maketx, &["noise.ppm", "-o", "0.tx"])?;
    }
    let across = count.isqrt() + u64::from(count.isqrt().pow(2) < count);
    let mut text = format!(
        "Attribute (\"int[2] resolution\", ({0}, {0}))\nAttribute (\"int[2] spatialquality\", (1, 1))\n\
         Attribute (\"float[4] screen\", (0, {across}, 0, {across}))\n\
         Attribute (\"int limits:texturememory\", 65536)\n{WORLD}",
        across * lookups
    );
    for i in 0..count {
        let own = place.folder.join(format!("{i}.tx"));
        if !own.exists() {
            std::fs::hard_link(&made, &own).map_err(|e| format!("{}: {e}", own.display()))?;
        }
        let (x, y) = (i % across, i / across);
        let (x1, y1) = (x + 1, y + 1);
        let _ = writeln!(
            text,
            "Shader (\"surface\", \"{shader}\", \"string texturename\", \"{i}.tx\")\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({x}, {y}, 1, {x1}, {y}, 1, {x}, {y1}, 1, {x1}, {y1}, 1))"
        );
    }
    Ok(text + "Render ()\n")
}

/// Writes an image of random bytes.
fn noise(side: u64, file: &Path) -> Result<(), String> {
    let mut bytes = format!("P6\n{side} {side}\n255\n").into_bytes();
    let mut state = 1_u32;
    for _ in 0..side * side * 3 {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        bytes.push((state >> 24) as u8);
    }
    std::fs::write(file, bytes).map_err(|e| format!("{}: {e}", file.display()))
}

/// Balls on a floor with occlusion from more rays.
fn rays(samples: u64, _: &Place<'_>) -> Result<String, String> {
    let mut text = head(96, 72, 2)
        + WORLD
        + "Attribute (\"string geometryset\", \"+all\")\nAttribute (\"float occlusion:maxerror\", 0)\n";
    let _ = writeln!(
        text,
        "Shader (\"surface\", \"ambocclude\", \"string occlusionname\", \"all\", \"float samples\", {samples}, \"float adaptive\", 0)\n\
         Patch (\"linear\", 2, 2, \"vertex point P\", (-6, -1, 2, 6, -1, 2, -6, -1, 12, 6, -1, 12))"
    );
    for i in 0..25 {
        let _ = writeln!(
            text,
            "PushTransform ()\nTranslate ({}, -0.6, {})\nSphere (0.4, -0.4, 0.4, 360)\nPopTransform ()",
            f64::from(i % 5) - 2.0,
            f64::from(i / 5) + 4.0
        );
    }
    Ok(text + "Render ()\n")
}
