//! Images for tests.
#![allow(dead_code, reason = "each test uses a part of it")]

use granita_edit::{File, Image, Noise, Pattern, Window, WriteOptions, float_rows, pattern, write};
use granita_image::{FormatRegistry, Limits, PixelType};
use std::path::Path;

pub(crate) fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

pub(crate) fn window(x: i64, y: i64, width: u32, height: u32) -> Window {
    Window { x, y, width, height }
}

/// Returns an image of random numbers from 0 to 1.
pub(crate) fn noise(data: Window, channels: usize, seed: u32) -> Image {
    let noise = Noise::Uniform { min: 0.0, max: 1.0 };
    pattern(Pattern::Noise { noise, mono: false, seed }, &data, channels).unwrap()
}

/// Returns an image of one colour.
pub(crate) fn constant(data: Window, color: &[f32]) -> Image {
    pattern(Pattern::Constant(color.to_vec()), &data, color.len()).unwrap()
}

/// Returns an image of one channel with these values.
pub(crate) fn values(width: u32, list: &[f32]) -> Image {
    let height = list.len() as u32 / width;
    let mut image = constant(window(0, 0, width, height), &[0.0]);
    for (i, v) in list.iter().enumerate() {
        let at = window((i as u32 % width).into(), (i as u32 / width).into(), 1, 1);
        image = image.filled(&at, &[*v]).unwrap();
    }
    image
}

/// Returns all values.
pub(crate) fn all(image: &Image) -> Vec<f32> {
    float_rows(&**image.source(), 0, image.spec().height).unwrap()
}

/// Returns all values, requested in rows from the bottom.
pub(crate) fn from_below(image: &Image) -> Vec<f32> {
    let height = image.spec().height;
    let rows = (0..height).rev().map(|y| float_rows(&**image.source(), y, y + 1).unwrap());
    let mut rows: Vec<Vec<f32>> = rows.collect();
    rows.reverse();
    rows.concat()
}

/// Returns all values, requested in parts of `step` rows.
pub(crate) fn in_parts(image: &Image, step: u32) -> Vec<f32> {
    let height = image.spec().height;
    let part = |y: u32| float_rows(&**image.source(), y, (y + step).min(height)).unwrap();
    (0..height).step_by(step as usize).flat_map(part).collect()
}

/// Returns the largest difference.
pub(crate) fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Writes an image, and returns that of the file.
pub(crate) fn stored(image: &Image, path: &Path, pixel_type: Option<PixelType>) -> Image {
    let options = WriteOptions { pixel_type, ..WriteOptions::default() };
    write(image, path, &formats(), &options).unwrap();
    File::open(path, &formats()).unwrap().image(0, 0).unwrap()
}
