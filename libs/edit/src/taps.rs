//! The pixels and weights from which a filter makes the pixels of one direction.

use granita_texture::make::Kernel;
use std::ops::Range;

/// The extent of an image in one direction: pixels that exist, and the range of the display window.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    /// The first pixel of the data window.
    pub(crate) begin: i64,
    /// The number of pixels of the data window.
    pub(crate) count: u32,
    /// The first pixel of the display window.
    pub(crate) full_begin: i64,
    /// The number of pixels of the display window.
    pub(crate) full_count: u32,
}

impl Axis {
    /// Returns the pixel of the data window, counted from its first, that a filter finds at `at`. Beyond the display
    /// window its border repeats. `None` for places without a pixel, which are 0.
    pub(crate) fn pixel(&self, at: i64) -> Option<u32> {
        let inside = |at: i64| u32::try_from(at - self.begin).ok().filter(|i| *i < self.count);
        let last = self.full_begin + i64::from(self.full_count) - 1;
        inside(at).or_else(|| inside(at.clamp(self.full_begin, last)))
    }
}

/// The source pixels and weights of each destination pixel. The pixels of each are consecutive.
#[derive(Debug)]
pub(crate) struct Taps {
    weights: Vec<f32>,
    /// The first pixel, and the range of its weights.
    places: Vec<(u32, Range<usize>)>,
}

impl Taps {
    fn new() -> Self {
        Self { weights: Vec::new(), places: Vec::new() }
    }

    /// Adds a destination pixel whose weights are divided by their sum. Places without a pixel count, and are 0.
    fn push(&mut self, axis: &Axis, taps: impl Iterator<Item = (i64, f32)> + Clone) {
        let total: f32 = taps.clone().map(|t| t.1).sum();
        let used = taps.filter(|t| t.1 != 0.0).filter_map(|(at, w)| Some((axis.pixel(at)?, w)));
        let used: Vec<(u32, f32)> = if total == 0.0 { Vec::new() } else { used.collect() };
        let first = used.iter().map(|t| t.0).min().unwrap_or(0);
        let last = used.iter().map(|t| t.0).max().unwrap_or(0);
        let start = self.weights.len();
        let count = if used.is_empty() { 0 } else { (last - first) as usize + 1 };
        self.weights.resize(start + count, 0.0);
        for (i, w) in used {
            self.weights[start + (i - first) as usize] += w / total;
        }
        self.places.push((first, start..start + count));
    }

    /// Returns the taps of a resize. Destination pixels are `to`, of a display window that begins at `to_begin` and has
    /// `to_count` pixels. The filter is that of OpenImageIO's `ImageBufAlgo::resize`.
    pub(crate) fn resize(axis: &Axis, to: Range<i64>, to_full: (i64, u32), kernel: Kernel) -> Self {
        let scale = Scale::new(axis, to_full, kernel);
        let mut taps = Self::new();
        for o in to {
            let (at, part) = scale.centre(o);
            let reach = scale.reach;
            let weight = |i: i64| kernel.weight(scale.ratio * (i as f32 - (part - 0.5)), scale.width);
            taps.push(axis, (-reach..=reach).map(|i| (at + i, weight(i))));
        }
        taps
    }

    /// Returns the taps of the nearest pixels, or with `linear` of the interpolation between two.
    pub(crate) fn sample(axis: &Axis, to: Range<i64>, to_full: (i64, u32), linear: bool) -> Self {
        let scale = Scale::new(axis, to_full, Kernel::Box);
        let mut taps = Self::new();
        for o in to {
            let (at, part) = scale.centre(o);
            let (at, part) = match (linear, part < 0.5) {
                (false, _) => (at, 0.0),
                (true, true) => (at - 1, part + 0.5),
                (true, false) => (at, part - 0.5),
            };
            taps.push(axis, [(at, 1.0 - part), (at + 1, part)].into_iter());
        }
        taps
    }

    /// Returns the taps of a blur over `width` pixels with the filter of a name.
    pub(crate) fn blur(axis: &Axis, width: f32, kernel: Kernel) -> Self {
        let reach = blur_reach(width);
        let mut taps = Self::new();
        for o in axis.begin..axis.begin + i64::from(axis.count) {
            taps.push(axis, (-reach..=reach).map(|i| (o + i, kernel.weight(i as f32, width))));
        }
        taps
    }

    /// The number of destination pixels.
    pub(crate) fn len(&self) -> usize {
        self.places.len()
    }

    /// Returns the first source pixel of a destination pixel, and the weights of it and of those that follow.
    #[inline]
    pub(crate) fn at(&self, o: usize) -> (usize, &[f32]) {
        let (first, range) = &self.places[o];
        (*first as usize, &self.weights[range.clone()])
    }

    /// Returns the range of source pixels of a range of destination pixels.
    pub(crate) fn sources(&self, to: Range<usize>) -> Range<u32> {
        let used = self.places[to].iter().filter(|(_, range)| !range.is_empty());
        let begin = used.clone().map(|(first, _)| *first).min().unwrap_or(0);
        let end = used.map(|(first, range)| first + range.len() as u32).max().unwrap_or(0);
        begin..end.max(begin)
    }
}

/// Returns the reach of a blur over `width` pixels: the kernel has an odd number of pixels.
pub(crate) fn blur_reach(width: f32) -> i64 {
    (width.ceil().max(1.0) as i64) / 2
}

/// The mapping of destination pixels to source pixels, and the extent of a filter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    axis: Axis,
    to_begin: f32,
    /// One over the number of destination pixels.
    step: f32,
    /// Destination pixels per source pixel.
    pub(crate) ratio: f32,
    /// The width of the filter in destination pixels.
    pub(crate) width: f32,
    /// The reach of the filter in source pixels.
    pub(crate) reach: i64,
}

impl Scale {
    pub(crate) fn new(axis: &Axis, (to_begin, to_count): (i64, u32), kernel: Kernel) -> Self {
        let ratio = to_count as f32 / axis.full_count as f32;
        let width = kernel.natural_width() * ratio.max(1.0);
        Self {
            axis: *axis,
            to_begin: to_begin as f32,
            step: 1.0 / to_count as f32,
            ratio,
            width,
            reach: (width / 2.0 / ratio).ceil() as i64,
        }
    }

    /// Returns the centre of a destination pixel as a source pixel and a part of it.
    pub(crate) fn centre(&self, o: i64) -> (i64, f32) {
        let s = (o as f32 - self.to_begin + 0.5) * self.step;
        let at = self.axis.full_begin as f32 + s * self.axis.full_count as f32;
        (at.floor() as i64, at - at.floor())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: Axis = Axis { begin: 0, count: 10, full_begin: 0, full_count: 10 };
    const PART: Axis = Axis { begin: 3, count: 4, full_begin: 0, full_count: 10 };

    #[test]
    fn borders_repeat_and_missing_pixels_are_zero() {
        assert_eq!([WHOLE.pixel(-3), WHOLE.pixel(4), WHOLE.pixel(12)], [Some(0), Some(4), Some(9)]);
        assert_eq!(
            [PART.pixel(-3), PART.pixel(3), PART.pixel(6), PART.pixel(7)],
            [None, Some(0), Some(3), None]
        );
        let beyond = Axis { begin: -2, count: 14, full_begin: 0, full_count: 10 };
        assert_eq!([beyond.pixel(-2), beyond.pixel(-3), beyond.pixel(20)], [Some(0), Some(2), Some(11)]);
    }

    #[test]
    fn weights_of_whole_images_add_up_to_one() {
        for (_, kernel) in Kernel::NAMES.into_iter().filter(|(_, kernel)| !kernel.is_radial()) {
            for n in [1, 3, 5, 10, 23] {
                let taps = Taps::resize(&WHOLE, 0..n, (0, n as u32), kernel);
                assert_eq!(taps.len(), n as usize);
                for o in 0..taps.len() {
                    let (first, weights) = taps.at(o);
                    let total: f32 = weights.iter().sum();
                    assert!((total - 1.0).abs() < 1e-4, "{kernel:?} {n} {o}: {total}");
                    assert!(first + weights.len() <= 10);
                }
            }
        }
    }

    #[test]
    fn the_same_size_is_copied_by_interpolation() {
        for linear in [false, true] {
            let taps = Taps::sample(&WHOLE, 0..10, (0, 10), linear);
            for o in 0..10 {
                let (first, weights) = taps.at(o);
                assert!(first == o && (weights[0] - 1.0).abs() < 1e-6, "{o}: {first} {weights:?}");
            }
        }
        let taps = Taps::sample(&WHOLE, 0..20, (0, 20), true);
        assert_eq!((taps.at(1), taps.at(0)), ((0, &[0.75, 0.25][..]), (0, &[1.0][..])));
        assert_eq!(taps.sources(4..6), 1..4);
    }
}
