//! Compares a part of a stored image with a new render of that part.

use image::RgbImage;
use std::path::Path;

/// Largest differences of equal images, in steps of eight bits.
pub(super) struct Tolerance {
    /// Of the mean over all values.
    mean: f64,
    /// Of one value.
    one: u8,
}

impl Tolerance {
    /// Returns the tolerance for the format of a file. Pixels are the same on all machines, so that PNG leaves rounding
    /// only. JPEG of quality 90 changes the colours of edges by up to about 50 steps.
    pub(super) fn of(file: &str) -> Self {
        if file.ends_with(".png") { Self { mean: 0.5, one: 2 } } else { Self { mean: 4.0, one: 60 } }
    }
}

/// Reads an image.
pub(super) fn read(path: &Path) -> Result<RgbImage, String> {
    let told = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    Ok(image::open(path).map_err(|e| told(&e))?.to_rgb8())
}

/// Compares `got` with the part of `stored` at `corner`. Returns the differences as text.
pub(super) fn part(
    stored: &RgbImage,
    got: &RgbImage,
    (left, top): (u32, u32),
    tolerance: Tolerance,
) -> Result<String, String> {
    if got.width() + left > stored.width() || got.height() + top > stored.height() {
        return Err(format!(
            "the stored image has {} x {} pixels: no part of {} x {} pixels begins at {left}, {top}",
            stored.width(),
            stored.height(),
            got.width(),
            got.height()
        ));
    }
    let (mut sum, mut largest, mut number) = (0.0, 0, 0_u32);
    for (x, y, pixel) in got.enumerate_pixels() {
        for (a, b) in pixel.0.iter().zip(stored.get_pixel(left + x, top + y).0) {
            let difference = a.abs_diff(b);
            sum += f64::from(difference);
            largest = largest.max(difference);
            number += 1;
        }
    }
    let mean = sum / f64::from(number.max(1));
    let told = format!("differs by {mean:.2} of 255 in the mean and {largest} at most");
    if mean > tolerance.mean || largest > tolerance.one {
        return Err(format!("{told}, more than {} and {}", tolerance.mean, tolerance.one));
    }
    Ok(told)
}

#[cfg(test)]
mod tests {
    use super::{Tolerance, part};
    use image::{Rgb, RgbImage};

    #[test]
    fn parts_are_compared_at_their_place() {
        let stored = RgbImage::from_fn(8, 8, |x, y| Rgb([x as u8 * 10, y as u8 * 10, 0]));
        let same = RgbImage::from_fn(3, 2, |x, y| Rgb([x as u8 * 10 + 40, y as u8 * 10 + 50, 1]));
        let png = || Tolerance::of("a.png");
        assert!(part(&stored, &same, (4, 5), png()).is_ok());
        assert!(part(&stored, &same, (3, 5), png()).is_err());
        assert!(part(&stored, &same, (6, 5), png()).unwrap_err().contains("no part"));
    }
}
