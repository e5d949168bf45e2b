//! DDS, the format of graphics cards (Microsoft, "DDS file layout", "Programming guide for DDS").

mod layout;
mod output;

use crate::rows::{Rows, RowsInput};
use granita_base::{BaseType, Param, ParamType};
use granita_image::{
    CreateOptions, FileSource, Format, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Pixels, Result,
};
use half::f16;
use layout::{Block, Storage};
use std::path::Path;

/// The format "dds".
///
/// Reading supports the block compressions BC1 to BC7 (also called DXT1 to DXT5, ATI1, ATI2), uncompressed integers of
/// any masks up to 32 bits per pixel, and 16 or 32-bit floats and integers. MIP levels are read, and the faces of cubes
/// and the elements of arrays as further images. Files are written uncompressed, with MIP levels, in 8 bits of 1 to 4
/// channels, or in 16 bits, halves and floats of 1, 2 or 4 channels.
///
/// BC1 to BC3 and BC7 are read as 8 bits RGBA, BC4 and BC5 as 8 bits of one and two channels (floats when signed), and
/// BC6H as halves RGB. An image with alpha has the attribute `unassociatedalpha` unless its header declares otherwise.
/// Images are written unchanged with a header that describes their alpha. Only those of 8 bits, whose header cannot,
/// are divided by alpha unless they have the attribute.
#[derive(Clone, Copy, Debug, Default)]
pub struct DdsFormat;

impl Format for DdsFormat {
    fn name(&self) -> &'static str {
        "dds"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["dds"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"DDS ")
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "DDS", &limits.files)?;
        let header = layout::Header::read(&source)?;
        limits.within(path, "number of images", u64::from(header.images), u64::from(limits.images))?;
        let storage = header.storage.clone();
        let mut images = Vec::new();
        let mut starts = Vec::new();
        let mut at = header.data_at;
        for _ in 0..header.images {
            let (mut levels, mut places) = (Vec::new(), Vec::new());
            for level in 0..header.levels {
                let side = |n: u32| (n >> level).max(1);
                let mut spec =
                    ImageSpec::new(side(header.width), side(header.height), 1, storage.pixel_type());
                spec.channels = storage.channels();
                if spec.alpha_channel().is_some() && !header.premultiplied {
                    let (ty, data) = (ParamType::of(BaseType::Int), 1.into());
                    spec.attributes.set(Param { name: "unassociatedalpha".into(), ty, data });
                }
                let (ty, data) = (ParamType::of(BaseType::String), storage.word().into());
                spec.attributes.set(Param { name: "compression".into(), ty, data });
                limits.check(path, "DDS", &spec)?;
                places.push(at);
                let bytes = storage.row_bytes(spec.width).checked_mul(storage.stored_rows(spec.height));
                let end = bytes.and_then(|b| at.checked_add(b));
                at = end.ok_or_else(|| source.malformed("a level of more than 2^64 bytes"))?;
                levels.push(spec);
            }
            if at > source.len() {
                break;
            }
            images.push(levels);
            starts.push(places);
        }
        if at > source.len() {
            let what = format!("its images end at byte {at}, but the file at byte {}", source.len());
            return Err(source.malformed(what));
        }
        let rows = DdsRows { storage, starts };
        Ok(Box::new(RowsInput::new("dds", "DDS", source, limits, images, rows)?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "levels" | "u16" | "half" | "float" | "alpha")
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(output::DdsOutput::create(path, options)?))
    }
}

struct DdsRows {
    storage: Storage,
    /// The offset of every level of every image.
    starts: Vec<Vec<u64>>,
}

impl Rows for DdsRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        (image, level): (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let stride = self.storage.row_bytes(spec.width);
        let (first, last) = match self.storage {
            Storage::Blocks(_) => (y0 / 4, y1.div_ceil(4)),
            _ => (y0, y1),
        };
        let at = self.starts[image][level] + u64::from(first) * stride;
        let bytes = source.read_vec(at, u64::from(last - first) * stride, "the pixels")?;
        Ok(match &self.storage {
            Storage::Blocks(kind) => decode_blocks(*kind, spec, &bytes, y0, y1),
            Storage::Masks { bytes: size, masks } => {
                let wide = spec.pixel_type == PixelType::U16;
                let values = bytes.chunks_exact(*size).flat_map(|pixel| {
                    let word = pixel.iter().rev().fold(0u32, |n, b| n << 8 | u32::from(*b));
                    masks.iter().map(move |m| scaled(word, *m, if wide { 65535 } else { 255 }))
                });
                if wide {
                    Pixels::U16(values.collect())
                } else {
                    Pixels::U8(values.map(|v| v as u8).collect())
                }
            }
            Storage::Plain(pixel_type, _) => Pixels::from_bytes(*pixel_type, bytes, false),
        })
    }
}

/// Returns the bits of `word` under `mask`, scaled to `0..=max`.
fn scaled(word: u32, mask: u32, max: u64) -> u16 {
    if mask == 0 {
        return max as u16;
    }
    let top = u64::from(mask >> mask.trailing_zeros());
    let value = u64::from((word & mask) >> mask.trailing_zeros());
    ((value * max + top / 2) / top).min(max) as u16
}

/// Returns rows `y0..y1` from rows of 4 x 4 blocks. The first row of blocks holds `y0`.
fn decode_blocks(kind: Block, spec: &ImageSpec, bytes: &[u8], y0: u32, y1: u32) -> Pixels {
    let n = spec.nchannels();
    let across = spec.width.div_ceil(4) as usize;
    let (width, rows) = (spec.width as usize, (y1 - y0) as usize);
    let mut out = Pixels::zeros(spec.pixel_type, width * rows * n);
    let top = (y0 / 4 * 4) as usize;
    for (i, block) in bytes.chunks_exact(kind.bytes()).enumerate() {
        let texels = decode_block(kind, block);
        let (bx, by) = (i % across * 4, top + i / across * 4);
        for y in 0..4 {
            let Some(row) = (by + y).checked_sub(y0 as usize).filter(|r| *r < rows) else { continue };
            out.copy_from((row * width + bx) * n, &texels, y * 4 * n, (width - bx).min(4) * n);
        }
    }
    out
}

/// Returns the 16 texels of one block.
fn decode_block(kind: Block, block: &[u8]) -> Pixels {
    let mut bytes = [0u8; 64];
    match kind {
        Block::Bc1 => bcdec_rs::bc1(block, &mut bytes, 16),
        Block::Bc2 => bcdec_rs::bc2(block, &mut bytes, 16),
        Block::Bc3 => bcdec_rs::bc3(block, &mut bytes, 16),
        Block::Bc7 => bcdec_rs::bc7(block, &mut bytes, 16),
        Block::Bc4 { signed: false } => {
            bcdec_rs::bc4(block, &mut bytes, 4, false);
            return Pixels::U8(bytes[..16].to_vec());
        }
        Block::Bc5 { signed: false } => {
            bcdec_rs::bc5(block, &mut bytes, 8, false);
            return Pixels::U8(bytes[..32].to_vec());
        }
        Block::Bc4 { signed: true } => {
            let mut values = [0f32; 16];
            bcdec_rs::bc4_float(block, &mut values, 4, true);
            return Pixels::Float(values.to_vec());
        }
        Block::Bc5 { signed: true } => {
            let mut values = [0f32; 32];
            bcdec_rs::bc5_float(block, &mut values, 8, true);
            return Pixels::Float(values.to_vec());
        }
        Block::Bc6 { signed } => {
            let mut values = [0u16; 48];
            bcdec_rs::bc6h_half(block, &mut values, 12, signed);
            return Pixels::Half(values.iter().map(|v| f16::from_bits(*v)).collect());
        }
    }
    Pixels::U8(bytes.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channel_masks_are_scaled_to_the_whole_range() {
        assert_eq!(scaled(0xf800, 0xf800, 255), 255);
        assert_eq!(scaled(0x0000, 0xf800, 255), 0);
        assert_eq!(scaled(0x8000, 0xf800, 255), 132);
        assert_eq!(scaled(0x1234_5678, 0x0000_ff00, 255), 0x56);
        assert_eq!(scaled(0, 0, 255), 255);
        assert_eq!(scaled(u32::MAX, u32::MAX, 65535), 65535);
    }

    /// The block of two colours of BC1 is computed from the format's description. It has red and blue, and two mixtures
    /// by thirds.
    #[test]
    fn bc1_and_bc4_blocks_decode_to_computed_texels() {
        let block = [0x00, 0xf8, 0x1f, 0x00, 0b1110_0100, 0b1110_0100, 0b1110_0100, 0b1110_0100];
        let Pixels::U8(texels) = decode_block(Block::Bc1, &block) else { panic!() };
        assert_eq!(texels[..4], [255, 0, 0, 255]);
        assert_eq!(texels[4..8], [0, 0, 255, 255]);
        assert_eq!(texels[8..12], [170, 0, 85, 255]);
        assert_eq!(texels[12..16], [85, 0, 170, 255]);
        assert_eq!(texels[16..32], texels[..16]);
        // The block is alpha of BC4 with two end values. All texels have the first.
        let Pixels::U8(texels) = decode_block(Block::Bc4 { signed: false }, &[200, 100, 0, 0, 0, 0, 0, 0])
        else {
            panic!()
        };
        assert_eq!(texels, [200; 16]);
    }
}
