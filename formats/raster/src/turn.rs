//! Images that are stored rotated or mirrored, by the orientation of Exif data.

use granita_image::Pixels;

/// The turn from the stored pixels to the upright image, by its Exif number (tag 274; CIPA DC-008, 4.6.4). The number
/// defines the sides of the image that the first row and the first column show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Turn {
    /// True when the first row is a column of the image.
    transposed: bool,
    /// True when the image is then mirrored from left to right.
    mirrored: bool,
    /// True when the image is then turned upside down by rows.
    flipped: bool,
}

impl Turn {
    /// Returns the turn of a number from 1 to 8. Other numbers are upright.
    pub(crate) fn of_exif(number: u8) -> Self {
        let (transposed, mirrored, flipped) = match number {
            // The first row and column are: top right, bottom right, bottom left.
            2 => (false, true, false),
            3 => (false, true, true),
            4 => (false, false, true),
            // The first row is the left side, the right, the right, the left. The first column is the top, the top, the
            // bottom, the bottom.
            5 => (true, false, false),
            6 => (true, true, false),
            7 => (true, true, true),
            8 => (true, false, true),
            _ => (false, false, false),
        };
        Self { transposed, mirrored, flipped }
    }

    /// Converts the size of the stored image to that of the upright one, and back.
    pub(crate) fn size(self, (width, height): (u32, u32)) -> (u32, u32) {
        if self.transposed { (height, width) } else { (width, height) }
    }

    /// True when rows keep their positions.
    pub(crate) fn keeps_rows(self) -> bool {
        !self.transposed && !self.flipped
    }

    /// Returns the upright image of stored pixels. `size` is their width and height, and `n` the number of channels.
    pub(crate) fn apply(self, pixels: Pixels, size: (usize, usize), n: usize) -> Pixels {
        if self == Self::of_exif(1) {
            return pixels;
        }
        let (width, height) = if self.transposed { (size.1, size.0) } else { size };
        let mut out = Pixels::zeros(pixels.pixel_type(), pixels.len());
        for y in 0..height {
            let row = if self.flipped { height - 1 - y } else { y };
            for x in 0..width {
                let column = if self.mirrored { width - 1 - x } else { x };
                let (stored_x, stored_y) = if self.transposed { (row, column) } else { (column, row) };
                out.copy_from((y * width + x) * n, &pixels, (stored_y * size.0 + stored_x) * n, n);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_turned_as_the_exif_orientation_says() {
        // There are three columns and two rows. The first row is 1 2 3, and the first column 1 4.
        let stored = || Pixels::U8(vec![1, 2, 3, 4, 5, 6]);
        for (number, upright) in [
            (1, [1, 2, 3, 4, 5, 6]),
            (2, [3, 2, 1, 6, 5, 4]),
            (3, [6, 5, 4, 3, 2, 1]),
            (4, [4, 5, 6, 1, 2, 3]),
            // There are two columns and three rows.
            (5, [1, 4, 2, 5, 3, 6]),
            (6, [4, 1, 5, 2, 6, 3]),
            (7, [6, 3, 5, 2, 4, 1]),
            (8, [3, 6, 2, 5, 1, 4]),
            (0, [1, 2, 3, 4, 5, 6]),
            (9, [1, 2, 3, 4, 5, 6]),
        ] {
            let turn = Turn::of_exif(number);
            assert_eq!(turn.apply(stored(), (3, 2), 1), Pixels::U8(upright.to_vec()), "{number}");
            assert_eq!(turn.size((3, 2)), if (5..=8).contains(&number) { (2, 3) } else { (3, 2) });
            assert_eq!(turn.keeps_rows(), !(3..=8).contains(&number));
        }
    }
}
