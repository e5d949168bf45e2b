//! Images to compare, with the values of any file as floats.

use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use std::path::Path;

/// The first level of the first image of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// The column of the first pixel in the whole image of which this is a part.
    pub x: i32,
    /// The row of the first pixel in the whole image.
    pub y: i32,
    /// The number of pixels in a row.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
    /// The number of values of a pixel.
    pub channels: usize,
    /// The values, in rows from the top, with channels interleaved.
    pub values: Vec<f32>,
}

impl Image {
    /// Reads any image that the suite's own formats read.
    ///
    /// # Errors
    /// Returns the error of the reader.
    pub fn read(path: &Path) -> Result<Self, String> {
        let input =
            granita_plugin::bundled_formats(Limits::default()).open(path).map_err(|e| e.to_string())?;
        let spec = input.spec(0, 0).ok_or_else(|| format!("{}: no image", path.display()))?;
        let values = input.read_level(0, 0).map_err(|e| e.to_string())?.to_floats();
        Ok(Self {
            x: spec.x,
            y: spec.y,
            width: spec.width as usize,
            height: spec.height as usize,
            channels: spec.channels.len(),
            values,
        })
    }

    /// Writes an 8-bit PNG with at most four channels. Further channels are left out.
    ///
    /// # Errors
    /// Returns the error of the writer.
    pub fn write_png(&self, path: &Path) -> Result<(), String> {
        let kept = self.channels.min(4);
        let values: Vec<f32> = self.values.chunks(self.channels).flat_map(|p| &p[..kept]).copied().collect();
        let spec = ImageSpec::new(self.width as u32, self.height as u32, kept, PixelType::U8);
        let registry = granita_plugin::bundled_formats(Limits::default());
        let mut output =
            registry.create(path, "png", &CreateOptions::new(&spec, 1)).map_err(|e| e.to_string())?;
        output.write_rows(&Pixels::from_floats(PixelType::U8, &values)).map_err(|e| e.to_string())?;
        output.close().map_err(|e| e.to_string())
    }

    /// Returns the values of pixel `(x, y)`; `None` outside of the image.
    pub fn pixel(&self, x: usize, y: usize) -> Option<&[f32]> {
        let at = (y * self.width + x) * self.channels;
        (x < self.width).then(|| self.values.get(at..at + self.channels)).flatten()
    }

    /// Returns the channel means over `x0..x1`, `y0..y1`.
    pub fn mean(&self, [x0, y0, x1, y1]: [usize; 4]) -> Option<Vec<f32>> {
        let mut sums = vec![0.0_f64; self.channels];
        for y in y0..y1 {
            for x in x0..x1 {
                for (sum, value) in sums.iter_mut().zip(self.pixel(x, y)?) {
                    *sum += f64::from(*value);
                }
            }
        }
        let count = (x1 - x0) as f64 * (y1 - y0) as f64;
        (count > 0.0).then(|| sums.iter().map(|s| (s / count) as f32).collect())
    }

    /// Returns the largest difference of any channel, with its position as column, row and channel. Two NaN are equal.
    ///
    /// # Errors
    /// Returns an error when the shapes differ.
    pub fn difference(&self, other: &Self) -> Result<(f32, [usize; 3]), String> {
        let shape = |p: &Self| (p.width, p.height, p.channels);
        if shape(self) != shape(other) {
            return Err(format!("shapes differ: {:?} and {:?}", shape(self), shape(other)));
        }
        let mut worst = (0.0, [0; 3]);
        for (i, (a, b)) in self.values.iter().zip(&other.values).enumerate() {
            let difference = match (a.is_nan(), b.is_nan()) {
                (true, true) => 0.0,
                (false, false) if a == b => 0.0,
                (false, false) => (a - b).abs(),
                _ => f32::INFINITY,
            };
            if difference > worst.0 {
                let pixel = i / self.channels;
                worst = (difference, [pixel % self.width, pixel / self.width, i % self.channels]);
            }
        }
        Ok(worst)
    }

    /// Checks that no more than `most` pixels differ by more than `tolerance` in some channel.
    ///
    /// # Errors
    /// Returns the number of such pixels and the position of the worst one, or that the shapes differ.
    pub fn close_but(&self, other: &Self, tolerance: f32, most: usize) -> Result<(), String> {
        let (worst, [x, y, c]) = self.difference(other)?;
        let differs = |(a, b): (&[f32], &[f32])| {
            a.iter().zip(b).any(|(a, b)| {
                // NaN differs from all numbers.
                let near = (a - b).abs() <= tolerance;
                a.to_bits() != b.to_bits() && !near
            })
        };
        let pixels = self.values.chunks(self.channels).zip(other.values.chunks(self.channels));
        match pixels.filter(|(a, b)| differs((a, b))).count() {
            count if count <= most => Ok(()),
            count => Err(format!(
                "{count} pixels differ, the worst by {worst} at {x} {y} in channel {c}; {most} may"
            )),
        }
    }

    /// Checks that the values are equal to the bit.
    ///
    /// # Errors
    /// Returns the number of different values and the first of them, or that the shapes differ.
    pub fn identical(&self, other: &Self) -> Result<(), String> {
        self.difference(other)?;
        let differing = |(a, b): (&f32, &f32)| a.to_bits() != b.to_bits();
        match self.values.iter().zip(&other.values).position(differing) {
            None => Ok(()),
            Some(i) => {
                let pixel = i / self.channels;
                let count = self.values.iter().zip(&other.values).filter(|(a, b)| differing((a, b))).count();
                Err(format!(
                    "{count} values differ, the first in pixel {} {} channel {}: {} and {}",
                    pixel % self.width,
                    pixel / self.width,
                    i % self.channels,
                    self.values[i],
                    other.values[i]
                ))
            }
        }
    }

    /// Checks that `parts`, put together, are `self` to the bit. Each pixel must be in exactly one part.
    ///
    /// # Errors
    /// Returns a pixel that no part or more than one part has, or that differs.
    pub fn is_assembled_of(&self, parts: &[Self]) -> Result<(), String> {
        let mut covered = vec![0_u32; self.width * self.height];
        for part in parts {
            for y in 0..part.height {
                for x in 0..part.width {
                    let (fx, fy) = (x as i64 + i64::from(part.x), y as i64 + i64::from(part.y));
                    let inside = fx >= 0 && fy >= 0 && fx < self.width as i64 && fy < self.height as i64;
                    let whole = inside.then(|| self.pixel(fx as usize, fy as usize)).flatten();
                    let whole = whole.ok_or_else(|| format!("pixel {fx} {fy} is outside the whole"))?;
                    covered[fy as usize * self.width + fx as usize] += 1;
                    let own = part.pixel(x, y).unwrap_or_default();
                    let bits = |p: &[f32]| p.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                    if bits(whole) != bits(own) {
                        return Err(format!("pixel {fx} {fy}: {whole:?} in the whole, {own:?} in the part"));
                    }
                }
            }
        }
        match covered.iter().position(|count| *count != 1) {
            None => Ok(()),
            Some(i) => Err(format!("pixel {} {} is in {} parts", i % self.width, i / self.width, covered[i])),
        }
    }

    /// True when all values are finite numbers.
    pub fn is_finite(&self) -> bool {
        self.values.iter().all(|v| v.is_finite())
    }

    /// True when not all pixels are equal.
    pub fn is_varied(&self) -> bool {
        let mut pixels = self.values.chunks(self.channels.max(1));
        pixels.next().is_some_and(|first| pixels.any(|p| p != first))
    }

    /// Returns `8 |a - b|`, opaque, for the report.
    pub fn difference_image(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).enumerate().map(|(i, (a, b))| {
            let is_alpha = self.channels == 4 && i % 4 == 3;
            if is_alpha { 1.0 } else { ((a - b).abs() * 8.0).min(1.0) }
        });
        Self { values: values.collect(), ..*self }
    }
}
