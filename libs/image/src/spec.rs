//! What an image is, apart from its pixels.

use granita_base::Params;

/// How one channel of one pixel is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PixelType {
    /// 8-bit unsigned; 255 stands for 1.
    U8,
    /// 16-bit unsigned; 65535 stands for 1.
    U16,
    /// 32-bit unsigned; as a number, not a fraction.
    U32,
    /// 16-bit float.
    Half,
    /// 32-bit float.
    Float,
}

impl PixelType {
    /// Bytes of one channel value.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::Half => 2,
            Self::U32 | Self::Float => 4,
        }
    }

    /// What people are told: "uint8", "half", "float" ...
    pub fn word(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::U32 => "uint32",
            Self::Half => "half",
            Self::Float => "float",
        }
    }
}

/// Everything about one MIP level of one image of a file, except the pixels.
///
/// The data window is `width x height` at `(x, y)`; the display window is
/// `full_width x full_height` at `(full_x, full_y)`. Rows run downward, row 0 is the top.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageSpec {
    /// Pixels across the data window.
    pub width: u32,
    /// Pixels down the data window.
    pub height: u32,
    /// Left edge of the data window in the display window's coordinates.
    pub x: i32,
    /// Upper edge of the data window.
    pub y: i32,
    /// Left edge of the display window.
    pub full_x: i32,
    /// Upper edge of the display window.
    pub full_y: i32,
    /// Width of the display window; for cube-face maps, of one face (reference 9.2.7).
    pub full_width: u32,
    /// Height of the display window; for cube-face maps, of one face.
    pub full_height: u32,
    /// Tile width in pixels; 0 for an image stored in scanlines.
    pub tile_width: u32,
    /// Tile height in pixels; 0 for an image stored in scanlines.
    pub tile_height: u32,
    /// One name per channel, in the order of the pixels: "R", "G", "B", "A", "Z" or the file's own.
    pub channels: Vec<String>,
    /// Storage of every channel.
    pub pixel_type: PixelType,
    /// Metadata. Names of the suite: `textureformat`, `wrapmodes` (strings), `worldtocamera`,
    /// `worldtoscreen` (matrices), `fovcot` (float), `compression`, `ImageDescription`,
    /// `DocumentName`, `Artist`, `copyright`, `software`, `owner` (strings), `rowsperstrip` (int),
    /// `planarconfig` ("contig" or "separate"), `unassociatedalpha` (int; 1: the colours are not
    /// multiplied by alpha, as in PNG; absent or 0: they are, as the suite computes).
    pub attributes: Params,
}

impl ImageSpec {
    /// A scanline image whose windows are the same, channels named by [`ImageSpec::default_channels`].
    pub fn new(width: u32, height: u32, nchannels: usize, pixel_type: PixelType) -> Self {
        Self {
            width,
            height,
            x: 0,
            y: 0,
            full_x: 0,
            full_y: 0,
            full_width: width,
            full_height: height,
            tile_width: 0,
            tile_height: 0,
            channels: Self::default_channels(nchannels),
            pixel_type,
            attributes: Params::new(),
        }
    }

    /// The same, stored in tiles.
    pub fn tiled(self, tile_width: u32, tile_height: u32) -> Self {
        Self { tile_width, tile_height, ..self }
    }

    /// "Y"; "Y", "A"; "R", "G", "B"; "R", "G", "B", "A"; then "channel4" and so on.
    pub fn default_channels(n: usize) -> Vec<String> {
        let names: &[&str] = match n {
            1 => &["Y"],
            2 => &["Y", "A"],
            _ => &["R", "G", "B", "A"],
        };
        (0..n).map(|i| names.get(i).map_or_else(|| format!("channel{i}"), |s| (*s).to_owned())).collect()
    }

    /// Number of channels.
    pub fn nchannels(&self) -> usize {
        self.channels.len()
    }

    /// Whether it is stored in tiles.
    pub fn is_tiled(&self) -> bool {
        self.tile_width > 0
    }

    /// Index of the alpha channel, named "A" or "alpha".
    pub fn alpha_channel(&self) -> Option<usize> {
        self.channels.iter().position(|c| c == "A" || c.eq_ignore_ascii_case("alpha"))
    }

    /// Tiles across and down; (0, 0) for scanlines.
    pub fn tiles(&self) -> (u32, u32) {
        if self.is_tiled() {
            (self.width.div_ceil(self.tile_width), self.height.div_ceil(self.tile_height))
        } else {
            (0, 0)
        }
    }

    /// Bytes of all pixels of the data window; `None` when that does not fit in 64 bits.
    pub fn bytes(&self) -> Option<u64> {
        u64::from(self.width)
            .checked_mul(u64::from(self.height))?
            .checked_mul(self.nchannels() as u64)?
            .checked_mul(self.pixel_type.bytes() as u64)
    }

    /// Bytes of memory that it takes to decode so many rows together, packed, unpacked and in order. 0 where they are as few as
    /// any reader asks for at once.
    pub fn decoding_bytes(&self, rows: u32) -> u64 {
        const FEW: u32 = 256;
        let row = u64::from(self.width).saturating_mul((self.nchannels() * self.pixel_type.bytes()) as u64);
        let rows = rows.min(self.height);
        if rows > FEW { row.saturating_mul(3 * u64::from(rows)) } else { 0 }
    }

    /// Value of a string attribute.
    pub fn string(&self, name: &str) -> Option<&str> {
        self.attributes.string(name).map(|s| &**s)
    }

    /// Value of a matrix attribute, row by row.
    pub fn matrix(&self, name: &str) -> Option<[f32; 16]> {
        self.attributes.floats(name)?.get(..16)?.try_into().ok()
    }
}
