//! Measures the time of one lookup in images and environments, with all tiles in the cache.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use criterion::{Criterion, criterion_group, criterion_main};
use granita_base::{Environment, Reporter, SearchPath, Vec3, hash};
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_texture::make::{MakeOptions, Mode, make};
use granita_texture::{CacheOptions, EnvLookup, Lookup, TextureCache};
use std::hint::black_box;

const SIZE: u32 = 2048;

fn unit(i: u32, k: u32) -> f32 {
    hash::unit(hash::words(&[i, k]))
}

fn lookups(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let formats = granita_plugin::bundled_formats(Limits::default());
    let image = folder.path().join("a.tif");
    for (pixel_type, word) in [(PixelType::U8, "u8"), (PixelType::Float, "float")] {
        let spec = ImageSpec::new(SIZE, SIZE / 2, 3, pixel_type);
        let values: Vec<f32> = (0..SIZE * SIZE / 2 * 3).map(|i| unit(i, 0)).collect();
        let mut file = formats.create(&image, "tiff", &CreateOptions::new(&spec, 1)).unwrap();
        file.write_rows(&Pixels::from_floats(pixel_type, &values)).unwrap();
        file.close().unwrap();
        let compression = Some("none".to_owned());
        for (mode, name) in [(Mode::Plain, "a.tx"), (Mode::EnvLatLong, "a.env")] {
            let options = MakeOptions { mode, compression: compression.clone(), ..MakeOptions::default() };
            make(std::slice::from_ref(&image), &folder.path().join(name), &options, &formats, &|_, _| ())
                .unwrap();
        }
        let path = SearchPath::parse(
            &folder.path().to_string_lossy(),
            &SearchPath::default(),
            &Environment::empty(),
        );
        let cache = TextureCache::new(
            formats.clone(),
            path,
            CacheOptions { memory_bytes: 1 << 30, ..CacheOptions::default() },
            Reporter::silent(),
        );
        let (plain, env) = (cache.find("a.tx").unwrap(), cache.find("a.env").unwrap());
        let mut out = [0.0; 4];
        for (what, width, ratio) in [("sharp", 0.0, 1.0), ("round", 3.0, 1.0), ("ratio 8", 3.0, 8.0)] {
            let mut i = 0_u32;
            c.bench_function(&format!("texture {word} {what}"), |b| {
                b.iter(|| {
                    i += 1;
                    // The points are close together, as neighbouring points of a grid are.
                    let (s, t) = ((i % 4096) as f32 / 4096.0, (i / 4096 % 4096) as f32 / 4096.0);
                    let d = width / SIZE as f32;
                    let lookup = Lookup { s, t, dsdx: d * ratio, dtdy: d, ..Lookup::default() };
                    cache.texture(plain, black_box(&lookup), &mut out);
                    out[0]
                });
            });
        }
        for (what, angle) in [("sharp", 0.0), ("blurred", 0.2)] {
            let mut i = 0_u32;
            c.bench_function(&format!("environment {word} {what}"), |b| {
                b.iter(|| {
                    i += 1;
                    let r = Vec3::new(unit(i, 1) - 0.5, unit(i, 2) - 0.5, unit(i, 3) - 0.5);
                    let lookup = EnvLookup { r, angle: Some(angle), ..EnvLookup::default() };
                    cache.environment(env, black_box(&lookup), &mut out);
                    out[0]
                });
            });
        }
    }
}

criterion_group!(benches, lookups);
criterion_main!(benches);
