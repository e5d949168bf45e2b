//! PNG, read and written by the `png` crate.

use crate::fields::param;
use crate::whole::{Decoded, Place, Source, WholeInput, WholeOutput, divide_by_alpha};
use granita_base::{Param, Params};
use granita_image::metadata::exif;
use granita_image::{
    AtomicFile, CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType,
    Pixels, Result,
};
use parking_lot::Mutex;
use png::{BitDepth, ColorType, DecodingError, EncodingError};
use std::borrow::Cow;
use std::io::Read;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The format "png", with 8 and 16 bits, grey or RGB, with or without alpha.
///
/// Every kind of PNG is read. Palettes and fewer than 8 bits become 8-bit values, and a transparent colour becomes
/// alpha. The colours of a PNG are *not* multiplied by alpha, so images that are read have the attribute `int
/// unassociatedalpha` 1. An image that is written without this attribute is divided by its alpha. Where alpha is 0,
/// colours are not changed.
///
/// The attributes `ImageDescription`, `DocumentName`, `Artist`, `copyright` and `software` are kept as texts, and other
/// texts under their keywords with the prefix "png:". Exif, XMP and ICC profiles are kept too, and what the file says
/// of its colours: `float png:gAMA`, `float[8] png:cHRM`, `int png:sRGB` and `int[4] png:cICP`. None of these is
/// applied. `compression` may be "none", "fast" or "zip" (the default).
#[derive(Clone, Copy, Debug, Default)]
pub struct PngFormat;

/// The largest number of bytes that deflate packs into one.
const DEFLATE: u64 = 1032;

/// The same in bytes of pixels, because a bit of a palette's index becomes three bytes.
const EXPANDED: u64 = 24 * DEFLATE;

/// The largest number of bytes of a text that is kept. Longer texts are omitted, because uncompressed they may be a
/// thousand times as long as the file.
const LONGEST_TEXT: usize = 1 << 20;

/// The largest number of texts that are kept, and of chunks that are searched for a profile.
const MOST_TEXTS: usize = 256;

/// The number of bytes that a profile has fewer than, packed and unpacked.
const LONGEST_PROFILE: u64 = 16 << 20;

/// The attributes of what a file says of its colours: the exponent of its values, the chromaticities (x and y of white,
/// red, green and blue), and the rendering intent of sRGB.
const GAMMA: &str = "png:gAMA";
const CHROMATICITIES: &str = "png:cHRM";
const SRGB: &str = "png:sRGB";
/// The numbers of ITU-T H.273: primaries, transfer function, matrix, and 1 for the full range.
const CODE_POINTS: &str = "png:cICP";

/// The keyword of XMP (XMP Specification, part 3).
const XMP_KEYWORD: &str = "XML:com.adobe.xmp";

/// The beginning of the names of attributes of IPTC, which are also keywords, as in OpenImageIO.
const IPTC: &str = "IPTC:";

/// The beginning of the names of texts whose keywords have no attribute of their own.
const PREFIX: &str = "png:";

/// The prefix of the names of the renderer's settings, which are keywords as they are.
const SETTINGS: &str = "granita/";

/// The keyword of a text chunk (PNG specification, 11.3.3.1), and the name of the attribute.
const TEXTS: [(&str, &str); 5] = [
    ("Title", "DocumentName"),
    ("Description", "ImageDescription"),
    ("Author", "Artist"),
    ("Copyright", "copyright"),
    ("Software", "software"),
];

impl Format for PngFormat {
    fn name(&self) -> &'static str {
        "png"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["png"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"\x89PNG\r\n\x1a\n")
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        open("png", Place::new(path, "PNG", limits))
    }

    fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        open("png", Place::new(path, "PNG", limits).with_bytes(bytes))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "u16" | "alpha")
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let fault = if !matches!(spec.pixel_type, PixelType::U8 | PixelType::U16) {
            format!("PNG holds 8 or 16-bit integers, not {:?}", spec.pixel_type)
        } else if !(1..=4).contains(&spec.nchannels()) {
            format!("PNG holds 1 to 4 channels, not {}", spec.nchannels())
        } else {
            return Ok(Box::new(WholeOutput::create(path, options, encode)?));
        };
        Err(ImageError::Unsupported { path: path.to_owned(), what: fault })
    }
}

/// Opens a PNG, which may be the content of a file of the format `name`.
pub(crate) fn open(name: &'static str, place: Place) -> Result<Box<dyn ImageInput>> {
    let (spec, interlaced) = read_spec(&place)?;
    if interlaced {
        return Ok(Box::new(WholeInput::new(name, place, spec, decode, EXPANDED)?));
    }
    place.limits.check(&place.path, "PNG", &spec)?;
    // Rows need little memory, but an image without data for its many rows would take hours.
    let bytes = (spec.bytes().unwrap_or(u64::MAX), place.len()?);
    place.limits.check_ratio(&place.path, "PNG", bytes, EXPANDED)?;
    Ok(Box::new(PngRows { name, place, spec, state: Mutex::new(None), broken: OnceLock::new() }))
}

/// An open PNG that is not interlaced. Rows are decoded in order and not kept. A request for earlier rows begins again.
struct PngRows {
    name: &'static str,
    place: Place,
    spec: ImageSpec,
    /// The decoder, and the index of the row that it returns next.
    state: Mutex<Option<(png::Reader<Source>, u32)>>,
    /// The first row that cannot be decoded, and the reason, so that it is not tried again.
    broken: OnceLock<(u32, ImageError)>,
}

impl ImageInput for PngRows {
    fn format_name(&self) -> &'static str {
        self.name
    }

    fn levels(&self, image: usize) -> usize {
        usize::from(image == 0)
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        (image == 0 && level == 0).then_some(&self.spec)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        let (place, spec) = (&self.place, &self.spec);
        if image != 0 || level != 0 || y0 > y1 || y1 > spec.height {
            let height = spec.height;
            return Err(
                place.misuse(format!("rows {y0} to {y1} of {height} of level {level} of image {image}"))
            );
        }
        let bytes = place.limits.check_read(&place.path, spec, spec.width, y1 - y0)?;
        if let Some((row, error)) = self.broken.get()
            && y1 > *row
            && let Some(error) = error.lasting()
        {
            return Err(error);
        }
        let failed = |y: u32, error: DecodingError| {
            let error = fault(place, error);
            if let Some(lasting) = error.lasting() {
                let _ = self.broken.set((y, lasting));
            }
            error
        };
        // The state is taken out while it is used. After an error there is none, and the next call begins again.
        let mut state = self.state.lock();
        let (mut reader, mut y) = match state.take() {
            Some((reader, next)) if next <= y0 => (reader, next),
            _ => (reader(place)?, 0),
        };
        let row = bytes / (y1 - y0).max(1) as usize;
        let whole = || place.malformed("the file changed while it was read");
        let size = reader.output_line_size(spec.width);
        if y1 > y0 && size != Some(row) {
            return Err(whole());
        }
        while y < y0 {
            reader.next_row().map_err(|e| failed(y, e))?.ok_or_else(whole)?;
            y += 1;
        }
        // The result grows as rows are read, so that a short file with a tall header does not need the memory of its
        // height.
        let mut out = Vec::new();
        while y < y1 {
            let at = out.len();
            out.resize(at + row, 0);
            reader.read_row(&mut out[at..]).map_err(|e| failed(y, e))?.ok_or_else(whole)?;
            y += 1;
        }
        *state = Some((reader, y));
        Ok(Pixels::from_bytes(spec.pixel_type, out, true))
    }

    fn read_tile(&self, _image: usize, _level: usize, _tx: u32, _ty: u32) -> Result<Pixels> {
        Err(self.place.misuse("a tile of an image stored in rows".to_owned()))
    }

    fn bytes_read(&self) -> u64 {
        self.place.bytes_read()
    }
}

/// Opens the decoder, which then is behind the header.
fn reader(place: &Place) -> Result<png::Reader<Source>> {
    /// The largest number of bytes of rows and texts. Pixels do not count.
    const MOST: u64 = 64 << 20;
    let bytes = usize::try_from(place.limits.bytes.min(MOST)).unwrap_or(usize::MAX);
    let mut decoder = png::Decoder::new_with_limits(place.source()?, png::Limits { bytes });
    // Colour profiles are not used, and may unpack to a thousand times their length.
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_transformations(png::Transformations::EXPAND);
    decoder.read_info().map_err(|e| fault(place, e))
}

fn fault(place: &Place, error: DecodingError) -> ImageError {
    match error {
        DecodingError::IoError(e) => place.io(e),
        DecodingError::LimitsExceeded => place.unsupported("the PNG needs more memory than the limits allow"),
        other => place.malformed(other.to_string()),
    }
}

/// Returns the content of the header, and true when rows are interlaced.
fn read_spec(place: &Place) -> Result<(ImageSpec, bool)> {
    let reader = reader(place)?;
    let info = reader.info();
    let (color, depth) = reader.output_color_type();
    let (channels, alpha) = match color {
        ColorType::Grayscale => (1, false),
        ColorType::GrayscaleAlpha => (2, true),
        ColorType::Rgba => (4, true),
        ColorType::Rgb | ColorType::Indexed => (3, false),
    };
    let pixel_type = if depth == BitDepth::Sixteen { PixelType::U16 } else { PixelType::U8 };
    let mut spec = ImageSpec::new(info.width, info.height, channels, pixel_type);
    if alpha {
        spec.attributes.set(param("unassociatedalpha", 1.into()));
    }
    let mut found = texts(info);
    // Those with attributes of their own come first, so that others do not displace them.
    found.sort_by_key(|(keyword, _)| {
        TEXTS.iter().position(|(known, _)| known == keyword).unwrap_or(TEXTS.len())
    });
    for (keyword, text) in found.into_iter().take(MOST_TEXTS) {
        let own = TEXTS.iter().find(|(known, _)| *known == keyword).map(|(_, name)| (*name).to_owned());
        let name = match (own, keyword.as_str()) {
            (Some(name), _) => name,
            (None, XMP_KEYWORD) => "XMP".to_owned(),
            (None, keyword) if keyword.starts_with(IPTC) || keyword.starts_with(SETTINGS) => {
                keyword.to_owned()
            }
            (None, keyword) => format!("{PREFIX}{keyword}"),
        };
        // Of several texts with one keyword the first one is kept.
        if spec.attributes.get(&name).is_none() {
            spec.attributes.set(param(&name, text.as_str().into()));
        }
    }
    colors(info, &mut spec);
    if let Some(data) = &info.exif_metadata {
        exif::read(data, &mut spec.attributes);
    }
    match profile(place)? {
        Some((_, Some(profile))) => spec.set_icc_profile(profile),
        Some((name, None)) => spec.attributes.set(param("ICCProfile", name.as_str().into())),
        None => {}
    }
    Ok((spec, info.interlaced))
}

/// Returns the keyword of an attribute with the prefix, of IPTC, or of the renderer's settings. It has 1 to 79
/// characters of ASCII.
fn keyword(name: &str) -> Option<&str> {
    let is_whole = name.starts_with(IPTC) || name.starts_with(SETTINGS);
    let keyword = if is_whole { Some(name) } else { name.strip_prefix(PREFIX) };
    keyword.filter(|keyword| (1..80).contains(&keyword.len()) && keyword.is_ascii())
}

/// Returns the keywords and texts before the pixels. Texts that are too long or damaged are left out.
fn texts(info: &png::Info<'_>) -> Vec<(String, String)> {
    let mut texts: Vec<(String, String)> = Vec::new();
    texts.extend(info.uncompressed_latin1_text.iter().map(|t| (t.keyword.clone(), t.text.clone())));
    for chunk in &info.compressed_latin1_text {
        let mut chunk = chunk.clone();
        if chunk.decompress_text_with_limit(LONGEST_TEXT).is_ok()
            && let Ok(text) = chunk.get_text()
        {
            texts.push((chunk.keyword, text));
        }
    }
    for chunk in &info.utf8_text {
        let mut chunk = chunk.clone();
        if chunk.decompress_text_with_limit(LONGEST_TEXT).is_ok()
            && let Ok(text) = chunk.get_text()
        {
            texts.push((chunk.keyword, text));
        }
    }
    texts
}

/// Adds what the file says of its colours (chunks gAMA, cHRM and sRGB), and of the size of its pixels (pHYs).
fn colors(info: &png::Info<'_>, spec: &mut ImageSpec) {
    if let Some(gamma) = info.gama_chunk {
        spec.attributes.set(param(GAMMA, gamma.into_value().into()));
    }
    if let Some(points) = info.chrm_chunk {
        let points = [points.white, points.red, points.green, points.blue];
        let values: Vec<f32> = points.iter().flat_map(|(x, y)| [x.into_value(), y.into_value()]).collect();
        if let Ok(param) = Param::declared(&format!("float[8] {CHROMATICITIES}"), &values[..]) {
            spec.attributes.set(param);
        }
    }
    if let Some(points) = info.coding_independent_code_points {
        let values = [
            i32::from(points.color_primaries),
            i32::from(points.transfer_function),
            i32::from(points.matrix_coefficients),
            i32::from(points.is_video_full_range_image),
        ];
        if let Ok(param) = Param::declared(&format!("int[4] {CODE_POINTS}"), &values[..]) {
            spec.attributes.set(param);
        }
    }
    if let Some(intent) = info.srgb {
        spec.attributes.set(param(SRGB, i32::from(intent as u8).into()));
    }
    if let Some(png::PixelDimensions { xppu, yppu, unit: png::Unit::Meter }) = info.pixel_dims {
        spec.attributes.set(param("XResolution", (xppu as f32 / 100.0).into()));
        spec.attributes.set(param("YResolution", (yppu as f32 / 100.0).into()));
        spec.attributes.set(param("ResolutionUnit", "cm".into()));
    }
}

/// Adds the same attributes to what is written.
fn set_colors(info: &mut png::Info<'_>, attributes: &Params) {
    info.source_gamma = attributes.float(GAMMA).filter(|v| *v > 0.0).map(png::ScaledFloat::new);
    if let Some([wx, wy, rx, ry, gx, gy, bx, by]) = attributes.floats(CHROMATICITIES).as_deref() {
        info.source_chromaticities =
            Some(png::SourceChromaticities::new((*wx, *wy), (*rx, *ry), (*gx, *gy), (*bx, *by)));
    }
    info.srgb = match attributes.int(SRGB) {
        Some(0) => Some(png::SrgbRenderingIntent::Perceptual),
        Some(1) => Some(png::SrgbRenderingIntent::RelativeColorimetric),
        Some(2) => Some(png::SrgbRenderingIntent::Saturation),
        Some(3) => Some(png::SrgbRenderingIntent::AbsoluteColorimetric),
        _ => None,
    };
    let per_meter = match attributes.string("ResolutionUnit").map(|s| &**s) {
        Some("cm") => 100.0,
        Some("in" | "inch") => 100.0 / 2.54,
        _ => return,
    };
    let pixels = |name| attributes.float(name).map(|v| v * per_meter).filter(|v| *v >= 1.0 && *v < 2e9);
    if let (Some(x), Some(y)) = (pixels("XResolution"), pixels("YResolution")) {
        let (xppu, yppu) = (x.round() as u32, y.round() as u32);
        info.pixel_dims = Some(png::PixelDimensions { xppu, yppu, unit: png::Unit::Meter });
    }
}

/// Returns the name of the colour profile, which precedes the pixels, and the profile, unless it is damaged or long.
fn profile(place: &Place) -> Result<Option<(String, Option<Vec<u8>>)>> {
    let mut file = place.source()?;
    let mut skip = 8;
    for _ in 0..MOST_TEXTS {
        let mut head = [0; 8];
        let read = file.seek_relative(skip).and_then(|()| file.read_exact(&mut head));
        let [a, b, c, d, kind @ ..] = head;
        if read.is_err() || kind == *b"IDAT" {
            return Ok(None);
        }
        if kind == *b"iCCP" {
            let len = u64::from(u32::from_be_bytes([a, b, c, d]));
            let mut content = Vec::new();
            file.take(len.min(LONGEST_PROFILE)).read_to_end(&mut content).map_err(|e| place.io(e))?;
            // A name of up to 79 Latin characters ends with a NUL. The number of the compression follows.
            let end = content.iter().take(79).position(|b| *b == 0).unwrap_or(79.min(content.len()));
            let name: String = content[..end].iter().map(|b| char::from(*b)).collect();
            let packed = content.get(end + 2..).unwrap_or_default();
            let mut profile = Vec::new();
            let read = flate2::read::ZlibDecoder::new(packed).take(LONGEST_PROFILE).read_to_end(&mut profile);
            let whole = read.is_ok() && (profile.len() as u64) < LONGEST_PROFILE && !profile.is_empty();
            return Ok(Some((name, whole.then_some(profile))));
        }
        // The checksum follows the content.
        skip = i64::from(u32::from_be_bytes([a, b, c, d])) + 4;
    }
    Ok(None)
}

fn decode(place: &Place, spec: &ImageSpec) -> Result<Decoded> {
    let mut reader = reader(place)?;
    let wanted = spec.bytes().unwrap_or(u64::MAX);
    let size = reader.output_buffer_size().filter(|s| *s as u64 == wanted);
    let size = size.ok_or_else(|| place.malformed("the file changed while it was read"))?;
    let mut bytes = vec![0; size];
    reader.next_frame(&mut bytes).map_err(|e| fault(place, e))?;
    Ok(Decoded::whole(Pixels::from_bytes(spec.pixel_type, bytes, true)))
}

fn encode(spec: &ImageSpec, mut pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let n = spec.nchannels();
    let (color, alpha) = match n {
        1 => (ColorType::Grayscale, false),
        2 => (ColorType::GrayscaleAlpha, true),
        3 => (ColorType::Rgb, false),
        _ => (ColorType::Rgba, true),
    };
    if alpha && spec.attributes.int("unassociatedalpha").unwrap_or(0) == 0 {
        divide_by_alpha(&mut pixels, n);
    }
    let bytes = match pixels {
        Pixels::U8(v) => v,
        Pixels::U16(v) => v.iter().flat_map(|v| v.to_be_bytes()).collect(),
        // `create` refuses other types.
        other => other.to_floats().iter().map(|v| (v * 255.0).round() as u8).collect(),
    };
    let path = file.path().to_owned();
    let fault = |error: EncodingError| match error {
        EncodingError::IoError(source) => ImageError::Io { path: path.clone(), source },
        other => ImageError::Unsupported { path: path.clone(), what: other.to_string() },
    };
    let mut info = png::Info::with_size(spec.width, spec.height);
    info.icc_profile = spec.icc_profile.as_deref().map(Cow::Borrowed);
    // What has texts of its own is not stored twice.
    info.exif_metadata = exif::write(&spec.attributes, &TEXTS.map(|(_, name)| name)).map(Cow::Owned);
    set_colors(&mut info, &spec.attributes);
    let mut encoder = png::Encoder::with_info(file, info).map_err(fault)?;
    encoder.set_color(color);
    encoder.set_depth(if spec.pixel_type == PixelType::U16 { BitDepth::Sixteen } else { BitDepth::Eight });
    encoder.set_compression(match spec.string("compression") {
        Some("none") => png::Compression::NoCompression,
        Some("fast") => png::Compression::Fast,
        _ => png::Compression::Balanced,
    });
    let given = |name: &str| {
        let param = spec.attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name))?;
        spec.string(&param.name)
    };
    let known = TEXTS.iter().filter_map(|(keyword, name)| Some((*keyword, given(name)?)));
    let others = spec.attributes.iter().filter_map(|p| Some((keyword(&p.name)?, spec.string(&p.name)?)));
    for (keyword, text) in known.chain(others) {
        let text = text.replace('\0', " ");
        // Plain chunks can store only Latin-1.
        if text.chars().all(|c| u32::from(c) < 256) {
            encoder.add_text_chunk(keyword.to_owned(), text).map_err(fault)?;
        } else {
            encoder.add_itxt_chunk(keyword.to_owned(), text).map_err(fault)?;
        }
    }
    if let Some(xmp) = spec.string("XMP") {
        encoder.add_itxt_chunk(XMP_KEYWORD.to_owned(), xmp.replace('\0', " ")).map_err(fault)?;
    }
    let mut writer = encoder.write_header().map_err(fault)?;
    writer.write_image_data(&bytes).map_err(fault)?;
    writer.finish().map_err(fault)
}
