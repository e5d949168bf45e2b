//! Rectangles of pixels.

/// Pixels from (`x0`, `y0`) up to and without (`x1`, `y1`); (0, 0) is the upper left pixel of the data window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Rect {
    /// First column.
    pub x0: i32,
    /// First row.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

impl Rect {
    /// A rectangle by its upper left pixel and its size; sizes beyond what coordinates hold are cut.
    pub fn at(x: i32, y: i32, width: u32, height: u32) -> Self {
        let end = |from: i32, size: u32| from.saturating_add(i32::try_from(size).unwrap_or(i32::MAX));
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

    /// Whether there is no pixel in it.
    pub fn is_empty(&self) -> bool {
        self.width() == 0 || self.height() == 0
    }

    /// What both have in common; empty when that is nothing.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            x0: self.x0.max(other.x0),
            y0: self.y0.max(other.y0),
            x1: self.x1.min(other.x1),
            y1: self.y1.min(other.y1),
        }
    }

    /// Whether all pixels of `other`, of which there is at least one, are in this one.
    pub fn contains(&self, other: &Self) -> bool {
        !other.is_empty() && self.intersection(other) == *other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_at_the_ends_of_what_coordinates_hold() {
        let all = Rect { x0: i32::MIN, y0: i32::MIN, x1: i32::MAX, y1: i32::MAX };
        assert_eq!(all.width(), u32::MAX as usize);
        assert_eq!(
            Rect::at(i32::MAX - 1, 0, u32::MAX, 3),
            Rect { x0: i32::MAX - 1, y0: 0, x1: i32::MAX, y1: 3 }
        );
        let upside_down = Rect { x0: i32::MAX, y0: 0, x1: i32::MIN, y1: 1 };
        assert!(upside_down.is_empty() && !all.contains(&upside_down));
        assert!(all.contains(&Rect::at(5, 5, 1, 1)) && !Rect::at(0, 0, 5, 5).contains(&Rect::at(4, 4, 2, 1)));
        assert!(Rect::at(0, 0, 5, 5).intersection(&Rect::at(5, 0, 5, 5)).is_empty());
    }
}
