//! Coarse frames of a desk: images of fewer pixels, which are shown enlarged while a light is dragged.

use granita_image::PixelRect;

/// The largest number of pixels of a coarse image. With that many, most scenes are rendered again within a moment.
const MOST_PIXELS: f64 = 32_768.0;

/// A full image and its coarse one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Coarse {
    /// The width and height of the full image in pixels.
    full: [i64; 2],
    /// Those of the coarse image.
    few: [i64; 2],
}

impl Coarse {
    /// Returns the coarse image for a full image of this width and height. They are divided by a whole number.
    pub(crate) fn new(resolution: [i32; 2]) -> Self {
        let full = resolution.map(|n| i64::from(n.max(1)));
        let factor = (((full[0] * full[1]) as f64 / MOST_PIXELS).sqrt().ceil() as i64).max(1);
        Self { full, few: full.map(|n| (n + factor - 1) / factor) }
    }

    /// Returns its width and height in pixels.
    pub(crate) fn resolution(&self) -> [i32; 2] {
        self.few.map(|n| n as i32)
    }

    /// Returns a crop window that is a pixel larger on each side, but not larger than the image.
    pub(crate) fn grown_crop(&self, [x0, x1, y0, y1]: [f32; 4]) -> [f32; 4] {
        let [dx, dy] = self.few.map(|n| 1.0 / n as f32);
        [x0 - dx, x1 + dx, y0 - dy, y1 + dy].map(|edge| edge.clamp(0.0, 1.0))
    }

    /// Returns the coarse pixel that a pixel of the full image shows.
    fn source(&self, axis: usize, at: i32) -> i32 {
        (i64::from(at) * self.few[axis]).div_euclid(self.full[axis]) as i32
    }

    /// Returns the pixels of the full image that show pixels of a rectangle of the coarse one.
    pub(crate) fn enlarged(&self, rect: &PixelRect) -> PixelRect {
        // The first pixel whose source is not before the edge.
        let edge = |axis: usize, at: i32| {
            (i64::from(at) * self.full[axis] + self.few[axis] - 1).div_euclid(self.few[axis]) as i32
        };
        PixelRect { x0: edge(0, rect.x0), y0: edge(1, rect.y0), x1: edge(0, rect.x1), y1: edge(1, rect.y1) }
    }

    /// Returns the pixels of the coarse image that a rectangle of the full one shows.
    pub(crate) fn reduced(&self, rect: &PixelRect) -> PixelRect {
        let last = |axis: usize, end: i32| self.source(axis, end - 1) + 1;
        PixelRect {
            x0: self.source(0, rect.x0),
            y0: self.source(1, rect.y0),
            x1: last(0, rect.x1),
            y1: last(1, rect.y1),
        }
    }

    /// Returns the values of the pixels `to` of the full image, all of which show pixels of the rectangle `from` of the
    /// coarse one, with its `values`. Each pixel has `n` channels.
    pub(crate) fn enlarge(&self, from: &PixelRect, values: &[f32], n: usize, to: &PixelRect) -> Vec<f32> {
        let mut out = Vec::with_capacity(to.width() * to.height() * n);
        for y in to.y0..to.y1 {
            let row = (self.source(1, y) - from.y0) as usize * from.width();
            for x in to.x0..to.x1 {
                let at = (row + (self.source(0, x) - from.x0) as usize) * n;
                out.extend_from_slice(&values[at..at + n]);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_images_have_few_pixels() {
        for (full, few) in [
            ([960, 540], [240, 135]),
            ([1920, 1080], [240, 135]),
            ([640, 481], [160, 121]),
            ([48, 36], [48, 36]),
            ([1, 100_000], [1, 50_000]),
        ] {
            assert_eq!(Coarse::new(full).resolution(), few, "{full:?}");
        }
    }

    #[test]
    fn every_pixel_shows_the_coarse_pixel_at_its_place() {
        let coarse = Coarse::new([641, 483]);
        let [width, height] = coarse.resolution();
        let mut seen = vec![0; 641 * 483];
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let pixel = PixelRect::at(x, y, 1, 1);
            let part = coarse.enlarged(&pixel);
            assert!(!part.is_empty());
            assert_eq!(coarse.reduced(&part), pixel);
            for (x, y) in (part.y0..part.y1).flat_map(|y| (part.x0..part.x1).map(move |x| (x, y))) {
                seen[(y * 641 + x) as usize] += 1;
            }
        }
        assert!(seen.iter().all(|times| *times == 1));
        let from = PixelRect::at(2, 1, 2, 2);
        let to = coarse.enlarged(&from).intersection(&PixelRect::at(10, 0, 4, 6));
        let values = coarse.enlarge(&from, &[1.0, 2.0, 3.0, 4.0], 1, &to);
        assert_eq!((to, values), (PixelRect::at(10, 4, 4, 2), vec![1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0]));
    }
}
