//! Measures the files that texture making reads and writes: the tiles of textures, and the rows of the images that they
//! are made from.
//!
//! Each file is measured with one thread and with all of them. The times include the disk, so put the folder for
//! temporary files into memory.

#![allow(missing_docs, reason = "criterion's macros")]
#![allow(clippy::print_stdout, reason = "sizes beside the times")]
#![allow(clippy::unwrap_used, reason = "a bench that cannot go on ends")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use granita_base::{Param, hash};
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_plugin::bundled_formats;
use std::path::Path;
use std::time::Duration;

/// The number of pixels of each side.
const SIDE: u32 = 1024;

/// Returns an image like a photograph, with smooth gradients and a little noise.
fn photograph(pixel_type: PixelType) -> Pixels {
    let value = |i: u32| {
        let (x, y, c) = (i / 3 % SIDE, i / 3 / SIDE, i % 3);
        let wave = (0.013 * x as f32 + c as f32).sin() * (0.011 * y as f32).cos();
        let noise = hash::words(&[i]) as f32 / u32::MAX as f32 - 0.5;
        (0.5 + 0.4 * wave + 0.03 * noise).clamp(0.0, 1.0)
    };
    Pixels::from_floats(pixel_type, &(0..SIDE * SIDE * 3).map(value).collect::<Vec<_>>())
}

fn spec(pixel_type: PixelType, tile: u32, compression: Option<&str>) -> ImageSpec {
    let mut spec = ImageSpec::new(SIDE, SIDE, 3, pixel_type);
    (spec.tile_width, spec.tile_height) = (tile, tile);
    if let Some(word) = compression {
        spec.attributes.set(Param::declared("string compression", word).unwrap());
    }
    spec
}

fn write(path: &Path, format: &str, spec: &ImageSpec, pixels: &Pixels) {
    let formats = bundled_formats(Limits::default());
    let mut out = formats.create(path, format, &CreateOptions::new(spec, 1)).unwrap();
    out.write_rows(pixels).unwrap();
    out.close().unwrap();
}

fn files(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let formats = bundled_formats(Limits::default());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut group = c.benchmark_group("files");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2));
    for (format, pixel_type, tile, compression) in [
        ("tiff", PixelType::U8, 64, Some("none")),
        ("tiff", PixelType::U8, 64, Some("zip:1")),
        ("tiff", PixelType::U8, 64, Some("zip")),
        ("tiff", PixelType::U8, 64, Some("zip:6")),
        ("tiff", PixelType::U8, 64, Some("lzw")),
        ("tiff", PixelType::U8, 0, Some("zip")),
        ("exr", PixelType::Half, 64, Some("zip")),
        ("exr", PixelType::Half, 64, Some("piz")),
        ("exr", PixelType::Half, 0, Some("zip")),
        ("png", PixelType::U8, 0, None),
        ("jpeg", PixelType::U8, 0, None),
        ("sgi", PixelType::U8, 0, None),
    ] {
        let (spec, pixels) = (spec(pixel_type, tile, compression), photograph(pixel_type));
        let words = format!("{format} {pixel_type:?} tile {tile} {}", compression.unwrap_or("default"));
        let path = folder.path().join("image").with_extension(format);
        group.throughput(Throughput::Bytes(spec.bytes().unwrap_or(0)));
        for count in [1, threads] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
            let name = format!("write, {count} threads/{words}");
            group.bench_function(name, |b| b.iter(|| pool.install(|| write(&path, format, &spec, &pixels))));
            let name = format!("read, {count} threads/{words}");
            group.bench_function(name, |b| {
                b.iter(|| pool.install(|| formats.open(&path).unwrap().read_level(0, 0).unwrap()));
            });
        }
        println!("{words}: {} bytes", std::fs::metadata(&path).unwrap().len());
    }
    group.finish();
}

criterion_group!(benches, files);
criterion_main!(benches);
