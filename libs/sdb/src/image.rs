//! Conversion of databases over surfaces to images.

use crate::Packed;

/// The options for converting a database over (s, t) to an image.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageOptions {
    /// The numbers of pixels across and down.
    pub resolution: [u32; 2],
    /// The data format: "8", "16", "half" or "float". Other values select the default of the file format for floats.
    pub data_format: String,
    /// The largest width of the filter in pixels, at least 2.
    pub filter_width: f32,
}

impl Default for ImageOptions {
    /// Returns 1024 x 1024 pixels and a filter 2 pixels wide.
    fn default() -> Self {
        Self { resolution: [1024, 1024], data_format: String::new(), filter_width: 2.0 }
    }
}

/// The largest side of an image, in pixels.
pub(crate) const LARGEST: u32 = 1 << 16;

/// Returns the records over [0, 1] x [0, 1] as rows of pixels of one or three channels. (0, 0) is the upper left
/// corner.
///
/// A pixel is the mean of the records around its centre, weighted by `(1 - (d / r)^2)^2`. The radius `r` is one
/// pixel, or larger, up to half of `filter_width`, until a record is found. Pixels without any record are 0.
pub fn image(records: &Packed, options: &ImageOptions) -> Vec<f32> {
    let schema = records.schema();
    let (width, height) = (options.resolution[0] as usize, options.resolution[1] as usize);
    let (key, channels) = (schema.key.numbers(), schema.value.numbers());
    let place = |record: &[f32]| (record[0] * width as f32, record[1] * height as f32);
    // The records are sorted by their pixels: the indices of all, and where those of each pixel begin.
    let pixel = |record: &[f32]| {
        let (x, y) = place(record);
        let inside = x >= 0.0 && y >= 0.0 && x <= width as f32 && y <= height as f32;
        inside.then(|| (y as usize).min(height - 1) * width + (x as usize).min(width - 1))
    };
    let all = records.records().chunks_exact(schema.numbers());
    let mut begin = vec![0_u32; width * height + 1];
    all.clone().filter_map(pixel).for_each(|p| begin[p + 1] += 1);
    for p in 0..width * height {
        begin[p + 1] += begin[p];
    }
    let mut next = begin.clone();
    let mut members = vec![0_u32; begin[width * height] as usize];
    for (i, record) in all.enumerate() {
        if let Some(p) = pixel(record) {
            members[next[p] as usize] = i as u32;
            next[p] += 1;
        }
    }
    let widest = 0.5 * options.filter_width.clamp(2.0, 2.0 * width.max(height) as f32);
    let mut out = vec![0.0; width * height * channels];
    for (p, value) in out.chunks_exact_mut(channels).enumerate() {
        let (cx, cy) = ((p % width) as f32 + 0.5, (p / width) as f32 + 0.5);
        let mut radius = 1.0_f32;
        loop {
            let range = |c: f32, n: usize| {
                (c - radius).floor().max(0.0) as usize..(((c + radius).floor() as usize) + 1).min(n)
            };
            let mut total = 0.0_f32;
            for y in range(cy, height) {
                for x in range(cx, width) {
                    let q = y * width + x;
                    for &i in &members[begin[q] as usize..begin[q + 1] as usize] {
                        let record = records.record(i as usize);
                        let (px, py) = place(record);
                        let squared = ((px - cx) * (px - cx) + (py - cy) * (py - cy)) / (radius * radius);
                        if squared < 1.0 {
                            let weight = (1.0 - squared) * (1.0 - squared);
                            total += weight;
                            for (v, r) in value.iter_mut().zip(&record[key..]) {
                                *v += weight * r;
                            }
                        }
                    }
                }
            }
            if total > 0.0 {
                value.iter_mut().for_each(|v| *v /= total);
                break;
            }
            if radius >= widest {
                break;
            }
            radius = (radius * std::f32::consts::SQRT_2).min(widest);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Key, Schema, Value};

    const SCHEMA: Schema = Schema { key: Key::Surface, value: Value::Color };

    fn options(width: u32, height: u32, filter_width: f32) -> ImageOptions {
        ImageOptions { resolution: [width, height], filter_width, ..ImageOptions::default() }
    }

    #[test]
    fn one_record_per_pixel_gives_the_image() {
        let record = |i: usize| {
            let (x, y) = (i % 4, i / 4);
            [(x as f32 + 0.5) / 4.0, (y as f32 + 0.5) / 3.0, x as f32, y as f32, 7.0]
        };
        let packed = Packed::new(SCHEMA, &(0..12).flat_map(record).collect::<Vec<f32>>());
        let got = image(&packed, &options(4, 3, 2.0));
        for i in 0..12 {
            assert_eq!(got[3 * i..][..3], [(i % 4) as f32, (i / 4) as f32, 7.0]);
        }
    }

    #[test]
    fn gaps_are_filled_within_the_filter_width() {
        let packed = Packed::new(SCHEMA, &[0.5 / 16.0, 0.5, 1.0, 2.0, 3.0]);
        let lit = |filter_width| {
            let got = image(&packed, &options(16, 1, filter_width));
            got.chunks(3).filter(|p| (p[2] - 3.0).abs() < 1e-5).count()
        };
        assert_eq!((lit(0.0), lit(2.0), lit(8.0), lit(64.0)), (1, 1, 4, 16));
        // Records outside, or no records at all, give black.
        let outside = Packed::new(SCHEMA, &[-0.1, 0.5, 1.0, 1.0, 1.0]);
        assert!(image(&outside, &options(4, 4, 2.0)).iter().all(|v| *v == 0.0));
        assert!(image(&Packed::new(SCHEMA, &[]), &options(4, 4, 9.0)).iter().all(|v| *v == 0.0));
    }
}
