//! Compares our tools with the public ones of the field in one run, as ratios.
//!
//! `cargo run --release -p granita-benches --bin peers [-- --maketx PROGRAM] [--large]`
//!
//! `cargo run --release -p granita-benches --bin peers -- --lookups [IMAGE ...]`
//!
//! `maketx` is compared with OpenImageIO's. That one is found by the variable `OIIO_MAKETX`, by the option, or on the
//! search path. Both get the same image, tile size (64), compression (zip) and type of texels, with one thread and with
//! two. The programs alternate, and the fastest of four runs counts. The last column is the size of our file over
//! theirs. The images are enlarged from those in `examples/first`. `--large` adds an image of 16384 x 16384 pixels for
//! our program only, to measure its memory.
//!
//! `--lookups` measures filtered lookups instead, see `lookups.rs`. `benches/peers/speed.py` compares `imgtool`, and
//! single options of `maketx`.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

mod lookups;

use granita_base::hash;
use granita_benches::{Cost, find_program, measure, release_tool, repository};
use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    granita_benches::exit("peers", run())
}

/// A comparison: its description, the input, and further arguments of both programs.
struct Case {
    about: &'static str,
    input: PathBuf,
    ours: &'static [&'static str],
    theirs: &'static [&'static str],
}

fn run() -> Result<(), String> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let Some(at) = words.iter().position(|w| w == "--lookups") {
        let place = tempfile::tempdir().map_err(|e| e.to_string())?;
        let images: Vec<PathBuf> = words[at + 1..].iter().map(PathBuf::from).collect();
        return lookups::run(&granita_plugin::bundled_formats(Limits::default()), &images, place.path());
    }
    let named = words.iter().position(|w| w == "--maketx").and_then(|i| words.get(i + 1)).map(PathBuf::from);
    let theirs = named
        .or_else(|| std::env::var_os("OIIO_MAKETX").map(PathBuf::from))
        .or_else(|| find_program("maketx"));
    let ours = release_tool("maketx")?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let (photo, hdri, large) =
        (place.path().join("photo.png"), place.path().join("hdri.exr"), place.path().join("large.tif"));
    let formats = granita_plugin::bundled_formats(Limits::default());
    let brick = Tile::read(&formats, "brick.png", PixelType::U8)?;
    brick.enlarge(&formats, &photo, "png", 4096, 4096)?;
    brick.enlarge(&formats, &large, "tiff", 8192, 8192)?;
    Tile::read(&formats, "studio.exr", PixelType::Half)?.enlarge(&formats, &hdri, "exr", 4096, 2048)?;
    let cases = [
        Case { about: "4096 x 4096 bytes, PNG", input: photo, ours: &[], theirs: &[] },
        Case {
            about: "4096 x 2048 halves, -envlatl, OpenEXR",
            input: hdri,
            ours: &["-envlatl", "-format", "OpenEXR"],
            theirs: &["--envlatl", "--format", "openexr"],
        },
        Case { about: "8192 x 8192 bytes, TIFF", input: large, ours: &[], theirs: &[] },
    ];
    if theirs.is_none() {
        println!("OpenImageIO's maketx is not here (OIIO_MAKETX, --maketx or the search path): ours alone");
    }
    println!(
        "{:<38} {:>7} {:>8} {:>8} {:>6} {:>9} {:>9} {:>6} {:>9}",
        "maketx", "threads", "ours", "theirs", "ratio", "our MiB", "their MiB", "ratio", "file size"
    );
    for case in &cases {
        for threads in ["1", "2"] {
            let output = place.path().join("out.tx");
            let common = ["--threads", threads, "--compression", "zip"];
            // The programs alternate, so that other work on the machine affects both.
            let (mut mine, mut other) = (None, None);
            for _ in 0..RUNS {
                quicker(&mut mine, texture(&ours, case, case.ours, &common, &output)?);
                if let Some(program) = &theirs {
                    quicker(&mut other, texture(program, case, case.theirs, &common, &output)?);
                }
            }
            let Some(mine) = mine else { continue };
            print_row(case.about, threads, &mine, other.as_ref());
        }
    }
    if words.iter().any(|w| w == "--large") {
        let input = place.path().join("huge.tif");
        brick.enlarge(&formats, &input, "tiff", 16384, 16384)?;
        let case = Case { about: "16384 x 16384 bytes, TIFF", input, ours: &[], theirs: &[] };
        let mine = texture(&ours, &case, &[], &["--threads", "2"], &place.path().join("out.tx"))?;
        print_row(case.about, "2", &mine, None);
    }
    Ok(())
}

fn print_row(about: &str, threads: &str, mine: &Made, other: Option<&Made>) {
    let seconds = |m: &Made| m.cost.wall.as_secs_f64();
    let mib = |m: &Made| m.cost.peak_bytes.map(|b| b as f64 / f64::from(1 << 20));
    let text = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    let memory = other.and_then(mib).zip(mib(mine));
    println!(
        "{about:<38} {threads:>7} {:>8} {:>8} {:>6} {:>9} {:>9} {:>6} {:>9}",
        text(Some(seconds(mine)), 2),
        text(other.map(seconds), 2),
        text(other.map(|o| seconds(mine) / seconds(o)), 2),
        text(mib(mine), 0),
        text(other.and_then(mib), 0),
        text(memory.map(|(theirs, ours)| ours / theirs), 2),
        text(other.map(|o| mine.size as f64 / o.size as f64), 3),
    );
}

/// The number of runs of each program for each texture. The fastest run counts.
const RUNS: usize = 4;

/// The cost of a texture.
#[derive(Clone, Copy)]
struct Made {
    cost: Cost,
    /// The bytes of the file.
    size: u64,
}

/// Keeps the faster run.
fn quicker(best: &mut Option<Made>, made: Made) {
    if best.is_none_or(|b| made.cost.wall < b.cost.wall) {
        *best = Some(made);
    }
}

/// Makes one texture.
fn texture(
    program: &Path,
    case: &Case,
    own: &[&str],
    common: &[&str],
    output: &Path,
) -> Result<Made, String> {
    let cost = measure(1, || {
        let mut command = Command::new(program);
        command.args(common).args(own).arg(&case.input).arg("-o").arg(output);
        command
    })?;
    let size = std::fs::metadata(output).map_err(|e| format!("{}: {e}", output.display()))?.len();
    Ok(Made { cost, size })
}

/// An image that larger ones are made of.
struct Tile {
    width: usize,
    height: usize,
    values: Vec<f32>,
    pixel_type: PixelType,
}

impl Tile {
    /// Reads one of the images of the first example, with three channels.
    fn read(formats: &FormatRegistry, name: &str, pixel_type: PixelType) -> Result<Self, String> {
        let path = repository().join("examples").join("first").join(name);
        let file = formats.open(&path).map_err(|e| e.to_string())?;
        let spec = file.spec(0, 0).ok_or("no image")?;
        let n = spec.nchannels();
        let all = file.read_level(0, 0).map_err(|e| e.to_string())?.to_floats();
        let values = all.chunks_exact(n).flat_map(|p| [0, 1, 2].map(|c| p[c.min(n - 1)])).collect();
        Ok(Self { width: spec.width as usize, height: spec.height as usize, values, pixel_type })
    }

    /// Writes an enlarged image. It is interpolated bilinearly, with noise of about two levels of a byte, like that of
    /// sensors and film.
    fn enlarge(
        &self,
        formats: &FormatRegistry,
        path: &Path,
        format: &str,
        width: u32,
        height: u32,
    ) -> Result<(), String> {
        let told = |e: granita_image::ImageError| e.to_string();
        let spec = ImageSpec::new(width, height, 3, self.pixel_type);
        let mut out = formats.create(path, format, &CreateOptions::new(&spec, 1)).map_err(told)?;
        let place = |i: u32, n: u32, own: usize| {
            let v = (f64::from(i) + 0.5) / f64::from(n) * own as f64 - 0.5;
            let low = v.floor();
            let index = |i: f64| (i as i64).rem_euclid(own as i64) as usize;
            (index(low), index(low + 1.0), (v - low) as f32)
        };
        let columns: Vec<_> = (0..width).map(|x| place(x, width, self.width)).collect();
        for y in 0..height {
            let (y0, y1, fy) = place(y, height, self.height);
            let mut row = Vec::with_capacity(3 * width as usize);
            for (x, (x0, x1, fx)) in columns.iter().enumerate() {
                for c in 0..3 {
                    let at = |x: usize, y: usize| self.values[(y * self.width + x) * 3 + c];
                    let top = at(*x0, y0) + (at(*x1, y0) - at(*x0, y0)) * fx;
                    let bottom = at(*x0, y1) + (at(*x1, y1) - at(*x0, y1)) * fx;
                    let noise = hash::unit(hash::words(&[x as u32, y, c as u32])) - 0.5;
                    row.push((top + (bottom - top) * fy) * (1.0 + 0.02 * noise) + 0.008 * noise.max(0.0));
                }
            }
            out.write_rows(&Pixels::from_floats(self.pixel_type, &row)).map_err(told)?;
        }
        out.close().map_err(told)
    }
}
