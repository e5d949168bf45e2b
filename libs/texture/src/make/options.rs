//! The options of making a texture.

use super::color::{ColorConvert, Conversion};
use super::flat::FlatOptions;
use crate::Wrap;
use granita_base::Filter;
use granita_image::PixelType;
use std::sync::Arc;
use std::time::Duration;

/// The kind of texture to make (reference 9.1.2 to 9.1.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// A texture from one image.
    #[default]
    Plain,
    /// A cube-face environment from six images, px nx py ny pz nz, or from one latitude-longitude map.
    EnvCube,
    /// A latitude-longitude environment from one image, from six faces, or from one file that declares a cube-face
    /// environment.
    EnvLatLong,
    /// A cube-face environment from one angular map.
    LightProbe,
    /// A cube-face environment from one vertical cross.
    VertCross,
    /// A shadow map from one depth map.
    Shadow,
    /// A cube-face shadow map from six depth maps. "-" stands for an empty one.
    ShadCube,
    /// A volume shadow map from one volume depth map.
    VolShad,
}

impl Mode {
    /// Returns the number of inputs. Environments also accept [`Mode::other_inputs`].
    pub fn inputs(self) -> usize {
        match self {
            Self::EnvCube | Self::ShadCube => 6,
            _ => 1,
        }
    }

    /// Returns the other accepted number of inputs, or `None`. The input is then converted.
    pub fn other_inputs(self) -> Option<usize> {
        match self {
            Self::EnvCube => Some(1),
            Self::EnvLatLong => Some(6),
            _ => None,
        }
    }

    /// True when one input is accepted.
    pub fn takes_one(self) -> bool {
        self.inputs() == 1 || self.other_inputs() == Some(1)
    }
}

/// The treatment of values of the inputs that are not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum BrokenValues {
    /// NaN becomes 0, and infinity becomes the largest number of its type (at most 1e30). A note reports it.
    #[default]
    Replace,
    /// No texture is made. The error contains the position of the first of these values.
    Refuse,
    /// The values become the mean of the finite values among the eight pixels around, or 0. A note reports it.
    Fix,
    /// The values become 0. It applies to images that are processed as a whole.
    Black,
    /// The values stay. It applies to images that are processed as a whole.
    Keep,
}

/// The options of [`make`](super::make).
#[derive(Clone, Debug, PartialEq)]
pub struct MakeOptions {
    /// The kind of texture.
    pub mode: Mode,
    /// The format of the texture file, by name.
    pub format: String,
    /// Rounds the resolution up to powers of two. Shadow maps of all kinds keep theirs in any case.
    pub resize: bool,
    /// Does nothing when the output has the time stamp of the newest input. Otherwise makes the texture and gives it
    /// that stamp.
    pub update: bool,
    /// Stores channels as separate planes ("separate") instead of interleaved.
    pub separate: bool,
    /// The width and height of tiles in texels, at least 1.
    pub tile_size: (u32, u32),
    /// The gamma of the inputs' first three channels.
    pub ingamma: f32,
    /// The gamma of the output's first three channels.
    pub outgamma: f32,
    /// Replaces the world-to-camera matrix, row by row.
    pub mcamera: Option<[f32; 16]>,
    /// Replaces the world-to-screen matrix, row by row.
    pub mscreen: Option<[f32; 16]>,
    /// The default wrap mode in s.
    pub swrap: Wrap,
    /// The default wrap mode in t.
    pub twrap: Wrap,
    /// The field of view of cube faces, in degrees, below 180.
    pub fov_deg: f32,
    /// The depth range over which opaque depths count as one surface.
    pub opaque_width: f32,
    /// The filter that makes each MIP level from the one before, over twice its natural width.
    pub filter: Filter,
    /// The compression by the format's name for it; `None` for the format's default.
    pub compression: Option<String>,
    /// The storage of the texture; `None` for that of the input, or the nearest that the format supports.
    pub pixel_type: Option<PixelType>,
    /// The conversion of colours. It is after `ingamma` and before `outgamma`.
    pub color_convert: Option<Arc<ColorConvert>>,
    /// The treatment of values that are not finite.
    pub broken_values: BrokenValues,
    /// Writes a hash of the pixels (SHA-1) and their mean into the metadata: `oiio:SHA-1` and `oiio:AverageColor`,
    /// which other texture systems read.
    pub hash: bool,
    /// Stores an image of one constant colour as one tile. It applies to plain textures and latitude-longitude maps.
    pub constant_color: bool,
    /// The largest number of bytes of memory of one texture that depend on the size of the image. They hold rows of it,
    /// or all of it where it is made or decoded as a whole. A texture that needs more is not made.
    pub memory_bytes: u64,
    /// Options of one flat image that is processed as a whole.
    pub flat: FlatOptions,
}

impl MakeOptions {
    /// True when the rows of a plain texture are read, filtered and written in turns, so that it takes little memory
    /// unless its format is decoded as a whole.
    pub fn is_streamed(&self) -> bool {
        let keeps_rows = self.twrap == Wrap::Periodic && self.filter != Filter::Box;
        self.mode == Mode::Plain && !keeps_rows && !self.flat.needs_whole()
    }

    /// True when the texture stores the colours of the input, as far as no filter changes them.
    pub(crate) fn keeps_colors(&self) -> bool {
        self.color_convert.as_ref().is_none_or(|colors| colors.same) && self.ingamma == self.outgamma
    }

    /// Returns the conversion of the colours of pixels with alpha in this channel, which are not yet multiplied by
    /// it if `straight`.
    pub(crate) fn conversion(&self, alpha: Option<usize>, straight: bool) -> Conversion {
        Conversion {
            ingamma: self.ingamma,
            outgamma: self.outgamma,
            colors: self.color_convert.clone(),
            alpha,
            multiply: straight && alpha.is_some() && !self.flat.ignore_unassociated,
        }
    }
}

impl Default for MakeOptions {
    /// Returns the options of `maketx` without arguments.
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
            flat: FlatOptions::default(),
        }
    }
}

/// The result of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Made {
    /// The texture was written.
    Written {
        /// The width of the largest level (of the mosaic for cubes).
        width: u32,
        /// The height of the largest level.
        height: u32,
        /// The number of MIP levels.
        levels: u32,
        /// Notes for the user, each in a line.
        notes: Vec<String>,
    },
    /// The output was up to date.
    UpToDate,
}

/// The wall time of making a texture. Reading runs in parallel with the other stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Costs {
    /// The time to read the whole input in advance, for hash and constant colour.
    pub scan: Duration,
    /// The time to read and decode, and to make the rows of level 0.
    pub read: Duration,
    /// The time to make smaller levels.
    pub filter: Duration,
    /// The time to compress and write tiles.
    pub write: Duration,
    /// The time to complete the file.
    pub close: Duration,
}
