//! The header of a DDS file, and its description of the storage of pixels.

use granita_image::{FileSource, ImageSpec, PixelType, Result};

/// A block compression. Every block holds 4 x 4 texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Block {
    Bc1,
    Bc2,
    Bc3,
    Bc4 { signed: bool },
    Bc5 { signed: bool },
    Bc6 { signed: bool },
    Bc7,
}

impl Block {
    /// Returns the number of bytes of one block.
    pub(super) fn bytes(self) -> usize {
        if matches!(self, Self::Bc1 | Self::Bc4 { .. }) { 8 } else { 16 }
    }
}

/// The storage of pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Storage {
    Blocks(Block),
    /// Words of `bytes` bytes, which contain the bits of the channels. The mask of a channel that is not stored is 0.
    Masks {
        bytes: usize,
        masks: Vec<u32>,
    },
    /// Values of one type, and their number per pixel.
    Plain(PixelType, usize),
}

impl Storage {
    fn rgba8(order: [u32; 4], alpha: bool) -> Self {
        let masks = order[..if alpha { 4 } else { 3 }].iter().map(|byte| 0xff << (8 * byte)).collect();
        Self::Masks { bytes: 4, masks }
    }

    /// Converts a number of the enumeration `DXGI_FORMAT`.
    fn of_dxgi(number: u32) -> Option<Self> {
        use PixelType::{Float, Half, U16, U32};
        Some(match number {
            2 => Self::Plain(Float, 4),
            6 => Self::Plain(Float, 3),
            10 => Self::Plain(Half, 4),
            11 => Self::Plain(U16, 4),
            16 => Self::Plain(Float, 2),
            24 => Self::Masks { bytes: 4, masks: vec![0x3ff, 0xf_fc00, 0x3ff0_0000, 0xc000_0000] },
            27..=29 => Self::rgba8([0, 1, 2, 3], true),
            34 => Self::Plain(Half, 2),
            35 => Self::Plain(U16, 2),
            41 => Self::Plain(Float, 1),
            42 => Self::Plain(U32, 1),
            49 => Self::Plain(PixelType::U8, 2),
            54 => Self::Plain(Half, 1),
            56 => Self::Plain(U16, 1),
            61 | 65 => Self::Plain(PixelType::U8, 1),
            70..=72 => Self::Blocks(Block::Bc1),
            73..=75 => Self::Blocks(Block::Bc2),
            76..=78 => Self::Blocks(Block::Bc3),
            79 | 80 => Self::Blocks(Block::Bc4 { signed: false }),
            81 => Self::Blocks(Block::Bc4 { signed: true }),
            82 | 83 => Self::Blocks(Block::Bc5 { signed: false }),
            84 => Self::Blocks(Block::Bc5 { signed: true }),
            85 => Self::Masks { bytes: 2, masks: vec![0xf800, 0x07e0, 0x001f] },
            86 => Self::Masks { bytes: 2, masks: vec![0x7c00, 0x03e0, 0x001f, 0x8000] },
            87 | 90 | 91 => Self::rgba8([2, 1, 0, 3], true),
            88 | 92 | 93 => Self::rgba8([2, 1, 0, 3], false),
            94 | 95 => Self::Blocks(Block::Bc6 { signed: false }),
            96 => Self::Blocks(Block::Bc6 { signed: true }),
            97..=99 => Self::Blocks(Block::Bc7),
            115 => Self::Masks { bytes: 2, masks: vec![0x0f00, 0x00f0, 0x000f, 0xf000] },
            _ => return None,
        })
    }

    /// Converts the four characters, or the number, of the older header.
    fn of_four(four: [u8; 4]) -> Option<Self> {
        use PixelType::{Float, Half, U16};
        Some(match &four {
            b"DXT1" => Self::Blocks(Block::Bc1),
            b"DXT2" | b"DXT3" => Self::Blocks(Block::Bc2),
            b"DXT4" | b"DXT5" => Self::Blocks(Block::Bc3),
            b"ATI1" | b"BC4U" => Self::Blocks(Block::Bc4 { signed: false }),
            b"BC4S" => Self::Blocks(Block::Bc4 { signed: true }),
            b"ATI2" | b"BC5U" => Self::Blocks(Block::Bc5 { signed: false }),
            b"BC5S" => Self::Blocks(Block::Bc5 { signed: true }),
            _ => match u32::from_le_bytes(four) {
                36 => Self::Plain(U16, 4),
                111 => Self::Plain(Half, 1),
                112 => Self::Plain(Half, 2),
                113 => Self::Plain(Half, 4),
                114 => Self::Plain(Float, 1),
                115 => Self::Plain(Float, 2),
                116 => Self::Plain(Float, 4),
                _ => return None,
            },
        })
    }

    pub(super) fn pixel_type(&self) -> PixelType {
        match self {
            Self::Blocks(Block::Bc6 { .. }) => PixelType::Half,
            Self::Blocks(Block::Bc4 { signed: true } | Block::Bc5 { signed: true }) => PixelType::Float,
            Self::Blocks(_) => PixelType::U8,
            Self::Masks { masks, .. } if masks.iter().any(|m| m.count_ones() > 8) => PixelType::U16,
            Self::Masks { .. } => PixelType::U8,
            Self::Plain(pixel_type, _) => *pixel_type,
        }
    }

    pub(super) fn channels(&self) -> Vec<String> {
        let n = match self {
            Self::Blocks(Block::Bc4 { .. }) => 1,
            Self::Blocks(Block::Bc5 { .. }) => 2,
            Self::Blocks(Block::Bc6 { .. }) => 3,
            Self::Blocks(_) => 4,
            Self::Masks { masks, .. } => masks.len(),
            Self::Plain(_, n) => *n,
        };
        match self {
            // Two values are the first two of a vector. Luminance and alpha have masks.
            Self::Blocks(_) | Self::Plain(..) if n == 2 => vec!["R".to_owned(), "G".to_owned()],
            _ => ImageSpec::default_channels(n),
        }
    }

    /// Returns the value of the attribute `compression`.
    pub(super) fn word(&self) -> &'static str {
        match self {
            Self::Blocks(Block::Bc1) => "bc1",
            Self::Blocks(Block::Bc2) => "bc2",
            Self::Blocks(Block::Bc3) => "bc3",
            Self::Blocks(Block::Bc4 { .. }) => "bc4",
            Self::Blocks(Block::Bc5 { .. }) => "bc5",
            Self::Blocks(Block::Bc6 { .. }) => "bc6h",
            Self::Blocks(Block::Bc7) => "bc7",
            _ => "none",
        }
    }

    /// Returns the number of bytes of one stored row (of blocks) of a level.
    pub(super) fn row_bytes(&self, width: u32) -> u64 {
        let width = u64::from(width);
        match self {
            Self::Blocks(kind) => width.div_ceil(4) * kind.bytes() as u64,
            Self::Masks { bytes, .. } => width * *bytes as u64,
            Self::Plain(pixel_type, n) => width * (pixel_type.bytes() * n) as u64,
        }
    }

    /// Returns the number of stored rows (of blocks) of a level.
    pub(super) fn stored_rows(&self, height: u32) -> u64 {
        u64::from(if matches!(self, Self::Blocks(_)) { height.div_ceil(4) } else { height })
    }
}

/// The content of a file's header.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) levels: u32,
    /// The number of elements of an array times the number of faces of a cube.
    pub(super) images: u32,
    pub(super) storage: Storage,
    /// True when colours are multiplied by alpha.
    pub(super) premultiplied: bool,
    pub(super) data_at: u64,
}

impl Header {
    pub(super) fn read(source: &FileSource) -> Result<Self> {
        let bytes = source.read_vec(0, 128, "the header")?;
        let long = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        if !bytes.starts_with(b"DDS ") || long(4) != 124 || long(76) != 32 {
            return Err(source.malformed("it does not begin like one"));
        }
        let (height, width, count) = (long(12), long(16), long(28));
        let (flags, bits) = (long(80), long(88));
        let four: [u8; 4] = [bytes[84], bytes[85], bytes[86], bytes[87]];
        let caps = long(112);
        let mut data_at = 128;
        let mut images = if caps & 0x200 != 0 { (caps & 0xfc00).count_ones().max(1) } else { 1 };
        let mut premultiplied = matches!(&four, b"DXT2" | b"DXT4");
        let unknown = |what: String| source.unsupported(format!("DDS with {what} is not supported"));
        if caps & 0x20_0000 != 0 {
            return Err(unknown(format!("a volume of {} slices", long(24))));
        }
        let storage = if flags & 4 != 0 && &four == b"DX10" {
            let more = source.read_vec(128, 20, "the second header")?;
            let long = |at: usize| u32::from_le_bytes([more[at], more[at + 1], more[at + 2], more[at + 3]]);
            data_at += 20;
            if long(4) == 4 {
                return Err(unknown("a volume".to_owned()));
            }
            let faces = if long(8) & 4 != 0 { 6 } else { 1 };
            images = long(12).max(1).saturating_mul(faces);
            premultiplied = long(16) & 7 == 2;
            Storage::of_dxgi(long(0)).ok_or_else(|| unknown(format!("pixels of DXGI format {}", long(0))))?
        } else if flags & 4 != 0 {
            let name = four.iter().all(u8::is_ascii_graphic);
            Storage::of_four(four).ok_or_else(|| {
                unknown(if name {
                    format!("pixels of kind \"{}\"", String::from_utf8_lossy(&four))
                } else {
                    format!("pixels of kind {}", u32::from_le_bytes(four))
                })
            })?
        } else {
            if bits == 0 || bits > 32 || bits % 8 != 0 {
                return Err(unknown(format!("pixels of {bits} bits")));
            }
            let alpha = (flags & 1 != 0 && long(104) != 0).then_some(long(104));
            let masks = if flags & 0x40 != 0 {
                [long(92), long(96), long(100)].into_iter().chain(alpha).collect()
            } else if flags & 0x2_0000 != 0 {
                [long(92)].into_iter().chain(alpha).collect()
            } else if flags & 2 != 0 {
                vec![long(104)]
            } else {
                return Err(unknown(format!("pixels of flags {flags:#x}")));
            };
            Storage::Masks { bytes: bits as usize / 8, masks }
        };
        // A number of levels beyond 1 x 1 is treated as an error of the writer.
        let all = 32 - width.max(height).max(1).leading_zeros();
        Ok(Self { width, height, levels: count.clamp(1, all), images, storage, premultiplied, data_at })
    }
}
