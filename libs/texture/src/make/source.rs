//! The rows of an input, as its file stores them and as they are computed with.

use super::color::{Conversion, HalfTable};
use super::flat::Frame;
use super::options::{BrokenValues, MakeOptions};
use crate::error::{Result, TextureError};
use crate::image::Image;
use crate::stage::Stage;
use granita_image::{BlockCopy, FormatRegistry, ImageInput, ImageSpec, PixelType, Pixels};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The number of pixels that any display window may have, even if little of it is covered by data: 16384 x 16384.
const LARGEST_WINDOW: u64 = 1 << 28;

/// The largest number of bytes of rows in floats that may be kept until the last row of an image that repeats.
const KEPT: usize = 16 << 20;

/// The number of values that one task converts.
const CHUNK: usize = 1 << 16;

/// The first image of a file in its display window. It is cropped where it is larger, and black where there is no data.
pub(crate) struct Source {
    pub(crate) path: PathBuf,
    file: Box<dyn ImageInput>,
    /// The description in the file.
    pub(crate) spec: ImageSpec,
    /// The size of the display window, in pixels.
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
    broken: BrokenValues,
    /// True when the rows are those of the data window.
    is_data: bool,
    nans: AtomicU64,
    infinities: AtomicU64,
}

impl Source {
    /// Opens a file.
    pub(crate) fn open(path: &Path, options: &MakeOptions, registry: &FormatRegistry) -> Result<Self> {
        let file = registry.open(path)?;
        let malformed = |what: &str| TextureError::Malformed { path: path.to_owned(), what: what.to_owned() };
        let spec = file.spec(0, 0).ok_or_else(|| malformed("there is no image in it"))?.clone();
        if spec.width == 0 || spec.height == 0 || spec.nchannels() == 0 {
            return Err(malformed("there are no pixels in it"));
        }
        let shown = spec.full_width > 0 && spec.full_height > 0;
        // The display window of a mosaic of faces is the size of one face, not of the whole.
        let cube = spec.string("textureformat").is_some_and(|t| t.starts_with("CubeFace"));
        let is_data = options.flat.frame != Frame::Display;
        let (width, height) = if shown && !cube && !is_data {
            (spec.full_width as usize, spec.full_height as usize)
        } else {
            (spec.width as usize, spec.height as usize)
        };
        let limits = registry.limits();
        // The part of a display window around the data is not in the file. Its size is limited, because the file does
        // not limit it.
        let most = limits.pixels.min(LARGEST_WINDOW.max(u64::from(spec.width) * u64::from(spec.height) * 64));
        for (what, asked, max) in [
            ("side of the display window", width.max(height) as u64, u64::from(limits.dimension)),
            ("number of pixels of the display window", width as u64 * height as u64, most),
        ] {
            if asked > max {
                return Err(TextureError::Limit { path: path.to_owned(), what, asked, max });
            }
        }
        Ok(Self {
            path: path.to_owned(),
            channels: spec.nchannels(),
            file,
            spec,
            width,
            height,
            broken: if options.flat.needs_whole() { BrokenValues::Keep } else { options.broken_values },
            is_data,
            nans: AtomicU64::new(0),
            infinities: AtomicU64::new(0),
        })
    }

    /// True when the rows are those of the data window, not of the display window.
    pub(crate) fn is_data(&self) -> bool {
        self.is_data
    }

    /// Returns the bytes of memory that reading takes beside the rows.
    pub(crate) fn working_bytes(&self) -> u64 {
        self.file.working_bytes(0, 0)
    }

    /// Returns the name of the file's format.
    pub(crate) fn format_name(&self) -> &'static str {
        self.file.format_name()
    }

    /// Returns the conversion of its colours.
    pub(crate) fn conversion(&self, options: &MakeOptions) -> Conversion {
        let straight = self.spec.attributes.int("unassociatedalpha").unwrap_or(0) != 0;
        options.conversion(self.spec.alpha_channel(), straight)
    }

    /// Returns notes for the user.
    pub(crate) fn notes(&self) -> Option<String> {
        let (nans, infinities) = (self.nans.load(Ordering::Relaxed), self.infinities.load(Ordering::Relaxed));
        let path = self.path.display();
        match self.broken {
            BrokenValues::Fix if nans + infinities > 0 => Some(format!(
                "{path}: {} values that are not finite were replaced by the mean of their neighbours",
                nans + infinities
            )),
            _ if nans > 0 => Some(format!("{path}: values that are not numbers: {nans}; they count as 0")),
            _ => None,
        }
    }

    /// Returns the rows `y0..y1` of the display window as the file stores them.
    fn window(&self, y0: usize, y1: usize) -> Result<Pixels> {
        let spec = &self.spec;
        let same = (self.width, self.height) == (spec.width as usize, spec.height as usize);
        let cube = spec.string("textureformat").is_some_and(|t| t.starts_with("CubeFace"));
        if self.is_data || same && (cube || (spec.x, spec.y) == (spec.full_x, spec.full_y)) {
            return Ok(self.file.read_rows(0, 0, y0 as u32, y1 as u32)?);
        }
        let (dx, dy) =
            (i64::from(spec.x) - i64::from(spec.full_x), i64::from(spec.y) - i64::from(spec.full_y));
        let mut out = Pixels::zeros(spec.pixel_type, self.width * (y1 - y0) * self.channels);
        let inside = |v: i64, n: u32| v.clamp(0, i64::from(n)) as u32;
        let (from, to) = (inside(y0 as i64 - dy, spec.height), inside(y1 as i64 - dy, spec.height));
        let (left, right) = (inside(-dx, spec.width), inside(self.width as i64 - dx, spec.width));
        if from < to && left < right {
            let data = self.file.read_rows(0, 0, from, to)?;
            BlockCopy {
                from_width: spec.width as usize,
                from: (left as usize, 0),
                to_width: self.width,
                to: ((i64::from(left) + dx) as usize, (i64::from(from) + dy - y0 as i64) as usize),
                size: ((right - left) as usize, (to - from) as usize),
                nchannels: self.channels,
            }
            .run(&data, &mut out);
        }
        Ok(out)
    }

    /// Returns the rows `y0..y1` of the display window, with all values finite.
    ///
    /// # Errors
    /// Returns an error when the file cannot be read, or when it holds a value that is not finite and the options
    /// refuse it.
    pub(crate) fn rows(&self, y0: usize, y1: usize) -> Result<Pixels> {
        let (pixels, nans, infinities) = self.finite_rows(y0, y1)?;
        self.nans.fetch_add(nans, Ordering::Relaxed);
        self.infinities.fetch_add(infinities, Ordering::Relaxed);
        Ok(pixels)
    }

    /// Does the same, and also returns the number of NaNs and the number of infinite values.
    fn finite_rows(&self, y0: usize, y1: usize) -> Result<(Pixels, u64, u64)> {
        let mut pixels = self.window(y0, y1)?;
        let (nans, infinities) = not_finite(&pixels);
        if nans + infinities == 0 {
            return Ok((pixels, 0, 0));
        }
        match self.broken {
            BrokenValues::Refuse => {
                let row = self.width * self.channels;
                let floats = pixels.to_floats();
                let first = floats.iter().position(|v| !v.is_finite()).unwrap_or(0);
                let (x, y) = (first % row / self.channels, y0 + first / row);
                let channel = &self.spec.channels[first % self.channels];
                let what = format!(
                    "channel {channel} of pixel ({x}, {y}) is {}, not a finite number",
                    floats[first]
                );
                return Err(TextureError::Malformed { path: self.path.clone(), what });
            }
            BrokenValues::Fix => {
                let (top, bottom) = (y0.saturating_sub(1), (y1 + 1).min(self.height));
                let around = self.window(top, bottom)?.to_floats();
                self.mend(&mut pixels, y0 - top, &around);
            }
            BrokenValues::Replace => replace(&mut pixels),
            BrokenValues::Keep | BrokenValues::Black => {}
        }
        Ok((pixels, nans, infinities))
    }

    /// Replaces values that are not finite by the mean of the finite ones among the eight around them, or 0. `around`
    /// has `above` more rows at its top than `pixels`.
    fn mend(&self, pixels: &mut Pixels, above: usize, around: &[f32]) {
        let (w, n) = (self.width, self.channels);
        let height = around.len() / (w * n);
        let mended = |i: usize| {
            let (c, x, y) = (i % n, i / n % w, i / n / w + above);
            let mut sum = (0.0_f64, 0);
            for y in y.saturating_sub(1)..(y + 2).min(height) {
                for x in x.saturating_sub(1)..(x + 2).min(w) {
                    let v = around[(y * w + x) * n + c];
                    if v.is_finite() {
                        sum = (sum.0 + f64::from(v), sum.1 + 1);
                    }
                }
            }
            if sum.1 > 0 { (sum.0 / f64::from(sum.1)) as f32 } else { 0.0 }
        };
        match pixels {
            Pixels::Half(v) => {
                for i in (0..v.len()).filter(|i| !v[*i].is_finite()).collect::<Vec<_>>() {
                    v[i] = f16::from_f32(mended(i));
                }
            }
            Pixels::Float(v) => {
                for i in (0..v.len()).filter(|i| !v[*i].is_finite()).collect::<Vec<_>>() {
                    v[i] = mended(i);
                }
            }
            _ => {}
        }
    }

    /// Returns the whole display window in floats, with integers in these units.
    pub(crate) fn image(&self, conversion: Option<&Conversion>, units: Units) -> Result<Image> {
        self.filled(|rows, first, out| fill(rows, first, self.channels, units, conversion, out))
    }

    /// Returns the whole display window, converted by `texels`.
    pub(crate) fn converted(&self, texels: &Texels) -> Result<Image> {
        self.filled(|rows, first, out| texels.fill(rows, first, out))
    }

    /// Returns the whole display window in floats. `fill` converts the values of rows from an index on.
    fn filled(&self, fill: impl Fn(&Pixels, usize, &mut [f32]) + Sync) -> Result<Image> {
        let mut image = Image::new(self.width, self.height, self.channels);
        let chunk = (CHUNK / self.channels).max(1) * self.channels;
        // The rows are read in portions, so that the stored values and the floats are not in memory as a whole at once.
        let portions = image.data.chunks_mut(256 * self.width * self.channels);
        for (y, out) in (0..self.height).step_by(256).zip(portions) {
            let rows = self.rows(y, (y + 256).min(self.height))?;
            out.par_chunks_mut(chunk).enumerate().for_each(|(i, out)| fill(&rows, i * chunk, out));
        }
        Ok(image)
    }
}

/// Returns the number of NaNs and the number of infinite values.
fn not_finite(pixels: &Pixels) -> (u64, u64) {
    match pixels {
        Pixels::Half(v) => {
            let odd = v.par_chunks(CHUNK).any(|v| v.iter().any(|v| v.to_bits() & 0x7c00 == 0x7c00));
            if !odd {
                return (0, 0);
            }
            let nans = v.iter().filter(|v| v.is_nan()).count() as u64;
            (nans, v.iter().filter(|v| !v.is_finite()).count() as u64 - nans)
        }
        Pixels::Float(v) => {
            if v.par_chunks(CHUNK).all(|v| v.iter().all(|v| v.abs() <= 1e30)) {
                return (0, 0);
            }
            let nans = v.iter().filter(|v| v.is_nan()).count() as u64;
            (nans, v.iter().filter(|v| v.abs() > 1e30).count() as u64)
        }
        _ => (0, 0),
    }
}

/// Replaces NaN by 0, and infinity by a large number that filters can process.
fn replace(pixels: &mut Pixels) {
    match pixels {
        Pixels::Half(v) => v.iter_mut().for_each(|v| {
            *v = if v.is_nan() { f16::ZERO } else { v.max(f16::MIN).min(f16::MAX) };
        }),
        Pixels::Float(v) => v.iter_mut().for_each(|v| {
            *v = if v.is_nan() { 0.0 } else { v.clamp(-1e30, 1e30) };
        }),
        _ => {}
    }
}

/// The value of integer pixels that becomes 1 in floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Units {
    /// The largest integer becomes 1, so that values are fractions.
    Fractions,
    /// The number 1 becomes 1, so that values are the integers. Means of up to 2^16 bytes are then exact.
    Stored,
}

/// Returns pixels of `n` channels as floats, which are linear when there is a conversion.
pub(crate) fn floats(pixels: &Pixels, n: usize, units: Units, conversion: Option<&Conversion>) -> Vec<f32> {
    let mut out = vec![0.0; pixels.len()];
    let chunk = (CHUNK / n).max(1) * n;
    out.par_chunks_mut(chunk)
        .enumerate()
        .for_each(|(i, out)| fill(pixels, i * chunk, n, units, conversion, out));
    out
}

/// Does the same for the values from index `first` on, as many as `out` holds. They are whole pixels.
fn fill(
    pixels: &Pixels,
    first: usize,
    n: usize,
    units: Units,
    conversion: Option<&Conversion>,
    out: &mut [f32],
) {
    let range = first..first + out.len();
    let conversion = conversion.filter(|c| !c.keeps_inputs());
    let stored = units == Units::Stored;
    match pixels {
        Pixels::U8(v) => {
            let v = &v[range];
            match conversion {
                Some(conversion) => return conversion.bytes_to_linear(v, n, out),
                None if stored => out.iter_mut().zip(v).for_each(|(o, v)| *o = f32::from(*v)),
                None => out.iter_mut().zip(v).for_each(|(o, v)| *o = f32::from(*v) / 255.0),
            }
        }
        Pixels::U16(v) => {
            let unit = if stored { 1.0 } else { 65535.0 };
            out.iter_mut().zip(&v[range]).for_each(|(o, v)| *o = f32::from(*v) / unit);
        }
        Pixels::U32(v) => out.iter_mut().zip(&v[range]).for_each(|(o, v)| *o = *v as f32),
        Pixels::Half(v) => v[range].convert_to_f32_slice(out),
        Pixels::Float(v) => out.copy_from_slice(&v[range]),
    }
    if let Some(conversion) = conversion {
        conversion.to_linear(out, n);
    }
}

/// The conversion from the pixels of a file to the floats of its texture.
#[derive(Clone, Debug)]
pub(crate) struct Texels {
    conversion: Conversion,
    channels: usize,
    /// The largest integer, where integers are multiplied by its inverse instead of divided by it, and remain integers
    /// when colours are multiplied by alpha. That is what OpenImageIO does, and its hash depends on it.
    largest: Option<f32>,
    /// The results for halves, where a table has them.
    halves: Option<Arc<HalfTable>>,
}

impl Texels {
    /// Returns the conversion for a file. `peer` is true by the conventions of OpenImageIO.
    pub(crate) fn new(source: &Source, conversion: &Conversion, peer: bool) -> Self {
        let largest = match source.spec.pixel_type {
            PixelType::U8 => Some(255.0),
            PixelType::U16 => Some(65535.0),
            _ => None,
        };
        let largest = largest.filter(|_| peer);
        let halves = match source.spec.pixel_type {
            PixelType::Half => conversion.table_of_halves(source.channels).map(Arc::new),
            _ => None,
        };
        Self { conversion: conversion.clone(), channels: source.channels, largest, halves }
    }

    /// Converts the values from index `first` on, as many as `out` holds. They are whole pixels.
    pub(crate) fn fill(&self, pixels: &Pixels, first: usize, out: &mut [f32]) {
        let n = self.channels;
        if let (Some(table), Pixels::Half(halves)) = (&self.halves, pixels) {
            return self.conversion.halves_to_linear(table, &halves[first..first + out.len()], n, out);
        }
        let Some(largest) = self.largest else {
            return fill(pixels, first, n, Units::Fractions, Some(&self.conversion), out);
        };
        fill(pixels, first, n, Units::Stored, None, out);
        let scale = 1.0 / largest;
        out.iter_mut().for_each(|v| *v *= scale);
        if self.conversion.multiplies() {
            self.conversion.associate(out, n);
            out.iter_mut().for_each(|v| *v = (*v * largest).round() * scale);
        }
        if !self.conversion.keeps_colors() {
            // The conversion is not rounded to integers.
            self.conversion.convert_colors(out, n);
        }
    }
}

/// Does the inverse of [`floats`], rounded to nearest and clamped. Colours are encoded when there is a conversion.
pub(crate) fn pixels(
    mut values: Vec<f32>,
    n: usize,
    pixel_type: PixelType,
    units: Units,
    conversion: Option<&Conversion>,
) -> Pixels {
    let chunk = (CHUNK / n).max(1) * n;
    if let Some(conversion) = conversion.filter(|c| !c.keeps_outputs()) {
        values.par_chunks_mut(chunk).for_each(|values| conversion.to_stored(values, n));
    }
    let each = |max: f32| if units == Units::Stored { 1.0 } else { max };
    let len = values.len();
    match pixel_type {
        PixelType::U8 => {
            let (mut out, unit) = (vec![0_u8; len], each(255.0));
            out.par_chunks_mut(chunk).zip(values.par_chunks(chunk)).for_each(|(out, values)| {
                out.iter_mut().zip(values).for_each(|(o, v)| *o = (v * unit + 0.5) as u8);
            });
            Pixels::U8(out)
        }
        PixelType::U16 => {
            let (mut out, unit) = (vec![0_u16; len], each(65535.0));
            out.par_chunks_mut(chunk).zip(values.par_chunks(chunk)).for_each(|(out, values)| {
                out.iter_mut().zip(values).for_each(|(o, v)| *o = (v * unit + 0.5) as u16);
            });
            Pixels::U16(out)
        }
        PixelType::Half => {
            let mut out = vec![f16::ZERO; len];
            out.par_chunks_mut(chunk).zip(values.par_chunks_mut(chunk)).for_each(|(out, values)| {
                // Large values stay finite, because infinity would spread through every filter.
                values.iter_mut().for_each(|v| *v = v.clamp(-65504.0, 65504.0));
                out.convert_from_f32_slice(values);
            });
            Pixels::Half(out)
        }
        PixelType::Float => Pixels::Float(values),
        PixelType::U32 => Pixels::from_floats(pixel_type, &values),
    }
}

/// Rows of level 0.
pub(crate) struct Band {
    /// The rows as the texture stores them.
    pub(crate) stored: Pixels,
    /// The rows as the next level is computed from them.
    pub(crate) floats: Vec<f32>,
}

/// Reads an input from its top.
pub(crate) struct Reader<'a> {
    source: &'a Source,
    conversion: Conversion,
    resize: Option<Stage>,
    pixel_type: PixelType,
    pub(crate) units: Units,
    next: usize,
    /// The rows that `resize` needs before all others.
    tail: Option<Range<usize>>,
}

impl<'a> Reader<'a> {
    /// Returns a reader of `source`. `resize` is the stage that makes level 0 of the input, when they differ in size.
    pub(crate) fn new(
        source: &'a Source,
        conversion: Conversion,
        pixel_type: PixelType,
        resize: Option<Stage>,
    ) -> Self {
        let same = pixel_type == source.spec.pixel_type
            && matches!(pixel_type, PixelType::U8 | PixelType::U16)
            && conversion.keeps_inputs()
            && conversion.keeps_outputs();
        let units = if same { Units::Stored } else { Units::Fractions };
        // Where the memory for all rows is small, no row is read twice.
        let bytes = resize.as_ref().map_or(0, |_| source.height * source.width * source.channels * 4);
        let tail = resize.as_ref().and_then(Stage::tail).filter(|_| bytes > KEPT);
        Self { source, conversion, resize, pixel_type, units, next: 0, tail }
    }

    /// Reads the rows that are needed before all others.
    fn read_tail(&mut self) -> Result<()> {
        if let (Some(tail), Some(stage)) = (self.tail.take(), &mut self.resize) {
            let (rows, ..) = self.source.finite_rows(tail.start, tail.end)?;
            let floats = floats(&rows, self.source.channels, self.units, Some(&self.conversion));
            stage.preload(tail.start, &floats);
        }
        Ok(())
    }

    /// Returns the stage that makes level 0, ready to receive rows.
    pub(crate) fn resize(&mut self) -> Result<Option<&Stage>> {
        self.read_tail()?;
        Ok(self.resize.as_ref())
    }

    /// Returns the rows of level 0 that result from the next `rows` rows of the input; `None` behind the last.
    pub(crate) fn next(&mut self, rows: usize) -> Result<Option<Band>> {
        let (from, to) = (self.next, (self.next + rows).min(self.source.height));
        if from == to {
            return Ok(None);
        }
        self.read_tail()?;
        self.next = to;
        let n = self.source.channels;
        let raw = self.source.rows(from, to)?;
        let mut floats = floats(&raw, n, self.units, Some(&self.conversion));
        let untouched = self.resize.is_none()
            && self.pixel_type == raw.pixel_type()
            && self.conversion.keeps_inputs()
            && self.conversion.keeps_outputs();
        if untouched {
            return Ok(Some(Band { stored: raw, floats }));
        }
        drop(raw);
        if let Some(stage) = &mut self.resize {
            floats = stage.push(&floats);
        }
        let stored = pixels(floats.clone(), n, self.pixel_type, self.units, Some(&self.conversion));
        Ok(Some(Band { stored, floats }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_survive_conversion_in_either_unit() {
        for units in [Units::Fractions, Units::Stored] {
            let bytes = Pixels::U8((0..=255).collect());
            assert_eq!(pixels(floats(&bytes, 1, units, None), 1, PixelType::U8, units, None), bytes);
            let shorts = Pixels::U16((0..=65535).collect());
            assert_eq!(pixels(floats(&shorts, 1, units, None), 1, PixelType::U16, units, None), shorts);
        }
        let odd = vec![-1.0, 2.0, f32::NAN, 0.5];
        let got = pixels(odd, 1, PixelType::U8, Units::Fractions, None);
        assert_eq!(got, Pixels::U8(vec![0, 255, 0, 128]));
    }

    #[test]
    fn invalid_values_are_counted_and_replaced() {
        let mut p = Pixels::Half(vec![f16::NAN, f16::INFINITY, f16::ONE, f16::NEG_INFINITY]);
        assert_eq!(not_finite(&p), (1, 2));
        replace(&mut p);
        assert_eq!(p, Pixels::Half(vec![f16::ZERO, f16::MAX, f16::ONE, f16::MIN]));
        let mut p = Pixels::Float(vec![f32::NAN, f32::MAX, 1.0, f32::NEG_INFINITY]);
        assert_eq!(not_finite(&p), (1, 2));
        replace(&mut p);
        assert_eq!(p, Pixels::Float(vec![0.0, 1e30, 1.0, -1e30]));
    }
}
