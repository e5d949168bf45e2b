//! Decodes kinds of values and of compression by the crate `tiff`. One strip or tile is passed to it as a file of its
//! own.
//!
//! These kinds are therefore read by position and from any thread, as all others are. Memory is bounded by the strip.
//! No channel is lost, whereas the crate omits further channels of a whole image.

use crate::directory::Layout;
use granita_image::{PixelType, Pixels, contained};
use half::f16;
use std::io::Cursor;
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// One strip or tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chunk {
    /// The number of pixels across and down.
    pub(crate) size: (usize, usize),
    /// The number of values of one pixel.
    pub(crate) samples: usize,
    pub(crate) bits: u64,
    /// The number of the kind of values: 1 unsigned, 2 signed, 3 floats.
    pub(crate) format: u64,
    /// The number of the compression.
    pub(crate) compression: u64,
    pub(crate) predictor: u64,
    /// True when the file is big-endian.
    pub(crate) big_endian: bool,
}

/// Returns the type of signed and 64-bit values after reading. It is the smallest type that holds 8 and 16-bit numbers
/// exactly. Larger numbers are rounded to 24 bits.
pub(crate) fn type_for(format: u64, bits: u64) -> Option<PixelType> {
    match (format, bits) {
        (2, 8) => Some(PixelType::Half),
        (2, 16 | 32 | 64) | (1 | 3, 64) => Some(PixelType::Float),
        _ => None,
    }
}

impl Chunk {
    /// Returns the pixels in `data`. `Err` describes the error in the data.
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
            // The values are of a type that `type_for` does not list.
            _ => return Err(format!("values of kind {} with {} bits", self.format, self.bits)),
        };
        Ok(pixels)
    }

    /// Returns the number of bytes of its decoded values.
    fn bytes(self) -> usize {
        (self.size.0 * self.samples * self.bits as usize).div_ceil(8) * self.size.1
    }

    /// Returns a file of one image in one strip. Its channels are declared as shades of grey, all of which the crate
    /// returns.
    fn file(self, data: &[u8]) -> Result<Vec<u8>, String> {
        /// The number of bytes before the data: header, number of entries, entries, end of the chain.
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
            // The entry has one number of 32 bits.
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
