//! The header of DPX files.

use crate::fields::{Field, Header, Kind, param};
use crate::film::{Element, Order, Packing};
use granita_image::{FileSource, ImageSpec, Limits, PixelType, Result};

/// The length of the five parts of the header, without the user's data.
pub(super) const LENGTH: usize = 2048;

/// The offset of the descriptions of the elements.
pub(super) const ELEMENTS: usize = 780;

/// The length of the description of an element.
const ELEMENT: usize = 72;

/// The names of transfer functions and colorimetric specifications, in the order of their numbers.
const CHARACTERISTICS: &[&str] = &[
    "User defined",
    "Printing density",
    "Linear",
    "Logarithmic",
    "Unspecified video",
    "SMPTE 274M",
    "ITU-R 709-4",
    "ITU-R 601-5 system B or G",
    "ITU-R 601-5 system M",
    "NTSC composite video",
    "PAL composite video",
    "Z depth linear",
    "Z depth homogeneous",
    "ADX",
];

/// Fields of the file, the film and the television frame, with their attributes.
pub(super) const FIELDS: [Field; 35] = [
    Field::new("DateTime", 136, Kind::Date),
    Field::new("software", 160, Kind::Text(100)),
    Field::new("DocumentName", 260, Kind::Text(200)),
    Field::new("copyright", 460, Kind::Text(200)),
    Field::new("dpx:SourceImageFileName", 1432, Kind::Text(100)),
    Field::new("dpx:SourceDateTime", 1532, Kind::Date),
    Field::new("dpx:InputDevice", 1556, Kind::Text(32)),
    Field::new("dpx:InputDeviceSerialNumber", 1588, Kind::Text(32)),
    Field::new("dpx:XScannedSize", 1636, Kind::Real),
    Field::new("dpx:YScannedSize", 1640, Kind::Real),
    Field::new("dpx:FilmEdgeCode", 1664, Kind::Characters(16)),
    Field::new("dpx:Format", 1680, Kind::Text(32)),
    Field::new("dpx:FramePosition", 1712, Kind::Long),
    Field::new("dpx:SequenceLength", 1716, Kind::Long),
    Field::new("dpx:HeldCount", 1720, Kind::Long),
    Field::new("dpx:FrameRate", 1724, Kind::Real),
    Field::new("dpx:ShutterAngle", 1728, Kind::Real),
    Field::new("dpx:FrameId", 1732, Kind::Text(32)),
    Field::new("dpx:SlateInfo", 1764, Kind::Text(100)),
    Field::new("dpx:TimeCode", 1920, Kind::TimeCode),
    Field::new("dpx:UserBits", 1924, Kind::Long),
    Field::new("dpx:Interlace", 1928, Kind::Byte),
    Field::new("dpx:FieldNumber", 1929, Kind::Byte),
    Field::new("dpx:Signal", 1930, Kind::Byte),
    Field::new("dpx:HorizontalSampleRate", 1932, Kind::Real),
    Field::new("dpx:VerticalSampleRate", 1936, Kind::Real),
    Field::new("dpx:TemporalFrameRate", 1940, Kind::Real),
    Field::new("dpx:TimeOffset", 1944, Kind::Real),
    Field::new("dpx:Gamma", 1948, Kind::Real),
    Field::new("dpx:BlackLevel", 1952, Kind::Real),
    Field::new("dpx:BlackGain", 1956, Kind::Real),
    Field::new("dpx:BreakPoint", 1960, Kind::Real),
    Field::new("dpx:WhiteLevel", 1964, Kind::Real),
    Field::new("dpx:IntegrationTimes", 1968, Kind::Real),
    Field::new("dpx:EncryptKey", 660, Kind::Long),
];

/// Returns the fields of an element.
pub(super) fn element_fields(element: usize) -> [Field; 7] {
    let at = ELEMENTS + element * ELEMENT;
    [
        Field::new("dpx:LowData", at + 4, Kind::Long),
        Field::new("dpx:LowQuantity", at + 8, Kind::Real),
        Field::new("dpx:HighData", at + 12, Kind::Long),
        Field::new("dpx:HighQuantity", at + 16, Kind::Real),
        Field::new("dpx:Transfer", at + 21, Kind::Word(CHARACTERISTICS)),
        Field::new("dpx:Colorimetric", at + 22, Kind::Word(CHARACTERISTICS)),
        Field::new("ImageDescription", at + 40, Kind::Text(32)),
    ]
}

/// Returns the channels of an image descriptor, the number of stored values per pixel, and their order.
fn channels(descriptor: u8) -> Option<(Vec<String>, usize, Order)> {
    let named = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    Some(match descriptor {
        0 | 9 => (ImageSpec::default_channels(1), 1, Order::Plain),
        1 => (named(&["R"]), 1, Order::Plain),
        2 => (named(&["G"]), 1, Order::Plain),
        3 => (named(&["B"]), 1, Order::Plain),
        4 => (named(&["A"]), 1, Order::Plain),
        6 => (named(&["Y"]), 1, Order::Plain),
        8 => (named(&["Z"]), 1, Order::Plain),
        50 => (ImageSpec::default_channels(3), 3, Order::Plain),
        51 => (ImageSpec::default_channels(4), 4, Order::Plain),
        52 => (ImageSpec::default_channels(4), 4, Order::Reversed),
        100 => (named(&["Cb", "Y", "Cr"]), 2, Order::Pairs),
        101 => (named(&["Cb", "Y", "Cr", "A"]), 3, Order::PairsWithAlpha),
        102 => (named(&["Cb", "Y", "Cr"]), 3, Order::Plain),
        103 => (named(&["Cb", "Y", "Cr", "A"]), 4, Order::Plain),
        150..=156 => {
            let n = usize::from(descriptor) - 148;
            ((0..n).map(|i| format!("channel{i}")).collect(), n, Order::Plain)
        }
        _ => return None,
    })
}

/// Returns the images of a file, and their stored form.
///
/// # Errors
/// Errors for a damaged header, an unsupported kind, and a file that holds not even one row.
pub(super) fn read(source: &FileSource, limits: &Limits) -> Result<(Vec<ImageSpec>, Vec<Element>)> {
    let bytes = source.read_vec(0, source.len().min(LENGTH as u64), "the header")?;
    let big_endian = bytes.starts_with(b"SDPX");
    if !big_endian && !bytes.starts_with(b"XPDS") {
        return Err(source.malformed("it does not begin like one"));
    }
    // The parts for film and television are optional.
    let (least, there) = (ELEMENTS + ELEMENT, bytes.len());
    if there < least {
        return Err(source.malformed(format!("the header is {least} bytes, of which the file has {there}")));
    }
    let header = Header::new(bytes, big_endian);
    let (orientation, count) = (header.short(768), header.short(770));
    if !(1..=8).contains(&count) {
        return Err(source.malformed(format!("{count} image elements, which are 1 to 8")));
    }
    if (4..=7).contains(&orientation) {
        return Err(
            source.unsupported(format!("DPX of columns (orientation {orientation}) is not supported"))
        );
    }
    let mut specs = Vec::new();
    let mut elements: Vec<Element> = Vec::new();
    let data = |i: u16| {
        let own = header.long(ELEMENTS + usize::from(i) * ELEMENT + 28);
        u64::from(if matches!(own, 0 | u32::MAX) { header.long(4) } else { own })
    };
    for i in 0..count {
        let (mut spec, mut element) = read_element(source, &header, usize::from(i))?;
        limits.check(source.path(), "DPX", &spec)?;
        element.at = data(i);
        let (line, height) = (element.line_bytes(spec.width), u64::from(spec.height));
        // Rows should begin at whole words. Most programs begin them anywhere, so the space decides.
        let end = (0..count).map(data).filter(|at| *at > element.at).chain([source.len()]).min();
        let space = end.unwrap_or(0).saturating_sub(element.at);
        let whole = line.next_multiple_of(4);
        element.stride = match header.long(ELEMENTS + usize::from(i) * ELEMENT + 32) {
            0 | u32::MAX if whole.saturating_mul(height) <= space => whole,
            0 | u32::MAX => line,
            padding => line + u64::from(padding),
        };
        if element.at.saturating_add(line) > source.len() {
            let what = format!(
                "a row of {line} bytes at byte {}, but the file ends at byte {}",
                element.at,
                source.len()
            );
            return Err(source.malformed(what));
        }
        header.read(&FIELDS, &mut spec.attributes);
        header.read(&element_fields(usize::from(i)), &mut spec.attributes);
        specs.push(spec);
        elements.push(element);
    }
    Ok((specs, elements))
}

fn read_element(source: &FileSource, header: &Header, i: usize) -> Result<(ImageSpec, Element)> {
    let at = ELEMENTS + i * ELEMENT;
    let (width, height) = (header.long(772), header.long(776));
    let (descriptor, bits) = (header.byte(at + 20), header.byte(at + 23));
    let Some((names, components, order)) = channels(descriptor) else {
        return Err(source.unsupported(format!("DPX of image descriptor {descriptor} is not supported")));
    };
    if header.long(at) == 1 {
        return Err(source.unsupported("DPX of signed values is not supported"));
    }
    if header.short(at + 26) == 1 {
        return Err(source.unsupported("DPX with run-length encoding is not supported"));
    }
    let pixel_type = match bits {
        8 => PixelType::U8,
        10 | 12 | 16 => PixelType::U16,
        32 | 64 => PixelType::Float,
        _ => return Err(source.unsupported(format!("DPX of {bits} bits per sample is not supported"))),
    };
    let mut spec = ImageSpec { channels: names, ..ImageSpec::new(width, height, 1, pixel_type) };
    let offset = |at: usize| i32::try_from(header.long(at)).unwrap_or(0);
    let full = |at: usize, own: u32| {
        Some(header.long(at)).filter(|v| i32::try_from(*v).is_ok_and(|v| v > 0)).unwrap_or(own)
    };
    (spec.x, spec.y) = (offset(1408), offset(1412));
    (spec.full_width, spec.full_height) = (full(1424, width), full(1428, height));
    if matches!(bits, 10 | 12) {
        spec.attributes.set(param("BitsPerSample", i32::from(bits).into()));
    }
    let aspect = [header.long(1628), header.long(1632)];
    if aspect[0] != aspect[1] && aspect.iter().all(|v| !matches!(*v, 0 | u32::MAX)) {
        spec.attributes.set(param("pixelaspect", (aspect[0] as f32 / aspect[1] as f32).into()));
    }
    let element = Element {
        at: 0,
        stride: 0,
        bits,
        packing: match header.short(at + 24) {
            1 => Packing::FilledHigh,
            2 => Packing::FilledLow,
            _ => Packing::Packed,
        },
        big_endian: header.is_big_endian(),
        low_first: components == 1,
        components,
        order,
        upward: matches!(header.short(768), 2 | 3),
        leftward: matches!(header.short(768), 1 | 3),
    };
    Ok((spec, element))
}
