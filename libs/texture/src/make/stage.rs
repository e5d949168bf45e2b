//! One resampling of rows as they come: what makes a MIP level of the one before it.

use crate::picture::{Taps, solid_taps, taps};
use crate::{TextureKind, Wrap};
use granita_base::Filter;
use rayon::prelude::*;

/// How rows are measured when they are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Measure {
    /// By their height.
    Plane,
    /// By the solid angle of the rows of a latitude-longitude map.
    LatLong,
}

impl Measure {
    /// For maps of a kind.
    pub(crate) fn of(kind: TextureKind) -> Self {
        if kind == TextureKind::LatLongEnvironment { Self::LatLong } else { Self::Plane }
    }
}

/// What a stage turns into what.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resample {
    pub(crate) from: (usize, usize),
    pub(crate) to: (usize, usize),
    pub(crate) channels: usize,
    pub(crate) filter: Filter,
    pub(crate) wrap: (Wrap, Wrap),
    pub(crate) measure: Measure,
}

/// Across a row.
enum Across {
    Same,
    Halved,
    Any(Vec<Taps>),
}

/// Takes rows from the top, gives rows from the top, and keeps only those that are still needed.
pub(crate) struct Stage {
    shape: Resample,
    across: Across,
    down: Vec<Taps>,
    /// For every row that comes out: the first row that it or a later one needs.
    first_needed: Vec<usize>,
    /// Rows filtered across: from row `base` on.
    window: Vec<f32>,
    base: usize,
    next: usize,
}

/// Means of neighbours in a row of pixels of `N` channels.
fn halve<const N: usize>(from: &[f32], to: &mut [f32]) {
    for (to, from) in to.as_chunks_mut::<N>().0.iter_mut().zip(from.chunks_exact(2 * N)) {
        for c in 0..N {
            to[c] = (from[c] + from[N + c]) * 0.5;
        }
    }
}

/// `to` becomes the weighted sum of rows; exact where all are equal.
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
        let mut first_needed: Vec<usize> = down.iter().map(Taps::first).collect();
        for i in (1..first_needed.len()).rev() {
            first_needed[i - 1] = first_needed[i - 1].min(first_needed[i]);
        }
        Self { shape, across, down, first_needed, window: Vec::new(), base: 0, next: 0 }
    }

    /// Adds whole rows; gives the rows that can be made now.
    pub(crate) fn push(&mut self, rows: &[f32]) -> Vec<f32> {
        let n = self.shape.channels;
        let (from, to) = (self.shape.from.0 * n, self.shape.to.0 * n);
        let start = self.window.len();
        self.window.resize(start + rows.len() / from * to, 0.0);
        let across = &self.across;
        self.window[start..].par_chunks_mut(to).zip(rows.par_chunks(from)).for_each(
            |(to, from)| match across {
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
            },
        );
        let end = self.base + self.window.len() / to;
        let last = self.down[self.next..].iter().take_while(|t| t.last() < end).count() + self.next;
        let mut out = vec![0.0; (last - self.next) * to];
        let (window, base, down) = (&self.window, self.base, &self.down[self.next..last]);
        out.par_chunks_mut(to).zip(down).for_each(|(out, taps)| {
            let rows: Vec<(&[f32], f32)> =
                taps.iter().map(|(i, w)| (&window[(i - base) * to..][..to], w)).collect();
            combine(&rows, taps, out);
        });
        self.next = last;
        let keep = self.first_needed.get(last).copied().unwrap_or(end).clamp(self.base, end);
        self.window.drain(..(keep - self.base) * to);
        self.base = keep;
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Picture;

    fn noise(width: usize, height: usize, channels: usize) -> Picture {
        let mut p = Picture::new(width, height, channels);
        for (i, v) in p.data.iter_mut().enumerate() {
            *v = granita_base::hash::unit(granita_base::hash::words(&[i as u32]));
        }
        p
    }

    /// In whatever portions rows come, the result is that of the whole picture.
    #[test]
    fn portions_do_not_matter() {
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

    #[test]
    fn only_what_is_needed_is_kept() {
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
