//! What to make, and how.

use super::color::{ColorSpace, Conversion};
use crate::Wrap;
use granita_base::Filter;
use granita_image::PixelType;
use std::time::Duration;

/// What to make (reference 9.1.2 to 9.1.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// A texture of one picture.
    #[default]
    Plain,
    /// A cube-face environment of six pictures: px nx py ny pz nz; or of one latitude-longitude map.
    EnvCube,
    /// A latitude-longitude environment of one picture; or of six faces, or of one file that says that it
    /// is a cube-face environment.
    EnvLatLong,
    /// A cube-face environment of one angular map.
    LightProbe,
    /// A cube-face environment of one vertical cross.
    VertCross,
    /// A shadow map of one depth map.
    Shadow,
    /// A cube-face shadow map of six depth maps; "-" stands for an empty one.
    ShadCube,
    /// A volume shadow map of one volume depth map.
    VolShad,
}

impl Mode {
    /// How many inputs it takes; environments also take [`Mode::other_inputs`].
    pub fn inputs(self) -> usize {
        match self {
            Self::EnvCube | Self::ShadCube => 6,
            _ => 1,
        }
    }

    /// The other number of inputs that it takes, if there is one: then it converts.
    pub fn other_inputs(self) -> Option<usize> {
        match self {
            Self::EnvCube => Some(1),
            Self::EnvLatLong => Some(6),
            _ => None,
        }
    }

    /// Whether it can be given one input.
    pub fn takes_one(self) -> bool {
        self.inputs() == 1 || self.other_inputs() == Some(1)
    }
}

/// What becomes of values of the inputs that are not finite numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum BrokenValues {
    /// What is not a number becomes 0, what is infinite the largest number of its type (at most 1e30). A note tells.
    #[default]
    Replace,
    /// Nothing is made; the error says where the first one is.
    Refuse,
    /// They become the mean of the finite ones among the eight pixels around, or 0. A note tells.
    Fix,
}

/// Options of [`make`](super::make).
#[derive(Clone, Debug, PartialEq)]
pub struct MakeOptions {
    /// What to make.
    pub mode: Mode,
    /// Format of the texture file, by name.
    pub format: String,
    /// Rounds the resolution up to powers of two. Shadow maps of all kinds keep theirs in any case.
    pub resize: bool,
    /// Does nothing when the output has the time stamp of the newest input; else gives it that stamp.
    pub update: bool,
    /// Stores channels one after the other ("separate") instead of interleaved.
    pub separate: bool,
    /// Width and height of tiles in texels, at least 1.
    pub tile_size: (u32, u32),
    /// Gamma of the inputs' first three channels.
    pub ingamma: f32,
    /// Gamma of the output's first three channels.
    pub outgamma: f32,
    /// Replaces the world-to-camera matrix, row by row.
    pub mcamera: Option<[f32; 16]>,
    /// Replaces the world-to-screen matrix, row by row.
    pub mscreen: Option<[f32; 16]>,
    /// Default wrap mode in s.
    pub swrap: Wrap,
    /// Default wrap mode in t.
    pub twrap: Wrap,
    /// Field of view of cube faces, in degrees, below 180.
    pub fov_deg: f32,
    /// Depth range over which opaque depths count as one surface.
    pub opaque_width: f32,
    /// Filter that makes each MIP level from the one before, over twice its natural width.
    pub filter: Filter,
    /// Compression by the format's name for it; `None` for the format's own choice.
    pub compression: Option<String>,
    /// Storage of the texture; `None` for that of the input, or the nearest that the format can store.
    pub pixel_type: Option<PixelType>,
    /// Colour space of the inputs and of the texture. MIP levels are made in linear light, in the primaries of
    /// the texture's. After `ingamma`, before `outgamma`.
    pub color_convert: Option<(ColorSpace, ColorSpace)>,
    /// What becomes of values that are not finite.
    pub broken_values: BrokenValues,
    /// Writes a hash of the pixels (SHA-1) and their mean into the metadata: `oiio:SHA-1` and
    /// `oiio:AverageColor`, which other texture systems know.
    pub hash: bool,
    /// Stores a picture whose pixels are all alike as one tile. For plain textures and
    /// latitude-longitude maps.
    pub constant_color: bool,
    /// What one texture may take of memory, in bytes, where it depends on the size of the picture: rows of it, all of it
    /// where it is made or decoded as a whole. Nothing is made that needs more.
    pub memory_bytes: u64,
}

impl MakeOptions {
    /// What happens to the colours of pixels with alpha in this channel, not yet multiplied in if `straight`.
    pub(crate) fn conversion(&self, alpha: Option<usize>, straight: bool) -> Conversion {
        Conversion {
            ingamma: self.ingamma,
            outgamma: self.outgamma,
            spaces: self.color_convert.unwrap_or((ColorSpace::Linear, ColorSpace::Linear)),
            alpha,
            multiply: straight && alpha.is_some(),
        }
    }
}

impl Default for MakeOptions {
    /// As `maketx` without options.
    fn default() -> Self {
        Self {
            mode: Mode::Plain,
            format: "tiff".to_owned(),
            resize: true,
            update: false,
            separate: false,
            tile_size: (64, 64),
            ingamma: 1.0,
            outgamma: 1.0,
            mcamera: None,
            mscreen: None,
            swrap: Wrap::Black,
            twrap: Wrap::Black,
            fov_deg: 90.0,
            opaque_width: 0.05,
            filter: Filter::Box,
            compression: None,
            pixel_type: None,
            color_convert: None,
            broken_values: BrokenValues::Replace,
            hash: false,
            constant_color: false,
            memory_bytes: 4 << 30,
        }
    }
}

/// What became of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Made {
    /// Written.
    Written {
        /// Width of the largest level (of the mosaic for cubes).
        width: u32,
        /// Height of the largest level.
        height: u32,
        /// MIP levels.
        levels: u32,
        /// What the user should know, each in a line.
        notes: Vec<String>,
    },
    /// Nothing to do: the output was up to date.
    UpToDate,
}

/// What making a texture took, of wall time; reading goes on while the rest is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Costs {
    /// Looking at the whole input before, for hash and constant colour.
    pub scan: Duration,
    /// Reading and decoding, and making the rows of level 0.
    pub read: Duration,
    /// Making smaller levels.
    pub filter: Duration,
    /// Compressing and writing tiles.
    pub write: Duration,
    /// Completing the file.
    pub close: Duration,
}
