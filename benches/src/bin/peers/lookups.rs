//! Compares filtered texture lookups with those of OpenImageIO's `TextureSystem`. Both use one file and one list of
//! positions and derivatives. The results are lookups per second with one thread and with two, and the error against
//! brute force.
//!
//! Rates are computed from processor time, with two threads from that of the slower one, so that other work on the
//! machine matters less. The speedup with two threads is also printed by the wall clock. That value is meaningful only
//! on a quiet machine.
//!
//! The other side is a C++ program (`benches/peers/oiio_texture.cpp`). It is compiled when the bench runs, with the
//! compiler arguments in the variable `OIIO_BUILD`, or else with those of a system package. Where that fails, only our
//! lookups are measured.

#[path = "../../../../libs/texture/tests/brute/mod.rs"]
mod brute;

use brute::{Brute, footprint};
use cpu_time::ThreadTime;
use granita_base::{Environment, Reporter, SearchPath, hash};
use granita_benches::repository;
use granita_image::FormatRegistry;
use granita_texture::make::{MakeOptions, make};
use granita_texture::{CacheOptions, Lookup, TextureCache, TextureId, Wrap};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// The arguments of the C++ compiler when `OIIO_BUILD` is not set.
const BUILD: &str = "-I/usr/include/Imath -lOpenImageIO -lOpenImageIO_Util -lpthread";

/// The number of runs, of which the fastest counts. The other program uses the same number.
const RUNS: usize = 10;

/// Prints the tables of these images, by default of the photograph of the first example.
pub(crate) fn run(formats: &FormatRegistry, images: &[PathBuf], place: &Path) -> Result<(), String> {
    let program = place.join("oiio_texture");
    let words = std::env::var("OIIO_BUILD").unwrap_or_else(|_| BUILD.to_owned());
    let built = Command::new("c++")
        .args(["-O2", "-std=c++17"])
        .arg(repository().join("benches").join("peers").join("oiio_texture.cpp"))
        .arg("-o")
        .arg(&program)
        .args(words.split_whitespace())
        .output()
        .is_ok_and(|o| o.status.success());
    if !built {
        println!("no program against OpenImageIO could be built (c++, OIIO_BUILD): our lookups alone");
    }
    let brick = [repository().join("examples").join("first").join("brick.png")];
    for image in if images.is_empty() { &brick } else { images } {
        one(formats, image, place, built.then_some(&program))?;
    }
    Ok(())
}

/// Prints the tables of one image.
fn one(
    formats: &FormatRegistry,
    image: &Path,
    place: &Path,
    program: Option<&PathBuf>,
) -> Result<(), String> {
    let texture = place.join("lookups.tx");
    let options = MakeOptions { swrap: Wrap::Periodic, twrap: Wrap::Periodic, ..MakeOptions::default() };
    make(&[image.to_path_buf()], &texture, &options, formats, &|_, _| ()).map_err(|e| e.to_string())?;
    let path = SearchPath::parse("/", &SearchPath::default(), &Environment::empty());
    let options = CacheOptions { memory_bytes: 1 << 30, ..CacheOptions::default() };
    let cache = TextureCache::new(formats.clone(), path, options, Reporter::silent());
    let name = texture.to_string_lossy();
    let id = cache.find(&name).ok_or("the texture cannot be read")?;
    let brute = Brute::read(&cache, &name);
    let size = brute.size();
    let about = image.file_name().unwrap_or_default().to_string_lossy();
    let random: Vec<Lookup> = (0..10_000).map(|i| footprint(i, size).1).collect();
    let sets = [
        (format!("{about}: random, 1 to 64 : 1"), random),
        (format!("{about}: grids, 2 texels"), grids(size, 2.0, 1.0)),
        (format!("{about}: grids, 2 x 16 texels"), grids(size, 2.0, 8.0)),
    ];
    for (about, lookups) in &sets {
        table(about, lookups, (&cache, id), &brute, place, program)?;
    }
    Ok(())
}

/// Returns grids of 16 x 16 neighbouring points all over the image, each with its own rotation. The footprint of a
/// point is `width` texels wide in one direction and `ratio` times that in the other.
fn grids((w, h): (u32, u32), width: f32, ratio: f32) -> Vec<Lookup> {
    (0..64 * 256_u32)
        .map(|i| {
            let (grid, x, y) = (i / 256, (i % 16) as f32, (i / 16 % 16) as f32);
            let r = |k| hash::unit(hash::words(&[grid, k]));
            let angle = r(0) * std::f32::consts::TAU;
            let (sin, cos) = angle.sin_cos();
            let (dx, dy) = ([width * cos, width * sin], [-width * ratio * sin, width * ratio * cos]);
            let (w, h) = (w as f32, h as f32);
            Lookup {
                s: r(1) + (x * dx[0] + y * dy[0]) / w,
                t: r(2) + (x * dx[1] + y * dy[1]) / h,
                dsdx: dx[0] / w,
                dtdx: dx[1] / h,
                dsdy: dy[0] / w,
                dtdy: dy[1] / h,
                ..Lookup::default()
            }
        })
        .collect()
}

/// The result of one way of filtering: its name, millions of lookups per second with one thread and with two, and its
/// error.
struct Row {
    name: String,
    rates: [f64; 2],
    /// The rates by the wall clock.
    clock: [f64; 2],
    rms: f64,
}

fn table(
    about: &str,
    lookups: &[Lookup],
    cache: (&TextureCache, TextureId),
    brute: &Brute,
    place: &Path,
    program: Option<&PathBuf>,
) -> Result<(), String> {
    let channels = brute.channels();
    let reference: Vec<[f32; 3]> = lookups.iter().map(|q| brute.mean(q)).collect();
    let mut values = vec![[0.0_f32; 3]; lookups.len()];
    let error = |value: &dyn Fn(usize, usize) -> f32| {
        let squares = (0..lookups.len()).flat_map(|i| (0..channels).map(move |c| (i, c)));
        let sum: f64 = squares.map(|(i, c)| f64::from(value(i, c) - reference[i][c]).powi(2)).sum();
        255.0 * (sum / (lookups.len() * channels) as f64).sqrt()
    };
    // Our lookups are measured before and after the others, so that other work on the machine affects both.
    let mut own = ours(cache, lookups, channels, &mut values);
    let mut rows = match program {
        Some(program) => theirs(program, lookups, channels, place, &error)?,
        None => Vec::new(),
    };
    let again = ours(cache, lookups, channels, &mut values);
    own.rates = [0, 1].map(|i| own.rates[i].max(again.rates[i]));
    own.clock = [0, 1].map(|i| own.clock[i].max(again.clock[i]));
    own.rms = error(&|i, c| values[i][c]);
    println!("\n{about}");
    println!(
        "{:<16} {:>9} {:>9} {:>9} {:>9} {:>8} {:>10}",
        "lookups", "M/s, 1", "M/s, 2", "2 over 1", "by clock", "RMS", "ours over"
    );
    let rate = own.rates[0];
    rows.insert(0, own);
    for row in &rows {
        let [one, two] = row.rates;
        println!(
            "{:<16} {one:>9.3} {two:>9.3} {:>9.2} {:>9.2} {:>8.2} {:>10.2}",
            row.name,
            two / one,
            row.clock[1] / row.clock[0],
            row.rms,
            rate / one
        );
    }
    Ok(())
}

/// Measures our lookups. Returns the best of several runs.
fn ours(
    (cache, id): (&TextureCache, TextureId),
    lookups: &[Lookup],
    channels: usize,
    values: &mut [[f32; 3]],
) -> Row {
    let some = |lookups: &[Lookup], values: &mut [[f32; 3]]| {
        let start = ThreadTime::now();
        let mut reader = cache.reader();
        for (lookup, value) in lookups.iter().zip(values) {
            reader.texture(id, lookup, &mut value[..channels]);
        }
        start.elapsed().as_secs_f64()
    };
    let mut row = Row { name: "ours".to_owned(), rates: [0.0; 2], clock: [0.0; 2], rms: 0.0 };
    let rate = |seconds: f64| lookups.len() as f64 / seconds / 1e6;
    for threads in [0, 1] {
        for _ in 0..RUNS {
            let start = Instant::now();
            let took = if threads == 0 {
                some(lookups, values)
            } else {
                let half = lookups.len() / 2;
                let (a, b) = values.split_at_mut(half);
                std::thread::scope(|scope| {
                    let other = scope.spawn(|| some(&lookups[..half], a));
                    let own = some(&lookups[half..], b);
                    other.join().map_or(own, |other| own.max(other))
                })
            };
            row.clock[threads] = row.clock[threads].max(rate(start.elapsed().as_secs_f64()));
            row.rates[threads] = row.rates[threads].max(rate(took));
        }
    }
    row
}

/// Returns the error of values, which are read by lookup and channel.
type Error<'a> = &'a dyn Fn(&dyn Fn(usize, usize) -> f32) -> f64;

/// Measures the other program's ways of filtering.
fn theirs(
    program: &Path,
    lookups: &[Lookup],
    channels: usize,
    place: &Path,
    error: Error<'_>,
) -> Result<Vec<Row>, String> {
    let told = |e: std::io::Error| e.to_string();
    let (questions, answers) = (place.join("lookups.bin"), place.join("answers.bin"));
    let bytes: Vec<u8> = lookups
        .iter()
        .flat_map(|q| [q.s, q.t, q.dsdx, q.dtdx, q.dsdy, q.dtdy])
        .flat_map(f32::to_le_bytes)
        .collect();
    std::fs::write(&questions, bytes).map_err(told)?;
    let output = Command::new(program)
        .arg(place.join("lookups.tx"))
        .args([&questions, &answers])
        .arg(channels.to_string())
        .output()
        .map_err(told)?;
    if !output.status.success() {
        println!("OpenImageIO's lookups failed: {}", String::from_utf8_lossy(&output.stderr).trim());
        return Ok(Vec::new());
    }
    let answers = std::fs::read(&answers).map_err(told)?;
    let values: Vec<f32> = answers.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let mut rows: Vec<Row> = Vec::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [name, threads, seconds, wall] = words[..] else { continue };
        let rate = |seconds: &str| {
            seconds.parse::<f64>().map(|s| lookups.len() as f64 / s / 1e6).map_err(|e| e.to_string())
        };
        let (rate, clock) = (rate(seconds)?, rate(wall)?);
        if threads == "1" {
            let own = &values[rows.len() * lookups.len() * channels..];
            let rms = error(&|i, c| own[i * channels + c]);
            rows.push(Row { name: name.to_owned(), rates: [rate; 2], clock: [clock; 2], rms });
        } else if let Some(row) = rows.last_mut() {
            (row.rates[1], row.clock[1]) = (rate, clock);
        }
    }
    Ok(rows)
}
