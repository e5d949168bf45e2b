//! Sizes and rectangles as text, as OpenImageIO's `oiiotool` writes them.

use crate::image::Window;
use crate::{EditError, Result};

/// The largest width or height that a text may request, in pixels.
const LARGEST: u32 = 1 << 20;

/// One side of a size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Side {
    /// A number of pixels; 0 keeps the proportions.
    Pixels(u32),
    /// A part of the size of the image; 1 is the same size.
    Part(f64),
}

/// A size and a position: `640x480`, `640x0`, `50%`, `50%x25%`, `640x480+10-20`, `+10+20`, or the corners
/// `xmin,ymin,xmax,ymax`, which are inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// The width and the height.
    pub size: Option<(Side, Side)>,
    /// The left and the upper edge.
    pub at: Option<(i64, i64)>,
}

impl Geometry {
    /// Reads a text.
    ///
    /// # Errors
    /// [`EditError::Misuse`] for other texts, and for sides of more than 1048576 pixels.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = || {
            EditError::misuse(format!(
                "\"{text}\" is not a size; sizes are like 640x480, 640x0, 50%, 640x480+10+20 and 0,0,639,479"
            ))
        };
        if text.contains(',') {
            let corners: Vec<i64> = text
                .split(',')
                .map(|w| w.trim().parse())
                .collect::<std::result::Result<_, _>>()
                .map_err(|_| wrong())?;
            let &[left, top, right, bottom] = &*corners else { return Err(wrong()) };
            let side = |low: i64, high: i64| -> Result<Side> {
                let n = high.checked_sub(low).and_then(|n| n.checked_add(1)).ok_or_else(wrong)?;
                Ok(Side::Pixels(
                    u32::try_from(n).ok().filter(|n| (1..=LARGEST).contains(n)).ok_or_else(wrong)?,
                ))
            };
            let size = (side(left, right)?, side(top, bottom)?);
            return Ok(Self { size: Some(size), at: Some((left, top)) });
        }
        let split = text.find(['+', '-']).unwrap_or(text.len());
        let (size, at) = text.split_at(split);
        let size = match size {
            "" => None,
            size => Some(Self::size(size).ok_or_else(wrong)?),
        };
        let at = match at {
            "" => None,
            at => Some(offset(at).ok_or_else(wrong)?),
        };
        if size.is_none() && at.is_none() { Err(wrong()) } else { Ok(Self { size, at }) }
    }

    fn size(text: &str) -> Option<(Side, Side)> {
        let side = |text: &str| match text.strip_suffix('%') {
            Some(percent) => {
                let part: f64 = percent.parse().ok()?;
                (part.is_finite() && part > 0.0).then_some(Side::Part(part / 100.0))
            }
            None => text.parse().ok().filter(|n| *n <= LARGEST).map(Side::Pixels),
        };
        match text.split_once(['x', 'X']) {
            Some((width, height)) => Some((side(width)?, side(height)?)),
            None => match side(text)? {
                Side::Part(part) => Some((Side::Part(part), Side::Part(part))),
                Side::Pixels(_) => None,
            },
        }
    }

    /// Returns the window that is meant for an image whose window is `like`. A missing size is that of `like`, a
    /// missing position too. A side of 0 follows from the other side and the proportions of `like`.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when both sides are 0, and for sides of more than 1048576 pixels.
    pub fn window(&self, like: &Window) -> Result<Window> {
        let (x, y) = self.at.unwrap_or((like.x, like.y));
        let (width, height) = match self.size {
            None => (like.width, like.height),
            Some((Side::Pixels(0), Side::Pixels(0))) => {
                return Err(EditError::misuse("a size of 0 x 0 pixels"));
            }
            Some((w, h)) => {
                let (lw, lh) = (f64::from(like.width), f64::from(like.height));
                let known = |side: Side, n: f64| match side {
                    Side::Pixels(0) => None,
                    Side::Pixels(n) => Some(f64::from(n)),
                    Side::Part(part) => Some(n * part),
                };
                let (width, height) = (known(w, lw), known(h, lh));
                let width_of = |height: f64| height * lw / lh;
                let height_of = |width: f64| width * lh / lw;
                let (width, height) = match (width, height) {
                    (Some(w), Some(h)) => (w, h),
                    (Some(w), None) => (w, height_of(w)),
                    (None, Some(h)) => (width_of(h), h),
                    (None, None) => (lw, lh),
                };
                (pixels(width)?, pixels(height)?)
            }
        };
        Ok(Window { x, y, width, height })
    }
}

/// Returns a number of pixels that is rounded, and at least 1.
fn pixels(n: f64) -> Result<u32> {
    let n = n.round().max(1.0);
    if n > f64::from(LARGEST) {
        return Err(EditError::Limit { what: "pixels a side", asked: n as u64, max: LARGEST.into() });
    }
    Ok(n as u32)
}

/// Reads an offset like `+10-20`.
fn offset(text: &str) -> Option<(i64, i64)> {
    let second = text[1..].find(['+', '-'])? + 1;
    let number = |text: &str| text.parse::<i32>().ok().map(i64::from);
    Some((number(&text[..second])?, number(&text[second..])?))
}

/// Reads a list of numbers that are separated by commas.
///
/// # Errors
/// [`EditError::Misuse`] for anything else.
pub fn numbers(text: &str) -> Result<Vec<f32>> {
    let wrong = || EditError::misuse(format!("\"{text}\" is not a list of numbers like 0.5 or 0.1,0.2,0.3"));
    text.split(',').map(|word| word.trim().parse::<f32>().map_err(|_| wrong())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_positions_and_corners_are_read() {
        let like = Window { x: 1, y: 2, width: 100, height: 50 };
        for (text, x, y, width, height) in [
            ("640x480", 1, 2, 640, 480),
            ("640x0", 1, 2, 640, 320),
            ("0x25", 1, 2, 50, 25),
            ("50%", 1, 2, 50, 25),
            ("50%x10%", 1, 2, 50, 5),
            ("1%", 1, 2, 1, 1),
            ("20x10+3-4", 3, -4, 20, 10),
            ("-3+4", -3, 4, 100, 50),
            ("10,20,19,39", 10, 20, 10, 20),
            ("-5,-5,-5,-5", -5, -5, 1, 1),
        ] {
            let found = Geometry::parse(text).and_then(|g| g.window(&like)).unwrap();
            assert_eq!(found, Window { x, y, width, height }, "{text}");
        }
        for text in [
            "",
            "640",
            "x",
            "0x0",
            "-1x5",
            "1,2,3",
            "5,5,4,9",
            "640x480+1",
            "axb",
            "50%%",
            "2000000x2",
            "0%",
            "9999999%",
        ] {
            assert!(Geometry::parse(text).and_then(|g| g.window(&like)).is_err(), "{text}");
        }
    }

    #[test]
    fn lists_of_numbers_are_read() {
        assert_eq!(numbers("0.5, -1,2e3").unwrap(), [0.5, -1.0, 2000.0]);
        assert!(numbers("1,,2").is_err() && numbers("").is_err());
    }
}
