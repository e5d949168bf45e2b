//! The layers of a document.

use super::cursor::Cursor;
use super::kind::{Document, Mode};
use super::planes::{Plane, Size};
use crate::fields::param;
use granita_base::Params;
use granita_image::{ImageSpec, Limits, PixelType, Result};

/// A layer with pixels.
pub(super) struct Layer {
    /// The left and upper edges in the document.
    pub(super) position: (i32, i32),
    /// The width and height in pixels.
    pub(super) size: (u32, u32),
    /// The number of planes of the colour.
    pub(super) inks: usize,
    /// True when a plane of alpha follows them.
    pub(super) alpha: bool,
    pub(super) planes: Vec<Plane>,
    pub(super) attributes: Params,
}

/// The description of a layer, which precedes the pixels of all layers.
struct Record {
    /// The top, left, bottom and right edges. The last two are outside.
    edges: [i32; 4],
    /// The number of each channel (-1 is alpha, lower ones are masks), and the length of its data.
    channels: Vec<(i16, u64)>,
    attributes: Params,
}

/// Reads the section of layers and masks, and records whether the merged image has alpha.
///
/// # Errors
/// Errors for a damaged section, and for layers that exceed the limits.
pub(super) fn read(section: &mut Cursor<'_>, document: &mut Document, limits: &Limits) -> Result<Vec<Layer>> {
    if section.left() == 0 {
        return Ok(Vec::new());
    }
    let len = section.length(document.wide)?;
    let mut info = section.part(len, "the description of layers")?;
    if info.left() > 0 {
        return read_info(&mut info, document, limits);
    }
    if section.left() < 4 {
        return Ok(Vec::new());
    }
    let masks = section.length(false)?;
    section.skip(masks)?;
    // Layers of 16 and 32 bits are in a block of their own.
    while section.left() >= 12 {
        let (mark, key) = (section.key()?, section.key()?);
        if !matches!(&mark, b"8BIM" | b"8B64") {
            break;
        }
        let len = section.length(document.wide && has_long_length(key))?;
        let mut block = section.part(len, "a block of layers")?;
        section.skip((len.next_multiple_of(4) - len).min(section.left()))?;
        match &key {
            b"Lr16" | b"Lr32" | b"Layr" => return read_info(&mut block, document, limits),
            b"Mt16" | b"Mt32" | b"Mtrn" => document.merged_alpha = true,
            _ => {}
        }
    }
    Ok(Vec::new())
}

/// True for blocks whose length has eight bytes in large documents.
fn has_long_length(key: [u8; 4]) -> bool {
    const LONG: [&[u8; 4]; 13] = [
        b"LMsk", b"Lr16", b"Lr32", b"Layr", b"Mt16", b"Mt32", b"Mtrn", b"Alph", b"FMsk", b"lnk2", b"FEid",
        b"FXid", b"PxSD",
    ];
    LONG.contains(&&key)
}

fn read_info(info: &mut Cursor<'_>, document: &mut Document, limits: &Limits) -> Result<Vec<Layer>> {
    let source = info.source;
    let count = info.i16()?;
    // A negative number marks alpha of the merged image.
    document.merged_alpha |= count < 0;
    let count = count.unsigned_abs();
    limits.within(source.path(), "number of layers", u64::from(count), u64::from(limits.images))?;
    let records = (0..count).map(|_| read_record(info, document, limits)).collect::<Result<Vec<_>>>()?;
    let mut layers = Vec::new();
    for record in records {
        let mut parts = Vec::new();
        for (id, len) in record.channels {
            parts.push((id, info.part(len, "a channel of a layer")?));
        }
        let [top, left, bottom, right] = record.edges.map(i64::from);
        let side = |from: i64, to: i64| u32::try_from(to - from).unwrap_or(0);
        let (width, height) = (side(left, right), side(top, bottom));
        // Groups and adjustments have no pixels. Indexed documents, bitmaps and inks have no layers.
        let inks = match document.mode {
            Mode::Bitmap | Mode::Indexed | Mode::Multichannel => continue,
            mode => mode.inks(0),
        };
        if width == 0 || height == 0 {
            continue;
        }
        limits.check(source.path(), "PSD", &ImageSpec::new(width, height, inks + 1, PixelType::Float))?;
        let size = Size { width, height, depth: document.depth };
        let mut plane = |id: i16| {
            let found = parts.iter().position(|(of, _)| *of == id)?;
            Some(Plane::of_layer(parts.swap_remove(found).1, size, document.wide))
        };
        let mut planes = Vec::new();
        for ink in 0..inks {
            let missing = || source.malformed(format!("a layer has no channel {ink} of {inks}"));
            planes.push(plane(ink as i16).ok_or_else(missing)??);
        }
        let alpha = plane(-1).transpose()?;
        layers.push(Layer {
            position: (record.edges[1], record.edges[0]),
            size: (width, height),
            inks,
            alpha: alpha.is_some(),
            planes: planes.into_iter().chain(alpha).collect(),
            attributes: record.attributes,
        });
    }
    Ok(layers)
}

fn read_record(info: &mut Cursor<'_>, document: &Document, limits: &Limits) -> Result<Record> {
    let source = info.source;
    let mut edges = [0; 4];
    for edge in &mut edges {
        *edge = info.i32()?;
    }
    let n = info.u16()?;
    limits.within(
        source.path(),
        "number of channels of a layer",
        u64::from(n),
        u64::from(limits.channels),
    )?;
    let channels =
        (0..n).map(|_| Ok((info.i16()?, info.length(document.wide)?))).collect::<Result<Vec<_>>>()?;
    let (mark, blend) = (info.key()?, info.key()?);
    if mark != *b"8BIM" {
        return Err(source.malformed(format!("a layer at byte {} has no mark", info.at - 8)));
    }
    let (opacity, _clipping, flags, _filler) = (info.u8()?, info.u8()?, info.u8()?, info.u8()?);
    let len = u64::from(info.u32()?);
    let mut extra = info.part(len, "the description of a layer")?;
    for _ in ["mask", "ranges of blending"] {
        let len = u64::from(extra.u32()?);
        extra.skip(len)?;
    }
    let mut name = extra.pascal(4)?;
    while extra.left() >= 12 {
        let (mark, key) = (extra.key()?, extra.key()?);
        if !matches!(&mark, b"8BIM" | b"8B64") {
            break;
        }
        let len = extra.length(document.wide && has_long_length(key))?;
        let mut block = extra.part(len, "a block of a layer")?;
        if key == *b"luni" {
            let count = u64::from(block.u32()?);
            let units = block.bytes(count.saturating_mul(2))?;
            let units = units.as_chunks::<2>().0.iter().map(|u| u16::from_be_bytes(*u));
            name = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
        }
    }
    let mut attributes = Params::new();
    let name = name.trim_end_matches('\0');
    if !name.is_empty() {
        attributes.set(param("name", name.into()));
    }
    attributes.set(param("psd:BlendMode", String::from_utf8_lossy(&blend).trim_end().into()));
    attributes.set(param("psd:Opacity", (f32::from(opacity) / 255.0).into()));
    if flags & 2 != 0 {
        attributes.set(param("psd:Hidden", 1.into()));
    }
    Ok(Record { edges, channels, attributes })
}
