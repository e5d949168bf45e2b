//! Positions, times and lens points of the samples of a rectangle of pixels.

use granita_base::sample::{self, Sequence};
use granita_base::{NoiseSource, PassNumbers, hash};
use granita_dicing::{CameraView, PixelRect};
use std::sync::Arc;

/// The dimensions of a sample that are hashed separately.
#[derive(Clone, Copy)]
#[repr(u32)]
enum Dimension {
    Place = 1,
    Time = 2,
    Lens = 3,
}

/// The number of samples of a pixel, and the dimensions in which they vary.
#[derive(Clone, Debug)]
pub struct SamplePattern {
    /// The number of strata across and down a pixel.
    pub strata: [u32; 2],
    /// The strata of a pixel in which nothing blurs. Equal to `strata` unless "limits:autopassreduction" saves
    /// samples.
    pub still_strata: [u32; 2],
    /// True when samples differ in time.
    pub blur: bool,
    /// True when samples differ in their lens point.
    pub defocus: bool,
    /// The patterns from which pixels choose.
    pub tables: Arc<Tables>,
}

/// Patterns of samples. Every pixel takes one pattern of each kind, chosen by a hash of its position, so that
/// patterns differ from pixel to pixel without being computed for each pixel. All lists are [`SampleGrid::PADDING`]
/// longer than the number of samples.
#[derive(Clone, Debug, Default)]
pub struct Tables {
    /// Positions across the pixel, 0 to 1, pattern by pattern. The patterns of whole pixels come first, then those of
    /// still pixels.
    pub fx: Vec<f32>,
    /// Positions down the pixel, 0 to 1.
    pub fy: Vec<f32>,
    /// Times, pattern by pattern. Sample `k` of `n` is in the k-th of `n` equal parts of the shutter.
    pub time: Vec<f32>,
    /// The x coordinates of points on the lens, in camera space units.
    pub lens_x: Vec<f32>,
    /// The y coordinates of points on the lens, in camera space units.
    pub lens_y: Vec<f32>,
    /// The boxes (x0, x1, y0, y1) around the lens points of each group of eight consecutive samples, over all
    /// patterns.
    pub lens_boxes: Vec<[f32; 4]>,
}

/// Returns the number of patterns of `n` samples in a table, a power of two. It is limited, so that the tables stay
/// small.
fn variants(n: u32) -> u32 {
    ((1 << 13) / n).clamp(16, 256).next_power_of_two()
}

/// Returns the sequence of a pattern in a table, for a number of a pass and its round.
fn sequence_of(variant: u32, dimension: Dimension, [number, round]: [u32; 2]) -> Sequence {
    let seed = match number {
        0 => hash::words(&[variant, dimension as u32]),
        _ => hash::words(&[variant, dimension as u32, number]),
    };
    Sequence { seed, round }
}

impl SamplePattern {
    /// Returns the pattern of a camera. `moving` is true when anything in the whole scene moves. The crop must not
    /// affect it.
    ///
    /// "temporalquality" and "dofquality" are the least numbers of different values in a pixel. Where they are larger
    /// than what `spatialquality` gives, pixels get more samples. A quality of 1 turns the blur off.
    pub fn new(camera: &CameraView, moving: bool) -> Self {
        Self::of_pass(camera, moving, PassNumbers::default())
    }

    /// Returns the pattern of a camera for one pass of an image that is the sum of several. The rounds of a set of
    /// numbers fill the strata of a pixel evenly. Different sets are independent of each other. The first pass has the
    /// pattern of [`SamplePattern::new`].
    pub fn of_pass(camera: &CameraView, moving: bool, numbers: PassNumbers) -> Self {
        let [place, time, at_lens] = [NoiseSource::Edges, NoiseSource::Motion, NoiseSource::Lens]
            .map(|source| [numbers.number(source), numbers.round]);
        let blur = Self::blurs(camera, moving);
        let defocus = camera.has_depth_of_field();
        let least = u64::from(1.max(if blur { camera.temporalquality } else { 1 }).max(if defocus {
            camera.dofquality
        } else {
            1
        }));
        let asked = camera.spatialquality;
        let [mut x, mut y] = asked;
        // The ratio of the strata stays close to the requested one.
        while u64::from(x) * u64::from(y) < least {
            if x <= y { x += 1 } else { y += 1 }
        }
        let strata = [x, y];
        let still_strata = if camera.autopassreduction { asked } else { strata };
        let n = x * y;
        let mut tables = Tables::default();
        tables.add_places(strata, blur, place);
        if still_strata != strata {
            tables.add_places(still_strata, false, place);
        }
        if blur {
            tables.add_times(n, camera.shutter, time);
        }
        if let Some(lens) = camera.lens.filter(|_| defocus) {
            tables.add_lens(strata, lens.radius, blur, at_lens);
        }
        let Tables { fx, fy, time, lens_x, lens_y, .. } = &mut tables;
        for list in [fx, fy, time, lens_x, lens_y] {
            list.extend([0.0; SampleGrid::PADDING]);
        }
        Self { strata, still_strata, blur, defocus, tables: Arc::new(tables) }
    }

    /// True when samples differ in time.
    pub fn blurs(camera: &CameraView, moving: bool) -> bool {
        moving && camera.has_motion_blur() && camera.temporalquality > 1
    }

    /// The number of samples of a pixel.
    pub fn per_pixel(&self) -> usize {
        self.strata[0] as usize * self.strata[1] as usize
    }

    /// The number of samples of a pixel in which nothing blurs.
    fn per_still_pixel(&self) -> usize {
        self.still_strata[0] as usize * self.still_strata[1] as usize
    }

    /// True when pixels in which nothing blurs have fewer samples.
    pub fn is_reducible(&self) -> bool {
        self.strata != self.still_strata
    }
}

impl Tables {
    /// Adds the positions of samples. `is_sorted` is true when their order is that of their times. They are then spread
    /// evenly over each part of the shutter.
    fn add_places(&mut self, strata: [u32; 2], is_sorted: bool, numbers: [u32; 2]) {
        let n = strata[0] * strata[1];
        for variant in 0..variants(n) {
            let sequence = sequence_of(variant, Dimension::Place, numbers);
            for k in 0..n {
                let stratum = if is_sorted { sequence.cell(k, strata) } else { sequence.shuffled(k, n) };
                let (fx, fy) = jittered(stratum, strata, sequence);
                self.fx.push(fx);
                self.fy.push(fy);
            }
        }
    }

    fn add_times(&mut self, n: u32, [open, close]: [f32; 2], numbers: [u32; 2]) {
        for variant in 0..variants(n) {
            let sequence = sequence_of(variant, Dimension::Time, numbers);
            self.time.extend((0..n).map(|k| {
                let within = hash::unit(sequence.dimension(k).seed);
                let t = (k as f32 + sequence.moved_on_line(within)) / n as f32;
                open + (close - open) * t
            }));
        }
    }

    /// Adds the lens points of a pattern. `is_shuffled` is true when the order of samples is that of their times.
    fn add_lens(&mut self, strata: [u32; 2], radius: f32, is_shuffled: bool, numbers: [u32; 2]) {
        let n = strata[0] * strata[1];
        for variant in 0..variants(n) {
            let sequence = sequence_of(variant, Dimension::Lens, numbers);
            for k in 0..n {
                let k = if is_shuffled { sequence.shuffled(k, n) } else { k };
                let (a, b) = jittered(k, strata, sequence);
                let [x, y] = disk(a, b);
                self.lens_x.push(x * radius);
                self.lens_y.push(y * radius);
            }
        }
        let nowhere = [f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY, f32::NEG_INFINITY];
        self.lens_boxes = vec![nowhere; n.div_ceil(8) as usize];
        for (i, (x, y)) in self.lens_x.iter().zip(&self.lens_y).enumerate() {
            let [x0, x1, y0, y1] = &mut self.lens_boxes[i % n as usize / 8];
            (*x0, *x1) = (x0.min(*x), x1.max(*x));
            (*y0, *y1) = (y0.min(*y), y1.max(*y));
        }
    }
}

/// The samples of a rectangle of pixels. Pixels are stored row by row, with the samples of a pixel together.
#[derive(Clone, Debug)]
pub struct SampleGrid {
    /// The pixels in absolute raster coordinates. They may reach beyond the image.
    pub rect: PixelRect,
    /// The distance between the first samples of neighbouring pixels, which is the largest number of samples of a
    /// pixel.
    pub per_pixel: usize,
    /// The number of samples of each pixel in which nothing blurs.
    per_still_pixel: usize,
    /// The absolute raster x of each sample, and [`SampleGrid::PADDING`] more.
    pub x: Vec<f32>,
    /// The absolute raster y of each sample, and as many more.
    pub y: Vec<f32>,
    /// The times at which the shutter opens and closes.
    pub shutter: [f32; 2],
    /// The patterns.
    pub tables: Arc<Tables>,
    /// For each pixel: the index in the tables at which its positions begin.
    places: Vec<u32>,
    /// For each pixel: the index at which its times begin, from shutter open to close. Sample `k` of a pixel is in
    /// the k-th of `per_pixel` equal parts of the shutter. Empty without motion blur.
    pub times: Vec<u32>,
    /// For each pixel: the index at which its lens points begin. Empty without depth of field.
    pub lenses: Vec<u32>,
    /// Positions from this index on belong to still pixels.
    still_from: u32,
    /// 2^32 / `per_pixel`, rounded up; 0 where products with it are not exact enough for [`SampleGrid::pixel_of`].
    reciprocal: u64,
}

impl SampleGrid {
    /// The number of values that may be read beyond the last sample.
    pub const PADDING: usize = 8;

    /// Returns the samples of `rect`. `blurred` holds the pixels in which anything may blur. The other pixels have
    /// fewer samples where the pattern allows it.
    pub fn new(rect: PixelRect, pattern: &SamplePattern, camera: &CameraView, blurred: &[PixelRect]) -> Self {
        let per_pixel = pattern.per_pixel();
        let pixels = rect.width() * rect.height();
        let total = pixels * per_pixel + Self::PADDING;
        let tables = &*pattern.tables;
        let count = |strata: [u32; 2]| strata[0] * strata[1];
        let [some, few] = [pattern.strata, pattern.still_strata].map(|s| variants(count(s)));
        let still_from = some * per_pixel as u32;
        let mut grid = Self {
            rect,
            per_pixel,
            per_still_pixel: pattern.per_still_pixel(),
            x: Vec::with_capacity(total),
            y: Vec::with_capacity(total),
            shutter: camera.shutter,
            tables: pattern.tables.clone(),
            places: Vec::with_capacity(pixels),
            times: Vec::with_capacity(if pattern.blur { pixels } else { 0 }),
            lenses: Vec::with_capacity(if pattern.defocus { pixels } else { 0 }),
            still_from,
            reciprocal: reciprocal(pixels, per_pixel),
        };
        let mut still = vec![pattern.is_reducible(); pixels];
        for part in blurred.iter().filter(|_| pattern.is_reducible()) {
            let part = part.intersection(&rect);
            for y in part.y0..part.y1 {
                let row = grid.pixel(part.x0, y);
                still[row..row + part.width()].fill(false);
            }
        }
        let mut still = still.into_iter();
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let choose = |d: Dimension, variants: u32| {
                    let h = hash::words(&[x.cast_unsigned(), y.cast_unsigned(), d as u32]);
                    (h & (variants - 1)) as usize
                };
                let (first, n) = match still.next() {
                    Some(true) => {
                        let n = grid.per_still_pixel;
                        (still_from as usize + choose(Dimension::Place, few) * n, n)
                    }
                    _ => (choose(Dimension::Place, some) * per_pixel, per_pixel),
                };
                grid.places.push(first as u32);
                let (x0, y0) = (x as f32, y as f32);
                grid.x.extend(tables.fx[first..first + n].iter().map(|fx| x0 + fx));
                grid.y.extend(tables.fy[first..first + n].iter().map(|fy| y0 + fy));
                let end = grid.places.len() * per_pixel;
                grid.x.resize(end, f32::NAN);
                grid.y.resize(end, f32::NAN);
                let first = |d| (choose(d, some) * per_pixel) as u32;
                if pattern.blur {
                    grid.times.push(first(Dimension::Time));
                }
                if pattern.defocus {
                    grid.lenses.push(first(Dimension::Lens));
                }
            }
        }
        // The padding has no position.
        for list in [&mut grid.x, &mut grid.y] {
            list.extend([f32::NAN; Self::PADDING]);
        }
        grid
    }

    /// The length of the list of samples. Pixels with fewer samples leave the rest of their entries without a
    /// position.
    pub fn len(&self) -> usize {
        self.pixels() * self.per_pixel
    }

    /// True when there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.rect.width() * self.rect.height()
    }

    /// The number of samples of a pixel.
    #[inline(always)]
    pub fn count(&self, pixel: usize) -> usize {
        if self.places[pixel] < self.still_from { self.per_pixel } else { self.per_still_pixel }
    }

    /// True when some pixels may have fewer samples than others.
    #[inline(always)]
    pub fn varies(&self) -> bool {
        self.per_still_pixel != self.per_pixel
    }

    /// The number of samples of all pixels in a rectangle inside of this one.
    pub fn within(&self, rect: &PixelRect) -> usize {
        let row = |y| (0..rect.width()).map(move |i| self.count(self.pixel(rect.x0, y) + i)).sum::<usize>();
        (rect.y0..rect.y1).map(row).sum()
    }

    /// Returns the index in the tables at which the positions of a pixel begin.
    #[inline(always)]
    pub fn places(&self, pixel: usize) -> usize {
        self.places[pixel] as usize
    }

    /// The number of equal parts of the shutter that have one sample of every pixel each; 1 without motion blur.
    #[inline(always)]
    pub fn time_strata(&self) -> usize {
        if self.times.is_empty() { 1 } else { self.per_pixel }
    }

    /// Returns the time of a sample.
    pub fn time(&self, sample: usize) -> f32 {
        let (pixel, k) = (sample / self.per_pixel, sample % self.per_pixel);
        self.times.get(pixel).map_or(self.shutter[0], |first| self.tables.time[*first as usize + k])
    }

    /// Returns the time at which a stratum of the shutter begins, or at which the last one ends.
    pub fn stratum_time(&self, stratum: usize) -> f32 {
        let [open, close] = self.shutter;
        open + (close - open) * (stratum as f32 / self.time_strata() as f32)
    }

    /// Calls `each` with the samples of some pixels inside of the rectangle, in runs of neighbours.
    #[inline(always)]
    pub fn each_run(&self, rect: PixelRect, mut each: impl FnMut(std::ops::Range<usize>)) {
        // A run is a row, or a pixel when the numbers of samples vary.
        let rows = !self.varies();
        let columns = if rows { 1 } else { rect.width() as i32 };
        for y in rect.y0..rect.y1 {
            for column in 0..columns {
                let pixel = self.pixel(rect.x0 + column, y);
                let first = pixel * self.per_pixel;
                let len = if rows { rect.width() * self.per_pixel } else { self.count(pixel) };
                each(first..first + len);
            }
        }
    }

    /// Returns the index of the pixel of a sample.
    #[inline(always)]
    pub fn pixel_of(&self, sample: usize) -> usize {
        match self.reciprocal {
            0 => sample / self.per_pixel,
            // A product takes less time than a division.
            reciprocal => ((sample as u64 * reciprocal) >> 32) as usize,
        }
    }

    /// Returns the index of a pixel inside of the rectangle.
    #[inline(always)]
    pub fn pixel(&self, x: i32, y: i32) -> usize {
        (y - self.rect.y0) as usize * self.rect.width() + (x - self.rect.x0) as usize
    }
}

/// Returns a number `r` for which `s * r >> 32` is `s / per_pixel` for all samples `s` of the pixels; 0 when there is
/// none. The product exceeds the quotient by less than `s / 2^32`, which must not reach the next integer.
fn reciprocal(pixels: usize, per_pixel: usize) -> u64 {
    let (pixels, n) = (pixels as u64, per_pixel as u64);
    let most = pixels.checked_mul(n).and_then(|samples| samples.checked_mul(n));
    if most.is_some_and(|most| most < 1 << 32) { (1 << 32) / n + 1 } else { 0 }
}

/// Returns point `s` of a correlated multi-jittered pattern of `nx x ny` strata (Kensler, Correlated Multi-Jittered
/// Sampling, Pixar technical memo 13-01, 2013). The pattern is stratified in both dimensions together and in each
/// alone.
fn jittered(s: u32, [nx, ny]: [u32; 2], sequence: Sequence) -> (f32, f32) {
    let Sequence { seed, .. } = sequence;
    let (i, j) = (s % nx, s / nx);
    let sx = sample::permute(i, nx, hash::mix32(seed ^ 0xa511_e9b3));
    let sy = sample::permute(j, ny, hash::mix32(seed ^ 0x63d8_3595));
    let jx = hash::unit(hash::words(&[seed, s, 0]));
    let jy = hash::unit(hash::words(&[seed, s, 1]));
    let [x, y] = sequence.moved([(sy as f32 + jx) / ny as f32, (sx as f32 + jy) / nx as f32]);
    let (x, y) = ((i as f32 + x) / nx as f32, (j as f32 + y) / ny as f32);
    const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
    (x.min(BELOW_ONE), y.min(BELOW_ONE))
}

/// Maps the unit square to the unit disk (Shirley and Chiu, A Low Distortion Map Between Disk and Square, 1997).
fn disk(a: f32, b: f32) -> [f32; 2] {
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};
    let (x, y) = (2.0 * a - 1.0, 2.0 * b - 1.0);
    if x == 0.0 && y == 0.0 {
        return [0.0; 2];
    }
    let (r, phi) =
        if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, FRAC_PI_2 - FRAC_PI_4 * (x / y)) };
    [r * libm::cosf(phi), r * libm::sinf(phi)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_stratified_in_two_and_in_one_dimension() {
        let strata = [4, 3];
        for seed in [0, 1, 99] {
            let points: Vec<_> = (0..12).map(|s| jittered(s, strata, Sequence::new(seed))).collect();
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
    fn rounds_fill_the_strata_of_a_pixel() {
        let of = |round| {
            let mut tables = Tables::default();
            tables.add_places([4, 4], true, [0, round]);
            tables.add_times(16, [0.0, 1.0], [0, round]);
            tables.add_lens([4, 4], 1.0, true, [0, round]);
            tables
        };
        let rounds: Vec<Tables> = (0..4).map(of).collect();
        let is_full = |cells: Vec<usize>, n: usize| {
            let mut seen = vec![false; n];
            cells.iter().for_each(|cell| seen[*cell] = true);
            cells.len() == n && !seen.contains(&false)
        };
        // Of each pattern, the samples of four rounds are in all cells of 8 x 8, and in all 64 parts of the shutter.
        for first in (0..rounds[0].fx.len()).step_by(16) {
            let all = || rounds.iter().flat_map(|t| (first..first + 16).map(move |k| (t, k)));
            let cell = |(t, k): (&Tables, usize)| (t.fx[k] * 8.0) as usize + 8 * (t.fy[k] * 8.0) as usize;
            assert!(is_full(all().map(cell).collect(), 64), "{first}");
            assert!(is_full(all().map(|(t, k)| (t.time[k] * 64.0) as usize).collect(), 64), "{first}");
            // Sample k has the k-th part of the shutter in each round, and other places.
            let part = |t: &Tables| (first..first + 16).all(|k| (t.time[k] * 16.0) as usize == k - first);
            assert!(rounds.iter().all(part));
            let stratum = |t: &Tables, k: usize| (t.fx[k] * 4.0) as usize + 4 * (t.fy[k] * 4.0) as usize;
            let same = (first..first + 16).filter(|k| stratum(&rounds[0], *k) == stratum(&rounds[1], *k));
            assert_eq!(same.count(), 0, "{first}");
        }
    }

    #[test]
    fn the_pixel_of_a_sample_is_a_quotient() {
        for (pixels, n) in [(1156, 16), (1156, 1), (7, 3), (1156, 1927), (40_000, 99), (1, 4096)] {
            let r = reciprocal(pixels, n);
            assert!(r > 0, "{pixels} x {n}");
            let samples = (0..pixels * n).filter(|s| s % n < 2 || (s + 1) % n < 2);
            for s in samples {
                assert_eq!((s as u64 * r) >> 32, (s / n) as u64, "{s} of {pixels} x {n}");
            }
        }
        assert_eq!([reciprocal(1156, 1928), reciprocal(usize::MAX, 3)], [0, 0]);
    }

    #[test]
    fn passes_have_other_samples_and_the_first_one_has_those_of_a_frame() {
        let camera = granita_scene::Camera {
            name: "main".into(),
            world_to_camera: Default::default(),
            params: granita_base::Params::new(),
        };
        let camera = CameraView::new(&camera, &granita_base::Reporter::silent());
        let places = |pattern: SamplePattern| (pattern.tables.fx.clone(), pattern.tables.fy.clone());
        let frame = places(SamplePattern::new(&camera, false));
        assert!(frame == places(SamplePattern::of_pass(&camera, false, PassNumbers::default())));
        let (first, second) = (1..3)
            .map(|k| places(SamplePattern::of_pass(&camera, false, PassNumbers::of(k))))
            .fold((Vec::new(), Vec::new()), |(mut x, mut y), (fx, fy)| {
                x.extend(fx.iter().take(64).map(|x| x.to_bits()));
                y.extend(fy.iter().take(64).map(|y| y.to_bits()));
                (x, y)
            });
        let of_frame: Vec<u32> = frame.0.iter().take(64).map(|x| x.to_bits()).collect();
        assert!(first[..64] != of_frame[..] && first[..64] != first[64..] && second[..64] != second[64..]);
    }

    #[test]
    fn samples_of_the_disk_are_uniform() {
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
