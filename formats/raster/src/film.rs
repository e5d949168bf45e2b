//! Rows of samples of 8 to 64 bits, with or without gaps in words, as DPX and Cineon store them.

use crate::rows::Rows;
use granita_image::{FileSource, ImageSpec, PixelType, Pixels, Result};

/// The position of values of 10 and 12 bits in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// There are no gaps within a row.
    Packed,
    /// Values are in the high bits of words (method A).
    FilledHigh,
    /// Values are in the low bits of words (method B).
    FilledLow,
}

/// The order of the values of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// It is that of the channels.
    Plain,
    /// It is the reverse of that of the channels.
    Reversed,
    /// Pairs of pixels share their colour difference: Cb Y Cr Y.
    Pairs,
    /// The same with alpha: Cb Y A Cr Y A.
    PairsWithAlpha,
}

/// The stored form of an image element.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    /// The offset of the first stored row.
    pub(crate) at: u64,
    /// The number of bytes from one row to the next.
    pub(crate) stride: u64,
    pub(crate) bits: u8,
    pub(crate) packing: Packing,
    pub(crate) big_endian: bool,
    /// True when the first of three values of 10 bits has the lowest bits of a word, not the highest.
    pub(crate) low_first: bool,
    /// The number of values per pixel.
    pub(crate) components: usize,
    pub(crate) order: Order,
    /// True when the first stored row is the lowest of the image.
    pub(crate) upward: bool,
    /// True when the first stored value of a row is the last of the image.
    pub(crate) leftward: bool,
}

impl Element {
    /// The number of values of a row.
    pub(crate) fn datums(&self, width: u32) -> usize {
        match self.order {
            Order::Pairs | Order::PairsWithAlpha => (width as usize).next_multiple_of(2) * self.components,
            _ => width as usize * self.components,
        }
    }

    /// The number of bytes of a row, without padding to whole words where other programs omit it.
    pub(crate) fn line_bytes(&self, width: u32) -> u64 {
        let n = self.datums(width) as u64;
        match (self.bits, self.packing) {
            (10, Packing::FilledHigh | Packing::FilledLow) => n.div_ceil(3) * 4,
            (10 | 12, Packing::Packed) => (n * u64::from(self.bits)).div_ceil(32) * 4,
            (12, _) => n * 2,
            (bits, _) => n * u64::from(bits / 8),
        }
    }

    /// Returns the offset of a stored row.
    pub(crate) fn row_at(&self, row: u64) -> u64 {
        self.at.saturating_add(self.stride.saturating_mul(row))
    }

    /// Returns the channels of the pixels of a row, from left to right.
    pub(crate) fn arranged(&self, row: Pixels, width: usize, n: usize) -> Pixels {
        if self.order == Order::Plain && !self.leftward {
            return row;
        }
        // The place of channel `c` of pixel `x` among the values.
        let place = |x: usize, c: usize| match self.order {
            Order::Plain => x * n + c,
            Order::Reversed => x * n + n - 1 - c,
            Order::Pairs => x / 2 * 4 + [0, x % 2 * 2 + 1, 2][c],
            Order::PairsWithAlpha => x / 2 * 6 + [0, x % 2 * 3 + 1, 3, x % 2 * 3 + 2][c],
        };
        let mut out = Pixels::zeros(row.pixel_type(), width * n);
        for x in 0..width {
            let from = if self.leftward { width - 1 - x } else { x };
            for c in 0..n {
                out.copy_from(x * n + c, &row, place(from, c), 1);
            }
        }
        out
    }
}

/// The elements of a file.
pub(crate) struct FilmRows(pub(crate) Vec<Element>);

impl Rows for FilmRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        (image, _): (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let element = &self.0[image];
        let (width, n) = (spec.width as usize, spec.nchannels());
        let line = element.line_bytes(spec.width);
        let row_of = |y: u32| u64::from(if element.upward { spec.height - 1 - y } else { y });
        // The range is checked before memory is allocated for its pixels.
        let last = row_of(y0).max(row_of(y1 - 1));
        if element.row_at(last).saturating_add(line) > source.len() {
            let there = source.len().saturating_sub(element.at) / element.stride;
            let what = format!("the file ends early: {there} of {} rows are there", spec.height);
            return Err(source.malformed(what));
        }
        let mut out = Pixels::zeros(spec.pixel_type, width * n * (y1 - y0) as usize);
        for y in y0..y1 {
            let bytes = source.read_vec(element.row_at(row_of(y)), line, "a row")?;
            let row = element.arranged(datums(element, bytes, element.datums(spec.width)), width, n);
            out.copy_from((y - y0) as usize * width * n, &row, 0, width * n);
        }
        Ok(out)
    }
}

/// Returns the first `count` values of a stored row.
fn datums(element: &Element, bytes: Vec<u8>, count: usize) -> Pixels {
    let big = element.big_endian;
    let shorts = |bytes: &[u8]| -> Vec<u16> {
        let short = |b: &[u8; 2]| if big { u16::from_be_bytes(*b) } else { u16::from_le_bytes(*b) };
        bytes.as_chunks::<2>().0.iter().map(short).collect()
    };
    let words = || -> Vec<u32> {
        let word = |b: &[u8; 4]| if big { u32::from_be_bytes(*b) } else { u32::from_le_bytes(*b) };
        bytes.as_chunks::<4>().0.iter().map(word).collect()
    };
    let mut pixels = match (element.bits, element.packing) {
        (10, Packing::FilledHigh | Packing::FilledLow) => {
            let padding = if element.packing == Packing::FilledHigh { 2 } else { 0 };
            let shifts = if element.low_first { [0, 10, 20] } else { [20, 10, 0] };
            let three = |w: &u32| shifts.map(|shift| wide10((w >> (shift + padding)) as u16 & 0x3ff));
            Pixels::U16(words().iter().flat_map(three).collect())
        }
        (12, Packing::FilledHigh) => Pixels::U16(shorts(&bytes).iter().map(|v| wide12(v >> 4)).collect()),
        (12, Packing::FilledLow) => Pixels::U16(shorts(&bytes).iter().map(|v| wide12(v & 0xfff)).collect()),
        (10, Packing::Packed) => Pixels::U16(packed(&words(), 10, count).map(wide10).collect()),
        (12, Packing::Packed) => Pixels::U16(packed(&words(), 12, count).map(wide12).collect()),
        (64, _) => {
            let double = |b: &[u8; 8]| if big { f64::from_be_bytes(*b) } else { f64::from_le_bytes(*b) };
            Pixels::Float(bytes.as_chunks::<8>().0.iter().map(|b| double(b) as f32).collect())
        }
        (32, _) => Pixels::from_bytes(PixelType::Float, bytes, big),
        (16, _) => Pixels::from_bytes(PixelType::U16, bytes, big),
        // The header permits no other number of bits than 8.
        _ => Pixels::U8(bytes),
    };
    pixels.truncate(count);
    pixels
}

/// Returns values that are packed without gaps into words, beginning with the lowest bit.
fn packed(words: &[u32], bits: usize, count: usize) -> impl Iterator<Item = u16> {
    (0..count).map(move |i| {
        let (at, shift) = (i * bits / 32, i * bits % 32);
        let next = words.get(at + 1).copied().unwrap_or(0);
        let both = u64::from(words.get(at).copied().unwrap_or(0)) | u64::from(next) << 32;
        (both >> shift) as u16 & ((1 << bits) - 1)
    })
}

/// Returns 16 bits of 10: the highest bits are repeated as the lowest ones.
fn wide10(v: u16) -> u16 {
    v << 6 | v >> 4
}

/// Returns 16 bits of 12: the highest bits are repeated as the lowest ones.
fn wide12(v: u16) -> u16 {
    v << 4 | v >> 8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_values_continue_in_the_next_word() {
        let values: Vec<u16> = (0..40).map(|i| i * 25 + 1).collect();
        for bits in [10, 12] {
            let mut words = vec![0_u32; (values.len() * bits).div_ceil(32)];
            for (i, v) in values.iter().enumerate() {
                for bit in (0..bits).filter(|bit| v >> bit & 1 == 1) {
                    words[(i * bits + bit) / 32] |= 1 << ((i * bits + bit) % 32);
                }
            }
            assert_eq!(packed(&words, bits, values.len()).collect::<Vec<_>>(), values);
        }
    }

    #[test]
    fn ten_and_twelve_bits_span_the_range_of_sixteen() {
        assert_eq!([wide10(0), wide10(0x3ff), wide12(0), wide12(0xfff)], [0, 65535, 0, 65535]);
        for (v, near) in [(1, 64.06), (512, 32799.5), (700, 44843.1)] {
            assert!((f64::from(wide10(v)) - near).abs() < 1.0, "{v}");
        }
    }
}
