//! Writing of DPX files: one element, big-endian, of 8 to 16 bits, with rows that are not padded.

use super::header::{ELEMENTS, FIELDS, LENGTH, element_fields};
use crate::fields::{Header, param};
use granita_image::{AtomicFile, ImageError, ImageSpec, PixelType, Pixels, Result};
use std::io::Write;
use std::path::Path;

/// The number of bits of a value that is written: `int BitsPerSample`, or those of the type.
pub(super) fn bits(spec: &ImageSpec) -> i32 {
    match spec.pixel_type {
        PixelType::U8 => 8,
        _ => spec.attributes.int("BitsPerSample").filter(|bits| *bits != 8).unwrap_or(16),
    }
}

/// Writes the header and all pixels.
pub(super) fn encode(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let bits = bits(spec);
    let row = spec.width as usize * spec.nchannels();
    let line = match bits {
        8 => row,
        10 => row.div_ceil(3) * 4,
        _ => row * 2,
    };
    let size = line as u64 * u64::from(spec.height) + LENGTH as u64;
    let Ok(size) = u32::try_from(size) else {
        let (path, what, max) = (file.path().to_owned(), "size of a DPX file", u64::from(u32::MAX));
        return Err(ImageError::Limit { path, what, asked: size, max });
    };
    let mut written = file.write_all(&header(spec, bits, size, file.path()));
    for y in 0..spec.height as usize {
        let bytes: Vec<u8> = match &pixels {
            Pixels::U8(v) => v[y * row..][..row].to_vec(),
            Pixels::U16(v) => {
                let values = &v[y * row..][..row];
                match bits {
                    10 => ten(values, spec.nchannels() == 1),
                    12 => values.iter().flat_map(|v| (narrow(*v, 12) << 4).to_be_bytes()).collect(),
                    _ => values.iter().flat_map(|v| v.to_be_bytes()).collect(),
                }
            }
            // `create` refuses other types.
            _ => Vec::new(),
        };
        written = written.and_then(|()| file.write_all(&bytes));
    }
    written.map_err(|e| file.io_error(e).into())
}

/// Returns the nearest value of fewer bits. Values whose high bits are repeated as the low ones stay exact.
fn narrow(v: u16, bits: u32) -> u16 {
    let most = (1_u32 << bits) - 1;
    ((u32::from(v) * most + 32767) / 65535) as u16
}

/// Returns three values of 10 bits per word, with two bits of padding below (method A). The first is in the highest
/// bits, or in the lowest ones for images of one channel.
fn ten(values: &[u16], single: bool) -> Vec<u8> {
    let shifts = if single { [2, 12, 22] } else { [22, 12, 2] };
    let word = |three: &[u16]| {
        let parts = three.iter().zip(shifts).map(|(v, shift)| u32::from(narrow(*v, 10)) << shift);
        parts.fold(0, |word, part| word | part).to_be_bytes()
    };
    values.chunks(3).flat_map(word).collect()
}

fn header(spec: &ImageSpec, bits: i32, size: u32, path: &Path) -> Vec<u8> {
    let mut header = Header::new(vec![0xff; LENGTH], true);
    header.set_text(0, 4, "SDPX");
    header.set_long(4, LENGTH as u32);
    header.set_text(8, 8, "V2.0");
    header.set_long(16, size);
    // It is not the same as the frame before.
    header.set_long(20, 1);
    header.set_long(24, 1664);
    header.set_long(28, 384);
    header.set_long(32, 0);
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    header.set_text(36, 100, &name);
    // Texts that are not given are empty.
    for (at, len) in
        [(136, 24), (160, 100), (260, 200), (460, 200), (1432, 100), (1532, 24), (1556, 32), (1588, 32)]
    {
        header.set_text(at, len, "");
    }
    for (at, len) in [(1664, 16), (1680, 32), (1732, 32), (1764, 100)] {
        header.set_text(at, len, "");
    }
    header.set_short(768, 0);
    header.set_short(770, 1);
    header.set_long(772, spec.width);
    header.set_long(776, spec.height);
    header.set_long(ELEMENTS, 0);
    let (descriptor, depth) = match (spec.nchannels(), spec.channels[0].as_str()) {
        (1, "Z") => (8, 11),
        (1, "A") => (4, 0),
        (1, _) => (6, 0),
        (3, _) => (50, 0),
        _ => (51, 0),
    };
    header.set_byte(ELEMENTS + 20, descriptor);
    header.set_byte(ELEMENTS + 21, depth);
    header.set_byte(ELEMENTS + 22, 0);
    header.set_byte(ELEMENTS + 23, bits as u8);
    header.set_short(ELEMENTS + 24, u16::from(matches!(bits, 10 | 12)));
    header.set_short(ELEMENTS + 26, 0);
    header.set_long(ELEMENTS + 28, LENGTH as u32);
    header.set_long(ELEMENTS + 32, 0);
    header.set_long(ELEMENTS + 36, 0);
    header.set_text(ELEMENTS + 40, 32, "");
    header.set_long(1408, spec.x.max(0) as u32);
    header.set_long(1412, spec.y.max(0) as u32);
    header.set_long(1424, spec.full_width);
    header.set_long(1428, spec.full_height);
    let aspect = spec.attributes.float("pixelaspect").filter(|a| (1e-3..1e3).contains(a)).unwrap_or(1.0);
    header.set_long(1628, (aspect * 1e6).round() as u32);
    header.set_long(1632, 1_000_000);
    if aspect == 1.0 {
        header.set_long(1628, 1);
        header.set_long(1632, 1);
    }
    header.write(&FIELDS, &spec.attributes);
    header.write(&element_fields(0), &spec.attributes);
    if spec.attributes.string("software").is_none() {
        let mut own = granita_base::Params::new();
        own.set(param("software", "Granita".into()));
        header.write(&FIELDS, &own);
    }
    header.into_bytes()
}
