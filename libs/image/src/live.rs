//! What those who make a picture and those who watch it say to each other: one vocabulary for the renderer, for what
//! goes over a wire, and for the viewer.

/// A rectangle of whole pixels, from (`x0`, `y0`) up to and without (`x1`, `y1`); empty when an upper end is not above
/// its lower. Rows count downward. Whose pixel (0, 0) is, each use says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PixelRect {
    /// First column.
    pub x0: i32,
    /// First row.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

impl PixelRect {
    /// All there are.
    pub const EVERYWHERE: Self = Self { x0: i32::MIN, y0: i32::MIN, x1: i32::MAX, y1: i32::MAX };

    /// A rectangle by its upper left pixel and its size; ends beyond what coordinates hold are cut.
    pub fn at(x: i32, y: i32, width: u32, height: u32) -> Self {
        let end = |from: i32, size: u32| from.saturating_add_unsigned(size);
        Self { x0: x, y0: y, x1: end(x, width), y1: end(y, height) }
    }

    /// Columns; 0 when empty.
    pub fn width(&self) -> usize {
        usize::try_from(i64::from(self.x1) - i64::from(self.x0)).unwrap_or(0)
    }

    /// Rows; 0 when empty.
    pub fn height(&self) -> usize {
        usize::try_from(i64::from(self.y1) - i64::from(self.y0)).unwrap_or(0)
    }

    /// Columns times rows.
    pub fn pixels(&self) -> u64 {
        self.width() as u64 * self.height() as u64
    }

    /// Whether there is no pixel in it.
    pub fn is_empty(&self) -> bool {
        self.width() == 0 || self.height() == 0
    }

    /// What both have in common; empty when that is nothing.
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

    /// Grown by `n` pixels on every side.
    #[must_use]
    pub fn grown(&self, n: i32) -> Self {
        Self { x0: self.x0 - n, y0: self.y0 - n, x1: self.x1 + n, y1: self.y1 + n }
    }

    /// Moved; ends beyond what coordinates hold are cut.
    #[must_use]
    pub fn moved(&self, x: i32, y: i32) -> Self {
        Self {
            x0: self.x0.saturating_add(x),
            y0: self.y0.saturating_add(y),
            x1: self.x1.saturating_add(x),
            y1: self.y1.saturating_add(y),
        }
    }

    /// Whether all pixels of `other`, of which there is at least one, are in this one.
    pub fn contains(&self, other: &Self) -> bool {
        !other.is_empty() && self.intersection(other) == *other
    }
}

/// What somebody who watches a picture asks of whoever makes it. Pixel (0, 0) is the upper left one of the data window;
/// what is asked for may lie outside of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Go on around this pixel.
    Center {
        /// Column.
        x: i32,
        /// Row.
        y: i32,
    },
    /// These pixels first.
    Priority(PixelRect),
    /// Make no more of it.
    Abort,
}

/// A command of a drawing over a picture, in its pixels; (0, 0) is the upper left corner of the first one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Draw {
    /// Keeps the colours.
    Save,
    /// Takes the kept colours.
    Restore,
    /// A path goes on from here.
    MoveTo([f32; 2]),
    /// A line to here.
    LineTo([f32; 2]),
    /// What is filled from now on: red, green, blue, alpha.
    FillColor([f32; 4]),
    /// What is drawn from now on.
    StrokeColor([f32; 4]),
    /// Fills the path.
    Fill,
    /// Draws the path.
    Stroke,
    /// A new path.
    BeginPath,
}

/// How whoever makes a picture would like it to be shown (reference 7.4.3).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wishes {
    /// On the whole screen.
    pub fullscreen: bool,
    /// So many screen pixels for one of the picture; 0 leaves it to the viewer.
    pub zoom: u32,
    /// File of a picture to be laid over it; empty for none.
    pub foreground: String,
    /// File of a picture to be laid under it; empty for none.
    pub background: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_at_the_ends_of_what_coordinates_hold() {
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
