//! The formats that the `image` crate reads and writes, with one row of a table for each.

use crate::fields::param;
use crate::jpeg::{self, Ending};
use crate::segments;
use crate::turn::Turn;
use crate::whole::{Decoded, Place, WholeInput, WholeOutput, divide_by_alpha};
use granita_image::metadata::{exif, iptc};
use granita_image::{
    AtomicFile, CreateOptions, FileSource, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits,
    PixelType, Pixels, Result, contained,
};
use image::{ColorType, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// One of the plain image formats (see [`FORMATS`]).
#[derive(Clone, Copy, Debug)]
pub struct PlainFormat {
    name: &'static str,
    aliases: &'static [&'static str],
    extensions: &'static [&'static str],
    /// The signatures at the beginning of files. It is empty for a format without a signature.
    magic: &'static [&'static [u8]],
    /// The name in errors.
    title: &'static str,
    image: ImageFormat,
    /// The types that can be written, the preferred one first. It is empty when the format is only read.
    types: &'static [PixelType],
    /// The numbers of channels that are stored as they are.
    channels: &'static [usize],
    /// True when 2 and 4 channels are written as 1 and 3, without their alpha (reference 7.4.5).
    drops_alpha: bool,
    encode: crate::whole::Encode,
}

const BYTES: &[PixelType] = &[PixelType::U8];

/// All plain formats. Formats without a signature come last.
pub const FORMATS: [PlainFormat; 9] = [
    PlainFormat {
        name: "jpeg",
        aliases: &["jpg"],
        extensions: &["jpg", "jpeg", "jpe"],
        magic: &[b"\xff\xd8\xff"],
        title: "JPEG",
        image: ImageFormat::Jpeg,
        types: BYTES,
        channels: &[1, 3],
        drops_alpha: true,
        encode: encode_jpeg,
    },
    PlainFormat {
        name: "bmp",
        aliases: &[],
        extensions: &["bmp"],
        magic: &[b"BM"],
        title: "BMP",
        image: ImageFormat::Bmp,
        types: BYTES,
        channels: &[1, 3, 4],
        drops_alpha: true,
        encode: |spec, pixels, file| encode_bytes(spec, pixels, file, ImageFormat::Bmp),
    },
    PlainFormat {
        name: "pnm",
        aliases: &["ppm", "pgm"],
        extensions: &["pnm", "ppm", "pgm", "pbm", "pam"],
        magic: &[b"P1", b"P2", b"P3", b"P4", b"P5", b"P6", b"P7"],
        title: "PNM",
        image: ImageFormat::Pnm,
        types: &[PixelType::U8, PixelType::U16],
        channels: &[1, 2, 3, 4],
        drops_alpha: false,
        encode: encode_pnm,
    },
    PlainFormat {
        name: "hdr",
        aliases: &["radiance"],
        extensions: &["hdr", "rgbe", "pic"],
        magic: &[b"#?RADIANCE", b"#?RGBE"],
        title: "Radiance HDR",
        image: ImageFormat::Hdr,
        types: &[PixelType::Float],
        channels: &[3],
        drops_alpha: true,
        encode: encode_hdr,
    },
    PlainFormat {
        name: "gif",
        aliases: &[],
        extensions: &["gif"],
        magic: &[b"GIF87a", b"GIF89a"],
        title: "GIF",
        image: ImageFormat::Gif,
        types: &[],
        channels: &[],
        drops_alpha: false,
        encode: |spec, pixels, file| encode_bytes(spec, pixels, file, ImageFormat::Gif),
    },
    PlainFormat {
        name: "ico",
        aliases: &[],
        extensions: &["ico"],
        magic: &[b"\0\0\x01\0"],
        title: "ICO",
        image: ImageFormat::Ico,
        types: &[],
        channels: &[],
        drops_alpha: false,
        encode: |spec, pixels, file| encode_bytes(spec, pixels, file, ImageFormat::Ico),
    },
    PlainFormat {
        name: "qoi",
        aliases: &[],
        extensions: &["qoi"],
        magic: &[b"qoif"],
        title: "QOI",
        image: ImageFormat::Qoi,
        types: BYTES,
        channels: &[3, 4],
        drops_alpha: false,
        encode: |spec, pixels, file| encode_bytes(spec, pixels, file, ImageFormat::Qoi),
    },
    PlainFormat {
        name: "webp",
        aliases: &[],
        extensions: &["webp"],
        magic: &[],
        title: "WebP",
        image: ImageFormat::WebP,
        types: BYTES,
        channels: &[3, 4],
        drops_alpha: false,
        encode: encode_webp,
    },
    PlainFormat {
        name: "tga",
        aliases: &["targa"],
        extensions: &["tga", "targa", "vda", "icb", "vst"],
        magic: &[],
        title: "Targa",
        image: ImageFormat::Tga,
        types: BYTES,
        channels: &[1, 3, 4],
        drops_alpha: true,
        encode: |spec, pixels, file| encode_bytes(spec, pixels, file, ImageFormat::Tga),
    },
];

impl Format for PlainFormat {
    fn name(&self) -> &'static str {
        self.name
    }

    fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }

    fn extensions(&self) -> &'static [&'static str] {
        self.extensions
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        match self.image {
            // The entry of the first image follows, in which a byte is reserved.
            ImageFormat::Ico => {
                head.starts_with(self.magic[0]) && matches!(head.get(4..10), Some([n, 0, .., 0]) if *n > 0)
            }
            ImageFormat::WebP => head.starts_with(b"RIFF") && head.get(8..12) == Some(b"WEBP"),
            ImageFormat::Pnm => {
                self.magic.iter().any(|m| head.starts_with(m))
                    && head.get(2).is_some_and(u8::is_ascii_whitespace)
            }
            _ => self.magic.iter().any(|m| head.starts_with(m)),
        }
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        if self.image == ImageFormat::Pnm
            && let Some(input) = crate::pnm::open(FileSource::open(path, "PNM", &limits.files)?, limits)?
        {
            return Ok(input);
        }
        self.open_place(Place::new(path, self.title, limits))
    }

    fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        self.open_place(Place::new(path, self.title, limits).with_bytes(bytes))
    }

    fn supports(&self, feature: &str) -> bool {
        match feature {
            "write" => !self.types.is_empty(),
            "u16" => self.types.contains(&PixelType::U16),
            "float" => self.types.contains(&PixelType::Float),
            "alpha" => self.channels.contains(&4),
            _ => false,
        }
    }

    fn output_type(&self, quantized: PixelType) -> PixelType {
        match self.types {
            [only] => *only,
            _ if quantized == PixelType::U8 => PixelType::U8,
            _ => PixelType::U16,
        }
    }

    fn leaves_out(&self, path: &Path, channels: usize) -> Option<String> {
        let ending = path.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
        (self.image == ImageFormat::Pnm && is_without_alpha(path, channels)).then(|| {
            format!("programs that read .{ending} files expect no alpha: it is left out; .pam keeps it")
        })
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let n = spec.nchannels();
        let drops_alpha = self.drops_alpha && matches!(n, 2 | 4) && self.channels.contains(&(n - 1));
        let fault = if self.types.is_empty() {
            format!("{} is not written", self.title)
        } else if !self.types.contains(&spec.pixel_type) {
            format!("{} does not hold {:?} values", self.title, spec.pixel_type)
        } else if !(self.channels.contains(&n) || drops_alpha) {
            format!("{} does not hold {n} channels", self.title)
        } else {
            return Ok(Box::new(WholeOutput::create(path, options, self.encode)?));
        };
        Err(ImageError::Unsupported { path: path.to_owned(), what: fault })
    }
}

impl PlainFormat {
    fn open_place(&self, place: Place) -> Result<Box<dyn ImageInput>> {
        if self.image == ImageFormat::Ico
            && let Some(inner) = crate::ico::png(&place)?
        {
            return crate::png::open(self.name, inner);
        }
        let mut decoder = decoder(&place, self.image)?;
        let (width, height) = turn(&mut decoder).size(decoder.dimensions());
        let (channels, pixel_type) = match decoder.color_type() {
            ColorType::L8 => (1, PixelType::U8),
            ColorType::La8 => (2, PixelType::U8),
            ColorType::Rgb8 => (3, PixelType::U8),
            ColorType::Rgba8 => (4, PixelType::U8),
            ColorType::L16 => (1, PixelType::U16),
            ColorType::La16 => (2, PixelType::U16),
            ColorType::Rgb16 => (3, PixelType::U16),
            ColorType::Rgba16 => (4, PixelType::U16),
            ColorType::Rgb32F => (3, PixelType::Float),
            ColorType::Rgba32F => (4, PixelType::Float),
            other => return Err(place.unsupported(format!("{} of {other:?} is not supported", self.title))),
        };
        let mut spec = ImageSpec::new(width, height, channels, pixel_type);
        describe(&mut decoder, &mut spec);
        drop(decoder);
        if straight(self.image) && spec.alpha_channel().is_some() {
            spec.attributes.set(param("unassociatedalpha", 1.into()));
        }
        Ok(Box::new(WholeInput::new(self.name, place, spec, decode, most_packed(self.image, width))?))
    }
}

/// Returns the largest number of bytes of pixels that one byte of a file can represent, with a margin for files that
/// end early and have fewer bytes.
fn most_packed(format: ImageFormat, width: u32) -> u64 {
    /// A file that ends early must have at least a sixteenth of its data.
    const SPARE: u64 = 16;
    SPARE
        * match format {
            // A byte of a bitmap has eight pixels.
            ImageFormat::Pnm => 8,
            // A run of 255 pixels takes two bytes.
            ImageFormat::Bmp => 384,
            // A run of 128 pixels takes two bytes, from a palette.
            ImageFormat::Tga => 256,
            // A run of 62 pixels takes one byte.
            ImageFormat::Qoi => 248,
            // A row of runs takes at least eight bytes.
            ImageFormat::Hdr => 2 * u64::from(width.max(1)),
            // Strings of up to 3838 pixels take 12 bits. Each is longer by one than the string before.
            ImageFormat::Gif => 8192,
            // A block of the greys of 64 pixels takes at least one bit. Each of its colours may cover four by four
            // pixels.
            ImageFormat::Jpeg => 2048,
            // An image of one colour has no bytes of pixels at all. A side has at most 16384 pixels.
            _ => u64::from(u32::MAX),
        }
}

/// True when colours are by definition not multiplied by alpha. For Targa and BMP files this is not defined.
fn straight(format: ImageFormat) -> bool {
    matches!(format, ImageFormat::WebP | ImageFormat::Qoi | ImageFormat::Gif | ImageFormat::Ico)
}

/// Returns the turn that makes the pixels of a file upright, from its Exif data. Without useful data the image is not
/// turned.
fn turn(decoder: &mut impl ImageDecoder) -> Turn {
    let found = contained(|| decoder.orientation()).ok().and_then(std::result::Result::ok);
    Turn::of_exif(found.map_or(1, image::metadata::Orientation::to_exif))
}

/// Adds what the file has besides its pixels: its profile, and the attributes of Exif, IPTC and XMP. The orientation is
/// left out, because the pixels are turned.
fn describe(decoder: &mut impl ImageDecoder, spec: &mut ImageSpec) {
    /// The number of bytes of the longest text that is kept.
    const LONGEST: usize = 1 << 20;
    // Damaged metadata is left out.
    let found = |data: std::result::Result<image::ImageResult<Option<Vec<u8>>>, String>| data.ok()?.ok()?;
    if let Some(icc) = found(contained(|| decoder.icc_profile())) {
        spec.set_icc_profile(icc);
    }
    if let Some(data) = found(contained(|| decoder.exif_metadata())) {
        exif::read(&data, &mut spec.attributes);
        spec.attributes.0.retain(|p| &*p.name != "orientation");
    }
    if let Some(data) = found(contained(|| decoder.iptc_metadata())) {
        iptc::read(iptc::of_resources(&data).unwrap_or(&data), &mut spec.attributes);
    }
    if let Some(xmp) = found(contained(|| decoder.xmp_metadata())).filter(|xmp| xmp.len() <= LONGEST) {
        let text = String::from_utf8_lossy(&xmp);
        spec.attributes.set(param("XMP", text.trim_end_matches('\0').into()));
    }
}

fn decoder(place: &Place, format: ImageFormat) -> Result<impl ImageDecoder> {
    let mut reader = image::ImageReader::with_format(place.source()?, format);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(place.limits.dimension);
    limits.max_image_height = Some(place.limits.dimension);
    limits.max_alloc = Some(place.limits.bytes);
    reader.limits(limits);
    contained(|| reader.into_decoder())
        .map_err(|fault| place.malformed(fault))?
        .map_err(|e| read_fault(place, e))
}

fn decode(place: &Place, spec: &ImageSpec) -> Result<Decoded> {
    // This is a plain function, so the row of the table is found again by its title.
    let format = FORMATS.iter().find(|f| f.title == place.format).map_or(ImageFormat::Tga, |f| f.image);
    let bytes = spec.bytes().unwrap_or(u64::MAX) as usize;
    if format == ImageFormat::Gif {
        crate::gif::check_first_image(place, most_packed(format, spec.width))?;
    }
    let part = match format {
        ImageFormat::Jpeg => decode_jpeg(place, bytes)?,
        ImageFormat::Hdr => decode_hdr(place, bytes)?,
        _ => Part { bytes: decode_into(place, format, vec![0; bytes])?, rest: None },
    };
    let turn = turn(&mut decoder(place, format)?);
    // The size as it is stored.
    let (width, height) = turn.size((spec.width, spec.height));
    let row = (bytes / height as usize).max(1);
    let missing = match part.rest {
        None => None,
        Some(Rest { there, .. }) if there < row => {
            return Err(place.malformed("the file ends before the first row of pixels is complete"));
        }
        Some(Rest { passes: true, .. }) => {
            let what = "the file ends early: passes that make all of it finer are missing";
            Some((spec.height - 1, what.to_owned()))
        }
        Some(Rest { there, .. }) => {
            let rows = (there / row) as u32;
            // When the image is turned, rows missing at the end of the file are missing in every row, or at the start.
            let known = if turn.keeps_rows() { rows } else { 0 };
            Some((known, format!("the file ends early: {rows} of {height} rows are there")))
        }
    };
    // The decoders return values in the byte order of the machine.
    let pixels = Pixels::from_bytes(spec.pixel_type, part.bytes, cfg!(target_endian = "big"));
    Ok(Decoded { pixels: turn.apply(pixels, (width as usize, height as usize), spec.nchannels()), missing })
}

/// The bytes of pixels, of which some may be missing.
struct Part {
    bytes: Vec<u8>,
    rest: Option<Rest>,
}

/// The missing part.
struct Rest {
    /// The number of available bytes of pixels, from the first on.
    there: usize,
    /// True when later passes, which concern all rows, may be missing.
    passes: bool,
}

/// Decodes all pixels into the bytes of `out`.
fn decode_into(place: &Place, format: ImageFormat, mut out: Vec<u8>) -> Result<Vec<u8>> {
    decode_some(place, format, &mut out)?;
    Ok(out)
}

/// Does the same as [`decode_into`]. On failure, the pixels that were decoded before it are kept.
fn decode_some(place: &Place, format: ImageFormat, out: &mut [u8]) -> Result<()> {
    let decoder = decoder(place, format)?;
    if decoder.total_bytes() != out.len() as u64 {
        return Err(place.malformed("the file changed while it was read"));
    }
    contained(|| decoder.read_image(out))
        .map_err(|fault| place.malformed(fault))?
        .map_err(|e| read_fault(place, e))
}

fn decode_jpeg(place: &Place, bytes: usize) -> Result<Part> {
    let mut file = place.read_all()?;
    let passes = match jpeg::ending(&file) {
        Ending::Marked => {
            let bytes = decode_into(&place.holding(file), ImageFormat::Jpeg, vec![0; bytes])?;
            return Ok(Part { bytes, rest: None });
        }
        Ending::Open { progressive } => progressive,
    };
    jpeg::without_half_a_mark(&mut file);
    let noisy = [false, true].map(|opposite| {
        let mut out: Vec<u8> = jpeg::noise().take(bytes).collect();
        // The decoder may refuse the data after the image.
        let _ = decode_some(&place.holding(jpeg::with_noise(&file, opposite)), ImageFormat::Jpeg, &mut out);
        out
    });
    let mut bytes = vec![0; bytes];
    let whole = decode_some(&place.holding(file), ImageFormat::Jpeg, &mut bytes);
    let same = |other: &Vec<u8>| bytes.iter().zip(other).position(|(a, b)| a != b).unwrap_or(bytes.len());
    let there = noisy.iter().map(same).min().unwrap_or(0);
    // The pixels decoded before the failure are kept.
    whole.or_else(|error| if there > 0 && there < bytes.len() { Ok(()) } else { Err(error) })?;
    let rest = (passes || there < bytes.len()).then_some(Rest { there, passes });
    Ok(Part { bytes, rest })
}

fn decode_hdr(place: &Place, bytes: usize) -> Result<Part> {
    // Values of this format are finite, and these bytes are NaN. So they mark the pixels that have not been decoded.
    const NOTHING: u8 = 0xff;
    let mut out = vec![NOTHING; bytes];
    let Err(error) = decode_some(place, ImageFormat::Hdr, &mut out) else {
        return Ok(Part { bytes: out, rest: None });
    };
    let there = 4 * out.as_chunks::<4>().0.iter().take_while(|v| **v != [NOTHING; 4]).count();
    if there == 0 || place.io(std::io::ErrorKind::UnexpectedEof.into()).to_string() != error.to_string() {
        return Err(error);
    }
    Ok(Part { bytes: out, rest: Some(Rest { there, passes: false }) })
}

fn read_fault(place: &Place, error: image::ImageError) -> ImageError {
    match error {
        image::ImageError::IoError(e) => place.io(e),
        image::ImageError::Unsupported(e) => place.unsupported(e.to_string()),
        image::ImageError::Limits(e) => place.unsupported(format!("{}: {e}", place.format)),
        // Some messages of the decoder of JPEG end with a line end that was escaped.
        other => place.malformed(other.to_string().trim_end_matches("\\n")),
    }
}

fn write_fault(file: &Path, error: image::ImageError) -> ImageError {
    match error {
        image::ImageError::IoError(source) => ImageError::Io { path: file.to_owned(), source },
        other => ImageError::Unsupported { path: file.to_owned(), what: other.to_string() },
    }
}

/// Returns the pixels without alpha, and the number of remaining channels.
fn without_alpha(pixels: &Pixels, n: usize) -> (Pixels, usize) {
    let left = n - 1;
    let mut out = Pixels::zeros(pixels.pixel_type(), pixels.len() / n * left);
    for c in 0..left {
        out.set_plane(c, left, &pixels.plane(c, n));
    }
    (out, left)
}

/// Returns the color type of `n` channels.
fn color(n: usize, pixel_type: PixelType) -> ExtendedColorType {
    match (n, pixel_type) {
        (1, PixelType::U16) => ExtendedColorType::L16,
        (2, PixelType::U16) => ExtendedColorType::La16,
        (3, PixelType::U16) => ExtendedColorType::Rgb16,
        (_, PixelType::U16) => ExtendedColorType::Rgba16,
        (1, _) => ExtendedColorType::L8,
        (2, _) => ExtendedColorType::La8,
        (3, _) => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    }
}

/// Returns the values in the byte order of the machine, as the encoders need them.
fn native_bytes(pixels: Pixels) -> Vec<u8> {
    match pixels {
        Pixels::U8(v) => v,
        Pixels::U16(v) => v.iter().flat_map(|v| v.to_ne_bytes()).collect(),
        other => other.to_floats().iter().flat_map(|v| v.to_ne_bytes()).collect(),
    }
}

fn encode_bytes(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile, format: ImageFormat) -> Result<()> {
    let mut n = spec.nchannels();
    let mut pixels = pixels;
    if n == 2 {
        (pixels, n) = without_alpha(&pixels, n);
    }
    if n == 4 && straight(format) && spec.attributes.int("unassociatedalpha").unwrap_or(0) == 0 {
        divide_by_alpha(&mut pixels, n);
    }
    let bytes = native_bytes(pixels);
    let path = file.path().to_owned();
    image::write_buffer_with_format(file, &bytes, spec.width, spec.height, color(n, spec.pixel_type), format)
        .map_err(|e| write_fault(&path, e))
}

fn encode_jpeg(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let n = spec.nchannels();
    let (pixels, n) = if matches!(n, 2 | 4) { without_alpha(&pixels, n) } else { (pixels, n) };
    let quality = spec.attributes.int("quality").unwrap_or(98).clamp(1, 100) as u8;
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality)
        .write_image(&native_bytes(pixels), spec.width, spec.height, color(n, PixelType::U8))
        .map_err(|e| write_fault(file.path(), e))?;
    file.write_all(&segments::with_metadata(&bytes, spec)).map_err(|e| file.io_error(e).into())
}

fn encode_webp(spec: &ImageSpec, mut pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let alpha = spec.nchannels() == 4;
    if alpha && spec.attributes.int("unassociatedalpha").unwrap_or(0) == 0 {
        divide_by_alpha(&mut pixels, 4);
    }
    let path = file.path().to_owned();
    let mut encoder = image_webp::WebPEncoder::new(file);
    if let Some(profile) = &spec.icc_profile {
        encoder.set_icc_profile(profile.to_vec());
    }
    if let Some(data) = exif::write(&spec.attributes, &[]) {
        encoder.set_exif_metadata(data);
    }
    if let Some(xmp) = spec.string("XMP") {
        encoder.set_xmp_metadata(xmp.as_bytes().to_vec());
    }
    let colors = if alpha { image_webp::ColorType::Rgba8 } else { image_webp::ColorType::Rgb8 };
    encoder.encode(&native_bytes(pixels), spec.width, spec.height, colors).map_err(|error| match error {
        image_webp::EncodingError::IoError(source) => ImageError::Io { path, source },
        other => ImageError::Unsupported { path, what: other.to_string() },
    })
}

/// True when a PNM file of this name cannot hold the alpha of its `n` channels. Programs expect P5 or P6 for the old
/// extensions, and cannot read the P7 of files with alpha.
fn is_without_alpha(path: &Path, n: usize) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    matches!(n, 2 | 4) && ending.is_some_and(|e| matches!(&*e, "ppm" | "pgm"))
}

/// Encodes binary PGM, PPM, and PAM for alpha. 16-bit values have the most significant byte first.
fn encode_pnm(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let (w, h, n) = (spec.width, spec.height, spec.nchannels());
    let (pixels, n) = if is_without_alpha(file.path(), n) { without_alpha(&pixels, n) } else { (pixels, n) };
    let max = if spec.pixel_type == PixelType::U16 { 65535 } else { 255 };
    let header = match n {
        1 => format!("P5\n{w} {h}\n{max}\n"),
        3 => format!("P6\n{w} {h}\n{max}\n"),
        _ => {
            let kind = if n == 2 { "GRAYSCALE_ALPHA" } else { "RGB_ALPHA" };
            format!("P7\nWIDTH {w}\nHEIGHT {h}\nDEPTH {n}\nMAXVAL {max}\nTUPLTYPE {kind}\nENDHDR\n")
        }
    };
    let bytes = match pixels {
        Pixels::U16(v) => v.iter().flat_map(|v| v.to_be_bytes()).collect(),
        other => native_bytes(other),
    };
    let written = file.write_all(header.as_bytes()).and_then(|()| file.write_all(&bytes));
    written.map_err(|e| file.io_error(e).into())
}

fn encode_hdr(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let n = spec.nchannels();
    let floats = pixels.to_floats();
    // RGBE cannot store negative numbers, NaN, or numbers from 2^127 on.
    let channel = |p: &[f32], c: usize| if p[c] > 0.0 { p[c].min(1e38) } else { 0.0 };
    let rgb: Vec<_> =
        floats.chunks_exact(n).map(|p| image::Rgb([channel(p, 0), channel(p, 1), channel(p, 2)])).collect();
    let path = file.path().to_owned();
    image::codecs::hdr::HdrEncoder::new(file)
        .encode(&rgb, spec.width as usize, spec.height as usize)
        .map_err(|e| write_fault(&path, e))
}
