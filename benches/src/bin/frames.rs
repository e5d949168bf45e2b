//! Measures the wall clock time and the peak memory of whole frames.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_benches::{measure, release_tool, repository};
use std::fmt::Write;
use std::process::{Command, ExitCode};

/// A scene: the name of its file under `benches/frames`, the function that makes it here instead, and its description.
type Frame = (&'static str, Option<fn() -> String>, &'static str);

/// All scenes.
const FRAMES: [Frame; 8] = [
    ("pot.pyg", None, "32 patches, a floor, traced shadows"),
    ("displaced.pyg", None, "a displaced sphere that fills the frame"),
    ("many.pyg", Some(many), "8000 moving spheres"),
    ("layers.pyg", Some(layers), "100 opaque layers, each hiding those behind it"),
    ("haze.pyg", Some(haze), "1000 layers of 1 % opacity: 307 million fragments"),
    ("turning.pyg", None, "ground to the horizon, the camera turns by 30 degrees"),
    ("passing.pyg", None, "the same, the camera moves by 100 times its height"),
    ("fine.pyg", Some(fine), "a displaced square of 11 million micropolygons"),
];

fn main() -> ExitCode {
    granita_benches::exit("frames", run())
}

fn run() -> Result<(), String> {
    let gelato = release_tool("gelato")?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    for (file, made, _) in FRAMES {
        let source = repository().join("benches").join("frames").join(file);
        let to = place.path().join(file);
        match made {
            Some(made) => std::fs::write(to, made()).map_err(|e| e.to_string())?,
            None => {
                std::fs::copy(&source, to).map_err(|e| format!("{}: {e}", source.display()))?;
            }
        }
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    println!("{:<15} {:>8} {:>9} {:>9} {:>9}  about", "frame", "1 thread", "all", "speed-up", "peak MiB");
    for (file, _, about) in FRAMES {
        let cost = |threads: usize| {
            measure(2, || {
                let mut command = Command::new(&gelato);
                command.current_dir(place.path()).args(["-silent", "-threads", &threads.to_string(), file]);
                command
            })
        };
        let (one, all) = (cost(1)?, cost(cores)?);
        let peak = all.peak_bytes.map_or("?".to_owned(), |b| format!("{:.0}", b as f64 / (1 << 20) as f64));
        println!(
            "{file:<15} {:>7.2}s {:>8.2}s {:>8.2}x {peak:>9}  {about}",
            one.wall.as_secs_f64(),
            all.wall.as_secs_f64(),
            one.wall.as_secs_f64() / all.wall.as_secs_f64(),
        );
    }
    println!("({cores} cores)");
    Ok(())
}

/// The first lines of the scenes that are made here.
const HEAD: &str = "Attribute (\"int[2] resolution\", (640, 480))\nAttribute (\"int[2] spatialquality\", (4, 4))\n\
     Attribute (\"string projection\", \"perspective\")\nAttribute (\"float fov\", 40)\n";

/// The output, light and surface of the scenes that are made here. They follow the lines for the camera.
const WORLD: &str = "Output (\"out.tif\", \"tiff\", \"rgba\", \"camera\")\nWorld ()\n\
     Light (\"key\", \"distantlight\", \"point from\", (-1, 1, -1), \"point to\", (0, 0, 0))\n\
     Shader (\"surface\", \"plastic\")\n";

/// Returns a square of half side `s` at depth `z`.
fn square(s: f64, z: f64) -> String {
    format!(
        "Patch (\"linear\", 2, 2, \"vertex point P\", ({}, {}, {z}, {s}, {}, {z}, {}, {s}, {z}, {s}, {s}, {z}))\n",
        -s, -s, -s, -s
    )
}

/// Returns squares that fill the frame, one behind another, the last one first.
fn layers() -> String {
    let squares = (0..100).rev().map(|i| square(6.0, 5.0 + 0.02 * f64::from(i)));
    format!("{HEAD}{WORLD}{}Render ()\n", squares.collect::<String>())
}

/// Returns 1000 transparent squares that fill a frame of 160 x 120 pixels, the first one in front.
fn haze() -> String {
    let squares = (0..1000).map(|i| square(3.0 + 0.012 * f64::from(i), 5.0 + 0.02 * f64::from(i)));
    let world = WORLD.replace("plastic", "constant");
    format!(
        "{HEAD}Attribute (\"int[2] resolution\", (160, 120))\n{world}\
         Attribute (\"color opacity\", (0.01, 0.01, 0.01))\n{}Render ()\n",
        squares.collect::<String>()
    )
}

/// Returns a square that fills the frame, with 36 micropolygons per pixel.
fn fine() -> String {
    format!(
        "{HEAD}Attribute (\"string units:length\", \"cm\")\n{WORLD}Shader (\"displacement\", \"bumpy\")\n\
         Attribute (\"float displace:maxradius\", 0.2)\nAttribute (\"float shadingquality\", 6)\n{}Render ()\n",
        square(6.0, 5.0)
    )
}

/// Returns a cube of 20 x 20 x 20 small spheres that fall while the shutter is open.
fn many() -> String {
    let mut scene = format!(
        "{HEAD}Attribute (\"float[2] shutter\", (0, 1))\nTranslate (0, 0, 34)\nRotate (30, 1, 1, 0)\n{WORLD}"
    );
    for i in 0..8000 {
        let at = |n: i32| f64::from(n % 20) - 9.5;
        let (x, y, z) = (at(i), at(i / 20), at(i / 400));
        let _ = writeln!(
            scene,
            "PushTransform ()\nMotion (0, 1)\nTranslate ({x}, {y}, {z})\nTranslate ({x}, {}, {z})\n\
             Sphere (0.3, -0.3, 0.3, 360)\nPopTransform ()",
            y - 0.2
        );
    }
    scene.push_str("Render ()\n");
    scene
}
