//! Still images, which are thumbnails, saved views and text.

use crate::display::Display;
use crate::draw::{Canvas, Mix, Shown, draw};
use crate::image::Page;
use crate::statistics::depth_range;
use crate::view::View;
use crate::{Result, ViewError};
use granita_image::{CreateOptions, FormatRegistry, ImageSpec, PixelType, Pixels};
use std::path::Path;

/// Returns an image of a whole page with no more than `longest` pixels in either direction. A smaller page is not
/// enlarged.
///
/// # Errors
/// Returns an error when the page cannot be read, or when `longest` is too large.
pub fn thumbnail(page: &Page, layer: usize, display: &Display, longest: u32) -> Result<Canvas> {
    let sheet = page.sheet(page.arrangement(), 0);
    let [left, top, right, bottom] = sheet.bounds;
    let zoom = (f64::from(longest.max(1)) / (right - left).max(bottom - top).max(1.0)).min(1.0);
    let side = |length: f64| (length * zoom).round().max(1.0) as u32;
    let view = View {
        width: side(right - left),
        height: side(bottom - top),
        center: ((left + right) / 2.0, (top + bottom) / 2.0),
        zoom,
        around: None,
    };
    let shown = Shown { page, sheet: &sheet, layer, display };
    shown.load(&view)?;
    draw(shown, None, Mix::First, &view)
}

/// Returns the default display for a layer. Depths are shown within their range, near ones bright.
///
/// # Errors
/// Returns an error when depths cannot be read.
pub fn suited(page: &Page, layer: usize, display: &Display) -> Result<Display> {
    let mut display = *display;
    if page.is_depth(layer) && display.range.is_none() {
        let channel = page.layers[layer].channels[0];
        if let Some((near, far)) = depth_range(page, channel)? {
            let far = if far > near { far } else { near + 1.0 };
            // The farthest depth still differs from empty pixels.
            display.range = Some((far + 0.15 * (far - near), near));
        }
    }
    Ok(display)
}

/// Writes a canvas in the format of the file's extension.
///
/// # Errors
/// Returns an error when the format is unknown or cannot be written, or when a system call fails.
pub fn save_canvas(canvas: &Canvas, path: &Path, formats: &FormatRegistry) -> Result<()> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("png");
    let mut spec = ImageSpec::new(canvas.width, canvas.height, 3, PixelType::U8);
    let rgb: Vec<u8> = canvas.bytes.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let pixels = match formats.by_name(extension).map(|f| f.output_type(PixelType::U8)) {
        // An unknown format is reported by `create`.
        None | Some(PixelType::U8) => Pixels::U8(rgb),
        Some(other) => {
            spec.pixel_type = other;
            let linear = rgb.iter().map(|v| granita_color::srgb_decode(f32::from(*v) / 255.0));
            Pixels::from_floats(other, &linear.collect::<Vec<f32>>())
        }
    };
    let mut file = formats.create(path, extension, &CreateOptions::new(&spec, 1))?;
    file.write_rows(&pixels)?;
    file.close()?;
    Ok(())
}

/// Writes the values of level 0, of all channels or those of a layer, in the format of the file's extension.
///
/// When the format does not support the type of the values, a similar type is written. Floats become integers of 16
/// bits if the format supports them, else of 8 bits, with colours encoded for a screen.
///
/// # Errors
/// Returns an error when the format cannot hold so many channels, or the errors of [`save_canvas`].
pub fn save_pixels(page: &Page, layer: Option<usize>, path: &Path, formats: &FormatRegistry) -> Result<()> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("exr");
    let source = page.spec();
    let channels: Vec<usize> = match layer.and_then(|l| page.layers.get(l)) {
        Some(layer) => layer.channels.clone(),
        None => (0..source.nchannels()).collect(),
    };
    let Some(format) = formats.by_name(extension).filter(|f| f.supports("write")) else {
        let what = format!("{}: its extension does not name a format that can be written", path.display());
        return Err(ViewError::Misuse { what });
    };
    let fits = |t: PixelType| match t {
        PixelType::U8 => true,
        PixelType::U16 => format.supports("u16"),
        PixelType::U32 => format.supports("u32"),
        PixelType::Half => format.supports("half"),
        PixelType::Float => format.supports("float"),
    };
    let wishes: &[PixelType] = match source.pixel_type {
        PixelType::U8 => &[PixelType::U8, PixelType::Half, PixelType::Float],
        PixelType::U16 => &[PixelType::U16, PixelType::Float, PixelType::U8],
        PixelType::U32 => &[PixelType::U32, PixelType::Float, PixelType::U16],
        PixelType::Half => &[PixelType::Half, PixelType::Float, PixelType::U16],
        PixelType::Float => &[PixelType::Float, PixelType::Half, PixelType::U16],
    };
    let stored = wishes.iter().copied().find(|t| fits(*t)).unwrap_or(PixelType::U8);
    let mut spec = ImageSpec {
        tile_width: 0,
        tile_height: 0,
        pixel_type: stored,
        channels: channels.iter().map(|c| source.channels[*c].clone()).collect(),
        ..source.clone()
    };
    // The format writes these attributes again where they apply.
    let compression = |name: &str| name == "compression" || name == "channelOrder";
    spec.attributes = source.attributes.iter().filter(|p| !compression(&p.name)).cloned().collect();
    let integers = |t: PixelType| matches!(t, PixelType::U8 | PixelType::U16);
    let (encode, decode) = (
        !page.encoded && integers(stored) && !integers(source.pixel_type),
        page.encoded && !integers(stored),
    );
    let mut file = formats.create(path, extension, &CreateOptions::new(&spec, 1))?;
    let n = channels.len();
    for ty in 0..source.height.div_ceil(crate::TILE) {
        let rows = (source.height - ty * crate::TILE).min(crate::TILE);
        let width = source.width as usize;
        let mut values = vec![0.0_f32; width * rows as usize * n];
        for tx in 0..source.width.div_ceil(crate::TILE) {
            let tile = page.pyramid.tile(0, tx, ty)?;
            for (y, x) in (0..tile.height).flat_map(|y| (0..tile.width).map(move |x| (y, x))) {
                let from = (y * tile.width + x) as usize * tile.channels;
                let to = (y as usize * width + (tx * crate::TILE + x) as usize) * n;
                for (out, c) in values[to..to + n].iter_mut().zip(&channels) {
                    *out = tile.pixels.get(from + c);
                }
            }
        }
        if encode || decode {
            let alpha = spec.alpha_channel();
            for (i, v) in values.iter_mut().enumerate().filter(|(i, _)| Some(i % n) != alpha) {
                let _ = i;
                *v = if encode { granita_color::srgb_encode(*v) } else { granita_color::srgb_decode(*v) };
            }
        }
        file.write_rows(&Pixels::from_floats(stored, &values))?;
    }
    file.close()?;
    Ok(())
}

/// The characters from dark to bright.
const RAMP: &[u8] = b" .:-=+*#%@";

/// Returns an image as text with `columns` characters per line, each twice as high as it is wide. With `colors`, a
/// character shows two pixels in colours of 24 bits, for terminals that support them.
///
/// # Errors
/// Returns the errors of [`thumbnail`].
pub fn ascii(page: &Page, layer: usize, display: &Display, columns: u32, colors: bool) -> Result<String> {
    let sheet = page.sheet(page.arrangement(), 0);
    let [left, top, right, bottom] = sheet.bounds;
    let columns = columns.clamp(1, 4096);
    let zoom = f64::from(columns) / (right - left).max(1.0);
    let rows = ((bottom - top) * zoom / 2.0).round().clamp(1.0, 4096.0) as u32;
    // Two rows of pixels make one row of characters.
    let view = View {
        width: columns,
        height: 2 * rows,
        center: ((left + right) / 2.0, (top + bottom) / 2.0),
        zoom,
        around: None,
    };
    let shown = Shown { page, sheet: &sheet, layer, display };
    shown.load(&view)?;
    let canvas = draw(shown, None, Mix::First, &view)?;
    let mut text = String::new();
    for y in 0..rows {
        for x in 0..columns {
            let (upper, lower) = (canvas.at(x, 2 * y), canvas.at(x, 2 * y + 1));
            if colors {
                let ([r, g, b], [s, h, c]) = (upper, lower);
                text.push_str(&format!("\x1b[38;2;{r};{g};{b}m\x1b[48;2;{s};{h};{c}m\u{2580}"));
            } else {
                let light = |c: [u8; 3]| crate::luminance(c.map(f32::from));
                let v = (light(upper) + light(lower)) / 2.0;
                let at = (v / 256.0 * RAMP.len() as f32) as usize;
                text.push(char::from(RAMP[at.min(RAMP.len() - 1)]));
            }
        }
        if colors {
            text.push_str("\x1b[0m");
        }
        text.truncate(text.trim_end_matches(' ').len());
        text.push('\n');
    }
    Ok(text)
}
