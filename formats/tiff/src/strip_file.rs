//! Kinds of values and of compression that the crate `tiff` decodes: one strip or tile is given to it as a file of its
//! own.
//!
//! So these kinds are read by position and from any thread as all others are, memory is bounded by the strip, and no
//! channel is lost (of a whole picture the crate leaves further channels out).

use crate::directory::Layout;
use granita_image::{PixelType, Pixels, contained};
use half::f16;
use std::io::Cursor;
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// One strip or tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chunk {
    /// Pixels across and down.
    pub(crate) size: (usize, usize),
    /// Values of one pixel.
    pub(crate) samples: usize,
    pub(crate) bits: u64,
    /// Number of the kind of values: 1 unsigned, 2 signed, 3 floats.
    pub(crate) format: u64,
    /// Number of the compression.
    pub(crate) compression: u64,
    pub(crate) predictor: u64,
    /// Byte order of the file.
    pub(crate) big_endian: bool,
}

/// The type that signed, 64-bit and bilevel values are given out in: the smallest that holds 8 and 16-bit numbers
/// exactly. Larger ones are rounded to 24 bits.
pub(crate) fn type_for(format: u64, bits: u64) -> Option<PixelType> {
    match (format, bits) {
        (2, 8) => Some(PixelType::Half),
        (2, 16 | 32 | 64) | (1 | 3, 64) => Some(PixelType::Float),
        _ => None,
    }
}

impl Chunk {
    /// The pixels in `data`. `Err` says what is wrong with it.
    pub(crate) fn decode(self, data: &[u8]) -> Result<Pixels, String> {
        let file = self.file(data)?;
        let decoded = contained(|| {
            let mut limits = Limits::default();
            limits.decoding_buffer_size = self.bytes();
            limits.intermediate_buffer_size = data.len();
            Decoder::new(Cursor::new(file))?.with_limits(limits).read_image()
        })?;
        let pixels = match decoded.map_err(|e| e.to_string())? {
            DecodingResult::U8(v) => Pixels::U8(v),
            DecodingResult::I8(v) => Pixels::Half(v.into_iter().map(f16::from).collect()),
            DecodingResult::I16(v) => floats(v, f32::from),
            DecodingResult::I32(v) => floats(v, |n| n as f32),
            DecodingResult::I64(v) => floats(v, |n| n as f32),
            DecodingResult::U64(v) => floats(v, |n| n as f32),
            DecodingResult::F64(v) => floats(v, |n| n as f32),
            // Of types that `type_for` does not list.
            _ => return Err(format!("values of kind {} with {} bits", self.format, self.bits)),
        };
        Ok(pixels)
    }

    /// Bytes of its decoded values.
    fn bytes(self) -> usize {
        (self.size.0 * self.samples * self.bits as usize).div_ceil(8) * self.size.1
    }

    /// A file of one image in one strip. Its channels are called shades of grey: the crate gives out all of these.
    fn file(self, data: &[u8]) -> Result<Vec<u8>, String> {
        /// Bytes before the data: header, number of entries, entries, end of the chain.
        const FRONT: usize = 8 + 2 + 11 * 12 + 4;
        let layout = Layout { big_endian: self.big_endian, big_tiff: false };
        let (width, height) = self.size;
        let mut file = if self.big_endian { b"MM\0\x2a".to_vec() } else { b"II\x2a\0".to_vec() };
        file.extend(layout.long(8));
        let number = |n: usize| u32::try_from(n).map_err(|_| format!("{n} bytes or pixels in one strip"));
        file.extend(layout.short(11));
        for (tag, value) in [
            (256, number(width)?),
            (257, number(height)?),
            (258, self.bits as u32),
            (259, self.compression as u32),
            (262, 1),
            (273, FRONT as u32),
            (277, number(self.samples)?),
            (278, number(height)?),
            (279, number(data.len())?),
            (317, self.predictor as u32),
            (339, self.format as u32),
        ] {
            // One number of 32 bits.
            file.extend([layout.short(tag), layout.short(4)].concat());
            file.extend([layout.long(1), layout.long(value)].concat());
        }
        file.extend(layout.long(0));
        debug_assert_eq!(file.len(), FRONT);
        file.extend_from_slice(data);
        Ok(file)
    }
}

fn floats<T>(values: Vec<T>, get: impl Fn(T) -> f32) -> Pixels {
    Pixels::Float(values.into_iter().map(get).collect())
}
