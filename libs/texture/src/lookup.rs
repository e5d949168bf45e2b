//! The parameters of lookups, one point at a time.

use crate::Wrap;
use granita_base::Vec3;
use granita_base::sample::{Draw, Sequence};
use granita_image::ImageSpec;

/// The parameters of `texture ()` at one point (reference 5.8.10).
///
/// Coordinates are fractions of the image. (0, 0) is the outer corner of its upper left texel, and (1, 1) that of its
/// lower right one.
#[derive(Clone, Copy, Debug)]
pub struct Lookup {
    /// The coordinate to the right.
    pub s: f32,
    /// The coordinate downward.
    pub t: f32,
    /// The change of `s` from this point to the next one in x.
    pub dsdx: f32,
    /// The change of `t` from this point to the next one in x.
    pub dtdx: f32,
    /// The change of `s` from this point to the next one in y.
    pub dsdy: f32,
    /// The change of `t` from this point to the next one in y.
    pub dtdy: f32,
    /// The full width of additional blur, as a fraction of the image's width.
    pub sblur: f32,
    /// The full height of additional blur, as a fraction of the image's height.
    pub tblur: f32,
    /// Scales the differentials of `s`.
    pub swidth: f32,
    /// Scales the differentials of `t`.
    pub twidth: f32,
    /// Replaces the file's wrap mode in s.
    pub swrap: Option<Wrap>,
    /// Replaces the file's wrap mode in t.
    pub twrap: Option<Wrap>,
    /// The first channel of the file to look up.
    pub first_channel: u32,
    /// The value of channels that the file does not have.
    pub fill: f32,
}

impl Default for Lookup {
    /// Returns a lookup at (0, 0) without footprint or blur, with the wrap modes of the file, from channel 0, with
    /// `fill` 0.
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

/// The parameters of `texture3d ()` at one point (reference 5.8.10).
///
/// Coordinates are fractions of the volume. (0, 0, 0) is the outer corner of the first texel of the first slice, and
/// (1, 1, 1) that of the last texel of the last one.
#[derive(Clone, Copy, Debug)]
pub struct Lookup3d {
    /// The position: to the right, downward, to the back.
    pub p: Vec3,
    /// The change of `p` from this point to the next one in x.
    pub dpdx: Vec3,
    /// The change of `p` from this point to the next one in y.
    pub dpdy: Vec3,
    /// The full width of additional blur, as a fraction of the width.
    pub sblur: f32,
    /// The full width of additional blur, as a fraction of the height and the depth. In texels, the smallest blur of
    /// the three directions is at least an eighth of the largest.
    pub tblur: f32,
    /// Scales the differentials to the right.
    pub swidth: f32,
    /// Scales the differentials downward and to the back.
    pub twidth: f32,
    /// Replaces the file's wrap mode to the right.
    pub swrap: Option<Wrap>,
    /// Replaces the file's wrap mode downward and to the back.
    pub twrap: Option<Wrap>,
    /// The first channel of the file to look up.
    pub first_channel: u32,
    /// The value of channels that the file does not have.
    pub fill: f32,
}

impl Default for Lookup3d {
    /// Returns a lookup at the origin without footprint or blur, with the wrap modes of the file, from channel 0, with
    /// `fill` 0.
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
    /// The axis +y. The map is right handed with +z in its centre, which is the convention of OpenEXR files.
    Y,
    /// The axis +z. The map is left handed with +x in its centre, which is the convention of all other files.
    Z,
}

impl Up {
    /// The attribute of a file with the orientation of its latitude-longitude map, "y" or "z". Formats without
    /// arbitrary attributes store it as a word `latlongup=y` of the description.
    pub(crate) const ATTRIBUTE: &str = "latlongup";

    /// Returns the orientation of latitude-longitude maps in files of a format.
    pub(crate) fn of_format(openexr: bool) -> Self {
        if openexr { Self::Y } else { Self::Z }
    }

    /// Returns the orientation of the latitude-longitude map of a file. It is the file's attribute, or else that of its
    /// format.
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

    /// Returns "y" or "z".
    pub fn word(self) -> &'static str {
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

    /// Returns the orientation for "y" or "z". Returns `None` for anything else, so that the orientation of the map
    /// applies.
    pub fn from_word(word: &str) -> Option<Self> {
        match word {
            "y" => Some(Self::Y),
            "z" => Some(Self::Z),
            _ => None,
        }
    }
}

/// The parameters of `environment ()` in one direction (reference 5.8.10).
#[derive(Clone, Copy, Debug)]
pub struct EnvLookup {
    /// The direction, of any length, in the space of the map.
    pub r: Vec3,
    /// The change of `r` from this point to the next one in x.
    pub drdx: Vec3,
    /// The change of `r` from this point to the next one in y.
    pub drdy: Vec3,
    /// The half angle of an additional cone, in radians. It replaces both blurs.
    pub angle: Option<f32>,
    /// The additional blur around the axis of the map. 1 is 90 degrees.
    pub sblur: f32,
    /// The additional blur towards the poles. 1 is 90 degrees.
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
    /// The first channel of the file to look up.
    pub first_channel: u32,
    /// The value of channels that the file does not have.
    pub fill: f32,
}

impl Default for EnvLookup {
    /// Returns a lookup along +z without footprint or blur.
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

/// The parameters of `shadow ()` at one point (reference 5.8.10).
#[derive(Clone, Copy, Debug)]
pub struct ShadowLookup {
    /// The position in "common" space.
    pub p: Vec3,
    /// The change of `p` from this point to the next one in x.
    pub dpdx: Vec3,
    /// The change of `p` from this point to the next one in y.
    pub dpdy: Vec3,
    /// The full width of additional blur, as a fraction of the map's width. For cube maps it is a fraction of a face,
    /// around the y axis.
    pub sblur: f32,
    /// The full height of additional blur, as a fraction of the map's height. For cube maps it is towards the poles.
    pub tblur: f32,
    /// Scales the footprint in the map's width.
    pub swidth: f32,
    /// Scales the footprint in the map's height.
    pub twidth: f32,
    /// The number of samples, which is clamped to 16 to 4096.
    pub samples: u32,
    /// The bias in "common" units that is added to the depths of the map. It is not negative. The caller replaces a
    /// negative one by the attribute "shadow:bias".
    pub bias: f32,
    /// The random numbers of the sample pattern. Their seed is a hash of the pixel or point, or of neighbours that
    /// share a sequence.
    pub draw: Draw,
}

impl Default for ShadowLookup {
    /// Returns a lookup at the origin without footprint or blur, with 16 samples and the bias 0.01.
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
            draw: Draw::alone(Sequence::new(0)),
        }
    }
}
