//! Resamples rows as they arrive, which makes a MIP level from the one before it.

use crate::image::{Taps, solid_taps, taps};
use crate::{TextureKind, Wrap};
use granita_base::Filter;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;

/// The weight of rows when they are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Measure {
    /// The weight is the height of a row.
    Plane,
    /// The weight is the solid angle of a row of a latitude-longitude map.
    LatLong,
}

impl Measure {
    /// Returns the measure for maps of a kind.
    pub(crate) fn of(kind: TextureKind) -> Self {
        if kind == TextureKind::LatLongEnvironment { Self::LatLong } else { Self::Plane }
    }
}

/// The input and the output of a stage.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resample {
    pub(crate) from: (usize, usize),
    pub(crate) to: (usize, usize),
    pub(crate) channels: usize,
    pub(crate) filter: Filter,
    pub(crate) wrap: (Wrap, Wrap),
    pub(crate) measure: Measure,
}

/// The filter across a row.
enum Across {
    Same,
    Halved,
    Any(Vec<Taps>),
}

/// Receives rows from the top, returns rows from the top, and keeps only those that are still needed.
pub(crate) struct Stage {
    shape: Resample,
    across: Across,
    down: Vec<Taps>,
    /// The last input row that each output row needs, among those that are not in `apart`.
    last: Vec<usize>,
    /// The first input row that each output row or a later one needs, among those that are not in `apart`.
    first_needed: Vec<usize>,
    /// The input rows that are kept, filtered across, from row `base` on.
    window: Vec<f32>,
    base: usize,
    next: usize,
    /// Rows of the other end, which rows near an end need where the image repeats, filtered across. They exist only
    /// after [`Stage::preload`].
    apart: BTreeMap<usize, Vec<f32>>,
    /// Input rows above this one are also put into `apart` as they arrive.
    head: usize,
}

/// Computes the means of neighbours in a row of pixels of `N` channels.
fn halve<const N: usize>(from: &[f32], to: &mut [f32]) {
    for (to, from) in to.as_chunks_mut::<N>().0.iter_mut().zip(from.chunks_exact(2 * N)) {
        for c in 0..N {
            to[c] = (from[c] + from[N + c]) * 0.5;
        }
    }
}

/// Sets `to` to the weighted sum of rows, which is exact where all are equal.
fn combine(rows: &[(&[f32], f32)], taps: &Taps, to: &mut [f32]) {
    match rows {
        [(a, _)] => to.copy_from_slice(a),
        [(a, _), (b, w)] if (0.0..=1.0).contains(w) => {
            for ((to, a), b) in to.iter_mut().zip(*a).zip(*b) {
                *to = a + w * (b - a);
            }
        }
        _ => {
            for (x, to) in to.iter_mut().enumerate() {
                *to = taps.apply_to(rows.len(), |i| rows[i].0[x]);
            }
        }
    }
}

impl Stage {
    pub(crate) fn new(shape: Resample) -> Self {
        let Resample { from, to, filter, wrap, measure, .. } = shape;
        let across = if from.0 == to.0 {
            Across::Same
        } else if filter == Filter::Box && from.0 == 2 * to.0 {
            Across::Halved
        } else {
            Across::Any(taps(from.0, to.0, filter, wrap.0))
        };
        let down = match measure {
            _ if from.1 == to.1 => (0..to.1).map(Taps::one).collect(),
            Measure::Plane => taps(from.1, to.1, filter, wrap.1),
            Measure::LatLong => solid_taps(from.1, to.1),
        };
        let last = down.iter().map(Taps::last).collect();
        let first_needed = needed_from(down.iter().map(Taps::first).collect());
        let (apart, head) = (BTreeMap::new(), 0);
        Self { shape, across, down, last, first_needed, window: Vec::new(), base: 0, next: 0, apart, head }
    }

    /// True when input row `i` is at the other end than output row `o`.
    fn is_far(&self, o: usize, i: usize) -> bool {
        let (from, to) = (self.shape.from.1, self.shape.to.1);
        // This is twice the distance of their centres, in input rows times `to`.
        ((2 * i + 1) * to).abs_diff((2 * o + 1) * from) > from * to
    }

    /// Returns the input rows at the end that the first output rows need, where the image repeats. Without
    /// [`Stage::preload`] all rows are kept until these arrive. Returns `None` where there are no such rows, or where
    /// the image is so low that keeping all of it costs little.
    pub(crate) fn tail(&self) -> Option<Range<usize>> {
        /// The height in rows below which an image is kept as a whole.
        const LOW: usize = 64;
        let from = self.shape.from.1;
        if self.shape.wrap.1 != Wrap::Periodic || from < LOW {
            return None;
        }
        let upper = self.down.iter().take(self.down.len() / 2).enumerate();
        let far = upper.flat_map(|(o, taps)| taps.iter().map(move |(i, _)| (o, i)));
        let first = far.filter(|(o, i)| self.is_far(*o, *i)).map(|(_, i)| i).min()?;
        (first > from / 2).then_some(first..from)
    }

    /// Adds the rows of [`Stage::tail`] before all others. They are added again in their order.
    pub(crate) fn preload(&mut self, first: usize, rows: &[f32]) {
        let to = self.shape.to.0 * self.shape.channels;
        let mut filtered = vec![0.0; rows.len() / (self.shape.from.0 * self.shape.channels) * to];
        self.filter_across(rows, &mut filtered);
        self.apart = (first..).zip(filtered.chunks(to).map(<[f32]>::to_vec)).collect();
        let this = &*self;
        let near = |o: usize| this.down[o].iter().map(|t| t.0).filter(move |&i| !this.is_far(o, i));
        let (mut firsts, mut lasts, mut head) = (Vec::new(), Vec::new(), 0);
        for (o, taps) in this.down.iter().enumerate() {
            firsts.push(near(o).min().unwrap_or(this.shape.from.1));
            lasts.push(near(o).max().unwrap_or(0));
            if o >= this.down.len() / 2 {
                let far = taps.iter().map(|t| t.0).filter(|&i| this.is_far(o, i));
                head = far.map(|i| i + 1).max().unwrap_or(0).max(head);
            }
        }
        (self.first_needed, self.last, self.head) = (needed_from(firsts), lasts, head);
    }

    fn filter_across(&self, rows: &[f32], out: &mut [f32]) {
        let n = self.shape.channels;
        let (from, to) = (self.shape.from.0 * n, self.shape.to.0 * n);
        let across = &self.across;
        out.par_chunks_mut(to).zip(rows.par_chunks(from)).for_each(|(to, from)| match across {
            Across::Same => to.copy_from_slice(from),
            Across::Halved => match n {
                1 => halve::<1>(from, to),
                2 => halve::<2>(from, to),
                3 => halve::<3>(from, to),
                4 => halve::<4>(from, to),
                _ => {
                    for (to, from) in to.chunks_exact_mut(n).zip(from.chunks_exact(2 * n)) {
                        for c in 0..n {
                            to[c] = (from[c] + from[n + c]) * 0.5;
                        }
                    }
                }
            },
            Across::Any(taps) => {
                for (x, t) in taps.iter().enumerate() {
                    for c in 0..n {
                        to[x * n + c] = t.apply(|i| from[i * n + c]);
                    }
                }
            }
        });
    }

    /// Adds whole rows. Returns the rows that can be computed now.
    pub(crate) fn push(&mut self, rows: &[f32]) -> Vec<f32> {
        let n = self.shape.channels;
        let (from, to) = (self.shape.from.0 * n, self.shape.to.0 * n);
        let start = self.window.len();
        let mut window = std::mem::take(&mut self.window);
        window.resize(start + rows.len() / from * to, 0.0);
        self.filter_across(rows, &mut window[start..]);
        let first = self.base + start / to;
        for (i, row) in (first..self.head).zip(window[start..].chunks(to)) {
            self.apart.insert(i, row.to_vec());
        }
        let end = self.base + window.len() / to;
        let last = self.last[self.next..].iter().take_while(|last| **last < end).count() + self.next;
        let mut out = vec![0.0; (last - self.next) * to];
        let this = &*self;
        out.par_chunks_mut(to).enumerate().for_each(|(k, out)| {
            let (o, base) = (this.next + k, this.base);
            let row = |i: usize| match this.apart.get(&i) {
                Some(row) if this.is_far(o, i) => row.as_slice(),
                _ => &window[(i - base) * to..][..to],
            };
            let rows: Vec<(&[f32], f32)> = this.down[o].iter().map(|(i, w)| (row(i), w)).collect();
            combine(&rows, &this.down[o], out);
        });
        self.window = window;
        self.next = last;
        let keep = self.first_needed.get(last).copied().unwrap_or(end).clamp(self.base, end);
        self.window.drain(..(keep - self.base) * to);
        self.base = keep;
        out
    }
}

/// Replaces each number by the least of it and those that follow.
fn needed_from(mut firsts: Vec<usize>) -> Vec<usize> {
    for i in (1..firsts.len()).rev() {
        firsts[i - 1] = firsts[i - 1].min(firsts[i]);
    }
    firsts
}

/// The memory that a [`Stage`] will hold, found by counting rows.
pub(crate) struct Forecast<'a> {
    stage: &'a Stage,
    base: usize,
    end: usize,
    next: usize,
    /// The largest number of rows held at once, and the largest number of bytes, including those of output rows.
    peak_rows: usize,
    peak_bytes: u64,
}

impl<'a> Forecast<'a> {
    pub(crate) fn new(stage: &'a Stage) -> Self {
        Self { stage, base: 0, end: 0, next: 0, peak_rows: 0, peak_bytes: 0 }
    }

    /// Returns the largest number of bytes held when it grows with the height of the image, and otherwise 0.
    pub(crate) fn growing_bytes(&self) -> u64 {
        /// The number of rows that may be held at any height, because rows arrive in portions and some wait for those
        /// below.
        const FEW: usize = 512;
        let all = self.peak_rows >= self.stage.shape.from.1;
        if all && self.peak_rows > FEW { self.peak_bytes } else { 0 }
    }

    /// Does the same as [`Stage::push`] of so many rows. Returns the number of output rows.
    pub(crate) fn push(&mut self, rows: usize) -> usize {
        let stage = self.stage;
        self.end += rows;
        let last = stage.last[self.next..].iter().take_while(|last| **last < self.end).count() + self.next;
        let out = last - self.next;
        let row = (stage.shape.to.0 * stage.shape.channels * size_of::<f32>()) as u64;
        // Output rows are in memory as floats, as a copy for conversion, and as stored values.
        let held = (self.end - self.base + stage.head) as u64 + 3 * out as u64;
        self.peak_bytes = self.peak_bytes.max(held * row);
        self.peak_rows = self.peak_rows.max(self.end - self.base);
        self.next = last;
        self.base = stage.first_needed.get(last).copied().unwrap_or(self.end).clamp(self.base, self.end);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    fn noise(width: usize, height: usize, channels: usize) -> Image {
        let mut p = Image::new(width, height, channels);
        for (i, v) in p.data.iter_mut().enumerate() {
            *v = granita_base::hash::unit(granita_base::hash::words(&[i as u32]));
        }
        p
    }

    /// The result is that of the whole image for all portions of rows.
    #[test]
    fn resampling_does_not_depend_on_the_batches_of_rows() {
        for (w, h, to) in
            [(16, 8, (8, 4)), (13, 9, (6, 4)), (5, 12, (16, 16)), (1, 7, (1, 3)), (6, 2, (3, 1))]
        {
            for filter in Filter::ALL {
                for wrap in Wrap::ALL {
                    let p = noise(w, h, 3);
                    let shape = Resample {
                        from: (w, h),
                        to,
                        channels: 3,
                        filter,
                        wrap: (wrap, wrap),
                        measure: Measure::Plane,
                    };
                    let whole = p.resized(to.0, to.1, filter, (wrap, wrap));
                    for portion in [1, 2, 5, h] {
                        let mut stage = Stage::new(shape);
                        let got: Vec<f32> =
                            p.data.chunks(portion * w * 3).flat_map(|rows| stage.push(rows)).collect();
                        assert_eq!(got.len(), to.0 * to.1 * 3, "{shape:?} {portion}");
                        for (a, b) in got.iter().zip(&whole.data) {
                            assert!((a - b).abs() < 1e-6, "{shape:?} {portion}");
                        }
                    }
                }
            }
        }
    }

    /// Where an image repeats, preloaded rows of its end result in the same rows, to the bit, and only a few are held.
    #[test]
    fn a_repeating_image_is_resampled_without_holding_all_rows() {
        for (from, to, filter) in [
            ((6, 300), (8, 512), Filter::CatmullRom),
            ((5, 100), (5, 128), Filter::CatmullRom),
            ((8, 512), (4, 256), Filter::Gaussian),
            ((3, 64), (3, 128), Filter::Sinc),
        ] {
            let p = noise(from.0, from.1, 2);
            let shape = Resample {
                from,
                to,
                channels: 2,
                filter,
                wrap: (Wrap::Periodic, Wrap::Periodic),
                measure: Measure::Plane,
            };
            let whole = Stage::new(shape).push(&p.data);
            for portion in [1, 7, 64] {
                let mut stage = Stage::new(shape);
                let tail = stage.tail().unwrap();
                stage.preload(tail.start, &p.data[tail.start * from.0 * 2..]);
                let (mut got, mut held) = (Vec::new(), 0);
                for rows in p.data.chunks(portion * from.0 * 2) {
                    got.extend(stage.push(rows));
                    held = held.max(stage.window.len() / (to.0 * 2));
                }
                assert!(got == whole, "{shape:?} {portion}");
                assert!(held < portion + 40, "{held} rows of {from:?}");
            }
        }
    }

    /// The forecast equals what is held.
    #[test]
    fn the_predicted_number_of_rows_is_held() {
        for wrap in [Wrap::Clamp, Wrap::Periodic] {
            let shape = Resample {
                from: (4, 200),
                to: (8, 256),
                channels: 1,
                filter: Filter::CatmullRom,
                wrap: (wrap, wrap),
                measure: Measure::Plane,
            };
            let (mut stage, idle) = (Stage::new(shape), Stage::new(shape));
            let mut forecast = Forecast::new(&idle);
            for _ in 0..20 {
                let (out, foreseen) = (stage.push(&[0.5; 40]), forecast.push(10));
                assert_eq!((out.len() / 8, stage.base, stage.next), (foreseen, forecast.base, forecast.next));
            }
            // All rows of 32 bytes are held where the first needs the last.
            assert_eq!(forecast.peak_bytes > 200 * 32, wrap == Wrap::Periodic, "{}", forecast.peak_bytes);
            assert_eq!(forecast.peak_rows == 200, wrap == Wrap::Periodic);
        }
    }

    #[test]
    fn only_needed_rows_are_held() {
        let shape = Resample {
            from: (4, 64),
            to: (2, 32),
            channels: 1,
            filter: Filter::Box,
            wrap: (Wrap::Periodic, Wrap::Periodic),
            measure: Measure::LatLong,
        };
        let mut stage = Stage::new(shape);
        for y in 0..64 {
            assert_eq!(stage.push(&[1.0; 4]).len(), if y % 2 == 1 { 2 } else { 0 });
            assert!(stage.window.len() <= 2);
        }
    }
}
