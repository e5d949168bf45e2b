//! Statistics and comparison.

use crate::image::{Image, Source, float_rows};
use crate::window::band;
use crate::{EditError, Result};
use granita_view::Statistics;
use rayon::prelude::*;

/// Calls `visit` with the first row and the values of consecutive bands of several sources of one size.
fn bands(sources: &[&dyn Source], mut visit: impl FnMut(u32, &[Vec<f32>])) -> Result<()> {
    let Some(first) = sources.first() else { return Ok(()) };
    let height = first.shape().height;
    let step = sources.iter().map(|s| band(&s.shape())).min().unwrap_or(1);
    for y0 in (0..height).step_by(step as usize) {
        let y1 = (y0 + step).min(height);
        let values = sources.iter().map(|s| float_rows(*s, y0, y1)).collect::<Result<Vec<_>>>()?;
        visit(y0, &values);
    }
    Ok(())
}

/// Returns the statistics of each channel of an image. They are the same for any number of threads.
///
/// # Errors
/// The error of reading the image.
pub fn statistics(image: &Image) -> Result<Vec<Statistics>> {
    let shape = image.source.shape();
    let n = shape.channels;
    let mut all = vec![Statistics::default(); n];
    bands(&[&*image.source], |_, values| {
        let of_row = |row: &[f32]| -> Vec<Statistics> {
            (0..n).map(|c| Statistics::of(row.iter().skip(c).step_by(n).copied())).collect()
        };
        let rows: Vec<_> = values[0].par_chunks_exact(shape.row()).map(of_row).collect();
        // The rows are combined in order.
        for row in rows {
            for (sum, one) in all.iter_mut().zip(row) {
                *sum = sum.and(one);
            }
        }
    })?;
    Ok(all)
}

/// The limits of a comparison, as those of OpenImageIO's `idiff`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffLimits {
    /// A pixel fails when a value differs by more.
    pub fail: f32,
    /// The comparison fails when more pixels fail, in percent.
    pub fail_percent: f64,
    /// The comparison fails when any value differs by more.
    pub hard_fail: f32,
    /// A pixel is warned about when a value differs by more.
    pub warn: f32,
    /// The comparison warns when more pixels are warned about, in percent.
    pub warn_percent: f64,
    /// The comparison warns when any value differs by more.
    pub hard_warn: f32,
}

impl Default for DiffLimits {
    fn default() -> Self {
        Self {
            fail: 1e-6,
            fail_percent: 0.0,
            hard_fail: f32::INFINITY,
            warn: 1e-6,
            warn_percent: 0.0,
            hard_warn: f32::INFINITY,
        }
    }
}

/// The result of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Within all limits.
    Pass,
    /// Beyond a limit of warnings.
    Warning,
    /// Beyond a limit of failures.
    Failure,
}

/// The difference of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The number of pixels.
    pub pixels: u64,
    /// The mean of the magnitudes of the differences of all values.
    pub mean: f64,
    /// The root of their mean square.
    pub rms: f64,
    /// The peak signal-to-noise ratio in decibels, with a peak of 1 or the largest magnitude of a value.
    pub psnr: f64,
    /// The largest magnitude. It is infinite where one value is not finite and the other is different.
    pub max: f32,
    /// The place of the largest magnitude, in pixels of the data window, and its channel.
    pub max_at: (u32, u32, usize),
    /// The values of all channels there, of both images.
    pub max_values: [Vec<f32>; 2],
    /// The number of pixels that fail.
    pub failed: u64,
    /// The number of pixels that are warned about.
    pub warned: u64,
}

impl Difference {
    /// Returns the result by limits.
    pub fn verdict(&self, limits: &DiffLimits) -> Verdict {
        let beyond = |count: u64, percent: f64| count as f64 > percent / 100.0 * self.pixels as f64;
        if beyond(self.failed, limits.fail_percent) || self.max > limits.hard_fail {
            Verdict::Failure
        } else if beyond(self.warned, limits.warn_percent) || self.max > limits.hard_warn {
            Verdict::Warning
        } else {
            Verdict::Pass
        }
    }
}

/// The sums of one row.
#[derive(Clone, Copy, Default)]
struct Sums {
    magnitude: f64,
    squares: f64,
    peak: f32,
    max: f32,
    at: usize,
    failed: u64,
    warned: u64,
}

/// Compares two images, channel by channel in their order. Values that are not finite are equal only to the same value.
///
/// # Errors
/// [`EditError::Misuse`] when their data windows or numbers of channels differ, or the error of reading one.
pub fn difference(a: &Image, b: &Image, limits: &DiffLimits) -> Result<Difference> {
    let (a, b) = (a.associated(), b.associated());
    let (p, q) = (a.data(), b.data());
    let (n, m) = (a.spec.nchannels(), b.spec.nchannels());
    if p != q || n != m {
        let text = |w: &crate::Window, n| {
            format!("{} x {} pixels at {},{} with {n} channels", w.width, w.height, w.x, w.y)
        };
        return Err(EditError::misuse(format!(
            "the images do not match in size: {} and {}",
            text(&p, n),
            text(&q, m)
        )));
    }
    let row = a.source.shape().row();
    let (mut total, mut place) = (Sums::default(), (0, 0, 0));
    let mut values = [Vec::new(), Vec::new()];
    bands(&[&*a.source, &*b.source], |y0, blocks| {
        let rows: Vec<Sums> = (blocks[0].par_chunks_exact(row))
            .zip(blocks[1].par_chunks_exact(row))
            .map(|(a, b)| row_sums(a, b, n, limits))
            .collect();
        // The rows are summed in order, so that the number of threads does not matter.
        for (i, sums) in rows.into_iter().enumerate() {
            total.magnitude += sums.magnitude;
            total.squares += sums.squares;
            total.peak = total.peak.max(sums.peak);
            total.failed += sums.failed;
            total.warned += sums.warned;
            if sums.max > total.max {
                total.max = sums.max;
                place = ((sums.at / n) as u32, y0 + i as u32, sums.at % n);
                values = [0, 1].map(|k| blocks[k][i * row + sums.at / n * n..][..n].to_vec());
            }
        }
    })?;
    let pixels = u64::from(p.width) * u64::from(p.height);
    let count = (pixels * n as u64).max(1) as f64;
    let rms = (total.squares / count).sqrt();
    Ok(Difference {
        pixels,
        mean: total.magnitude / count,
        rms,
        psnr: 20.0 * libm::log10(f64::from(total.peak.max(1.0)) / rms),
        max: total.max,
        max_at: place,
        max_values: values,
        failed: total.failed,
        warned: total.warned,
    })
}

fn row_sums(a: &[f32], b: &[f32], n: usize, limits: &DiffLimits) -> Sums {
    let mut sums = Sums::default();
    for (x, (p, q)) in a.chunks_exact(n).zip(b.chunks_exact(n)).enumerate() {
        let (mut failed, mut warned) = (false, false);
        for (c, (u, v)) in p.iter().zip(q).enumerate() {
            let d = if u == v || u.is_nan() && v.is_nan() {
                0.0
            } else if u.is_finite() && v.is_finite() {
                (u - v).abs()
            } else {
                f32::INFINITY
            };
            sums.magnitude += f64::from(d);
            sums.squares += f64::from(d) * f64::from(d);
            for v in [u, v].into_iter().filter(|v| v.is_finite()) {
                sums.peak = sums.peak.max(v.abs());
            }
            if d > sums.max {
                (sums.max, sums.at) = (d, x * n + c);
            }
            failed |= d > limits.fail;
            warned |= d > limits.warn;
        }
        sums.failed += u64::from(failed);
        sums.warned += u64::from(warned);
    }
    sums
}
