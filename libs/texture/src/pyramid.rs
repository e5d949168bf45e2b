//! Makes the smaller levels of a flat image while its rows arrive.

use crate::image::half;
use crate::stage::{Measure, Resample, Stage};
use crate::{TextureKind, Wrap};
use granita_base::Filter;

/// Returns the sizes of an image and all its smaller levels.
pub(crate) fn level_sizes(width: usize, height: usize) -> Vec<(usize, usize)> {
    let mut sizes = vec![(width, height)];
    while let Some(&(w, h)) = sizes.last().filter(|(w, h)| *w > 1 || *h > 1) {
        sizes.push((half(w), half(h)));
    }
    sizes
}

/// Makes the smaller levels of a flat image while its rows arrive, as [`make`](crate::make::make) makes them
/// without resizing.
pub(crate) struct Levels(Vec<Stage>);

impl Levels {
    pub(crate) fn new(kind: TextureKind, size: (usize, usize), channels: usize, wrap: (Wrap, Wrap)) -> Self {
        let measure = Measure::of(kind);
        let sizes = level_sizes(size.0, size.1);
        let stage = |pair: &[(usize, usize)]| {
            let (from, to) = (pair[0], pair[1]);
            Stage::new(Resample { from, to, channels, filter: Filter::Box, wrap, measure })
        };
        Self(sizes.windows(2).map(stage).collect())
    }

    /// Adds the next rows of the largest level. Calls `put` with the index of each smaller level and its next rows.
    pub(crate) fn push(&mut self, rows: &[f32], mut put: impl FnMut(usize, &[f32])) {
        let mut above: Option<Vec<f32>> = None;
        for (i, stage) in self.0.iter_mut().enumerate() {
            let next = stage.push(above.as_deref().unwrap_or(rows));
            if next.is_empty() {
                break;
            }
            put(i + 1, &next);
            above = Some(next);
        }
    }
}
