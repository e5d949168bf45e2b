//! What to make, and how.

use crate::Wrap;
use granita_base::Filter;
use granita_image::PixelType;

/// What to make (reference 9.1.2 to 9.1.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// A texture of one picture.
    #[default]
    Plain,
    /// A cube-face environment of six pictures: px nx py ny pz nz.
    EnvCube,
    /// A latitude-longitude environment of one picture.
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
    /// How many inputs it takes.
    pub fn inputs(self) -> usize {
        match self {
            Self::EnvCube | Self::ShadCube => 6,
            _ => 1,
        }
    }
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
