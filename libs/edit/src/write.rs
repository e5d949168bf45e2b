//! Images are written.

use crate::channels::{Note, converted};
use crate::image::Image;
use crate::window::band;
use crate::{EditError, Result};
use granita_base::{BaseType, Param, ParamType};
use granita_image::{
    BlockCopy, CreateOptions, Format, FormatRegistry, ImageOutput, ImageSpec, PixelType, Pixels,
};
use rayon::prelude::*;
use std::path::Path;

/// The requested tiling of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tiling {
    /// That of the image, where the format stores tiles.
    #[default]
    Keep,
    /// Rows.
    Scanlines,
    /// Tiles of a width and a height in pixels.
    Tiles(u32, u32),
}

/// The options of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WriteOptions {
    /// The type of the values. Without it, that of the file from which the image came.
    pub pixel_type: Option<PixelType>,
    /// The tiling.
    pub tiling: Tiling,
    /// The compression, by its name in the format; `NAME:LEVEL` where it has levels.
    pub compression: Option<String>,
    /// True to store channels one after the other.
    pub separate: Option<bool>,
    /// The name of the format. Without it, the extension of the file decides.
    pub format: Option<String>,
    /// True to write the pixels of the data window where a format does not store windows, instead of those of the
    /// display window.
    pub keep_data: bool,
}

/// Metadata that describes the storage of another file.
const STORAGE: [&str; 5] = ["compression", "channelOrder", "planarconfig", "rowsperstrip", "name"];

/// Returns the types in which values are stored, the best first.
fn wishes(pixel_type: PixelType) -> [PixelType; 5] {
    use PixelType::{Float, Half, U8, U16, U32};
    match pixel_type {
        U8 => [U8, U16, Half, Float, U32],
        U16 => [U16, Float, Half, U8, U32],
        U32 => [U32, Float, Half, U16, U8],
        Half => [Half, Float, U16, U8, U32],
        Float => [Float, Half, U16, U8, U32],
    }
}

/// Returns the type that a format stores for values of a type.
fn stored_type(format: &dyn Format, wanted: PixelType) -> PixelType {
    let fits = |t: &PixelType| match t {
        PixelType::U8 => format.output_type(PixelType::U8) == PixelType::U8,
        PixelType::U16 => format.supports("u16"),
        PixelType::U32 => format.supports("u32"),
        PixelType::Half => format.supports("half"),
        PixelType::Float => format.supports("float"),
    };
    wishes(wanted).into_iter().find(fits).unwrap_or_else(|| format.output_type(wanted))
}

/// True for formats whose files store data windows that are not the display window.
fn stores_windows(format: &str) -> bool {
    matches!(format, "exr" | "tiff")
}

/// True for formats whose files store colours that are not multiplied by alpha without a change.
fn stores_straight(format: &str) -> bool {
    matches!(format, "png" | "tiff" | "dds" | "jpegxl" | "tga" | "webp" | "bmp" | "qoi" | "ico" | "gif")
}

/// True for formats whose writers divide colours by alpha.
fn divides(format: &str) -> bool {
    matches!(format, "png" | "dds" | "jpegxl" | "webp" | "qoi")
}

/// Returns the channels that a format stores, and a note when some are left out.
fn stored_channels(image: &Image, format: &dyn Format, path: &Path) -> Result<(Image, Option<Note>)> {
    let names = &image.spec.channels;
    let (n, alpha) = (names.len(), image.spec.alpha_channel());
    let mut keep: Vec<usize> = (0..n).collect();
    if n > 4 && !format.supports("channels") {
        let colors: Vec<usize> =
            ["R", "G", "B"].iter().filter_map(|c| names.iter().position(|n| n == c)).collect();
        keep = if colors.len() == 3 { colors } else { vec![0, 1, 2] };
        keep.extend(alpha.filter(|a| !keep.contains(a)));
    }
    if !format.supports("alpha") && !format.supports("channels") {
        match keep.len() {
            2 => keep.truncate(1),
            4 => keep.retain(|c| Some(*c) != alpha.or(keep_last(n))),
            _ => {}
        }
    }
    if keep.len() == n {
        return Ok((image.clone(), None));
    }
    let kept: Vec<&str> = keep.iter().map(|c| &*names[*c]).collect();
    let lost: Vec<&str> = (0..n).filter(|c| !keep.contains(c)).map(|c| &*names[c]).collect();
    let note = format!(
        "{}: the channels {} are left out, the format \"{}\" does not store them",
        path.display(),
        lost.join(", "),
        format.name()
    );
    let (image, _) = image.channels(&kept.join(","))?;
    Ok((image, Some(note)))
}

/// Returns the last of four channels.
fn keep_last(n: usize) -> Option<usize> {
    n.checked_sub(1)
}

/// Writes an image. The file appears complete or not at all. The result holds notes about what the format does not
/// store.
///
/// The image is computed in bands of about 4 MiB, one while the one before is written.
///
/// # Errors
/// [`EditError::Unsupported`] when no format is known or it cannot store the image, and the errors of computing and
/// writing.
pub fn write(
    image: &Image,
    path: &Path,
    formats: &FormatRegistry,
    options: &WriteOptions,
) -> Result<Vec<Note>> {
    let unsupported = |what: String| EditError::Unsupported { path: path.to_owned(), what };
    let name = match &options.format {
        Some(name) => name.clone(),
        None => path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_owned(),
    };
    let Some(format) = formats.by_name(&name) else {
        return Err(unsupported(match name.is_empty() {
            true => "the name has no extension, which chooses the format".to_owned(),
            false => format!("no format is known for \"{name}\" (known: {})", formats.names().join(", ")),
        }));
    };
    let mut notes = Vec::new();
    let windows = stores_windows(format.name());
    let mut image = match windows {
        false if options.keep_data => image.full_is_data()?,
        false if image.data() != image.full() => image.crop_to_full()?,
        _ => image.clone(),
    };
    if !stores_straight(format.name()) {
        image = image.associated();
    }
    let (image, left_out) = stored_channels(&image, &*format, path)?;
    notes.extend(left_out);
    let wanted = options.pixel_type.unwrap_or(image.stored);
    let pixel_type = stored_type(&*format, wanted);
    if options.pixel_type.is_some_and(|wanted| wanted != pixel_type) {
        notes.push(format!(
            "{}: the values are {}, the format \"{}\" does not store {}",
            path.display(),
            pixel_type.word(),
            format.name(),
            wanted.word()
        ));
    }
    let is_integer = matches!(pixel_type, PixelType::U8 | PixelType::U16);
    let is_straight = image.spec.attributes.int("unassociatedalpha").unwrap_or(0) != 0;
    let image = match divides(format.name())
        && is_integer
        && !is_straight
        && image.spec.pixel_type == PixelType::Float
    {
        // Floats are divided before they are rounded, which the writer cannot do.
        true => image.straight(),
        false => image,
    };
    let spec = described(&image, &*format, options, pixel_type, path, &mut notes);
    let mut output = format.create(path, &CreateOptions::new(&spec, 1).with_files(formats.files()))?;
    emit(&image, &spec, &mut *output)?;
    output.close()?;
    Ok(notes)
}

/// Returns the description of a file.
fn described(
    image: &Image,
    format: &dyn Format,
    options: &WriteOptions,
    pixel_type: PixelType,
    path: &Path,
    notes: &mut Vec<Note>,
) -> ImageSpec {
    let mut spec = ImageSpec { pixel_type, ..image.spec.clone() };
    let tiles = match options.tiling {
        Tiling::Keep => (spec.tile_width, spec.tile_height),
        Tiling::Scanlines => (0, 0),
        Tiling::Tiles(w, h) => (w, h),
    };
    let has_tiles = format.supports("tiles");
    if matches!(options.tiling, Tiling::Tiles(..)) && !has_tiles {
        notes.push(format!("{}: the format \"{}\" does not store tiles", path.display(), format.name()));
    }
    (spec.tile_width, spec.tile_height) = if has_tiles { tiles } else { (0, 0) };
    let same_format = image.format == format.name();
    spec.attributes.0.retain(|param: &Param| {
        !STORAGE.contains(&&*param.name) || same_format && &*param.name == "compression"
    });
    let mut text = |name: &str, value: &str| {
        let ty = ParamType::of(BaseType::String);
        spec.attributes.set(Param { name: name.into(), ty, data: value.into() });
    };
    if let Some(compression) = &options.compression {
        text("compression", compression);
    }
    if let Some(separate) = options.separate {
        text("planarconfig", if separate { "separate" } else { "contig" });
    }
    spec
}

/// Writes all rows.
fn emit(image: &Image, spec: &ImageSpec, output: &mut dyn ImageOutput) -> Result<()> {
    let shape = image.source.shape();
    let step = match spec.tile_height {
        0 => band(&shape),
        tile => band(&shape).div_ceil(tile).saturating_mul(tile),
    };
    let rows = |y0: u32| -> Result<Pixels> {
        let y1 = y0.saturating_add(step).min(shape.height);
        Ok(converted(image.source.rows(y0, y1)?, spec.pixel_type))
    };
    let mut y0 = 0_u32;
    let mut next = Some(rows(0)?);
    while let Some(pixels) = next.take() {
        let end = y0.saturating_add(step).min(shape.height);
        let (written, computed) = rayon::join(
            || emit_band(spec, output, y0, &pixels),
            || (end < shape.height).then(|| rows(end)).transpose(),
        );
        written?;
        next = computed?;
        y0 = end;
    }
    Ok(())
}

/// Writes the rows from `y0`, which is the top of a row of tiles in a tiled file.
fn emit_band(spec: &ImageSpec, output: &mut dyn ImageOutput, y0: u32, pixels: &Pixels) -> Result<()> {
    if !spec.is_tiled() {
        return Ok(output.write_rows(pixels)?);
    }
    let n = spec.nchannels();
    let (tw, th) = (spec.tile_width, spec.tile_height);
    let height = (pixels.len() / (spec.width as usize * n)) as u32;
    for row in 0..height.div_ceil(th) {
        let tiles: Vec<(u32, u32, Pixels)> = (0..spec.tiles().0)
            .into_par_iter()
            .map(|tx| {
                let mut tile = Pixels::zeros(spec.pixel_type, tw as usize * th as usize * n);
                BlockCopy {
                    from_width: spec.width as usize,
                    from: ((tx * tw) as usize, (row * th) as usize),
                    to_width: tw as usize,
                    to: (0, 0),
                    size: (tw.min(spec.width - tx * tw) as usize, th.min(height - row * th) as usize),
                    nchannels: n,
                }
                .run(pixels, &mut tile);
                (tx, y0 / th + row, tile)
            })
            .collect();
        output.write_tiles(&tiles)?;
    }
    Ok(())
}

impl Image {
    /// Returns the image with its pixels in memory, when they need at most `memory_bytes`; else, and when they are
    /// those of a file, the image itself. An image that is used several times is then computed once.
    ///
    /// # Errors
    /// The error of computing it.
    pub fn held(&self, memory_bytes: u64) -> Result<Self> {
        let shape = self.source.shape();
        if self.ready || shape.row_bytes().saturating_mul(shape.height.into()) > memory_bytes {
            return Ok(self.clone());
        }
        let mut pixels = Pixels::zeros(shape.pixel_type, shape.row() * shape.height as usize);
        let step = band(&shape);
        for y0 in (0..shape.height).step_by(step as usize) {
            let rows = self.source.rows(y0, (y0 + step).min(shape.height))?;
            pixels.copy_from(y0 as usize * shape.row(), &rows, 0, rows.len());
        }
        let mut image = self.with_source(std::sync::Arc::new(crate::hold::Held { shape, pixels }));
        image.ready = true;
        Ok(image)
    }
}
