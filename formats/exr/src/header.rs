//! The headers of files that are written.

use crate::attributes::{self, channel_order};
use crate::{CompressionName, Order};
use exr::meta::attribute::{
    self as exr_attribute, AttributeValue, ChannelDescription, IntegerBounds, LevelMode, LineOrder,
    SampleType, TileDescription,
};
use exr::meta::header::{Header, ImageAttributes};
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{SmallVec, Vec2};
use granita_image::{DeflateLevel, ImageError, ImageSpec, PixelType, Result};
use std::path::Path;

/// The description of a part.
pub(crate) struct Described {
    pub(crate) header: Header,
    pub(crate) order: Order,
    /// The level of the compressions "zip" and "zips".
    pub(crate) deflate: DeflateLevel,
}

/// Describes the parts of a file of several. A part without the attribute `name` is called by its number, "part1" for
/// the second one.
///
/// # Errors
/// Returns an error for a description that OpenEXR cannot store.
pub(crate) fn described_parts(path: &Path, specs: &[ImageSpec]) -> Result<Vec<Described>> {
    let describe = |(k, spec): (usize, &ImageSpec)| {
        let mut part = described(path, spec, 1)?;
        let name = &mut part.header.own_attributes.layer_name;
        if specs.len() > 1 && name.as_ref().is_none_or(|name| name.as_slice().is_empty()) {
            *name = attributes::channel_name(&format!("part{k}"));
        }
        Ok(part)
    };
    specs.iter().enumerate().map(describe).collect()
}

/// Returns the bytes of a file before the tables of its chunks.
///
/// # Errors
/// Returns an error when the headers do not fit together.
pub(crate) fn front(path: &Path, headers: &[Header]) -> Result<Vec<u8>> {
    let requirements = MetaData::validate(headers, true)
        .map_err(|e| misuse(path, format!("OpenEXR cannot hold it: {e}")))?;
    let mut front = vec![0x76, 0x2f, 0x31, 0x01];
    let mut written = requirements.write(&mut front);
    for header in headers {
        // The attributes are sorted by name. The crate's own order is that of a hash map, and differs from run to run.
        let mut all: Vec<(Vec<u8>, AttributeValue)> =
            header.all_named_attributes().map(|(name, value)| (name.to_vec(), value)).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        for (name, value) in &all {
            written = written.and_then(|()| exr_attribute::write(name, value, &mut front));
        }
        front.push(0);
    }
    written.map_err(|e| misuse(path, e.to_string()))?;
    if headers.len() > 1 {
        // An empty header ends the list.
        front.push(0);
    }
    Ok(front)
}

/// Returns an error of a caller.
pub(crate) fn misuse(path: &Path, what: String) -> ImageError {
    ImageError::Misuse { path: path.to_owned(), what }
}

/// Describes a part for `spec`.
///
/// # Errors
/// Returns an error for a description that OpenEXR cannot store.
pub(crate) fn described(path: &Path, spec: &ImageSpec, levels: usize) -> Result<Described> {
    let unsupported = |what: String| ImageError::Unsupported { path: path.to_owned(), what };
    if spec.width == 0 || spec.height == 0 || spec.nchannels() == 0 {
        let (w, h, n) = (spec.width, spec.height, spec.nchannels());
        return Err(misuse(path, format!("an image of {w} x {h} pixels with {n} channels")));
    }
    let sample_type = match spec.pixel_type {
        PixelType::Half => SampleType::F16,
        PixelType::Float => SampleType::F32,
        PixelType::U32 => SampleType::U32,
        other => return Err(unsupported(format!("OpenEXR does not hold {other:?} values"))),
    };
    let mut sorted = spec.channels.clone();
    sorted.sort_by(|a, b| a.as_bytes().cmp(b.as_bytes()));
    if let Some(pair) = sorted.windows(2).find(|p| p[0] == p[1]) {
        return Err(misuse(path, format!("two channels are called \"{}\"", pair[0])));
    }
    let mut list: SmallVec<[ChannelDescription; 5]> = SmallVec::new();
    for name in &sorted {
        let text = attributes::channel_name(name)
            .ok_or_else(|| misuse(path, format!("\"{name}\" cannot name a channel")))?;
        list.push(ChannelDescription::named(text, sample_type));
    }
    let joined = spec.channels.join(",");
    let order = channel_order(&sorted, Some(&joined));
    let mut own = attributes::to_header(spec);
    if channel_order(&sorted, None) != order
        && let Some(text) = attributes::channel_name(&joined)
    {
        own.other.insert(attributes::CHANNEL_ORDER.into(), AttributeValue::Text(text));
    }
    own.layer_position = Vec2(spec.x, spec.y);

    let word = spec.string("compression").unwrap_or("zip");
    let (compression, deflate) = CompressionName::parse(word).map_err(unsupported)?;
    let (blocks, line_order) = if spec.is_tiled() {
        if spec.tile_height == 0 {
            return Err(misuse(path, format!("tiles of {} x 0 pixels", spec.tile_width)));
        }
        let tiles = TileDescription {
            tile_size: Vec2(spec.tile_width as usize, spec.tile_height as usize),
            level_mode: if levels > 1 { LevelMode::MipMap } else { LevelMode::Singular },
            rounding_mode: exr::math::RoundingMode::Down,
        };
        (BlockDescription::Tiles(tiles), LineOrder::Unspecified)
    } else if levels > 1 {
        return Err(misuse(path, "OpenEXR stores MIP levels in tiles only".to_owned()));
    } else {
        (BlockDescription::ScanLines, LineOrder::Increasing)
    };
    // The format cannot store the size of one cube face. The display window is that of all six faces.
    let cube = spec.string("textureformat").is_some_and(|t| t.starts_with("CubeFace"));
    let display = if cube {
        IntegerBounds::new(Vec2(spec.x, spec.y), Vec2(spec.width as usize, spec.height as usize))
    } else {
        let size = Vec2(spec.full_width.max(1) as usize, spec.full_height.max(1) as usize);
        IntegerBounds::new(Vec2(spec.full_x, spec.full_y), size)
    };
    let size = Vec2(spec.width as usize, spec.height as usize);
    let pixel_aspect = spec.attributes.float("pixelaspect").filter(|a| *a > 0.0).unwrap_or(1.0);
    let header = Header::new(Default::default(), size, list)
        .with_attributes(own)
        .with_shared_attributes(ImageAttributes {
            pixel_aspect,
            chromaticities: attributes::to_chromaticities(spec),
            ..ImageAttributes::new(display)
        })
        .with_encoding(compression, blocks, line_order);
    let types = vec![sample_type; sorted.len()];
    Ok(Described { header, order: Order { types, order, pixel_type: spec.pixel_type }, deflate })
}
