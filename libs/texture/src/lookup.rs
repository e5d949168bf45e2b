//! The parameters of lookups, one point at a time.

use crate::Wrap;
use granita_base::Vec3;
use granita_image::ImageSpec;

/// `texture ()` at one point (reference 5.8.10).
///
/// Coordinates are fractions of the image: (0, 0) is the outer corner of its upper left texel, (1, 1) that of its
/// lower right one.
#[derive(Clone, Copy, Debug)]
pub struct Lookup {
    /// Coordinate to the right.
    pub s: f32,
    /// Coordinate downward.
    pub t: f32,
    /// Change of `s` from this point to the next in x.
    pub dsdx: f32,
    /// Change of `t` in x.
    pub dtdx: f32,
    /// Change of `s` in y.
    pub dsdy: f32,
    /// Change of `t` in y.
    pub dtdy: f32,
    /// Full width of additional blur, as a fraction of the image's width.
    pub sblur: f32,
    /// Full height of additional blur, as a fraction of the image's height.
    pub tblur: f32,
    /// Scales the differentials of `s`.
    pub swidth: f32,
    /// Scales the differentials of `t`.
    pub twidth: f32,
    /// Replaces the file's wrap mode in s.
    pub swrap: Option<Wrap>,
    /// Replaces the file's wrap mode in t.
    pub twrap: Option<Wrap>,
    /// First channel of the file to look up.
    pub first_channel: u32,
    /// Value of channels that the file does not have.
    pub fill: f32,
}

impl Default for Lookup {
    /// At (0, 0), without footprint or blur, wrap modes of the file, from channel 0, fill 0.
    fn default() -> Self {
        Self {
            s: 0.0,
            t: 0.0,
            dsdx: 0.0,
            dtdx: 0.0,
            dsdy: 0.0,
            dtdy: 0.0,
            sblur: 0.0,
            tblur: 0.0,
            swidth: 1.0,
            twidth: 1.0,
            swrap: None,
            twrap: None,
            first_channel: 0,
            fill: 0.0,
        }
    }
}

/// `texture3d ()` at one point (reference 5.8.10).
///
/// Coordinates are fractions: (0, 0, 0) is the outer corner of the first texel of the first slice, (1, 1, 1) that of
/// the last texel of the last one.
#[derive(Clone, Copy, Debug)]
pub struct Lookup3d {
    /// The position: to the right, downward, to the back.
    pub p: Vec3,
    /// Change of `p` from this point to the next in x.
    pub dpdx: Vec3,
    /// Change of `p` in y.
    pub dpdy: Vec3,
    /// Full width of additional blur, as a fraction of the width.
    pub sblur: f32,
    /// Full width of additional blur, as a fraction of the height and the depth. The larger of the blurs in texels
    /// applies in all directions.
    pub tblur: f32,
    /// Scales the differentials to the right.
    pub swidth: f32,
    /// Scales the differentials downward and to the back.
    pub twidth: f32,
    /// Replaces the file's wrap mode to the right.
    pub swrap: Option<Wrap>,
    /// Replaces the file's wrap mode downward and to the back.
    pub twrap: Option<Wrap>,
    /// First channel of the file to look up.
    pub first_channel: u32,
    /// Value of channels that the file does not have.
    pub fill: f32,
}

impl Default for Lookup3d {
    /// At the origin, without footprint or blur, wrap modes of the file, from channel 0, fill 0.
    fn default() -> Self {
        Self {
            p: Vec3::ZERO,
            dpdx: Vec3::ZERO,
            dpdy: Vec3::ZERO,
            sblur: 0.0,
            tblur: 0.0,
            swidth: 1.0,
            twidth: 1.0,
            swrap: None,
            twrap: None,
            first_channel: 0,
            fill: 0.0,
        }
    }
}

/// The axis of a latitude-longitude map that points to its upper edge (option "up").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// +y up, right handed, +z in the centre: the convention of OpenEXR files.
    Y,
    /// +z up, left handed, +x in the centre: the convention of all other files.
    Z,
}

impl Up {
    /// The attribute of a file with the orientation of its panorama: "y" or "z". In formats without arbitrary
    /// attributes it is a word `latlongup=y` of the description.
    pub(crate) const ATTRIBUTE: &str = "latlongup";

    /// Returns the orientation of panoramas in files of a format.
    pub(crate) fn of_format(openexr: bool) -> Self {
        if openexr { Self::Y } else { Self::Z }
    }

    /// Returns the orientation of the panorama of a file: its attribute, else that of its format.
    pub(crate) fn of(spec: &ImageSpec, openexr: bool) -> Self {
        let own = spec.string(Self::ATTRIBUTE).and_then(Self::from_word);
        let described = || {
            let text = spec.string("ImageDescription")?;
            text.split_whitespace().find_map(|word| {
                let (name, value) = word.split_once('=')?;
                (name == Self::ATTRIBUTE).then_some(value).and_then(Self::from_word)
            })
        };
        own.or_else(described).unwrap_or(Self::of_format(openexr))
    }

    /// "y" or "z".
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    /// Returns a direction in the frame of a latitude-longitude map: x to its centre, y to the right of it, z to
    /// its upper edge.
    pub fn to_map(self, r: Vec3) -> Vec3 {
        match self {
            Self::Z => r,
            Self::Y => Vec3::new(r.z, -r.x, r.y),
        }
    }

    /// Returns the orientation for "y" or "z"; `None` for anything else, so that the map decides.
    pub fn from_word(word: &str) -> Option<Self> {
        match word {
            "y" => Some(Self::Y),
            "z" => Some(Self::Z),
            _ => None,
        }
    }
}

/// `environment ()` in one direction (reference 5.8.10).
#[derive(Clone, Copy, Debug)]
pub struct EnvLookup {
    /// Direction, of any length, in the space of the map.
    pub r: Vec3,
    /// Change of `r` to the next point in x.
    pub drdx: Vec3,
    /// Change of `r` in y.
    pub drdy: Vec3,
    /// Half angle of an additional cone in radians; replaces both blurs.
    pub angle: Option<f32>,
    /// Additional blur around the axis of the map: 1 is 90 degrees.
    pub sblur: f32,
    /// Additional blur towards the poles: 1 is 90 degrees.
    pub tblur: f32,
    /// Scales the footprint around the axis of the map.
    pub swidth: f32,
    /// Scales the footprint towards the poles.
    pub twidth: f32,
    /// Replaces the orientation of a latitude-longitude map.
    pub up: Option<Up>,
    /// True to look up wide footprints in the level whose texels have their width, and to limit them to 0.2
    /// radians, instead of averaging under their ellipse. It is for sums of many lookups. A larger requested blur
    /// is looked up as usual.
    pub quick: bool,
    /// First channel of the file to look up.
    pub first_channel: u32,
    /// Value of channels that the file does not have.
    pub fill: f32,
}

impl Default for EnvLookup {
    /// Along +z, without footprint or blur.
    fn default() -> Self {
        Self {
            r: Vec3::Z,
            drdx: Vec3::ZERO,
            drdy: Vec3::ZERO,
            angle: None,
            sblur: 0.0,
            tblur: 0.0,
            swidth: 1.0,
            twidth: 1.0,
            up: None,
            quick: false,
            first_channel: 0,
            fill: 0.0,
        }
    }
}

/// `shadow ()` at one point (reference 5.8.10).
#[derive(Clone, Copy, Debug)]
pub struct ShadowLookup {
    /// Position in "common" space.
    pub p: Vec3,
    /// Change of `p` to the next point in x.
    pub dpdx: Vec3,
    /// Change of `p` in y.
    pub dpdy: Vec3,
    /// Full width of additional blur, as a fraction of the map's width (cube maps: of a face, around the y axis).
    pub sblur: f32,
    /// Full height of additional blur, as a fraction of the map's height (cube maps: towards the poles).
    pub tblur: f32,
    /// Scales the footprint in the map's width.
    pub swidth: f32,
    /// Scales the footprint in the map's height.
    pub twidth: f32,
    /// The number of samples, limited to 16 to 4096.
    pub samples: u32,
    /// The bias in "common" units that is added to the depths of the map. It is not negative. The caller replaces a
    /// negative one by the attribute "shadow:bias".
    pub bias: f32,
    /// The seed of the sample pattern, which is a hash of the pixel or point.
    pub seed: u32,
}

impl Default for ShadowLookup {
    /// At the origin, without footprint or blur, 16 samples, bias 0.01.
    fn default() -> Self {
        Self {
            p: Vec3::ZERO,
            dpdx: Vec3::ZERO,
            dpdy: Vec3::ZERO,
            sblur: 0.0,
            tblur: 0.0,
            swidth: 1.0,
            twidth: 1.0,
            samples: 16,
            bias: 0.01,
            seed: 0,
        }
    }
}
