//! JPEG XL, read by the `jxl-oxide` crate and written without loss by `zune-jpegxl`.

use crate::boxes;
use crate::fields::param;
use crate::whole::{Decoded, Place, WholeInput, WholeOutput, divide_by_alpha};
use granita_base::Param;
use granita_image::metadata::exif;
use granita_image::{
    AtomicFile, CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType,
    Pixels, Result, contained,
};
use half::f16;
use jxl_oxide::image::BitDepth as JxlDepth;
use jxl_oxide::{AllocTracker, ExtraChannelType, InitializeResult, JxlImage, PixelFormat};
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;
use std::sync::Arc;
use zune_core::bit_depth::BitDepth;
use zune_core::colorspace::ColorSpace;
use zune_core::options::EncoderOptions;

/// The format "jpegxl".
///
/// The first frame is read, upright, with its alpha. Integers of up to 8 and 16 bits keep their precision, others
/// become floats. The colours are those that the file names (the numbers of ITU-T H.273 are `int[4] CICP`), or those of
/// its ICC profile. Written are 8 and, without alpha, 16 bits without loss, at least two pixels wide and high.
#[derive(Clone, Copy, Debug, Default)]
pub struct JpegXlFormat;

/// The beginning of a file in a container. Others begin with the codestream.
const CONTAINER: &[u8] = b"\0\0\0\x0cJXL \r\n\x87\n";

impl Format for JpegXlFormat {
    fn name(&self) -> &'static str {
        "jpegxl"
    }

    fn aliases(&self) -> &'static [&'static str] {
        &["jxl"]
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["jxl"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"\xff\x0a") || head.starts_with(CONTAINER)
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        open(Place::new(path, "JPEG XL", limits))
    }

    fn open_bytes(&self, path: &Path, bytes: Arc<[u8]>, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        open(Place::new(path, "JPEG XL", limits).with_bytes(bytes))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "u16" | "alpha")
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let fault = if !matches!(spec.pixel_type, PixelType::U8 | PixelType::U16) {
            format!("JPEG XL is written with 8 or 16-bit integers, not {:?}", spec.pixel_type)
        } else if !(1..=4).contains(&spec.nchannels()) {
            format!("JPEG XL is written with 1 to 4 channels, not {}", spec.nchannels())
        } else if spec.pixel_type == PixelType::U16 && matches!(spec.nchannels(), 2 | 4) {
            // The encoder declares alpha of 8 bits for any number of bits.
            "JPEG XL with alpha is written with 8 bits, not 16".to_owned()
        } else if spec.width < 2 || spec.height < 2 {
            format!("JPEG XL is written with sides of at least 2, not {} x {}", spec.width, spec.height)
        } else {
            return Ok(Box::new(WholeOutput::create(path, options, encode)?));
        };
        Err(ImageError::Unsupported { path: path.to_owned(), what: fault })
    }
}

fn open(place: Place) -> Result<Box<dyn ImageInput>> {
    let spec = contained(|| read_spec(&place)).map_err(|fault| place.malformed(fault))??;
    // An image of one colour has no bytes of pixels at all.
    Ok(Box::new(WholeInput::new("jpegxl", place, spec, decode, u64::from(u32::MAX))?))
}

/// The error of the decoder.
type Fault = Box<dyn std::error::Error + Send + Sync>;

fn fault(place: &Place, error: Fault) -> ImageError {
    match error.downcast::<io::Error>() {
        Ok(error) => place.io(*error),
        Err(error) => place.malformed(error.to_string()),
    }
}

/// Returns a decoder whose memory is limited.
fn builder(place: &Place) -> jxl_oxide::JxlImageBuilder {
    let bytes = usize::try_from(place.limits.bytes).unwrap_or(usize::MAX);
    JxlImage::builder().alloc_tracker(AllocTracker::with_limit(bytes))
}

/// Reads the header, and no more of the file than that.
fn read_header(place: &Place) -> Result<JxlImage> {
    let mut file = place.source()?;
    let mut decoder = builder(place).build_uninit();
    let mut buffer = vec![0; 4096];
    let mut filled = 0;
    loop {
        let n = file.read(&mut buffer[filled..]).map_err(|e| place.io(e))?;
        if n == 0 {
            return Err(place.io(ErrorKind::UnexpectedEof.into()));
        }
        filled += n;
        let used = decoder.feed_bytes(&buffer[..filled]).map_err(|e| fault(place, e))?;
        buffer.copy_within(used..filled, 0);
        filled -= used;
        match decoder.try_init().map_err(|e| fault(place, e))? {
            InitializeResult::Initialized(image) => return Ok(image),
            InitializeResult::NeedMoreData(more) => decoder = more,
        }
    }
}

fn read_spec(place: &Place) -> Result<ImageSpec> {
    let image = read_header(place)?;
    let metadata = &image.image_header().metadata;
    let channels = match image.pixel_format() {
        format @ (PixelFormat::Cmyk | PixelFormat::Cmyka) => {
            return Err(place.unsupported(format!("JPEG XL of {format:?} is not supported")));
        }
        format => format.channels(),
    };
    let pixel_type = match metadata.bit_depth {
        JxlDepth::IntegerSample { bits_per_sample: 0..=8 } => PixelType::U8,
        JxlDepth::IntegerSample { bits_per_sample: 9..=16 } => PixelType::U16,
        JxlDepth::FloatSample { bits_per_sample: 0..=16, exp_bits: 0..=5 } => PixelType::Half,
        _ => PixelType::Float,
    };
    let mut spec = ImageSpec::new(image.width(), image.height(), channels, pixel_type);
    let associated = metadata.ec_info.iter().find_map(|channel| match channel.ty {
        ExtraChannelType::Alpha { alpha_associated } => Some(alpha_associated),
        _ => None,
    });
    if associated == Some(false) {
        spec.attributes.set(param("unassociatedalpha", 1.into()));
    }
    if let Some(icc) = image.original_icc() {
        spec.set_icc_profile(icc.to_vec());
    } else if let Some(numbers) = image.rendered_cicp()
        && let Ok(numbers) = Param::declared("int[4] CICP", &numbers.map(i32::from)[..])
    {
        spec.attributes.set(numbers);
    }
    boxed_metadata(place, &mut spec)?;
    Ok(spec)
}

/// Adds the attributes of the boxes of a file in a container. The orientation is left out, because the codestream has
/// its own. Boxes that are compressed are left out.
fn boxed_metadata(place: &Place, spec: &mut ImageSpec) -> Result<()> {
    const LONGEST: u64 = 1 << 20;
    let (mut file, found) = boxes::of_file(place)?;
    if found.first().is_none_or(|f| f.kind != *b"JXL ") {
        return Ok(());
    }
    for item in found.iter().filter(|f| matches!(&f.kind, b"Exif" | b"xml ")) {
        let Some(bytes) = boxes::content(&mut file, item, LONGEST) else { continue };
        if item.kind == *b"xml " {
            let text = String::from_utf8_lossy(&bytes);
            spec.attributes.set(param("XMP", text.trim_end_matches('\0').into()));
        } else if let Some((skipped, rest)) = bytes.split_first_chunk() {
            let skipped = u32::from_be_bytes(*skipped) as usize;
            exif::read(rest.get(skipped..).unwrap_or_default(), &mut spec.attributes);
            spec.attributes.0.retain(|p| &*p.name != "orientation");
        }
    }
    Ok(())
}

fn decode(place: &Place, spec: &ImageSpec) -> Result<Decoded> {
    contained(|| decode_frame(place, spec)).map_err(|fault| place.malformed(fault))?
}

fn decode_frame(place: &Place, spec: &ImageSpec) -> Result<Decoded> {
    let image = builder(place).read(place.source()?).map_err(|e| fault(place, e))?;
    if image.num_loaded_keyframes() == 0 {
        return Err(place.io(ErrorKind::UnexpectedEof.into()));
    }
    let frame = image.render_frame(0).map_err(|e| fault(place, e))?;
    let mut stream = frame.stream();
    let size = (stream.width(), stream.height(), stream.channels() as usize);
    if size != (spec.width, spec.height, spec.nchannels()) {
        return Err(
            place.malformed(format!("a frame of {} x {} pixels with {} channels", size.0, size.1, size.2))
        );
    }
    // The size was checked against the limits when the file was opened.
    let n = size.0 as usize * size.1 as usize * size.2;
    let mut pixels = Pixels::zeros(spec.pixel_type, n);
    match &mut pixels {
        Pixels::U8(v) => stream.write_to_buffer(v),
        Pixels::U16(v) => stream.write_to_buffer(v),
        Pixels::Float(v) => stream.write_to_buffer(v),
        Pixels::Half(v) => {
            let mut row = vec![0_f32; size.0 as usize * size.2];
            v.chunks_exact_mut(row.len())
                .map(|out| {
                    let count = stream.write_to_buffer(&mut row);
                    out.iter_mut().zip(&row).for_each(|(out, v)| *out = f16::from_f32(*v));
                    count
                })
                .sum()
        }
        // The header selects no other type.
        Pixels::U32(_) => 0,
    };
    Ok(Decoded::whole(pixels))
}

fn encode(spec: &ImageSpec, mut pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let n = spec.nchannels();
    let (colors, alpha) = match n {
        1 => (ColorSpace::Luma, false),
        2 => (ColorSpace::LumaA, true),
        3 => (ColorSpace::RGB, false),
        _ => (ColorSpace::RGBA, true),
    };
    if alpha && spec.attributes.int("unassociatedalpha").unwrap_or(0) == 0 {
        divide_by_alpha(&mut pixels, n);
    }
    let (bytes, depth) = match pixels {
        Pixels::U16(v) => (v.iter().flat_map(|v| v.to_ne_bytes()).collect(), BitDepth::Sixteen),
        Pixels::U8(v) => (v, BitDepth::Eight),
        // `create` refuses other types.
        _ => (Vec::new(), BitDepth::Eight),
    };
    let options = EncoderOptions::new(spec.width as usize, spec.height as usize, colors, depth);
    let mut out: Vec<u8> = Vec::new();
    let unsupported = |what: String| ImageError::Unsupported { path: file.path().to_owned(), what };
    contained(|| zune_jpegxl::JxlSimpleEncoder::new(&bytes, options).encode(&mut out))
        .map_err(&unsupported)?
        .map_err(|e| unsupported(format!("JPEG XL: {e:?}")))?;
    file.write_all(&in_container(spec, out)).map_err(|e| file.io_error(e).into())
}

/// Returns a codestream in a container with metadata, or the codestream alone where there is none.
fn in_container(spec: &ImageSpec, codestream: Vec<u8>) -> Vec<u8> {
    let (exif, xmp) = (exif::write(&spec.attributes, &[]), spec.string("XMP"));
    if exif.is_none() && xmp.is_none() {
        return codestream;
    }
    let mut file = [CONTAINER, &boxes::written(b"ftyp", b"jxl \0\0\0\0jxl ")].concat();
    // The data begins at once, after 0 bytes.
    file.extend(exif.map(|data| boxes::written(b"Exif", &[&[0; 4][..], &data].concat())).unwrap_or_default());
    file.extend(xmp.map(|text| boxes::written(b"xml ", text.as_bytes())).unwrap_or_default());
    file.extend(boxes::written(b"jxlc", &codestream));
    file
}
