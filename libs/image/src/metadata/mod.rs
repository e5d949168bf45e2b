//! Metadata that several formats share: Exif of cameras and positions, and IPTC of archives, as attributes and back.
//!
//! A reader passes the bytes that its format has to [`exif::read`] and [`iptc::read`], which add attributes. A writer
//! gets the bytes of the attributes from [`exif::write`] and [`iptc::write`]. So conversion carries what both formats
//! can hold. The names are those of OpenImageIO: `ExposureTime`, `Exif:LensModel`, `GPS:Latitude`, `IPTC:City`. XMP is
//! one string, `XMP`, and an ICC profile is [`crate::ImageSpec::icc_profile`].
//!
//! # Invariants
//!
//! Damaged values are left out. No offset and no count of the data is trusted, and the work is bounded.
//!
//! ```
//! use granita_base::Param;
//! use granita_image::{ImageSpec, PixelType, metadata::exif};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut spec = ImageSpec::new(4, 3, 3, PixelType::U8);
//! spec.attributes.set(Param::declared("float ExposureTime", 0.008)?);
//! let bytes = exif::write(&spec.attributes, &[]).unwrap();
//! let mut read = ImageSpec::new(4, 3, 3, PixelType::U8);
//! exif::read(&bytes, &mut read.attributes);
//! assert_eq!(read.attributes.float("ExposureTime"), Some(0.008));
//! # Ok(())
//! # }
//! ```

pub mod exif;
pub mod iptc;
pub mod settings;
mod tags;

use granita_base::{BaseType, Param, ParamData, ParamType, Params};

/// Returns an attribute. Several values are an array.
fn param(name: &str, data: ParamData) -> Param {
    let base = match data {
        ParamData::Float(_) => BaseType::Float,
        ParamData::Int(_) => BaseType::Int,
        ParamData::String(_) => BaseType::String,
    };
    let ty = match data.len() {
        1 => ParamType::of(base),
        n => ParamType::array(base, n as u32),
    };
    Param { name: name.into(), ty, data }
}

/// Returns the value of an attribute, whatever the case of its name.
fn value<'a>(attributes: &'a Params, name: &str) -> Option<&'a ParamData> {
    attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name)).map(|p| &p.data)
}

/// Returns the text of bytes up to the first NUL, without blanks at its end: UTF-8, or else Latin-1. `None` when it is
/// empty.
fn text(bytes: &[u8]) -> Option<String> {
    let bytes = bytes.split(|b| *b == 0).next().unwrap_or_default();
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|b| char::from(*b)).collect(),
    };
    let text = text.trim_end();
    (!text.is_empty()).then(|| text.to_owned())
}
