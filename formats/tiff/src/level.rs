//! One directory with the description of its pixels and their storage.

use crate::codec::Compression;
use crate::colors::Colors;
use crate::directory::Directory;
use crate::{fax, strip_file, tags};
use granita_base::{BaseType, Param, ParamData, ParamType};
use granita_image::metadata::{exif, iptc, settings};
use granita_image::{FileSource, ImageSpec, Limits, PixelType, Result};
use std::sync::OnceLock;

/// The offsets and lengths in bytes of the strips or tiles of a level, in order.
#[derive(Debug)]
pub(crate) struct ChunkTable {
    pub(crate) offsets: Vec<u64>,
    pub(crate) counts: Vec<u64>,
}

/// One directory of a file as an image.
#[derive(Debug)]
pub(crate) struct Level {
    pub(crate) spec: ImageSpec,
    pub(crate) compression: Compression,
    /// The predictor: 1, 2 or 3 (see [`crate::codec`]).
    pub(crate) predictor: u64,
    /// True when each channel is stored in its own strips or tiles.
    pub(crate) separate: bool,
    /// True when 0 is white.
    pub(crate) invert: bool,
    /// The number of stored channels. It is 1 for a palette, and 4 for inks.
    pub(crate) samples: usize,
    /// The number of bits of one stored sample: 1, 2, 4, 8 to 16, 32 or 64.
    pub(crate) bits: u64,
    /// The number of the kind of values, where the crate `tiff` decodes them ([`crate::strip_file`]).
    pub(crate) by_crate: Option<u64>,
    /// True when the bits of every byte are stored in reverse order.
    pub(crate) reversed: bool,
    /// The tables that all strips or tiles of JPEG data share.
    pub(crate) jpeg_tables: Option<Vec<u8>>,
    /// True for JPEG data of luminance and colour differences.
    pub(crate) ycc: bool,
    /// The colours of the stored indices, for a palette.
    pub(crate) palette: Option<Vec<[u8; 3]>>,
    /// The conversion of stored colours that are neither grey nor red, green and blue.
    pub(crate) colors: Option<Colors>,
    /// The size of a tile, or of a strip (the last may have fewer rows), in pixels.
    pub(crate) chunk: (u32, u32),
    /// True when the file declares it as a smaller version of another image.
    pub(crate) reduced: bool,
    /// The arrangement of rows of CCITT run lengths and group 3.
    pub(crate) fax: fax::Rows,
    pub(crate) directory: Directory,
    pub(crate) table: OnceLock<ChunkTable>,
}

/// The type of the values of one channel.
#[derive(Clone, Copy)]
struct Sample {
    /// The pixel type after reading.
    pixel_type: PixelType,
    bits: u64,
    /// The number of the kind of values: 1 unsigned, 2 signed, 3 floats.
    format: u64,
}

/// Reads the tags of one directory.
pub(crate) fn understand(source: &FileSource, directory: Directory, limits: &Limits) -> Result<Level> {
    let number = |tag, default| directory.number(source, tag, default);
    let side = |tag, what: &str| -> Result<u32> {
        let n = number(tag, 0)?;
        u32::try_from(n).map_err(|_| source.malformed(format!("{what} is {n}")))
    };
    let (width, height) = (side(tags::IMAGE_WIDTH, "width")?, side(tags::IMAGE_LENGTH, "height")?);
    let samples = number(tags::SAMPLES_PER_PIXEL, 1)?;
    limits.within(source.path(), "number of channels", samples, u64::from(limits.channels))?;

    let compression = Compression::from_code(number(tags::COMPRESSION, 1)?)
        .map_err(|name| source.unsupported(format!("TIFF compression {name} is not supported")))?;
    let photometric = number(tags::PHOTOMETRIC, if samples >= 3 { 2 } else { 1 })?;
    let mut sample = sample_type(source, &directory, samples, photometric)?;
    if matches!(compression, Compression::SgiLog | Compression::SgiLog24) {
        // The bits of the tags are those that a program wanted to have when it wrote the file.
        let three = (photometric, samples) == (32845, 3);
        if !three && ((photometric, samples) != (32844, 1) || compression == Compression::SgiLog24) {
            let (name, colors) = match compression {
                Compression::SgiLog24 => ("sgilog24", "LogLuv"),
                _ => ("sgilog", "LogL and LogLuv"),
            };
            return Err(source.unsupported(format!(
                "TIFF with {name} data of other than {colors} colours is not supported"
            )));
        }
        sample = Sample { pixel_type: PixelType::Float, bits: 32, format: 3 };
    }
    let (pixel_type, bits) = (sample.pixel_type, sample.bits);
    let separate = number(tags::PLANAR_CONFIG, 1)? == 2 && samples > 1;

    let palette = match photometric {
        3 if samples == 1 && bits <= 8 && sample.format == 1 => Some(read_palette(source, &directory, bits)?),
        3 => return Err(source.malformed(format!("colour map with {samples} channels of {bits} bits"))),
        _ => None,
    };
    let ycc = photometric == 6 && compression == Compression::Jpeg;
    let colors = match compression {
        // The strips and tiles are images that describe their colours themselves, and the decoder converts them.
        Compression::Jpeg if ycc => None,
        Compression::WebP | Compression::SgiLog | Compression::SgiLog24 => None,
        _ => Colors::of(source, &directory, photometric, (pixel_type, bits, samples))?,
    };
    let predictor = number(tags::PREDICTOR, 1)?;
    check_combination(source, (compression, predictor), sample, (samples, separate, &colors))?;

    let mut jpeg_tables = None;
    if compression == Compression::Jpeg {
        // Tables have about a kilobyte. Much longer data is not a table.
        jpeg_tables = directory.bytes(source, tags::JPEG_TABLES, 1 << 16)?;
    }

    let mut spec = ImageSpec::new(width, height, 1, pixel_type);
    let shown = colors.as_ref().map_or(samples as usize, |c| c.channels(samples as usize));
    spec.channels = channel_names(source, &directory, (photometric, colors.is_some()), shown)?;
    let tiled = directory.entry(tags::TILE_WIDTH).is_some() || directory.entry(tags::TILE_OFFSETS).is_some();
    let chunk = if tiled {
        let (w, h) = (side(tags::TILE_WIDTH, "tile width")?, side(tags::TILE_LENGTH, "tile height")?);
        if w == 0 || h == 0 {
            return Err(source.malformed(format!("tiles of {w} x {h} pixels")));
        }
        (spec.tile_width, spec.tile_height) = (w, h);
        (w, h)
    } else {
        let rows = number(tags::ROWS_PER_STRIP, u64::from(u32::MAX))?;
        (width, rows.clamp(1, u64::from(height.max(1))) as u32)
    };
    limits.check(source.path(), "TIFF", &spec)?;
    metadata(source, &directory, &mut spec)?;
    if colors.is_some() {
        spec.remove_icc_profile();
    }
    let word = |name: &str, value: &str| Param {
        name: name.into(),
        ty: ParamType::of(BaseType::String),
        data: value.into(),
    };
    spec.attributes.set(word("compression", compression.word()));
    spec.attributes.set(word("planarconfig", if separate { "separate" } else { "contig" }));
    if !tiled {
        let (ty, data) = (ParamType::of(BaseType::Int), ParamData::from(chunk.1 as i32));
        spec.attributes.set(Param { name: "rowsperstrip".into(), ty, data });
    }
    let by_crate = strip_file::type_for(sample.format, bits).is_some() || compression == Compression::Group4;
    Ok(Level {
        spec,
        compression,
        predictor,
        separate,
        invert: photometric == 0,
        samples: samples as usize,
        bits,
        by_crate: by_crate.then_some(sample.format),
        // The order of bits does not apply to JPEG data.
        reversed: compression != Compression::Jpeg && number(tags::FILL_ORDER, 1)? == 2,
        jpeg_tables,
        ycc,
        palette,
        colors,
        chunk,
        reduced: number(tags::NEW_SUBFILE_TYPE, 0)? & 1 == 1,
        fax: match compression {
            Compression::Group3 => {
                fax::Rows::Marked { two_dimensional: number(tags::T4_OPTIONS, 0)? & 1 == 1 }
            }
            _ => fax::Rows::Aligned,
        },
        directory,
        table: OnceLock::new(),
    })
}

/// Returns `Ok` when such values may have this compression, predictor and layout.
fn check_combination(
    source: &FileSource,
    (compression, predictor): (Compression, u64),
    sample: Sample,
    (samples, separate, colors): (u64, bool, &Option<Colors>),
) -> Result<()> {
    let Sample { pixel_type, bits, format } = sample;
    let unsupported = |what: String| Err(source.unsupported(format!("TIFF {what} is not supported")));
    let fits = match predictor {
        1 => true,
        2 => matches!(bits, 8 | 16 | 32 | 64),
        3 => format == 3,
        _ => false,
    };
    if !fits {
        return unsupported(format!("predictor {predictor} on {bits} bits"));
    }
    let name = compression.word();
    match compression {
        Compression::Jpeg | Compression::WebP
            if pixel_type != PixelType::U8 || bits != 8 || predictor != 1 =>
        {
            return unsupported(format!("with {name} data of {bits} bits, predictor {predictor},"));
        }
        Compression::WebP if separate || !matches!(samples, 3 | 4) => {
            return unsupported(format!("with {name} data of other than 3 or 4 channels together"));
        }
        Compression::SgiLog | Compression::SgiLog24 if separate || predictor != 1 => {
            return unsupported(format!("with {name} data in planes or with a predictor"));
        }
        Compression::Group4 | Compression::Group3 | Compression::Runs
            if bits != 1 || samples != 1 || predictor != 1 =>
        {
            return unsupported(format!("with {name} data of {samples} channels of {bits} bits"));
        }
        _ => {}
    }
    match colors {
        Some(Colors::YCbCr(tags)) if tags.block != (1, 1) && (separate || samples != 3 || predictor != 1) => {
            unsupported("in YCbCr colours that share differences, in planes or with a predictor,".to_owned())
        }
        _ => Ok(()),
    }
}

/// Returns the type of values after reading, and the stored one.
fn sample_type(source: &FileSource, directory: &Directory, samples: u64, photometric: u64) -> Result<Sample> {
    let all = |tag| directory.numbers(source, tag, samples);
    let different =
        |what: &str| Err(source.unsupported(format!("TIFF channels of different {what} are not supported")));
    let depths = all(tags::BITS_PER_SAMPLE)?;
    let bits = depths.first().copied().unwrap_or(1);
    if depths.iter().any(|n| *n != bits) {
        return different("bit depths");
    }
    let mut kinds = all(tags::SAMPLE_FORMAT)?;
    if matches!(photometric, 8 | 9) {
        // Some programs declare a* and b* as signed. The photometric kind determines whether they are.
        kinds.clear();
    }
    let kind = kinds.first().copied().unwrap_or(1);
    if kinds.iter().any(|n| *n != kind) {
        return different("types");
    }
    let (format, name) = match kind {
        // Undefined data is read as unsigned, as other programs do.
        1 | 4 => (1, "unsigned integer"),
        2 => (2, "signed integer"),
        3 => (3, "float"),
        _ => (kind, "complex"),
    };
    let pixel_type = match (format, bits) {
        (1, 1 | 2 | 4 | 8) => PixelType::U8,
        (1, 9..=16) => PixelType::U16,
        (1, 32) => PixelType::U32,
        (3, 16) => PixelType::Half,
        (3, 32) => PixelType::Float,
        _ => strip_file::type_for(format, bits).ok_or_else(|| {
            source.unsupported(format!("TIFF of {bits}-bit {name} values is not supported"))
        })?,
    };
    Ok(Sample { pixel_type, bits, format })
}

/// Returns the colours of a palette image, as bytes.
fn read_palette(source: &FileSource, directory: &Directory, bits: u64) -> Result<Vec<[u8; 3]>> {
    let n = 1usize << bits;
    let map = directory.numbers(source, tags::COLOR_MAP, 3 * n as u64)?;
    if map.len() < 3 * n {
        return Err(source.malformed(format!("colour map of {} values, {} needed", map.len(), 3 * n)));
    }
    // Some old programs wrote 8-bit values where 16 bits are required.
    let shift = if map.iter().any(|v| *v > 255) { 8 } else { 0 };
    let byte = |v: u64| (v >> shift) as u8;
    Ok((0..n).map(|i| [byte(map[i]), byte(map[n + i]), byte(map[2 * n + i])]).collect())
}

/// Returns the names of the channels. One further channel beside grey or RGB counts as alpha, whether or not the file
/// declares it. Of several further channels, only the one that is declared as alpha counts.
fn channel_names(
    source: &FileSource,
    directory: &Directory,
    (photometric, converted): (u64, bool),
    samples: usize,
) -> Result<Vec<String>> {
    let colors: &[&str] = match photometric {
        3 => return Ok(ImageSpec::default_channels(3)),
        _ if converted => &["R", "G", "B"],
        5 => &["C", "M", "Y", "K"],
        2 | 6 => &["R", "G", "B"],
        _ if samples >= 3 => &["R", "G", "B"],
        _ => &["Y"],
    };
    let kinds = directory.numbers(source, tags::EXTRA_SAMPLES, samples as u64)?;
    let extras = samples.saturating_sub(colors.len());
    let declared = kinds.iter().position(|k| matches!(k, 1 | 2));
    let alpha = if extras == 1 { Some(0) } else { declared.filter(|_| extras > 0) };
    let mut names: Vec<String> = colors.iter().take(samples).map(|s| (*s).to_owned()).collect();
    for i in names.len()..samples {
        names.push(if alpha == Some(i - colors.len()) { "A".to_owned() } else { format!("channel{i}") });
    }
    if samples == 1 && directory.text(source, tags::TEXTURE_FORMAT)?.is_some_and(|t| t.ends_with("Shadow")) {
        names = vec!["Z".to_owned()];
    }
    Ok(names)
}

/// Reads windows and attributes into `spec`.
fn metadata(source: &FileSource, directory: &Directory, spec: &mut ImageSpec) -> Result<()> {
    for (tag, name) in tags::STRINGS {
        if let Some(text) = directory.text(source, tag)? {
            let ty = ParamType::of(BaseType::String);
            spec.attributes.set(Param { name: name.into(), ty, data: text.as_str().into() });
        }
    }
    settings::take(&mut spec.attributes);
    camera_and_archive(source, directory, spec);
    for (tag, name) in tags::MATRICES {
        let m = directory.floats(source, tag, 16)?;
        if m.len() == 16 {
            let ty = ParamType::of(BaseType::Matrix);
            spec.attributes.set(Param { name: name.into(), ty, data: m[..].into() });
        }
    }
    if let Some(&cot) = directory.floats(source, tags::FOV_COT, 1)?.first() {
        spec.attributes.set(Param {
            name: "fovcot".into(),
            ty: ParamType::of(BaseType::Float),
            data: cot.into(),
        });
    }
    // Kind 2 of a further channel is alpha by which colours are not multiplied.
    let kinds = directory.numbers(source, tags::EXTRA_SAMPLES, spec.nchannels() as u64)?;
    if spec.alpha_channel().is_some() && kinds.iter().find(|k| matches!(k, 1 | 2)) == Some(&2) {
        let (ty, data) = (ParamType::of(BaseType::Int), 1.into());
        spec.attributes.set(Param { name: "unassociatedalpha".into(), ty, data });
    }
    let orientation = directory.number(source, tags::ORIENTATION, 1)?;
    if orientation != 1 {
        let (ty, data) = (ParamType::of(BaseType::Int), ParamData::from(orientation as i32));
        spec.attributes.set(Param { name: "orientation".into(), ty, data });
    }
    let full = |tag| -> Result<Option<u32>> {
        Ok(u32::try_from(directory.number(source, tag, 0)?).ok().filter(|n| *n > 0))
    };
    let (full_width, full_height) = (full(tags::FULL_WIDTH)?, full(tags::FULL_LENGTH)?);
    spec.full_width = full_width.unwrap_or(spec.width);
    spec.full_height = full_height.unwrap_or(spec.height);
    // A position without a full size is the position that a scanner or a page layout gave the image. It is not a
    // crop.
    if full_width.is_some() && full_height.is_some() {
        let place = |position, resolution| -> Result<i32> {
            let p = directory.floats(source, position, 1)?.first().copied().unwrap_or(0.0);
            let r = directory.floats(source, resolution, 1)?.first().copied().unwrap_or(1.0);
            Ok((p * r).round() as i32)
        };
        spec.x = place(tags::X_POSITION, tags::X_RESOLUTION)?;
        spec.y = place(tags::Y_POSITION, tags::Y_RESOLUTION)?;
    }
    Ok(())
}

/// Reads Exif, IPTC, the profile and the resolution into `spec`. What is damaged is left out.
fn camera_and_archive(source: &FileSource, directory: &Directory, spec: &mut ImageSpec) {
    // Much longer data is not a profile.
    const LONGEST: u64 = 1 << 24;
    if let Some(profile) = directory.bytes(source, tags::ICC_PROFILE, LONGEST).ok().flatten() {
        spec.set_icc_profile(profile);
    }
    for (tag, part) in [(tags::EXIF_IFD, exif::Part::Camera), (tags::GPS_IFD, exif::Part::Position)] {
        if let Some(offset) = directory.number(source, tag, 0).ok().filter(|offset| *offset > 0) {
            let fetch = |at, len| source.read_vec(at, len, "metadata").ok();
            exif::read_directory(&directory.metadata_source(&fetch), offset, part, &mut spec.attributes);
        }
    }
    if let Some(data) = directory.bytes(source, tags::IPTC, LONGEST).ok().flatten() {
        iptc::read(&data, &mut spec.attributes);
    }
    let float = |tag| directory.floats(source, tag, 1).ok()?.first().copied().filter(|v| v.is_finite());
    let unit = directory.number(source, tags::RESOLUTION_UNIT, 2).unwrap_or(2);
    let (Some(x), Some(y)) = (float(tags::X_RESOLUTION), float(tags::Y_RESOLUTION)) else { return };
    let unit = match unit {
        // Square pixels without a size say nothing.
        1 if (x, y) == (1.0, 1.0) => return,
        1 => "none",
        3 => "cm",
        _ => "in",
    };
    for (name, data) in
        [("XResolution", x.into()), ("YResolution", y.into()), ("ResolutionUnit", unit.into())]
    {
        let ty = ParamType::of(if name == "ResolutionUnit" { BaseType::String } else { BaseType::Float });
        spec.attributes.set(Param { name: name.into(), ty, data });
    }
}

impl Level {
    /// Returns the number of strips or tiles across and down one plane.
    pub(crate) fn chunks(&self) -> (u32, u32) {
        (self.spec.width.div_ceil(self.chunk.0), self.spec.height.div_ceil(self.chunk.1))
    }

    /// True when `next` is the MIP level that follows this one (`first` is level 0). It has the same kind of pixels. It
    /// has half the size or, in a texture file, is not larger (reference 9.2.1, 9.2.7), because mosaics of small faces
    /// are padded.
    pub(crate) fn is_followed_by(&self, next: &Self, first: &Self) -> bool {
        let halves = |a: u32, b: u32| b == (a / 2).max(1) || b == a.div_ceil(2);
        let (a, b) = (&self.spec, &next.spec);
        let alike = a.channels == b.channels
            && a.pixel_type == b.pixel_type
            && a.is_tiled() == b.is_tiled()
            && b.width <= a.width
            && b.height <= a.height;
        let texture = first.spec.string("textureformat").is_some();
        let smaller = halves(a.width, b.width) && halves(a.height, b.height);
        alike && (texture || smaller && (a.is_tiled() || next.reduced))
    }

    /// Returns the offsets of the strips or tiles, which are read from the file at the first use.
    pub(crate) fn table(&self, source: &FileSource) -> Result<&ChunkTable> {
        if let Some(table) = self.table.get() {
            return Ok(table);
        }
        let (across, down) = self.chunks();
        let planes = if self.separate { self.samples as u64 } else { 1 };
        let needed = u64::from(across) * u64::from(down) * planes;
        let list = |tile_tag, strip_tag, what: &str| -> Result<Vec<u64>> {
            // A few files use the tag of strips for the table of their tiles.
            let tag = match self.directory.entry(tile_tag) {
                Some(_) if self.spec.is_tiled() => tile_tag,
                _ => strip_tag,
            };
            let held = self.directory.entry(tag).map_or(0, |e| e.count);
            if held < needed {
                return Err(source.malformed(format!("{held} {what} of strips or tiles, {needed} needed")));
            }
            self.directory.numbers(source, tag, needed)
        };
        let offsets = list(tags::TILE_OFFSETS, tags::STRIP_OFFSETS, "positions")?;
        let counts = list(tags::TILE_BYTE_COUNTS, tags::STRIP_BYTE_COUNTS, "lengths")?;
        Ok(self.table.get_or_init(|| ChunkTable { offsets, counts }))
    }
}
