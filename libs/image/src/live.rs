//! The messages between the producer and the viewers of an image. The renderer, the network protocol and the viewer
//! use the same types.

/// A rectangle of whole pixels, from (`x0`, `y0`) up to but not including (`x1`, `y1`). It is empty when an upper end
/// is not above its lower end. Rows count downward. Each use defines the position of pixel (0, 0).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PixelRect {
    /// The first column.
    pub x0: i32,
    /// The first row.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

impl PixelRect {
    /// The rectangle of all pixels.
    pub const EVERYWHERE: Self = Self { x0: i32::MIN, y0: i32::MIN, x1: i32::MAX, y1: i32::MAX };

    /// Returns the rectangle of an upper left pixel and a size. Ends that overflow are clamped.
    pub fn at(x: i32, y: i32, width: u32, height: u32) -> Self {
        let end = |from: i32, size: u32| from.saturating_add_unsigned(size);
        Self { x0: x, y0: y, x1: end(x, width), y1: end(y, height) }
    }

    /// The number of columns; 0 when empty.
    pub fn width(&self) -> usize {
        usize::try_from(i64::from(self.x1) - i64::from(self.x0)).unwrap_or(0)
    }

    /// The number of rows; 0 when empty.
    pub fn height(&self) -> usize {
        usize::try_from(i64::from(self.y1) - i64::from(self.y0)).unwrap_or(0)
    }

    /// The number of columns times the number of rows.
    pub fn pixels(&self) -> u64 {
        self.width() as u64 * self.height() as u64
    }

    /// True when the rectangle has no pixel.
    pub fn is_empty(&self) -> bool {
        self.width() == 0 || self.height() == 0
    }

    /// Returns the common part of both, which may be empty.
    #[inline]
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            x0: self.x0.max(other.x0),
            y0: self.y0.max(other.y0),
            x1: self.x1.min(other.x1),
            y1: self.y1.min(other.y1),
        }
    }

    /// Returns the rectangle grown by `n` pixels on every side.
    #[must_use]
    pub fn grown(&self, n: i32) -> Self {
        Self { x0: self.x0 - n, y0: self.y0 - n, x1: self.x1 + n, y1: self.y1 + n }
    }

    /// Returns the rectangle moved. Ends that overflow are clamped.
    #[must_use]
    pub fn moved(&self, x: i32, y: i32) -> Self {
        Self {
            x0: self.x0.saturating_add(x),
            y0: self.y0.saturating_add(y),
            x1: self.x1.saturating_add(x),
            y1: self.y1.saturating_add(y),
        }
    }

    /// True when `other` is not empty and all its pixels are in this one.
    pub fn contains(&self, other: &Self) -> bool {
        !other.is_empty() && self.intersection(other) == *other
    }
}

/// A request of a viewer to the producer of an image. Pixel (0, 0) is the upper left one of the data window. The
/// requested pixels may be outside of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Continue around this pixel.
    Center {
        /// The column.
        x: i32,
        /// The row.
        y: i32,
    },
    /// Compute these pixels first.
    Priority(PixelRect),
    /// Stop the image.
    Abort,
}

/// A drawing command for an overlay of an image, in its pixels. (0, 0) is the upper left corner of the first one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Draw {
    /// Saves the colours.
    Save,
    /// Restores the saved colours.
    Restore,
    /// Continues the path from this point.
    MoveTo([f32; 2]),
    /// Adds a line to this point.
    LineTo([f32; 2]),
    /// Sets the fill colour: red, green, blue, alpha.
    FillColor([f32; 4]),
    /// Sets the stroke colour.
    StrokeColor([f32; 4]),
    /// Fills the path.
    Fill,
    /// Strokes the path.
    Stroke,
    /// Begins a new path.
    BeginPath,
}

/// The display settings that the producer of an image suggests to viewers (reference 7.4.3).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wishes {
    /// True for the whole screen.
    pub fullscreen: bool,
    /// The number of screen pixels for one image pixel. 0 leaves it to the viewer.
    pub zoom: u32,
    /// The file of an image to be drawn over it; empty for none.
    pub foreground: String,
    /// The file of an image to be drawn under it; empty for none.
    pub background: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_at_the_limits_of_coordinates_do_not_overflow() {
        let all = PixelRect::EVERYWHERE;
        assert_eq!(all.width(), u32::MAX as usize);
        assert_eq!(all.pixels(), u64::from(u32::MAX) * u64::from(u32::MAX));
        assert_eq!(
            PixelRect::at(i32::MAX - 1, 0, u32::MAX, 3),
            PixelRect { x0: i32::MAX - 1, y0: 0, x1: i32::MAX, y1: 3 }
        );
        assert_eq!(PixelRect::at(i32::MIN, 0, u32::MAX, 1).x1, i32::MAX);
        let upside_down = PixelRect { x0: i32::MAX, y0: 0, x1: i32::MIN, y1: 1 };
        assert!(upside_down.is_empty() && !all.contains(&upside_down) && upside_down.pixels() == 0);
        let at = PixelRect::at;
        assert!(all.contains(&at(5, 5, 1, 1)) && !at(0, 0, 5, 5).contains(&at(4, 4, 2, 1)));
        assert!(at(0, 0, 5, 5).intersection(&at(5, 0, 5, 5)).is_empty());
        assert_eq!(at(1, 2, 3, 4).grown(1), at(0, 1, 5, 6));
        assert_eq!(
            at(1, 2, 3, 4).moved(-1, i32::MAX),
            PixelRect { x0: 0, y0: i32::MAX, x1: 3, y1: i32::MAX }
        );
    }
}
