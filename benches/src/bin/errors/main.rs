//! Measures how well a requested error is reached: twelve scenes at four requested errors, beside converged images.
//!
//! `cargo run --release -p granita-benches --bin errors
//! [-- --only WORD --converged SECONDS --limit SECONDS --gelato PROGRAM --resolution W,H --asked E,E
//! --denoise LIBRARY --fixed SECONDS]`
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
//!
//! With `--fixed`, requested errors are compared with the best of many fixed settings of frames without passes
//! (samples of a pixel, samples of lights and rays, `shadingquality`, `maxerror`) that take up to that many seconds:
//! the time for the error that was reached, and the error of `-seconds` in the same time. The error of the frame
//! without passes is requested as well.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a table for a terminal")]

mod fixed;
mod scenes;

use crate::fixed::Frames;
use crate::scenes::{CONVERGED, ORDINARY, Quality, SCENES};
use granita_benches::{release_tool, repository};
use granita_image::Limits;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// The requested errors in percent.
const ASKED: [f64; 4] = [8.0, 4.0, 2.0, 1.0];

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
    /// The most seconds of a fixed setting; `None` where there is no comparison with these.
    fixed: Option<f64>,
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
        fixed: None,
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
            "--fixed" => options.fixed = Some(value.parse().map_err(|e| format!("{value}: {e}"))?),
            _ => return Err(format!("no option {word}")),
        }
    }
    Ok(options)
}

/// The head of the table of denoised images.
const DENOISED: &str = "| scene | without passes | denoised | passes in that time | 4 passes denoised | estimated | converged to |\n|---|---|---|---|---|---|---|";

/// The head of the table beside fixed settings.
const FIXED: &str = "| scene | requested | reached | time | best fixed setting | ratio of times | `-seconds`, error | best fixed error | ratio of errors | setting |\n|---|---|---|---|---|---|---|---|---|---|";

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
        None if options.fixed.is_some() => println!("{FIXED}"),
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
        // With a number of passes, time makes no surfaces finer.
        let as_it_is = ["-seconds", &options.converged, "-passes", "1000000"];
        let mut converged = draw(CONVERGED, &as_it_is)?;
        if converged.passes.parse::<u32>().is_ok_and(|passes| passes < 4) {
            converged = draw(CONVERGED, &["-passes", "4"])?;
        }
        let own = converged.says.unwrap_or_default();
        let of = |image: &Rendered| error(&image.pixels, &converged.pixels, own);
        let plain = draw(ORDINARY, &[])?;
        if let Some(most) = options.fixed {
            let frames = Frames::new(make, most, |quality, words| {
                let image = draw(quality, words)?;
                Ok((image.seconds, of(&image)))
            })?;
            let own = format!("{:.3}", of(&plain));
            println!("| {name} | without passes | {own} % | {:.2} s | | | | | | |", plain.seconds);
            let asked = options.asked.iter().map(f64::to_string).chain([own]);
            for asked in asked {
                let image = draw(ORDINARY, &["-error", &format!("{asked}%")])?;
                let timed = draw(ORDINARY, &["-seconds", &format!("{:.3}", image.seconds)])?;
                println!("{}", frames.row(name, &asked, [&image, &timed].map(|i| (i.seconds, of(i)))));
            }
            continue;
        }
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
        let many = draw(ORDINARY, &as_it_is)?;
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
            let said =
                |percent: Option<f64>| percent.map_or("not measured".to_owned(), |p| format!("{p:.2}"));
            let (says, bias) = (said(image.says), said(image.says_bias));
            show(&format!(
                "{before} {most:.2} ({says}, {bias}) {:.2} s, {} passes |",
                image.seconds, image.passes
            ))?;
        }
        println!();
    }
    if options.denoise.is_none() && options.fixed.is_none() {
        println!("\nat most 1.2 times the requested error: {reached} of {cells}; not known of {hidden}");
    }
    Ok(())
}
