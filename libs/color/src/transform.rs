//! Transforms as a configuration describes them.

use crate::table::{Interpolation, Lut1d, Lut3d};
use std::sync::Arc;

/// The treatment of negative values by an exponent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Negatives {
    /// They become 0.
    #[default]
    Clamp,
    /// The function is odd around 0.
    Mirror,
    /// They pass unchanged.
    Pass,
}

/// The parameters of a logarithm, one for each of red, green and blue:
/// `log_slope * log (lin_slope * x + lin_offset, base) + log_offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LogParams {
    /// The base.
    pub(crate) base: f64,
    /// The slope on the side of the logarithm.
    pub(crate) log_slope: [f64; 3],
    /// The offset on the side of the logarithm.
    pub(crate) log_offset: [f64; 3],
    /// The slope on the linear side.
    pub(crate) lin_slope: [f64; 3],
    /// The offset on the linear side.
    pub(crate) lin_offset: [f64; 3],
    /// The linear value at and below which the function is a line; `None` for a pure logarithm.
    pub(crate) lin_break: Option<[f64; 3]>,
    /// The slope of that line; `None` for that of the logarithm at the break.
    pub(crate) linear_slope: Option<[f64; 3]>,
}

impl LogParams {
    /// Returns the pure logarithm to a base.
    pub(crate) fn pure(base: f64) -> Self {
        Self {
            base,
            log_slope: [1.0; 3],
            log_offset: [0.0; 3],
            lin_slope: [1.0; 3],
            lin_offset: [0.0; 3],
            lin_break: None,
            linear_slope: None,
        }
    }
}

/// The parameters of the colour decision list of the American Society of Cinematographers (ASC CDL 1.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cdl {
    /// The slopes.
    pub(crate) slope: [f64; 3],
    /// The offsets.
    pub(crate) offset: [f64; 3],
    /// The powers.
    pub(crate) power: [f64; 3],
    /// The saturation.
    pub(crate) saturation: f64,
    /// True when values are clamped to [0, 1], as the definition says.
    pub(crate) clamp: bool,
}

impl Default for Cdl {
    fn default() -> Self {
        Self { slope: [1.0; 3], offset: [0.0; 3], power: [1.0; 3], saturation: 1.0, clamp: false }
    }
}

/// The scale on which an exposure and a contrast act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Linear light.
    Linear,
    /// Video, by the power 0.54644808743169393 of linear light.
    Video,
    /// A logarithm.
    Log,
}

/// The parameters of an exposure and a contrast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExposureContrast {
    /// The scale.
    pub(crate) scale: Scale,
    /// The exposure in stops.
    pub(crate) exposure: f64,
    /// The contrast.
    pub(crate) contrast: f64,
    /// A factor of the contrast.
    pub(crate) gamma: f64,
    /// The linear value that contrast does not change.
    pub(crate) pivot: f64,
    /// The step of a stop on the scale of the logarithm.
    pub(crate) log_step: f64,
    /// The value of mid grey on the scale of the logarithm.
    pub(crate) log_mid_grey: f64,
}

/// A function of one value with a definition of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Named {
    /// From linear light, with 1 for 100 cd/m2, to the signal of SMPTE ST 2084.
    LinearToPq,
    /// From linear light of a scene, in which 3 is the largest value, to the signal of hybrid log-gamma
    /// (ITU-R BT.2100). Mid grey has the signal 0.42.
    LinearToHlg,
    /// From linear light to Apple Log (Apple Log Profile White Paper, 2023).
    LinearToAppleLog,
    /// From linear light to Canon Log 2.
    LinearToCanonLog2,
    /// From linear light to Canon Log 3.
    LinearToCanonLog3,
    /// From linear light in AP1 to ACEScc (AMPAS S-2014-003).
    LinearToAcesCc,
    /// From linear light in AP1 to that of a screen, in fractions of its white: the curves of the output transforms of
    /// ACES 1 for standard range.
    AcesTone,
    /// From printing density to the logarithm of exposure of ACES (SMPTE ST 2065-3).
    DensityToExposure,
}

/// A function of three values with a definition of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Fixed {
    /// The reference gamut compression of ACES 1.3 (AMPAS S-2020-001), in linear AP1: the distance limits of cyan,
    /// magenta and yellow, their thresholds, and the power.
    GamutCompression([f64; 7]),
    /// The glow of dark saturated colours of ACES 1, in ACES2065-1: the largest share, and the luminance that gets half
    /// of it.
    Glow(f64, f64),
    /// The change of saturated reds of ACES 1, in ACES2065-1.
    RedModifier,
    /// The change from dark to dim surroundings of ACES 1, in AP1.
    DarkToDim,
    /// Luminance to a power, with the ratios of colours kept (ITU-R BT.2100, OOTF).
    Surround(f64),
    /// CIE XYZ to x, y and Y.
    XyzToXyy,
    /// CIE XYZ to u', v' and Y (CIE 1976).
    XyzToUvy,
}

/// A transform as a configuration describes it, in its forward direction.
#[derive(Clone, Debug)]
pub(crate) enum Transform {
    /// A transform with a name that the configuration does not define.
    Builtin(String),
    /// A matrix that acts on column vectors, row by row, and an offset that is added. Alpha is the fourth value.
    Matrix([f64; 16], [f64; 4]),
    /// A power. Alpha is the fourth value.
    Exponent([f64; 4], Negatives),
    /// A power with a line near black, as that of sRGB: gammas, offsets.
    ExponentWithLinear([f64; 4], [f64; 4], Negatives),
    /// A logarithm.
    Log(LogParams),
    /// A colour decision list.
    Cdl(Cdl),
    /// A range: lower input, upper input, lower output and upper output. True when values are clamped.
    Range([Option<f64>; 4], bool),
    /// An exposure and a contrast.
    ExposureContrast(ExposureContrast),
    /// A function of one value.
    Named(Named),
    /// A function of three values.
    Fixed(Fixed),
    /// A table of one dimension.
    Lut1d(Arc<Lut1d>),
    /// A table of three dimensions.
    Lut3d(Arc<Lut3d>),
    /// A file of tables or of another transform.
    File {
        /// The name of the file.
        src: String,
        /// The name or the index of a colour correction within the file.
        id: Option<String>,
        /// The interpolation; `None` for that of the file.
        interpolation: Option<Interpolation>,
        /// True when colour decision lists of the file clamp.
        clamp: bool,
    },
    /// Transforms one after the other.
    Group(Vec<Directed>),
    /// From one colour space to another.
    ColorSpace {
        /// The source.
        src: String,
        /// The destination.
        dst: String,
        /// True when spaces of data are not converted.
        data_bypass: bool,
    },
    /// Looks.
    Look {
        /// The source.
        src: String,
        /// The destination.
        dst: String,
        /// The names of looks, as a configuration writes them.
        looks: String,
        /// True when the result stays in the space of the looks.
        skip_conversion: bool,
    },
    /// From a colour space to a view of a display.
    DisplayView {
        /// The source.
        src: String,
        /// The display.
        display: String,
        /// The view.
        view: String,
    },
    /// A transform that is not supported, by its name.
    Unsupported(String),
}

/// A transform with its direction and its place.
#[derive(Clone, Debug)]
pub(crate) struct Directed {
    /// The transform.
    pub(crate) transform: Transform,
    /// True when it is applied backwards.
    pub(crate) inverse: bool,
    /// The line of the configuration; 0 where there is none.
    pub(crate) line: usize,
}

impl Directed {
    /// Returns a transform in its forward direction that is not from a file.
    pub(crate) fn forward(transform: Transform) -> Self {
        Self { transform, inverse: false, line: 0 }
    }

    /// Returns a transform in its inverse direction that is not from a file.
    pub(crate) fn backward(transform: Transform) -> Self {
        Self { transform, inverse: true, line: 0 }
    }
}
