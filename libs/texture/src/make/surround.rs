//! Levels of an image that continues in neighbours, whose texels its filters use (`-seams`).

use super::flat::Neighbour;
use crate::image::Image;
use std::collections::{BTreeMap, BTreeSet};

/// The largest number of texels of each neighbour that are used.
const MOST: usize = 256;

/// An image with a margin of its neighbours around it. Where there is no neighbour, the texels of the border continue.
#[derive(Debug)]
pub(crate) struct Surrounded {
    image: Image,
    /// The width of the margin on each side, at least 1.
    margin: usize,
    /// The directions across and down of the neighbours, and (0, 0).
    sides: BTreeSet<(i8, i8)>,
}

/// The parts of neighbours, by their directions across and down.
#[derive(Debug, Default)]
pub(crate) struct Parts {
    parts: BTreeMap<(i8, i8), Image>,
}

/// Returns the width of the margin of an image: a power of two, so that it can be halved with the image.
fn margin_of(image: &Image) -> usize {
    let side = image.width.min(image.height).clamp(1, MOST);
    1 << side.ilog2()
}

impl Parts {
    /// Adds the part of a neighbour that lies in the margin around `image`. Returns false when the neighbour has
    /// another size, so that its texels do not continue those of the image.
    pub(crate) fn add(&mut self, image: &Image, neighbour: &Neighbour, other: &Image) -> bool {
        if (other.width, other.height, other.channels) != (image.width, image.height, image.channels) {
            return false;
        }
        let m = margin_of(image);
        let range = |side: i8, n: usize| match side {
            -1 => (n - m, m),
            0 => (0, n),
            _ => (0, m),
        };
        let ((x, w), (y, h)) = (range(neighbour.across, image.width), range(neighbour.down, image.height));
        self.parts.insert((neighbour.across, neighbour.down), other.cropped(x, y, w, h));
        true
    }

    /// Puts the image in the middle of its neighbours. Returns `None` when there are none.
    pub(crate) fn around(self, image: &Image) -> Option<Surrounded> {
        if self.parts.is_empty() {
            return None;
        }
        let m = margin_of(image);
        let mut whole = Image::new(image.width + 2 * m, image.height + 2 * m, image.channels);
        whole.paste(image, m, m);
        let place = |side: i8, n: usize| match side {
            -1 => 0,
            0 => m,
            _ => m + n,
        };
        for ((across, down), part) in &self.parts {
            whole.paste(part, place(*across, image.width), place(*down, image.height));
        }
        let sides = self.parts.into_keys().chain([(0, 0)]).collect();
        let mut surrounded = Surrounded { image: whole, margin: m, sides };
        surrounded.fill();
        Some(surrounded)
    }
}

impl Surrounded {
    /// Continues the texels of the border where there is no neighbour.
    fn fill(&mut self) {
        let m = self.margin;
        let (width, height) = (self.image.width, self.image.height);
        // The side of a row or column, and the nearest one of the middle.
        let place = |at: usize, n: usize| match at {
            _ if at < m => (-1, m),
            _ if at < n - m => (0, at),
            _ => (1, n - m - 1),
        };
        for y in 0..height {
            let (down, middle_y) = place(y, height);
            for x in 0..width {
                let (across, middle_x) = place(x, width);
                if self.sides.contains(&(across, down)) {
                    continue;
                }
                let near = [((across, 0), x, middle_y), ((0, down), middle_x, y)];
                let near = near.into_iter().find(|(side, ..)| self.sides.contains(side));
                let (from_x, from_y) = near.map_or((middle_x, middle_y), |(_, x, y)| (x, y));
                let texel = self.image.texel(from_x, from_y).to_vec();
                self.image.texel_mut(x, y).copy_from_slice(&texel);
            }
        }
    }

    /// Makes the next level, with `next` for the image with its margin. Returns the level, and itself at that level
    /// while the image and the margin can be halved again.
    pub(crate) fn next(self, next: impl FnOnce(&Image) -> Image) -> (Image, Option<Self>) {
        let (image, margin) = (next(&self.image), self.margin / 2);
        let (w, h) = (image.width - 2 * margin, image.height - 2 * margin);
        let level = image.cropped(margin, margin, w, h);
        let goes_on = margin.is_multiple_of(2) && margin > 0 && w.is_multiple_of(2) && h.is_multiple_of(2);
        let next = goes_on.then(|| {
            let mut next = Self { image, margin, sides: self.sides };
            next.fill();
            next
        });
        (level, next)
    }
}
