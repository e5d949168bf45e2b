//! Exif, which has the structure of TIFF: directories of numbered values.

use super::tags::{CAMERA, IMAGE, Kind, POSITION, Tag};
use super::{param, text, value};
use granita_base::{ParamData, Params};

/// One of the directories of Exif data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// What is known of the image: its description, its author, its resolution.
    Image,
    /// The camera and the shot.
    Camera,
    /// The position on the earth.
    Position,
}

impl Part {
    fn tags(self) -> &'static [Tag] {
        match self {
            Self::Image => &IMAGE,
            Self::Camera => &CAMERA,
            Self::Position => &POSITION,
        }
    }
}

/// The tag of the offset of the directory of the camera, in the first directory.
pub const CAMERA_TAG: u16 = 34665;
/// The tag of the offset of the directory of the position, in the first directory.
pub const POSITION_TAG: u16 = 34853;

/// The largest number of entries of a directory that are read.
const MOST_ENTRIES: u64 = 1000;

/// The largest number of bytes of a value that is read.
const LONGEST: u64 = 1 << 16;

/// The largest number of numbers of a value that is read.
const MOST_NUMBERS: u64 = 64;

/// Where directories lie, and how their numbers are stored.
pub struct Source<'a> {
    /// Returns that many bytes at an offset; `None` when they do not exist.
    pub fetch: &'a dyn Fn(u64, u64) -> Option<Vec<u8>>,
    /// True for numbers with the most significant byte first.
    pub big_endian: bool,
    /// True for offsets of 64 bits, as in large TIFF files.
    pub big_tiff: bool,
}

impl Source<'_> {
    fn number(&self, bytes: &[u8]) -> u64 {
        let fold = |n: u64, b: &u8| n << 8 | u64::from(*b);
        if self.big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
    }
}

/// An entry of a directory to be written, with little-endian values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The number of the tag.
    pub tag: u16,
    /// The kind of the values, as in TIFF: 1 bytes, 2 text, 3 16 bits, 4 32 bits, 5 fractions, 7 opaque bytes, 10
    /// signed fractions.
    pub kind: u16,
    /// The number of values.
    pub count: u32,
    /// The values.
    pub bytes: Vec<u8>,
}

/// Adds the attributes of Exif data, with or without the mark "Exif" that it has in JPEG files. Damaged values and tags
/// without a name are left out. An orientation is added as `orientation`.
pub fn read(bytes: &[u8], attributes: &mut Params) {
    let bytes = bytes.strip_prefix(b"Exif\0\0").unwrap_or(bytes);
    let big_endian = match bytes.get(..4) {
        Some(b"II\x2a\0") => false,
        Some(b"MM\0\x2a") => true,
        _ => return,
    };
    let fetch = |at: u64, len: u64| {
        let at = usize::try_from(at).ok()?;
        let end = at.checked_add(usize::try_from(len).ok()?)?;
        bytes.get(at..end).map(<[u8]>::to_vec)
    };
    let source = Source { fetch: &fetch, big_endian, big_tiff: false };
    let Some(first) = fetch(4, 4) else { return };
    let mut image = Params::new();
    let links = read_directory(&source, source.number(&first), Part::Image, &mut image);
    if image.get("XResolution").is_some() && image.get("ResolutionUnit").is_none() {
        image.set(param("ResolutionUnit", "in".into()));
    }
    attributes.extend(image.0);
    for (link, part) in links.into_iter().zip([Part::Camera, Part::Position]) {
        if let Some(offset) = link {
            read_directory(&source, offset, part, attributes);
        }
    }
}

/// Adds the attributes of one directory. Returns the offsets of the directories of the camera and of the position,
/// where it names them.
pub fn read_directory(
    source: &Source<'_>,
    offset: u64,
    part: Part,
    attributes: &mut Params,
) -> [Option<u64>; 2] {
    let mut links = [None; 2];
    let (count_bytes, entry_bytes) = if source.big_tiff { (8, 20) } else { (2, 12) };
    let Some(count) = (source.fetch)(offset, count_bytes) else { return links };
    let count = source.number(&count).min(MOST_ENTRIES);
    for i in 0..count {
        // A directory that ends early has its first entries.
        let at = offset.checked_add(count_bytes + i * entry_bytes);
        let Some(entry) = at.and_then(|at| (source.fetch)(at, entry_bytes)) else { break };
        let (tag, kind) = (source.number(&entry[..2]) as u16, source.number(&entry[2..4]) as u16);
        let (count, field) = entry[4..].split_at(entry.len() / 2 - 2);
        let Some((values, size)) = values(source, kind, source.number(count), field) else { continue };
        if let (Part::Image, CAMERA_TAG | POSITION_TAG) = (part, tag) {
            if matches!(kind, 4 | 13 | 16 | 18) && !values.is_empty() {
                links[usize::from(tag == POSITION_TAG)] = Some(source.number(&values[..size]));
            }
            continue;
        }
        let Some((_, name, kind_written)) = part.tags().iter().find(|t| t.0 == tag) else { continue };
        let data = match kind_written {
            Kind::Comment => comment(&values, source.big_endian).as_deref().map(ParamData::from),
            Kind::Version => text(&values).filter(|t| t.is_ascii()).as_deref().map(ParamData::from),
            Kind::Unit => match source.number(values.get(..size).unwrap_or_default()) {
                1 => Some("none".into()),
                2 => Some("in".into()),
                3 => Some("cm".into()),
                _ => None,
            },
            // Some programs store texts as bytes.
            Kind::Text if matches!(kind, 1 | 2 | 7) => text(&values).as_deref().map(ParamData::from),
            Kind::Text => None,
            _ => numbers_of(source, kind, &values, size),
        };
        // Upright images have no orientation.
        let data = data.filter(|data| tag != 274 || part != Part::Image || *data != ParamData::from(1));
        if let Some(data) = data {
            attributes.set(param(name, data));
        }
    }
    links
}

/// Returns the bytes of the values of an entry, and the bytes of one value. `None` when they are not there, too many,
/// or of an unknown kind.
fn values(source: &Source<'_>, kind: u16, count: u64, field: &[u8]) -> Option<(Vec<u8>, usize)> {
    let size = match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16 | 17 | 18 => 8,
        _ => return None,
    };
    let bytes = count.checked_mul(size).filter(|bytes| *bytes <= LONGEST)?;
    let values = match field.get(..bytes as usize) {
        Some(values) => values.to_vec(),
        None => (source.fetch)(source.number(field), bytes)?,
    };
    Some((values, size as usize))
}

/// Returns the numbers of a kind of TIFF; `None` for texts, for none, for too many, and for numbers that are not finite
/// or exceed 32 bits.
fn numbers_of(source: &Source<'_>, kind: u16, values: &[u8], size: usize) -> Option<ParamData> {
    if kind == 2 || values.is_empty() || (values.len() / size) as u64 > MOST_NUMBERS {
        return None;
    }
    let numbers = || values.chunks_exact(size).map(|v| source.number(v));
    let halves = |v: &[u8]| (source.number(&v[..4]) as u32, source.number(&v[4..]) as u32);
    let floats: Vec<f64> = match kind {
        5 => values.chunks_exact(8).map(halves).map(|(n, d)| f64::from(n) / f64::from(d)).collect(),
        10 => {
            let signed = |(n, d): (u32, u32)| f64::from(n as i32) / f64::from(d as i32);
            values.chunks_exact(8).map(halves).map(signed).collect()
        }
        11 => numbers().map(|n| f64::from(f32::from_bits(n as u32))).collect(),
        12 => numbers().map(f64::from_bits).collect(),
        _ => {
            let int = |n: u64| match kind {
                6 => Some(i32::from(n as u8 as i8)),
                8 => Some(i32::from(n as u16 as i16)),
                9 => Some(n as u32 as i32),
                17 => i32::try_from(n as i64).ok(),
                _ => i32::try_from(n).ok(),
            };
            let ints: Option<Vec<i32>> = numbers().map(int).collect();
            return ints.map(|ints| ints[..].into());
        }
    };
    let floats: Vec<f32> = floats.into_iter().map(|v| v as f32).collect();
    floats.iter().all(|v| v.is_finite()).then(|| floats[..].into())
}

/// Returns a text after eight bytes that name its encoding.
fn comment(bytes: &[u8], big_endian: bool) -> Option<String> {
    let (encoding, bytes) = bytes.split_at_checked(8)?;
    if encoding != b"UNICODE\0" {
        return text(bytes);
    }
    let unit = |b: &[u8; 2]| if big_endian { u16::from_be_bytes(*b) } else { u16::from_le_bytes(*b) };
    let units = bytes.as_chunks::<2>().0.iter().map(unit).take_while(|unit| *unit != 0);
    let all: String = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
    text(all.as_bytes())
}

/// Returns the entries of a directory, sorted by tag, of the attributes that have a tag there. Names in `without` are
/// left out, and so are values that the tag cannot hold. Upright images have no orientation.
pub fn entries(attributes: &Params, part: Part, without: &[&str]) -> Vec<Entry> {
    let tags = part.tags().iter().filter(|(_, name, _)| !without.contains(name));
    tags.filter_map(|(tag, name, kind)| {
        let data = value(attributes, name)?;
        if *name == "orientation" && data.to_ints()?.first() == Some(&1) {
            return None;
        }
        let (kind, count, bytes) = stored(*kind, data)?;
        Some(Entry { tag: *tag, kind, count: u32::try_from(count).ok()?, bytes })
    })
    .collect()
}

/// Returns the kind in TIFF, the number of values, and the values.
fn stored(kind: Kind, data: &ParamData) -> Option<(u16, usize, Vec<u8>)> {
    let string = || match data {
        // The format ends texts at a NUL.
        ParamData::String(v) => v.first().and_then(|s| s.split('\0').next()),
        _ => None,
    };
    let ints = |most: i64| -> Option<Vec<i64>> {
        let ints: Vec<i64> = data.to_ints()?.iter().map(|v| i64::from(*v)).collect();
        ints.iter().all(|v| (0..=most).contains(v)).then_some(ints).filter(|v| !v.is_empty())
    };
    Some(match kind {
        Kind::Text => {
            let bytes = [string()?.as_bytes(), &[0]].concat();
            (2, bytes.len(), bytes)
        }
        Kind::Version => {
            let mut bytes = string().filter(|t| t.is_ascii())?.as_bytes().to_vec();
            bytes.resize(4, b'0');
            (7, 4, bytes)
        }
        Kind::Comment => {
            let text = string()?;
            let bytes = if text.is_ascii() {
                [&b"ASCII\0\0\0"[..], text.as_bytes()].concat()
            } else {
                let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
                [&b"UNICODE\0"[..], &units].concat()
            };
            (7, bytes.len(), bytes)
        }
        Kind::Unit => {
            let unit = match string()? {
                "none" => 1_u16,
                "in" | "inch" => 2,
                "cm" => 3,
                _ => return None,
            };
            (3, 1, unit.to_le_bytes().to_vec())
        }
        Kind::Byte | Kind::Opaque => {
            let bytes: Vec<u8> = ints(255)?.into_iter().map(|v| v as u8).collect();
            (if kind == Kind::Byte { 1 } else { 7 }, bytes.len(), bytes)
        }
        Kind::Short => {
            let values = ints(65535)?;
            (3, values.len(), values.iter().flat_map(|v| (*v as u16).to_le_bytes()).collect())
        }
        Kind::Long => {
            let values = ints(i64::from(u32::MAX))?;
            (4, values.len(), values.iter().flat_map(|v| (*v as u32).to_le_bytes()).collect())
        }
        Kind::Fraction | Kind::SignedFraction => {
            let values = data.to_floats().filter(|v| !v.is_empty())?;
            let signed = kind == Kind::SignedFraction;
            let fractions: Option<Vec<(i64, i64)>> = values.iter().map(|v| fraction(*v, signed)).collect();
            let bytes = |(n, d): (i64, i64)| [(n as u32).to_le_bytes(), (d as u32).to_le_bytes()].concat();
            (if signed { 10 } else { 5 }, values.len(), fractions?.into_iter().flat_map(bytes).collect())
        }
    })
}

/// Returns the simplest fraction that is the same float, by a continued fraction. `None` when there is none with 32
/// bits.
fn fraction(value: f32, signed: bool) -> Option<(i64, i64)> {
    let most = if signed { i64::from(i32::MAX) } else { i64::from(u32::MAX) };
    if !value.is_finite() || f64::from(value.abs()) > most as f64 || value < 0.0 && !signed {
        return None;
    }
    let target = f64::from(value.abs());
    let (mut before, mut last) = ((0_i64, 1_i64), (1_i64, 0_i64));
    let mut rest = target;
    for _ in 0..32 {
        let whole = rest.floor();
        let next = |a: i64, b: i64| (whole as i64).checked_mul(a)?.checked_add(b).filter(|n| *n <= most);
        let (Some(n), Some(d)) = (next(last.0, before.0), next(last.1, before.1)) else { break };
        (before, last) = (last, (n, d));
        if (n as f64 / d as f64) as f32 == value.abs() || rest == whole {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    let sign = if value < 0.0 { -1 } else { 1 };
    (last.1 > 0).then_some((sign * last.0, last.1))
}

/// Returns Exif data of the attributes, little-endian, without the mark "Exif". Names in `without` are left out, which
/// are those that a format has its own place for. `None` when no attribute is left.
pub fn write(attributes: &Params, without: &[&str]) -> Option<Vec<u8>> {
    let [mut first, mut camera, position] =
        [Part::Image, Part::Camera, Part::Position].map(|part| entries(attributes, part, without));
    if first.is_empty() && camera.is_empty() && position.is_empty() {
        return None;
    }
    complete(&mut camera);
    // A link has the length of a number of 32 bits, whatever its value is.
    let link =
        |tag: u16, at: usize| Entry { tag, kind: 4, count: 1, bytes: (at as u32).to_le_bytes().into() };
    let linked = [(CAMERA_TAG, &camera), (POSITION_TAG, &position)];
    let linked: Vec<_> = linked.into_iter().filter(|(_, entries)| !entries.is_empty()).collect();
    let plain = first.len();
    first.extend(linked.iter().map(|(tag, _)| link(*tag, 0)));
    first.sort_by_key(|e| e.tag);
    let mut at = 8 + laid_out(&first, 8).len();
    let mut rest = Vec::new();
    for (tag, entries) in &linked {
        if let Some(entry) = first.iter_mut().find(|e| e.tag == *tag) {
            *entry = link(*tag, at);
        }
        rest.extend(laid_out(entries, at));
        at += laid_out(entries, at).len();
    }
    debug_assert_eq!(plain + linked.len(), first.len());
    Some([&b"II\x2a\0\x08\0\0\0"[..], &laid_out(&first, 8), &rest].concat())
}

/// Adds the version, which a directory of the camera must have, when it has other entries.
pub fn complete(camera: &mut Vec<Entry>) {
    const VERSION: u16 = 36864;
    if !camera.is_empty() && camera.iter().all(|e| e.tag != VERSION) {
        camera.push(Entry { tag: VERSION, kind: 7, count: 4, bytes: b"0232".to_vec() });
        camera.sort_by_key(|e| e.tag);
    }
}

/// Returns a directory and the values that do not fit in it, for the offset `at`.
fn laid_out(entries: &[Entry], at: usize) -> Vec<u8> {
    let mut directory = (entries.len() as u16).to_le_bytes().to_vec();
    let values_at = at + 2 + 12 * entries.len() + 4;
    let mut values: Vec<u8> = Vec::new();
    for entry in entries {
        directory.extend(entry.tag.to_le_bytes());
        directory.extend(entry.kind.to_le_bytes());
        directory.extend(entry.count.to_le_bytes());
        if entry.bytes.len() <= 4 {
            let mut field = entry.bytes.clone();
            field.resize(4, 0);
            directory.extend(field);
        } else {
            directory.extend(((values_at + values.len()) as u32).to_le_bytes());
            values.extend(&entry.bytes);
            // Values begin at even offsets.
            values.resize(values.len().next_multiple_of(2), 0);
        }
    }
    directory.extend(0_u32.to_le_bytes());
    [directory, values].concat()
}

#[cfg(test)]
mod tests;
