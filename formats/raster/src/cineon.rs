//! Cineon (Kodak, "Cineon Image File Format", version 4.5), which is read.

use crate::fields::{Field, Header, Kind, param};
use crate::film::{Element, FilmRows, Order, Packing};
use crate::rows::RowsInput;
use granita_image::{FileSource, Format, ImageInput, ImageSpec, Limits, PixelType, Result};
use std::path::Path;

/// The format "cineon", which is only read.
///
/// Values are those of the file, which are logarithms of the density of film. No transfer function is applied. 10 bits
/// become 16 bits whose high bits are repeated as the low ones, and `int BitsPerSample` is their number.
#[derive(Clone, Copy, Debug, Default)]
pub struct CineonFormat;

/// The length of the parts of the header.
const LENGTH: u64 = 2048;

/// The offset of the descriptions of the channels, and their length.
const CHANNELS: (usize, usize) = (196, 28);

const FIELDS: [Field; 18] = [
    Field::new("cineon:Version", 24, Kind::Text(8)),
    Field::new("cineon:CreationDate", 132, Kind::Text(12)),
    Field::new("cineon:CreationTime", 144, Kind::Text(12)),
    Field::new("cineon:LowData", 208, Kind::Real),
    Field::new("cineon:LowQuantity", 212, Kind::Real),
    Field::new("cineon:HighData", 216, Kind::Real),
    Field::new("cineon:HighQuantity", 220, Kind::Real),
    Field::new("cineon:LabelText", 452, Kind::Text(200)),
    Field::new("cineon:SourceImageFileName", 720, Kind::Text(100)),
    Field::new("cineon:SourceDate", 820, Kind::Text(12)),
    Field::new("cineon:SourceTime", 832, Kind::Text(12)),
    Field::new("cineon:InputDevice", 844, Kind::Text(64)),
    Field::new("cineon:InputDeviceModelNumber", 908, Kind::Text(32)),
    Field::new("cineon:InputDeviceSerialNumber", 940, Kind::Text(32)),
    Field::new("cineon:XDevicePitch", 972, Kind::Real),
    Field::new("cineon:YDevicePitch", 976, Kind::Real),
    Field::new("cineon:Gamma", 980, Kind::Real),
    Field::new("cineon:ImageSense", 683, Kind::Byte),
];

/// Fields of the film, which only files with the second part of the header have.
const FILM_FIELDS: [Field; 8] = [
    Field::new("cineon:FilmManufacturer", 1024, Kind::Byte),
    Field::new("cineon:FilmType", 1025, Kind::Byte),
    Field::new("cineon:FilmPrefix", 1028, Kind::Long),
    Field::new("cineon:FilmCount", 1032, Kind::Long),
    Field::new("cineon:Format", 1036, Kind::Text(32)),
    Field::new("cineon:FramePosition", 1068, Kind::Long),
    Field::new("cineon:FrameRate", 1072, Kind::Real),
    Field::new("cineon:FrameId", 1076, Kind::Text(32)),
];

const SLATE: [Field; 1] = [Field::new("cineon:SlateInfo", 1108, Kind::Text(200))];

impl Format for CineonFormat {
    fn name(&self) -> &'static str {
        "cineon"
    }

    fn aliases(&self) -> &'static [&'static str] {
        &["cin"]
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["cin"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(&[0x80, 0x2a, 0x5f, 0xd7]) || head.starts_with(&[0xd7, 0x5f, 0x2a, 0x80])
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "Cineon", &limits.files)?;
        let (spec, element) = read(&source, limits)?;
        let images = vec![vec![spec]];
        Ok(Box::new(RowsInput::new("cineon", "Cineon", source, limits, images, FilmRows(vec![element]))?))
    }
}

fn read(source: &FileSource, limits: &Limits) -> Result<(ImageSpec, Element)> {
    let bytes = source.read_vec(0, source.len().min(LENGTH), "the header")?;
    let big_endian = bytes.first() == Some(&0x80);
    if !CineonFormat.recognizes(&bytes) {
        return Err(source.malformed("it does not begin like one"));
    }
    if bytes.len() < 1024 {
        let what = format!("the header is 1024 bytes, of which the file has {}", bytes.len());
        return Err(source.malformed(what));
    }
    let header = Header::new(bytes, big_endian);
    let n = usize::from(header.byte(193));
    if !(1..=8).contains(&n) {
        return Err(source.malformed(format!("{n} channels, which are 1 to 8")));
    }
    let channel = |c: usize, at: usize| CHANNELS.0 + c * CHANNELS.1 + at;
    let (bits, width, height) =
        (header.byte(channel(0, 2)), header.long(channel(0, 4)), header.long(channel(0, 8)));
    let same = |c: usize| {
        let other = (header.byte(channel(c, 2)), header.long(channel(c, 4)), header.long(channel(c, 8)));
        other == (bits, width, height)
    };
    if !(1..n).all(same) {
        return Err(source.unsupported("Cineon with channels of different sizes is not supported"));
    }
    let (orientation, interleave, packing) = (header.byte(192), header.byte(680), header.byte(681));
    if (4..=7).contains(&orientation) {
        let what = format!("Cineon of columns (orientation {orientation}) is not supported");
        return Err(source.unsupported(what));
    }
    if n > 1 && interleave != 0 {
        let what = format!("Cineon with interleave {interleave} (lines or channels) is not supported");
        return Err(source.unsupported(what));
    }
    if header.byte(682) == 1 {
        return Err(source.unsupported("Cineon of signed values is not supported"));
    }
    // Cells of 8, 16 or 32 bits hold their values at the left (the high bits) or at the right. The highest bit is set
    // where a cell holds as many values as fit.
    let layout = match (bits, packing & 0x7f) {
        (8 | 16, _) | (10 | 12, 0) => Packing::Packed,
        (10, 5) | (12, 3) => Packing::FilledHigh,
        (10, 6) | (12, 4) => Packing::FilledLow,
        _ => {
            let what = format!("Cineon of {bits} bits with packing {packing} is not supported");
            return Err(source.unsupported(what));
        }
    };
    let pixel_type = if bits == 8 { PixelType::U8 } else { PixelType::U16 };
    let mut spec = ImageSpec::new(width, height, n, pixel_type);
    spec.channels = names((0..n).map(|c| header.byte(channel(c, 1))));
    limits.check(source.path(), "Cineon", &spec)?;
    if matches!(bits, 10 | 12) {
        spec.attributes.set(param("BitsPerSample", i32::from(bits).into()));
    }
    for table in [&FIELDS[..], &FILM_FIELDS, &SLATE] {
        header.read(table, &mut spec.attributes);
    }
    let mut element = Element {
        at: u64::from(header.long(4)),
        stride: 0,
        bits,
        packing: layout,
        big_endian,
        low_first: false,
        components: n,
        order: Order::Plain,
        upward: matches!(orientation, 2 | 3),
        leftward: matches!(orientation, 1 | 3),
    };
    let line = element.line_bytes(width);
    let padding = Some(header.long(684)).filter(|p| *p != u32::MAX).unwrap_or(0);
    element.stride = line + u64::from(padding);
    if element.at + line > source.len() {
        let (at, end) = (element.at, source.len());
        return Err(
            source.malformed(format!("a row of {line} bytes at byte {at}, but the file ends at byte {end}"))
        );
    }
    Ok((spec, element))
}

/// Returns the names of channels with these descriptors.
fn names(descriptors: impl Iterator<Item = u8>) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for (i, descriptor) in descriptors.enumerate() {
        let name = match descriptor {
            0 => "Y",
            1 | 4 => "R",
            2 | 5 => "G",
            3 | 6 => "B",
            _ => "",
        };
        let taken = name.is_empty() || names.iter().any(|n| n == name);
        names.push(if taken { format!("channel{i}") } else { name.to_owned() });
    }
    names
}
