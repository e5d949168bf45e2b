//! JPEG 2000, read by the `hayro-jpeg2000` crate.

use crate::boxes;
use crate::fields::param;
use crate::whole::{Decoded, Place, WholeInput};
use granita_image::metadata::{exif, iptc};
use granita_image::{
    CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Pixels, Result,
    color, contained,
};
use hayro_jpeg2000::{ColorSpace, DecodeSettings, DecoderContext, Image};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

/// The format "jpeg2000", which is only read: files with boxes, and codestreams without.
///
/// Integers of up to 8 bits are returned with 8, and of up to 16 bits with 16. Their high bits are repeated as the low
/// ones, as in DPX. Values of more bits become floats of the same fraction. Signed values are not fractions: they
/// become halves (up to 8 bits) or floats of the same number. Grey, RGB, palettes, YCC and, as RGB, CMYK and L*a*b* are
/// read, with alpha. Channels of fewer samples are enlarged.
#[derive(Clone, Copy, Debug, Default)]
pub struct Jpeg2000Format;

/// The beginning of a file with boxes.
const BOXES: &[u8] = b"\0\0\0\x0cjP  \r\n\x87\n";

/// The beginning of a codestream: its mark, and that of its sizes.
const CODESTREAM: &[u8] = b"\xff\x4f\xff\x51";

/// The largest number of tiles, because their index has 16 bits.
const MOST_TILES: u64 = 65535;

/// The largest number of bytes of metadata of one kind.
const LONGEST: u64 = 16 << 20;

/// The identifiers of boxes with metadata (ISO/IEC 16684-1 for XMP; those of Adobe for the others).
const XMP: [u8; 16] =
    [0xbe, 0x7a, 0xcf, 0xcb, 0x97, 0xa9, 0x42, 0xe8, 0x9c, 0x71, 0x99, 0x94, 0x91, 0xe3, 0xaf, 0xac];
const IPTC: [u8; 16] =
    [0x33, 0xc7, 0xa4, 0xd2, 0xb8, 0x1d, 0x47, 0x23, 0xa0, 0xba, 0xf1, 0xa3, 0xe0, 0x97, 0xad, 0x38];
const EXIF: [u8; 16] = *b"JpgTiffExif->JP2";

impl Format for Jpeg2000Format {
    fn name(&self) -> &'static str {
        "jpeg2000"
    }

    fn aliases(&self) -> &'static [&'static str] {
        &["jp2"]
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["jp2", "j2k", "j2c", "jpc", "jpx", "jpf"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(BOXES) || head.starts_with(CODESTREAM)
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        open(Place::new(path, "JPEG 2000", limits))
    }

    fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        open(Place::new(path, "JPEG 2000", limits).with_bytes(bytes))
    }

    fn supports(&self, _feature: &str) -> bool {
        false
    }

    fn create(&self, path: &Path, _options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        Err(ImageError::Unsupported { path: path.to_owned(), what: "JPEG 2000 is not written".to_owned() })
    }
}

fn open(place: Place) -> Result<Box<dyn ImageInput>> {
    let siz = Sizes::read(&place)?;
    siz.check(&place)?;
    let file = read_file(&place)?;
    let (mut spec, channels) = with_image(&place, &file, |image| spec_of(image, &siz))?;
    if siz.signed && (channels.colors != Colors::Plain || has_palette(&place)?) {
        return Err(place.unsupported("JPEG 2000 of signed inks, L*a*b* or palettes is not supported"));
    }
    metadata(&place, &mut spec, channels.colors == Colors::Plain)?;
    // An image of one colour has almost no bytes of pixels.
    Ok(Box::new(WholeInput::new("jpeg2000", place, spec, decode, u64::from(u32::MAX))?))
}

/// The sizes of a codestream (ISO/IEC 15444-1, A.5.1). They are checked before the decoder sees them.
struct Sizes {
    /// The offset of the codestream in the file, and its length when a box has it.
    at: u64,
    len: Option<u64>,
    width: u32,
    height: u32,
    tiles: u64,
    /// The numbers of bits of each component.
    bits: Vec<u8>,
    /// True when the components have signed values.
    signed: bool,
}

impl Sizes {
    fn read(place: &Place) -> Result<Self> {
        let (mut file, found) = boxes::of_file(place)?;
        let codestream = found.iter().find(|f| f.kind == *b"jp2c");
        let (at, len) = (codestream.map_or(0, |found| found.at), codestream.map(|found| found.len));
        let mut head = [0; 42];
        file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut head)).map_err(|e| place.io(e))?;
        if !head.starts_with(CODESTREAM) {
            return Err(place.malformed("there is no codestream"));
        }
        let long = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let [x1, y1, x0, y0, tile_w, tile_h, tile_x, tile_y] = [8, 12, 16, 20, 24, 28, 32, 36].map(long);
        let count = u16::from_be_bytes([head[40], head[41]]);
        if x1 <= x0 || y1 <= y0 || tile_w == 0 || tile_h == 0 || tile_x > x0 || tile_y > y0 || count == 0 {
            return Err(place.malformed("the sizes in the header contradict each other"));
        }
        let mut components = vec![[0; 3]; usize::from(count)];
        file.read_exact(components.as_flattened_mut()).map_err(|e| place.io(e))?;
        let tiles = |end: u32, start: u32, size: u32| u64::from((end - start).div_ceil(size));
        // Where all components have fewer samples than the grid, the image is that much smaller.
        let shrink = |i: usize| components.iter().map(|c| c[i]).min().unwrap_or(1).max(1);
        let is_signed = |c: &[u8; 3]| c[0] & 0x80 != 0;
        let signed = components.iter().any(is_signed);
        if signed && !components.iter().all(is_signed) {
            return Err(place.unsupported("JPEG 2000 of signed and unsigned values is not supported"));
        }
        let side = |start: u32, end: u32, by: u8| end.div_ceil(by.into()) - start.div_ceil(by.into());
        Ok(Self {
            at,
            len,
            width: side(x0, x1, shrink(1)),
            height: side(y0, y1, shrink(2)),
            tiles: tiles(x1, tile_x, tile_w).saturating_mul(tiles(y1, tile_y, tile_h)),
            bits: components.iter().map(|c| (c[0] & 0x7f) + 1).collect(),
            signed,
        })
    }

    /// Returns the codestream of a file.
    fn codestream<'f>(&self, file: &'f [u8]) -> &'f [u8] {
        let at = usize::try_from(self.at).unwrap_or(usize::MAX);
        let rest = file.get(at..).unwrap_or_default();
        let len = self.len.and_then(|len| usize::try_from(len).ok());
        len.and_then(|len| rest.get(..len)).unwrap_or(rest)
    }

    /// Checks the numbers against the limits, before the decoder allocates memory for them.
    fn check(&self, place: &Place) -> Result<()> {
        let n = self.bits.len();
        // The decoder holds floats.
        let spec = ImageSpec::new(self.width, self.height, n, PixelType::Float);
        place.limits.check(&place.path, place.format, &spec)?;
        place.limits.within(&place.path, "number of tiles", self.tiles, MOST_TILES)?;
        // The decoder keeps coefficients and samples, of which the result is made.
        let bytes = place.limits.check_read(&place.path, &spec, self.width, self.height)?;
        Limits::check_memory(&place.path, 3 * bytes as u64)
    }
}

/// True when no tile part of a codestream is cut (ISO/IEC 15444-1, A.4). The decoder takes what is missing for zeros.
fn is_whole(codestream: &[u8]) -> bool {
    const TILE_PART: u16 = 0xff90;
    const END: u16 = 0xffd9;
    let short = |at: usize| {
        let bytes = codestream.get(at..at.checked_add(2)?)?;
        Some(u16::from_be_bytes(bytes.try_into().ok()?))
    };
    let mut at = 2;
    while at < codestream.len() {
        let part = codestream.get(at..).unwrap_or_default();
        let (Some(mark), Some(len)) = (short(at), short(at + 2)) else { return short(at) == Some(END) };
        let len = match (mark, part.get(6..10)) {
            (END, _) => return true,
            // The last tile part may extend to the end.
            (TILE_PART, Some([0, 0, 0, 0])) => return codestream.ends_with(&END.to_be_bytes()),
            (TILE_PART, Some(&[a, b, c, d])) => u32::from_be_bytes([a, b, c, d]) as usize,
            (TILE_PART, None) => return false,
            _ => 2 + usize::from(len),
        };
        at = at.saturating_add(len.max(2));
    }
    // Some programs write no mark of the end.
    at == codestream.len()
}

/// Reads the file, which may not be larger than one read.
fn read_file(place: &Place) -> Result<Vec<u8>> {
    place.limits.within(&place.path, "bytes of the file", place.len()?, place.limits.bytes)?;
    place.read_all()
}

/// Parses the headers of a file for `then`.
fn with_image<T>(place: &Place, file: &[u8], then: impl FnOnce(&Image<'_>) -> T) -> Result<T> {
    let parsed = contained(|| Image::new(file, &DecodeSettings::default()).map(|image| then(&image)));
    parsed.map_err(|fault| place.malformed(fault))?.map_err(|e| place.malformed(e.to_string()))
}

/// The channels of an image.
struct Channels {
    colors: Colors,
    /// The number of components of the colours.
    components: usize,
    alpha: bool,
}

/// The conversion of colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Colors {
    /// The components are the channels.
    Plain,
    Cmyk,
    Lab,
}

impl Channels {
    fn of(image: &Image<'_>) -> Self {
        let colors = match image.color_space() {
            ColorSpace::CMYK => Colors::Cmyk,
            // The space of the colours is at byte 16 of a profile.
            ColorSpace::Icc { profile, num_channels } => match (profile.get(16..20), num_channels) {
                (Some(b"Lab "), 3) => Colors::Lab,
                (Some(b"CMYK"), 4) => Colors::Cmyk,
                _ => Colors::Plain,
            },
            _ => Colors::Plain,
        };
        let components = usize::from(image.color_space().num_channels());
        Self { colors, components, alpha: image.has_alpha() }
    }

    fn names(&self) -> Vec<String> {
        let mut names = match (self.colors, self.components) {
            (Colors::Plain, n @ (1 | 3)) => ImageSpec::default_channels(n),
            (Colors::Plain, n) => (0..n).map(|i| format!("channel{i}")).collect(),
            _ => ImageSpec::default_channels(3),
        };
        if self.alpha {
            names.push("A".to_owned());
        }
        names
    }
}

fn spec_of(image: &Image<'_>, siz: &Sizes) -> (ImageSpec, Channels) {
    let pixel_type = match (siz.bits.iter().copied().max().unwrap_or(8), siz.signed) {
        (0..=8, false) => PixelType::U8,
        (0..=8, true) => PixelType::Half,
        (9..=16, false) => PixelType::U16,
        _ => PixelType::Float,
    };
    let channels = Channels::of(image);
    let mut spec = ImageSpec::new(image.width(), image.height(), 1, pixel_type);
    spec.channels = channels.names();
    if channels.alpha {
        spec.attributes.set(param("unassociatedalpha", 1.into()));
    }
    (spec, channels)
}

/// Returns true for a file whose components are indices of colours.
fn has_palette(place: &Place) -> Result<bool> {
    let (mut file, found) = boxes::of_file(place)?;
    let mut headers = found.iter().filter(|f| f.kind == *b"jp2h");
    Ok(headers.any(|h| boxes::list(&mut file, h.at, h.at + h.len).iter().any(|f| f.kind == *b"pclr")))
}

/// Adds what the boxes of a file have besides its pixels. `plain` is false for converted colours, whose profile is not
/// that of the result.
fn metadata(place: &Place, spec: &mut ImageSpec, plain: bool) -> Result<()> {
    let (mut file, found) = boxes::of_file(place)?;
    for item in found {
        if item.kind == *b"jp2h" && plain {
            let inner = boxes::list(&mut file, item.at, item.at + item.len);
            let colors = inner.iter().find(|f| f.kind == *b"colr");
            // A profile follows the method 2, the precedence and the approximation.
            if let Some([2, _, _, profile @ ..]) =
                colors.and_then(|f| boxes::content(&mut file, f, LONGEST)).as_deref()
            {
                spec.set_icc_profile(profile.to_vec());
            }
        }
        if item.kind != *b"uuid" {
            continue;
        }
        let Some(bytes) = boxes::content(&mut file, &item, LONGEST) else { continue };
        let Some((id, bytes)) = bytes.split_first_chunk::<16>() else { continue };
        match *id {
            XMP => spec.attributes.set(param("XMP", (&*String::from_utf8_lossy(bytes)).into())),
            IPTC => iptc::read(bytes, &mut spec.attributes),
            EXIF => exif::read(bytes, &mut spec.attributes),
            _ => {}
        }
    }
    Ok(())
}

fn decode(place: &Place, spec: &ImageSpec) -> Result<Decoded> {
    let siz = Sizes::read(place)?;
    siz.check(place)?;
    let file = read_file(place)?;
    if !is_whole(siz.codestream(&file)) {
        return Err(place.malformed("the file ends before its last tile"));
    }
    with_image(place, &file, |image| {
        let (now, channels) = spec_of(image, &siz);
        if (now.width, now.height, &now.channels) != (spec.width, spec.height, &spec.channels) {
            return Err(place.malformed("the file changed while it was read"));
        }
        let mut context = DecoderContext::default();
        let decoded = image.decode(&mut context).map_err(|e| place.malformed(e.to_string()))?;
        let wanted = channels.components + usize::from(channels.alpha);
        let size = spec.width as usize * spec.height as usize;
        let components = decoded.components();
        if components.len() < wanted || components[..wanted].iter().any(|c| c.samples().len() != size) {
            let n = components.len();
            return Err(place.malformed(format!("{n} components, {wanted} of {size} values are needed")));
        }
        let mut stored = Pixels::zeros(spec.pixel_type, size * wanted);
        for (i, component) in components[..wanted].iter().enumerate() {
            let (samples, bits) = (component.samples(), component.bit_depth());
            let plane = match siz.signed {
                true => signed_plane(samples, bits, spec.pixel_type),
                false => plane(samples, bits, spec.pixel_type),
            };
            stored.set_plane(i, wanted, &plane);
        }
        Ok(Decoded::whole(converted(stored, &channels)))
    })?
}

/// Returns the values of a component, which are numbers of `bits` bits, in the type of the image.
fn plane(samples: &[f32], bits: u8, pixel_type: PixelType) -> Pixels {
    let largest = (1_u64 << bits.min(63)) - 1;
    let whole = |v: &f32| (v.max(0.0).round() as u64).min(largest);
    match pixel_type {
        PixelType::U8 => Pixels::U8(samples.iter().map(|v| widened(whole(v), bits, 8) as u8).collect()),
        PixelType::U16 => Pixels::U16(samples.iter().map(|v| widened(whole(v), bits, 16) as u16).collect()),
        _ => Pixels::Float(samples.iter().map(|v| v / largest as f32).collect()),
    }
}

/// Returns the values of a component of signed numbers. The decoder adds half of their range, as it does to unsigned
/// ones (ISO/IEC 15444-1, G.1, is for the latter alone).
fn signed_plane(samples: &[f32], bits: u8, pixel_type: PixelType) -> Pixels {
    let half = (1_u64 << (bits.clamp(1, 63) - 1)) as f32;
    let numbers: Vec<f32> = samples.iter().map(|v| (v - half).round().clamp(-half, half - 1.0)).collect();
    Pixels::from_floats(pixel_type, &numbers)
}

/// Returns a number of `bits` bits as one of `to` bits. Its high bits are repeated as the low ones, or its low bits are
/// left out.
fn widened(value: u64, bits: u8, to: u8) -> u64 {
    if bits >= to {
        return value >> (bits - to);
    }
    let mut filled = bits;
    let mut out = value << (to - bits);
    while filled < to {
        out |= out >> filled;
        filled = filled.saturating_mul(2);
    }
    out
}

/// Converts inks and L*a*b* to RGB. Alpha stays.
fn converted(stored: Pixels, channels: &Channels) -> Pixels {
    let rgb: &dyn Fn(&[f32]) -> [f32; 3] = match channels.colors {
        Colors::Plain => return stored,
        Colors::Cmyk => &|p| color::cmyk_to_rgb([p[0], p[1], p[2], p[3]]),
        Colors::Lab => &|p| color::lab_to_srgb([p[0] * 100.0, p[1] * 255.0 - 128.0, p[2] * 255.0 - 128.0]),
    };
    let n = channels.components;
    let values = stored.floats();
    let pixels = values.chunks_exact(n + usize::from(channels.alpha));
    let out: Vec<f32> = pixels.flat_map(|p| rgb(p).into_iter().chain(p[n..].iter().copied())).collect();
    Pixels::from_floats(stored.pixel_type(), &out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn high_bits_are_repeated_as_low_ones() {
        for (value, bits, to, expected) in [
            (1, 1, 8, 255),
            (0b101, 3, 8, 0b1011_0110),
            (0x3ff, 10, 16, 0xffff),
            (0x200, 10, 16, 0x8020),
            (0xabc, 12, 16, 0xabca),
            (0xab, 8, 16, 0xabab),
            (0xabcd, 16, 8, 0xab),
        ] {
            assert_eq!(widened(value, bits, to), expected, "{value:#x} of {bits} bits");
        }
    }

    #[test]
    fn values_outside_of_the_range_are_clamped() {
        assert_eq!(plane(&[-3.0, 1023.4, 2000.0], 10, PixelType::U16), Pixels::U16(vec![0, 65535, 65535]));
    }
}
