//! Places, times and lens points of the samples of a rectangle of pixels.

use crate::{CameraView, PixelRect};
use granita_base::{hash, sample};

/// Dimensions that are hashed separately.
#[derive(Clone, Copy)]
#[repr(u32)]
enum Dimension {
    Place = 1,
    Time = 2,
    Lens = 3,
}

/// How many samples a pixel has, and what varies among them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SamplePattern {
    /// Strata across and down a pixel.
    pub(crate) strata: [u32; 2],
    /// Whether samples differ in time.
    pub(crate) blur: bool,
    /// Whether samples differ in their lens point.
    pub(crate) defocus: bool,
}

impl SamplePattern {
    /// For a camera; `moving` says whether anything in the whole scene moves (the crop must not count).
    ///
    /// "temporalquality" and "dofquality" are least numbers of different values in a pixel: where they ask
    /// for more than `spatialquality` gives, pixels get more samples. A quality of 1 turns the blur off.
    pub(crate) fn new(camera: &CameraView, moving: bool) -> Self {
        let blur = moving && camera.has_motion_blur() && camera.temporalquality > 1;
        let defocus = camera.lens.is_some() && camera.dofquality > 1;
        let least = u64::from(1.max(if blur { camera.temporalquality } else { 1 }).max(if defocus {
            camera.dofquality
        } else {
            1
        }));
        let [mut x, mut y] = camera.spatialquality;
        // The shape of the strata stays about as it was asked for.
        while u64::from(x) * u64::from(y) < least {
            if x <= y { x += 1 } else { y += 1 }
        }
        Self { strata: [x, y], blur, defocus }
    }

    /// Samples of a pixel.
    pub(crate) fn per_pixel(&self) -> usize {
        self.strata[0] as usize * self.strata[1] as usize
    }
}

/// The samples of a rectangle of pixels: pixels row by row, the samples of a pixel side by side.
#[derive(Clone, Debug)]
pub(crate) struct SampleGrid {
    /// Pixels, in absolute raster coordinates; may reach beyond the image.
    pub(crate) rect: PixelRect,
    /// Samples of a pixel.
    pub(crate) per_pixel: usize,
    /// Place inside the pixel, 0 to 1.
    pub(crate) fx: Vec<f32>,
    /// Place inside the pixel, 0 to 1.
    pub(crate) fy: Vec<f32>,
    /// Absolute raster place.
    pub(crate) x: Vec<f32>,
    /// Absolute raster place.
    pub(crate) y: Vec<f32>,
    /// Time, from shutter open to close; empty without motion blur.
    pub(crate) time: Vec<f32>,
    /// Shutter open and close.
    pub(crate) shutter: [f32; 2],
    /// The samples of a pixel in order of their times: sample `by_time[pixel * per_pixel + k]` of the pixel is in the
    /// k-th of `per_pixel` equal parts of the shutter. Empty without motion blur.
    pub(crate) by_time: Vec<u32>,
    /// Point on the lens in camera space; empty without depth of field.
    pub(crate) lens: Vec<[f32; 2]>,
}

impl SampleGrid {
    /// The samples of `rect`.
    pub(crate) fn new(rect: PixelRect, pattern: &SamplePattern, camera: &CameraView) -> Self {
        let per_pixel = pattern.per_pixel();
        let total = rect.width() * rect.height() * per_pixel;
        let mut grid = Self {
            rect,
            per_pixel,
            fx: Vec::with_capacity(total),
            fy: Vec::with_capacity(total),
            x: Vec::with_capacity(total),
            y: Vec::with_capacity(total),
            time: Vec::new(),
            shutter: camera.shutter,
            by_time: Vec::new(),
            lens: Vec::new(),
        };
        let n = u32::try_from(per_pixel).unwrap_or(u32::MAX);
        let radius = camera.lens.map_or(0.0, |l| l.radius);
        let [open, close] = camera.shutter;
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let seed = |d: Dimension| hash::words(&[x.cast_unsigned(), y.cast_unsigned(), d as u32]);
                let place = seed(Dimension::Place);
                for s in 0..n {
                    let (fx, fy) = jittered(s, pattern.strata, place);
                    grid.fx.push(fx);
                    grid.fy.push(fy);
                    grid.x.push(x as f32 + fx);
                    grid.y.push(y as f32 + fy);
                }
                if pattern.blur {
                    let seed = seed(Dimension::Time);
                    let first = grid.by_time.len();
                    grid.by_time.resize(first + per_pixel, 0);
                    grid.time.extend((0..n).map(|s| {
                        let stratum = sample::permute(s, n, seed);
                        grid.by_time[first + stratum as usize] = s;
                        let t = (stratum as f32 + hash::unit(hash::words(&[seed, s]))) / n as f32;
                        open + (close - open) * t
                    }));
                }
                if pattern.defocus {
                    let seed = seed(Dimension::Lens);
                    grid.lens.extend((0..n).map(|s| {
                        // Shuffled, so that lens and place are not related.
                        let (a, b) = jittered(sample::permute(s, n, seed), pattern.strata, seed);
                        disk(a, b).map(|c| c * radius)
                    }));
                }
            }
        }
        grid
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.x.len()
    }

    /// Number of pixels.
    pub(crate) fn pixels(&self) -> usize {
        self.rect.width() * self.rect.height()
    }

    /// Number of equal parts of the shutter that have one sample of every pixel each; 1 without motion blur.
    pub(crate) fn time_strata(&self) -> usize {
        if self.by_time.is_empty() { 1 } else { self.per_pixel }
    }

    /// The time at which a part begins, or at which the last one ends.
    pub(crate) fn stratum_time(&self, stratum: usize) -> f32 {
        let [open, close] = self.shutter;
        open + (close - open) * (stratum as f32 / self.time_strata() as f32)
    }

    /// Indices of the samples of a pixel that are in the given parts of the shutter.
    pub(crate) fn within(
        &self,
        pixel: usize,
        strata: &std::ops::Range<usize>,
    ) -> impl Iterator<Item = usize> {
        let first = pixel * self.per_pixel;
        let (listed, all) = match self.by_time.get(first + strata.start..first + strata.end) {
            Some(listed) => (listed, 0..0),
            None => (&[][..], 0..self.per_pixel),
        };
        listed.iter().map(|s| *s as usize).chain(all).map(move |s| first + s)
    }

    /// Index of a pixel inside the rectangle.
    pub(crate) fn pixel(&self, x: i32, y: i32) -> usize {
        (y - self.rect.y0) as usize * self.rect.width() + (x - self.rect.x0) as usize
    }
}

/// Point `s` of a correlated multi-jittered pattern of `nx x ny` strata (Kensler, Correlated Multi-Jittered
/// Sampling, Pixar technical memo 13-01, 2013): stratified in both dimensions together and in each alone.
fn jittered(s: u32, [nx, ny]: [u32; 2], seed: u32) -> (f32, f32) {
    let (i, j) = (s % nx, s / nx);
    let sx = sample::permute(i, nx, hash::mix32(seed ^ 0xa511_e9b3));
    let sy = sample::permute(j, ny, hash::mix32(seed ^ 0x63d8_3595));
    let jx = hash::unit(hash::words(&[seed, s, 0]));
    let jy = hash::unit(hash::words(&[seed, s, 1]));
    let x = (i as f32 + (sy as f32 + jx) / ny as f32) / nx as f32;
    let y = (j as f32 + (sx as f32 + jy) / nx as f32) / ny as f32;
    const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
    (x.min(BELOW_ONE), y.min(BELOW_ONE))
}

/// The unit square onto the unit disk (Shirley and Chiu, A Low Distortion Map Between Disk and Square, 1997).
fn disk(a: f32, b: f32) -> [f32; 2] {
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};
    let (x, y) = (2.0 * a - 1.0, 2.0 * b - 1.0);
    if x == 0.0 && y == 0.0 {
        return [0.0; 2];
    }
    let (r, phi) =
        if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, FRAC_PI_2 - FRAC_PI_4 * (x / y)) };
    [r * phi.cos(), r * phi.sin()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strata_are_filled_in_two_and_in_one_dimension() {
        let strata = [4, 3];
        for seed in [0, 1, 99] {
            let points: Vec<_> = (0..12).map(|s| jittered(s, strata, seed)).collect();
            let count = |nx: usize, ny: usize| {
                let mut cells = vec![0; nx * ny];
                for (x, y) in &points {
                    cells[(x * nx as f32) as usize + nx * (y * ny as f32) as usize] += 1;
                }
                cells.iter().all(|c| *c == 1)
            };
            assert!(count(4, 3) && count(12, 1) && count(1, 12), "seed {seed}");
        }
    }

    #[test]
    fn the_disk_is_filled_evenly() {
        let mut inside = 0;
        for i in 0..10_000 {
            let (a, b) = sample::square(i, 5);
            let [x, y] = disk(a, b);
            assert!(x * x + y * y <= 1.0 + 1e-5);
            inside += usize::from(x * x + y * y < 0.25);
        }
        assert!((2400..2600).contains(&inside), "{inside}");
    }
}
