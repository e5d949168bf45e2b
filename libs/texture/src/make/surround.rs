//! Levels of an image that continues in neighbours, whose texels its filters use (`-seams`).

use super::flat::Neighbour;
use crate::image::Image;
use std::collections::BTreeMap;

/// The largest number of texels of each neighbour that are used.
const MOST: usize = 256;

/// An image with a margin of its neighbours around it. Where there is no neighbour, the texels of the border continue.
#[derive(Debug)]
pub(crate) struct Surrounded {
    image: Image,
    /// The width of the margin on each side, at least 1.
    margin: usize,
    /// For each side down, and in it for each side across, -1 to 1: whether texels are there.
    sides: [[bool; 3]; 3],
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
        let (across, down) = ([0, m, m + image.width], [0, m, m + image.height]);
        let mut sides = [[false; 3]; 3];
        sides[1][1] = true;
        for (side, part) in &self.parts {
            let [i, j] = [side.0, side.1].map(|s| (s.clamp(-1, 1) + 1) as usize);
            whole.paste(part, across[i], down[j]);
            sides[j][i] = true;
        }
        let mut surrounded = Surrounded { image: whole, margin: m, sides };
        surrounded.fill();
        Some(surrounded)
    }
}

impl Surrounded {
    /// Continues the texels of the border where there is no neighbour.
    fn fill(&mut self) {
        let (m, n) = (self.margin, self.image.channels);
        let (width, height) = (self.image.width, self.image.height);
        // The side of a row or column, and the nearest one of the middle.
        let place = |at: usize, n: usize| match at {
            _ if at < m => (0, m),
            _ if at < n - m => (1, at),
            _ => (2, n - m - 1),
        };
        for y in 0..height {
            let (down, middle_y) = place(y, height);
            // The middle needs nothing.
            let end = if down == 1 { m } else { width - m };
            for x in (0..end).chain(width - m..width) {
                let (across, middle_x) = place(x, width);
                if self.sides[down][across] {
                    continue;
                }
                let from = match (self.sides[1][across], self.sides[down][1]) {
                    (true, _) => middle_y * width + x,
                    (_, true) => y * width + middle_x,
                    _ => middle_y * width + middle_x,
                };
                self.image.data.copy_within(from * n..(from + 1) * n, (y * width + x) * n);
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
