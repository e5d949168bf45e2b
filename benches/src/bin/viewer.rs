//! Measures the viewer: the time until the first image, the frame rate while panning a large texture, and the memory
//! for tiles.
//!
//! It runs `iv` under Xvfb, so that the window is drawn by whatever driver there is, in software on machines without a
//! screen.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_base::hash;
use granita_benches::{Cost, Screen, find_program, measure_into, release_tool};
use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    granita_benches::exit("viewer", run())
}

/// The number of texels of each side of the texture.
const SIDE: u32 = 16384;

fn run() -> Result<(), String> {
    // `viewer PATH` measures another build of the tool.
    let iv = match std::env::args_os().nth(1) {
        Some(path) => PathBuf::from(path),
        None => release_tool("iv")?,
    };
    if find_program("Xvfb").is_none() {
        return Err("Xvfb is not installed: nothing is measured".to_owned());
    }
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let formats = granita_plugin::bundled_formats(Limits::default());
    let (photo, texture) = (place.path().join("photo.exr"), place.path().join("texture.tif"));
    write_photo(&photo, &formats).map_err(|e| e.to_string())?;
    write_texture(&texture, &formats).map_err(|e| e.to_string())?;
    let screen = Screen::start([1280, 800])?;
    let small = small_files(place.path(), &formats).map_err(|e| e.to_string())?;
    let small: Vec<&str> = small.iter().map(|name| &**name).collect();
    // The smallest image shows the cost of the window and the driver alone.
    for (what, files) in [
        ("nothing but the window (16 x 16 pixels)", &small[..1]),
        ("4096 x 2160 OpenEXR (half, RGBA, zip)", &["photo.exr"][..]),
        ("the first of 5000 PNG files", &small),
    ] {
        // The first run, which is not counted, brings the files into memory.
        for i in 0..4 {
            let run = first_image(&iv, &screen, place.path(), files)?;
            if i > 0 {
                println!("{what}: {run}");
            }
        }
    }
    std::fs::copy(&photo, place.path().join("next.exr")).map_err(|e| e.to_string())?;
    let script = "wait\nkey PageDown\nwait\nprint\nquit\n";
    for _ in 0..3 {
        let (text, _) = script_run(&iv, &screen, place.path(), script, &["photo.exr", "next.exr"])?;
        println!("the next one of that size, read ahead: {}", shown(&text)?);
    }
    many_files(&iv, &screen, place.path(), &small)?;
    for (name, script) in [
        ("one pixel for one", "wait\nkey 1\nwait\nbench 400\nquit\n"),
        ("half size, by levels of the file", "wait\nkey 1\nkey Minus\nkey Minus\nwait\nbench 400\nquit\n"),
    ] {
        let (text, _) = script_run(&iv, &screen, place.path(), script, &["texture.tif"])?;
        let line = text.lines().find(|l| l.starts_with("bench: ")).ok_or("no numbers came")?;
        println!("{SIDE} x {SIDE} texture, {name}: {}", line.trim_start_matches("bench: "));
    }
    Ok(())
}

/// Returns a ramp with noise, like the pixels of a camera.
fn value(x: u32, y: u32, c: u32) -> f32 {
    let noise = hash::unit(hash::words(&[x, y, c]));
    ((x / 7 + y / 5) % 256) as f32 / 300.0 + 0.04 * noise
}

fn write_photo(path: &Path, formats: &FormatRegistry) -> granita_image::Result<()> {
    let spec = ImageSpec::new(4096, 2160, 4, PixelType::Half);
    let mut file = formats.create(path, "exr", &CreateOptions::new(&spec, 1))?;
    for y0 in (0..spec.height).step_by(16) {
        let values: Vec<f32> = (y0..y0 + 16)
            .flat_map(|y| {
                (0..spec.width)
                    .flat_map(move |x| [0, 1, 2, 3].map(|c| if c == 3 { 1.0 } else { value(x, y, c) }))
            })
            .collect();
        file.write_rows(&Pixels::from_floats(PixelType::Half, &values))?;
    }
    file.close()
}

/// Writes tiles of 64 x 64 texels in all levels, like `maketx`.
fn write_texture(path: &Path, formats: &FormatRegistry) -> granita_image::Result<()> {
    let level = |l: u32| ImageSpec::new(SIDE >> l, SIDE >> l, 3, PixelType::U8).tiled(64, 64);
    let levels = SIDE.ilog2() + 1;
    let mut file = formats.create(path, "tiff", &CreateOptions::new(&level(0), levels as usize))?;
    for l in 0..levels {
        let spec = level(l);
        if l > 0 {
            file.next_level(&spec)?;
        }
        let (across, down) = spec.tiles();
        for ty in 0..down {
            let row: Vec<(u32, u32, Pixels)> = (0..across)
                .map(|tx| {
                    let pixels = (0..64 * 64).flat_map(|i| {
                        let (x, y) = (tx * 64 + i % 64, ty * 64 + i / 64);
                        [0, 1, 2].map(|c| (value(x << l, y << l, c) * 255.0) as u8)
                    });
                    (tx, ty, Pixels::U8(pixels.collect()))
                })
                .collect();
            file.write_tiles(&row)?;
        }
    }
    file.close()
}

/// Runs a script. Returns its output and its cost.
fn script_run(
    iv: &Path,
    screen: &Screen,
    folder: &Path,
    script: &str,
    files: &[&str],
) -> Result<(String, Cost), String> {
    std::fs::write(folder.join("script.txt"), script).map_err(|e| e.to_string())?;
    let printed = folder.join("printed.txt");
    let mut command = Command::new(iv);
    command.current_dir(folder).env("DISPLAY", &screen.name).env_remove("WAYLAND_DISPLAY");
    command.args(["-window", "1280", "800", "-script", "script.txt"]).args(files);
    let cost = measure_into(&printed, command)?;
    Ok((std::fs::read_to_string(&printed).map_err(|e| e.to_string())?, cost))
}

/// Writes 5000 images of 16 x 16 pixels, and returns their names.
fn small_files(folder: &Path, formats: &FormatRegistry) -> granita_image::Result<Vec<String>> {
    let spec = ImageSpec::new(16, 16, 3, PixelType::U8);
    (0..5000_u32)
        .map(|i| {
            let name = format!("small{i:04}.png");
            let options = CreateOptions::new(&spec, 1);
            let mut file = formats.create(&folder.join(&name), "png", &options)?;
            let bytes = (0..16 * 16 * 3).map(|k| hash::words(&[i, k]) as u8);
            file.write_rows(&Pixels::U8(bytes.collect()))?;
            file.close()?;
            Ok(name)
        })
        .collect()
}

/// Steps through some of many files, with the list of all of them beside the image.
fn many_files(iv: &Path, screen: &Screen, folder: &Path, files: &[&str]) -> Result<(), String> {
    let steps = 200;
    let run = |steps: usize| {
        let script = format!("key Tab\nwait\n{}quit\n", "key PageDown\nwait\n".repeat(steps));
        script_run(iv, screen, folder, &script, files).map(|(_, cost)| cost)
    };
    let (without, with) = (run(0)?, run(steps)?);
    let each = 1e3 * (with.wall.as_secs_f64() - without.wall.as_secs_f64()) / steps as f64;
    let memory = with.peak_bytes.map_or("?".to_owned(), |b| (b >> 20).to_string());
    let count = files.len();
    println!(
        "{count} files, the list open: {each:.1} ms to the next one (six frames), {memory} MiB of memory"
    );
    Ok(())
}

/// Returns the line in which the window reports the time of the first image.
fn shown(text: &str) -> Result<&str, String> {
    let line = text.lines().find(|l| l.starts_with("first image after "));
    line.ok_or_else(|| format!("no number came: {text}"))
}

/// Returns a text with three times in seconds: those until the first and the complete image are sent to the screen,
/// including the creation of the window, the wall clock time of the whole process, and its processor time.
fn first_image(iv: &Path, screen: &Screen, folder: &Path, files: &[&str]) -> Result<String, String> {
    let (text, cost) = script_run(iv, screen, folder, "wait\nprint\nquit\n", files)?;
    let first = shown(&text)?;
    let processor = cost.processor.map_or("?".to_owned(), |time| format!("{:.3}", time.as_secs_f64()));
    Ok(format!("{first}; {:.3} s of process, {processor} s of processor", cost.wall.as_secs_f64()))
}
