//! Measures the error of filtered lookups against brute force, on photographs: `cargo bench -p granita-texture --bench
//! quality -- [--dump FILE] [IMAGE ...]`.
//!
//! The reference of a footprint is the mean of 4096 stratified samples of the bilinear image under a Gaussian. `--dump`
//! writes each lookup, our result and the reference, for other programs.
#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout, reason = "a benchmark")]

#[path = "../tests/brute/mod.rs"]
mod brute;

use brute::{Brute, footprint};
use granita_base::{Environment, Reporter, SearchPath};
use granita_image::Limits;
use granita_texture::make::{MakeOptions, make};
use granita_texture::{CacheOptions, Lookup, TextureCache, Wrap};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

const COUNT: u32 = 10_000;

fn main() {
    let mut args: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let dump = args.iter().position(|a| a == "--dump").map(|at| {
        let file = args[at + 1].clone();
        args.drain(at..at + 2);
        std::io::BufWriter::new(std::fs::File::create(file).unwrap())
    });
    if args.is_empty() {
        args.push(concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/first/brick.png").to_owned());
    }
    let mut dump = dump;
    println!(
        "{:28} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>7}",
        "RMS, code values of 255", "all", "1-2", "2-8", "8-32", "32-64", "worst", "ns"
    );
    for image in args.iter().map(PathBuf::from) {
        one(&image, dump.as_mut());
    }
}

fn one(image: &Path, mut dump: Option<&mut std::io::BufWriter<std::fs::File>>) {
    let folder = tempfile::tempdir().unwrap();
    let formats = granita_plugin::bundled_formats(Limits::default());
    let texture = folder.path().join("a.tx");
    let options = MakeOptions { swrap: Wrap::Periodic, twrap: Wrap::Periodic, ..MakeOptions::default() };
    make(&[image.to_path_buf()], &texture, &options, &formats, &|_, _| ()).unwrap();
    let path = SearchPath::parse("/", &SearchPath::default(), &Environment::empty());
    let options = CacheOptions { memory_bytes: 1 << 30, ..CacheOptions::default() };
    let cache = TextureCache::new(formats, path, options, Reporter::silent());
    let id = cache.find(texture.to_str().unwrap()).unwrap();
    let brute = Brute::read(&cache, texture.to_str().unwrap());
    let lookups: Vec<(f32, Lookup)> = (0..COUNT).map(|i| footprint(i, brute.size())).collect();
    let mut values = vec![[0.0_f32; 4]; lookups.len()];
    let mut reader = cache.reader();
    let ns = (0..10)
        .map(|_| {
            let start = Instant::now();
            for ((_, lookup), value) in lookups.iter().zip(&mut values) {
                reader.texture(id, lookup, &mut value[..3]);
            }
            start.elapsed().as_nanos() / u128::from(COUNT)
        })
        .min()
        .unwrap_or(0);
    let (mut sums, mut counts, mut worst) = ([0.0_f64; 4], [0_u32; 4], 0.0_f64);
    for ((ratio, lookup), value) in lookups.iter().zip(&values) {
        let reference = brute.mean(lookup);
        let band = [2.0, 8.0, 32.0].iter().filter(|&&b| *ratio >= b).count();
        for c in 0..brute.channels() {
            let error = f64::from(value[c] - reference[c]) * 255.0;
            sums[band] += error * error;
            counts[band] += 1;
            worst = worst.max(error.abs());
        }
        if let Some(out) = &mut dump {
            let l = lookup;
            writeln!(
                out,
                "{} {} {} {} {} {} {} {}",
                l.s, l.t, l.dsdx, l.dtdx, l.dsdy, l.dtdy, value[0], reference[0]
            )
            .unwrap();
        }
    }
    let rms = |sum: f64, n: u32| (sum / f64::from(n)).sqrt();
    let name = image.file_name().unwrap().to_string_lossy();
    print!("{name:28} {:6.2}", rms(sums.iter().sum(), counts.iter().sum()));
    for band in 0..4 {
        print!(" {:6.2}", rms(sums[band], counts[band]));
    }
    println!(" {worst:6.1} {ns:7}");
}
