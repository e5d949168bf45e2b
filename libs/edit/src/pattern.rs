//! Images that are made from nothing.

use crate::image::{Image, Shape, Source, Window};
use crate::{EditError, Result};
use granita_base::hash::{unit, words};
use granita_image::{ImageSpec, PixelType, Pixels};
use rayon::prelude::*;
use std::sync::Arc;

/// The values of a pattern. A list of colours has one number for all channels, or one for each; missing ones are the
/// last.
#[derive(Clone, Debug, PartialEq)]
pub enum Pattern {
    /// One colour.
    Constant(Vec<f32>),
    /// Two colours in rectangles of a width and a height, the first at the corner of the image.
    Checker {
        /// The size of a rectangle in pixels.
        size: (u32, u32),
        /// The colours.
        colors: [Vec<f32>; 2],
        /// The shift of the pattern in pixels.
        offset: (i64, i64),
    },
    /// Colours at the corners, interpolated: upper left, upper right, lower left, lower right.
    Fill([Vec<f32>; 4]),
    /// Random numbers.
    Noise {
        /// Their distribution.
        noise: Noise,
        /// True when all channels of a pixel have the same number.
        mono: bool,
        /// Selects one of many patterns.
        seed: u32,
    },
}

/// A distribution of random numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// Normal numbers.
    Gaussian {
        /// The mean.
        mean: f32,
        /// The standard deviation.
        deviation: f32,
    },
    /// Numbers of equal probability between two.
    Uniform {
        /// The lower end.
        min: f32,
        /// The upper end.
        max: f32,
    },
    /// One value at some places, 0 elsewhere (or the value of the image to which the noise is added).
    Salt {
        /// The value.
        value: f32,
        /// The part of the places, from 0 to 1.
        portion: f32,
    },
}

impl Noise {
    /// Returns the value at a place where the image has `v`.
    fn at(self, v: f32, place: &[u32; 4]) -> f32 {
        let [x, y, c, seed] = *place;
        let number = |i: u32| unit(words(&[x, y, c, seed, i]));
        match self {
            Self::Uniform { min, max } => v + min + (max - min) * number(0),
            // The method of G. Box and M. Muller (A Note on the Generation of Random Normal Deviates, 1958).
            Self::Gaussian { mean, deviation } => {
                let radius = (-2.0 * libm::logf(1.0 - number(0))).sqrt();
                v + mean + deviation * radius * libm::cosf(std::f32::consts::TAU * number(1))
            }
            Self::Salt { value, portion } => {
                if number(0) < portion {
                    value
                } else {
                    v
                }
            }
        }
    }

    /// Adds the noise to a row.
    fn add(self, y: u32, row: &mut [f32], n: usize, mono: bool, seed: u32) {
        for (x, pixel) in (0_u32..).zip(row.chunks_exact_mut(n)) {
            for (c, v) in (0_u32..).zip(pixel) {
                *v = self.at(*v, &[x, y, if mono { 0 } else { c }, seed]);
            }
        }
    }
}

/// A pattern as a source.
struct Drawn {
    shape: Shape,
    pattern: Pattern,
}

impl Source for Drawn {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let shape = self.shape;
        let n = shape.channels;
        let mut out = vec![0.0; (y1 - y0) as usize * shape.row()];
        out.par_chunks_mut(shape.row()).zip(y0..y1).for_each(|(row, y)| match &self.pattern {
            Pattern::Constant(color) => {
                row.chunks_exact_mut(n).for_each(|pixel| pixel.copy_from_slice(color))
            }
            Pattern::Checker { size, colors, offset } => {
                for (x, pixel) in (0_i64..).zip(row.chunks_exact_mut(n)) {
                    let cell = (x - offset.0).div_euclid(size.0.into())
                        + (i64::from(y) - offset.1).div_euclid(size.1.into());
                    pixel.copy_from_slice(&colors[(cell & 1) as usize]);
                }
            }
            Pattern::Fill(corners) => {
                // The corners are the centres of the outer pixels.
                let part = |i: u32, count: u32| if count > 1 { i as f32 / (count - 1) as f32 } else { 0.0 };
                let t = part(y, shape.height);
                for (x, pixel) in (0_u32..).zip(row.chunks_exact_mut(n)) {
                    let s = part(x, shape.width);
                    for (c, v) in pixel.iter_mut().enumerate() {
                        let [a, b, d, e] = [0, 1, 2, 3].map(|i| corners[i][c]);
                        let (top, bottom) = (a + (b - a) * s, d + (e - d) * s);
                        *v = top + (bottom - top) * t;
                    }
                }
            }
            Pattern::Noise { noise, mono, seed } => noise.add(y, row, n, *mono, *seed),
        });
        Ok(Pixels::Float(out))
    }
}

/// Returns an image of a pattern. Both windows are `window`.
///
/// # Errors
/// [`EditError::Misuse`] when there are no channels or more than 1024, when a colour has no number, or when a side is
/// 0.
pub fn pattern(pattern: Pattern, window: &Window, channels: usize) -> Result<Image> {
    if !(1..=1024).contains(&channels) {
        return Err(EditError::misuse(format!("{channels} channels, 1 to 1024 are possible")));
    }
    if window.width == 0 || window.height == 0 {
        return Err(EditError::misuse(format!("a size of {} x {} pixels", window.width, window.height)));
    }
    let color = |list: Vec<f32>| -> Result<Vec<f32>> {
        let last = *list.last().ok_or_else(|| EditError::misuse("a colour without a number"))?;
        Ok((0..channels).map(|c| *list.get(c).unwrap_or(&last)).collect())
    };
    let pattern = match pattern {
        Pattern::Constant(list) => Pattern::Constant(color(list)?),
        Pattern::Checker { size, colors: [a, b], offset } => {
            if size.0 == 0 || size.1 == 0 {
                let what = format!("a checker of {} x {} pixels", size.0, size.1);
                return Err(EditError::misuse(what));
            }
            Pattern::Checker { size, colors: [color(a)?, color(b)?], offset }
        }
        Pattern::Fill([a, b, c, d]) => Pattern::Fill([color(a)?, color(b)?, color(c)?, color(d)?]),
        Pattern::Noise { .. } => pattern,
    };
    let shape = Shape { width: window.width, height: window.height, channels, pixel_type: PixelType::Float };
    let spec = ImageSpec::new(window.width, window.height, channels, PixelType::Float);
    Image::new(spec, Arc::new(Drawn { shape, pattern })).placed(window.x, window.y)?.with_full(*window)
}

impl Image {
    /// Returns the image with noise.
    #[must_use]
    pub fn with_noise(&self, noise: Noise, mono: bool, seed: u32) -> Self {
        let image = self.associated();
        let n = image.spec.nchannels();
        image.mapped(move |y, row| noise.add(y, row, n, mono, seed))
    }
}
