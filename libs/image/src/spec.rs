//! The description of an image without its pixels.

use granita_base::{BaseType, Param, ParamType, Params};
use std::sync::Arc;

/// The storage type of one channel of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PixelType {
    /// 8-bit unsigned; 255 represents 1.
    U8,
    /// 16-bit unsigned; 65535 represents 1.
    U16,
    /// 32-bit unsigned; a number, not a fraction.
    U32,
    /// 16-bit float.
    Half,
    /// 32-bit float.
    Float,
}

impl PixelType {
    /// The number of bytes of one channel value.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::Half => 2,
            Self::U32 | Self::Float => 4,
        }
    }

    /// Returns the name for users: "uint8", "half", "float" ...
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

/// The description of one MIP level of one image of a file, without the pixels.
///
/// The data window is `width x height` at `(x, y)`. The display window is `full_width x full_height` at
/// `(full_x, full_y)`. Rows run downward, and row 0 is the top.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageSpec {
    /// The width of the data window in pixels.
    pub width: u32,
    /// The height of the data window in pixels.
    pub height: u32,
    /// The left edge of the data window in the coordinates of the display window.
    pub x: i32,
    /// The upper edge of the data window.
    pub y: i32,
    /// The left edge of the display window.
    pub full_x: i32,
    /// The upper edge of the display window.
    pub full_y: i32,
    /// The width of the display window; for cube-face maps, of one face (reference 9.2.7).
    pub full_width: u32,
    /// The height of the display window; for cube-face maps, of one face.
    pub full_height: u32,
    /// The tile width in pixels; 0 for an image stored in scanlines.
    pub tile_width: u32,
    /// The tile height in pixels; 0 for an image stored in scanlines.
    pub tile_height: u32,
    /// One name per channel, in the order of the pixels: "R", "G", "B", "A", "Z" or the file's own.
    pub channels: Vec<String>,
    /// The storage type of every channel.
    pub pixel_type: PixelType,
    /// Metadata. The names of the suite are `textureformat`, `wrapmodes` (strings), `worldtocamera`, `worldtoscreen`
    /// (matrices), `fovcot` (float), `compression`, `ImageDescription`, `DocumentName`, `Artist`, `copyright`,
    /// `software`, `owner` (strings), `rowsperstrip` (int), `planarconfig` ("contig" or "separate"), and
    /// `unassociatedalpha` (int; 1: the colours are not multiplied by alpha, as in PNG; absent or 0: they are, as in
    /// the suite's computations).
    pub attributes: Params,
    /// The ICC profile of the colours, as the file has it. It is not applied by readers, and writers store it where the
    /// format can hold one. Its description is also the attribute `ICCProfile`, which writers ignore.
    pub icc_profile: Option<Arc<[u8]>>,
}

/// The attributes that describe the colours of the stored values.
const COLORS: [&str; 10] = [
    "ICCProfile",
    "CICP",
    "png:cICP",
    "png:gAMA",
    "png:cHRM",
    "png:sRGB",
    "chromaticities",
    "colorInteropID",
    "oiio:ColorSpace",
    "Exif:ColorSpace",
];

/// True for an attribute that describes the colours of the stored values, such as `chromaticities`.
pub fn is_about_colors(name: &str) -> bool {
    COLORS.contains(&name)
}

impl ImageSpec {
    /// Returns a scanline image whose windows are the same, with the channels of [`ImageSpec::default_channels`].
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
            icc_profile: None,
        }
    }

    /// Returns the same image stored in tiles.
    pub fn tiled(self, tile_width: u32, tile_height: u32) -> Self {
        Self { tile_width, tile_height, ..self }
    }

    /// Returns the channel names "Y"; "Y", "A"; "R", "G", "B"; "R", "G", "B", "A"; then "channel4" and so on.
    pub fn default_channels(n: usize) -> Vec<String> {
        let names: &[&str] = match n {
            1 => &["Y"],
            2 => &["Y", "A"],
            _ => &["R", "G", "B", "A"],
        };
        (0..n).map(|i| names.get(i).map_or_else(|| format!("channel{i}"), |s| (*s).to_owned())).collect()
    }

    /// The number of channels.
    pub fn nchannels(&self) -> usize {
        self.channels.len()
    }

    /// True when the image is stored in tiles.
    pub fn is_tiled(&self) -> bool {
        self.tile_width > 0
    }

    /// Returns the index of the alpha channel, named "A" or "alpha".
    pub fn alpha_channel(&self) -> Option<usize> {
        self.channels.iter().position(|c| c == "A" || c.eq_ignore_ascii_case("alpha"))
    }

    /// The numbers of tiles across and down; (0, 0) for scanlines.
    pub fn tiles(&self) -> (u32, u32) {
        if self.is_tiled() {
            (self.width.div_ceil(self.tile_width), self.height.div_ceil(self.tile_height))
        } else {
            (0, 0)
        }
    }

    /// The number of bytes of all pixels of the data window; `None` when it overflows 64 bits.
    pub fn bytes(&self) -> Option<u64> {
        u64::from(self.width)
            .checked_mul(u64::from(self.height))?
            .checked_mul(self.nchannels() as u64)?
            .checked_mul(self.pixel_type.bytes() as u64)
    }

    /// The number of bytes of memory for decoding so many rows together: packed, unpacked and in order. 0 for as few
    /// rows as any reader requests at once.
    pub fn decoding_bytes(&self, rows: u32) -> u64 {
        const FEW: u32 = 256;
        let row = u64::from(self.width).saturating_mul((self.nchannels() * self.pixel_type.bytes()) as u64);
        let rows = rows.min(self.height);
        if rows > FEW { row.saturating_mul(3 * u64::from(rows)) } else { 0 }
    }

    /// Sets the ICC profile, and the attribute `ICCProfile` to its description.
    pub fn set_icc_profile(&mut self, profile: Vec<u8>) {
        let name = crate::color::profile(&profile);
        let ty = ParamType::of(BaseType::String);
        self.attributes.set(Param { name: "ICCProfile".into(), ty, data: name.as_str().into() });
        self.icc_profile = Some(profile.into());
    }

    /// Removes the ICC profile and its description, for pixels that were converted to other colours.
    pub fn remove_icc_profile(&mut self) {
        self.attributes.0.retain(|p| &*p.name != "ICCProfile");
        self.icc_profile = None;
    }

    /// Removes what describes the colours, the ICC profile too, for pixels that were converted to other colours.
    pub fn remove_colors(&mut self) {
        self.attributes.0.retain(|param| !is_about_colors(&param.name));
        self.icc_profile = None;
    }

    /// Returns the value of a string attribute.
    pub fn string(&self, name: &str) -> Option<&str> {
        self.attributes.string(name).map(|s| &**s)
    }

    /// Returns the value of a matrix attribute, row by row.
    pub fn matrix(&self, name: &str) -> Option<[f32; 16]> {
        self.attributes.floats(name)?.get(..16)?.try_into().ok()
    }
}
