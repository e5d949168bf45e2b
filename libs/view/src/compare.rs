//! Compares two images numerically.

use crate::image::Page;
use crate::plane::Plane;
use crate::store::TileStore;
use crate::tile::{TILE, Tile};
use crate::{Result, ViewError, flip};
use granita_color::srgb_decode;
use granita_image::{ImageSpec, PixelType};
use std::sync::Arc;

/// The largest number of pixels of images whose perceived difference is computed.
const FLIP_PIXELS: u64 = 1 << 26;

/// The options of a comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompareOptions {
    /// The largest difference of values that count as equal.
    pub tolerance: f32,
    /// The peak value of the signal-to-noise ratio.
    pub peak: f32,
    /// True to compute the perceived difference (FLIP) too.
    pub flip: bool,
    /// The exposure of both in stops for FLIP.
    pub exposure: f32,
    /// Screen pixels per degree of sight for FLIP.
    pub pixels_per_degree: f32,
}

impl Default for CompareOptions {
    fn default() -> Self {
        Self {
            tolerance: 0.0,
            peak: 1.0,
            flip: true,
            exposure: 0.0,
            pixels_per_degree: flip::PIXELS_PER_DEGREE,
        }
    }
}

/// The difference of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelDifference {
    /// Its name.
    pub name: String,
    /// The number of compared values, which are finite in both images.
    pub count: u64,
    /// The mean of the magnitudes.
    pub mean: f64,
    /// The mean of `a - b`.
    pub bias: f64,
    /// The root of the mean square.
    pub rms: f64,
    /// The largest magnitude.
    pub max: f32,
    /// The position of the largest magnitude, in pixels of the data window.
    pub max_at: (u32, u32),
    /// The number of values that differ by more than the tolerance, or of which one is not finite and the other is
    /// different.
    pub beyond: u64,
    /// The part of `beyond` where one value is not finite.
    pub broken: u64,
}

/// The difference of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The width and height in pixels.
    pub size: (u32, u32),
    /// The channels that both have, in the order of the first.
    pub channels: Vec<ChannelDifference>,
    /// The channels that only one has.
    pub single: Vec<String>,
    /// The number of pixels with any value beyond the tolerance.
    pub pixels_beyond: u64,
    /// The root of the mean square of all channels together.
    pub rms: f64,
    /// The peak signal-to-noise ratio of all channels together, in decibels; infinite when they are equal.
    pub psnr: f64,
    /// The largest magnitude.
    pub max: f32,
    /// The mean and largest perceived difference (FLIP), from 0 to 1.
    pub flip: Option<(f64, f32)>,
    /// True when one of them was decoded, because it is encoded for a screen and the other is linear.
    pub decoded: bool,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    count: u64,
    magnitude: f64,
    signed: f64,
    squares: f64,
    max: f32,
    at: (u32, u32),
    beyond: u64,
    broken: u64,
}

/// Compares the largest levels of two pages.
///
/// Channels are paired by name. Integers are fractions of their range. Where one page has integers of encoded
/// colours and the other has floats, the integers are decoded. Values that are not finite are equal only to the
/// same value.
///
/// # Errors
/// Returns an error when sizes differ, no channel is common to both, or one cannot be read.
pub fn compare(a: &Page, b: &Page, options: &CompareOptions) -> Result<Comparison> {
    let (sa, sb) = (a.spec(), b.spec());
    let size = (sa.width, sa.height);
    same_size(sa, sb)?;
    let ChannelPairs { pairs, single } = paired(a, b)?;
    let decoded = a.encoded != b.encoded;
    let (sums, pixels_beyond) = sums(a, b, &pairs, options.tolerance)?;
    let channels: Vec<ChannelDifference> =
        pairs.iter().zip(&sums).map(|((i, _), s)| s.finish(&sa.channels[*i])).collect();
    let count: u64 = sums.iter().map(|s| s.count).sum();
    let rms = (sums.iter().map(|s| s.squares).sum::<f64>() / count.max(1) as f64).sqrt();
    let pixels = u64::from(size.0) * u64::from(size.1);
    let flip = match options.flip && pixels <= FLIP_PIXELS {
        true => flip_of(a, b, options)?,
        false => None,
    };
    Ok(Comparison {
        size,
        max: channels.iter().map(|c| c.max).fold(0.0, f32::max),
        channels,
        single,
        pixels_beyond,
        rms,
        psnr: 20.0 * (f64::from(options.peak) / rms).log10(),
        flip,
        decoded,
    })
}

/// The channels of two pages.
struct ChannelPairs {
    /// The indices of the channels that are compared, in the first and in the second page.
    pairs: Vec<(usize, usize)>,
    /// The names of the channels that only one page has.
    single: Vec<String>,
}

/// Pairs the channels of two pages.
///
/// # Errors
/// Returns an error when no channel is common to both.
fn paired(a: &Page, b: &Page) -> Result<ChannelPairs> {
    let (sa, sb) = (a.spec(), b.spec());
    let mut pairs = Vec::new();
    let mut single = Vec::new();
    for (i, name) in sa.channels.iter().enumerate() {
        match sb.channels.iter().position(|n| n == name) {
            Some(j) => pairs.push((i, j)),
            None => single.push(name.clone()),
        }
    }
    single.extend(sb.channels.iter().filter(|n| !sa.channels.contains(n)).cloned());
    // Without a common name, images with the same number of channels are paired by index. Not every format can store
    // all names.
    if pairs.is_empty() && sa.nchannels() == sb.nchannels() {
        pairs = (0..sa.nchannels()).map(|c| (c, c)).collect();
        single.clear();
    }
    // Grey is compared with each colour.
    let colors = |page: &Page| -> Vec<usize> {
        let layer = &page.layers[0];
        layer.channels.iter().copied().filter(|c| Some(*c) != layer.alpha).collect()
    };
    if pairs.is_empty() {
        let (p, q) = (colors(a), colors(b));
        if p.len() == 1 || q.len() == 1 {
            pairs = p.iter().flat_map(|i| q.iter().map(|j| (*i, *j))).collect();
            single.clear();
        }
    }
    if pairs.is_empty() {
        let what =
            format!("no channel is common to both: {} and {}", sa.channels.join(" "), sb.channels.join(" "));
        return Err(ViewError::Misuse { what });
    }
    Ok(ChannelPairs { pairs, single })
}

/// Returns the sums over all pixels of the largest levels for each pair of channels, and the number of pixels with any
/// value beyond the tolerance.
///
/// # Errors
/// Returns an error when one page cannot be read.
fn sums(a: &Page, b: &Page, pairs: &[(usize, usize)], tolerance: f32) -> Result<(Vec<Sums>, u64)> {
    let mut sums = vec![Sums::default(); pairs.len()];
    let (mut pixels_beyond, mut last) = (0, None);
    // Pixels come in a fixed order, so that the sums are always the same. The pairs of a pixel follow each other.
    each_pixel(a, b, pairs, |at, k, u, v| {
        if sums[k].add(u, v, at, tolerance) && last != Some(at) {
            pixels_beyond += 1;
            last = Some(at);
        }
    })?;
    Ok((sums, pixels_beyond))
}

impl Sums {
    /// Adds a pair of values. Returns true when they differ by more than the tolerance, or when one is not finite and
    /// the other is different.
    fn add(&mut self, u: f32, v: f32, at: (u32, u32), tolerance: f32) -> bool {
        if !u.is_finite() || !v.is_finite() {
            let alike = u == v || u.is_nan() && v.is_nan();
            self.broken += u64::from(!alike);
            self.beyond += u64::from(!alike);
            return !alike;
        }
        let d = f64::from(u) - f64::from(v);
        let size = d.abs() as f32;
        self.count += 1;
        self.magnitude += d.abs();
        self.signed += d;
        self.squares += d * d;
        if size > self.max {
            (self.max, self.at) = (size, at);
        }
        let beyond = size > tolerance;
        self.beyond += u64::from(beyond);
        beyond
    }

    fn finish(&self, name: &str) -> ChannelDifference {
        let n = self.count.max(1) as f64;
        ChannelDifference {
            name: name.to_owned(),
            count: self.count,
            mean: self.magnitude / n,
            bias: self.signed / n,
            rms: (self.squares / n).sqrt(),
            max: self.max,
            max_at: self.at,
            beyond: self.beyond,
            broken: self.broken,
        }
    }
}

/// Returns the perceived difference of the first layers for each pixel; `None` when one of them does not contain
/// colours.
fn flip_map(a: &Page, b: &Page, options: &CompareOptions) -> Result<Option<Vec<f32>>> {
    let color = |page: &Page| page.layers[0].meaning == crate::Meaning::Color;
    if !color(a) || !color(b) {
        return Ok(None);
    }
    let (one, two) = (linear_colors(a, options.exposure)?, linear_colors(b, options.exposure)?);
    Ok(Some(flip::flip(&one, &two, a.spec().width as usize, options.pixels_per_degree)))
}

/// Returns the mean and the largest perceived difference of the first layers.
fn flip_of(a: &Page, b: &Page, options: &CompareOptions) -> Result<Option<(f64, f32)>> {
    Ok(flip_map(a, b, options)?.map(|map| {
        let mean = map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len() as f64;
        (mean, map.iter().copied().fold(0.0, f32::max))
    }))
}

/// Returns the perceived difference of the largest levels of two pages, as a page with the one channel `FLIP`, from
/// 0 (no difference) to 1, at the position of the first. Its mean is that of [`Comparison::flip`] for the same
/// options.
///
/// # Errors
/// Returns an error when sizes differ, there are too many pixels, the first layers are not colours, or one cannot
/// be read.
pub fn flip_page(a: &Page, b: &Page, options: &CompareOptions, store: &TileStore) -> Result<Page> {
    let (sa, sb) = (a.spec(), b.spec());
    same_size(sa, sb)?;
    let asked = u64::from(sa.width) * u64::from(sa.height);
    if asked > FLIP_PIXELS {
        return Err(ViewError::Limit { what: "pixels of a perceptual comparison", asked, max: FLIP_PIXELS });
    }
    let no_colors = || ViewError::Misuse { what: "a perceptual comparison needs colours".to_owned() };
    let values = flip_map(a, b, options)?.ok_or_else(no_colors)?;
    Ok(page_like(sa, "FLIP", vec!["FLIP".to_owned()], values, store))
}

/// Returns a page of floats in memory, at the position of another image. `values` are in rows from the top.
fn page_like(
    like: &ImageSpec,
    name: &str,
    channels: Vec<String>,
    values: Vec<f32>,
    store: &TileStore,
) -> Page {
    let mut spec = ImageSpec::new(like.width, like.height, channels.len(), PixelType::Float);
    let plane = Plane { width: like.width, height: like.height, channels: channels.len(), values };
    spec.channels = channels;
    (spec.x, spec.y) = (like.x, like.y);
    (spec.full_x, spec.full_y) = (like.full_x, like.full_y);
    (spec.full_width, spec.full_height) = (like.full_width, like.full_height);
    Page::from_source(name, spec, Arc::new(plane), store)
}

/// Returns the magnitudes of the differences of the largest levels of two pages, `scale |a - b|`, at the position of
/// the first. Values are converted and channels are paired as by [`compare`]. Where one value is not finite and the
/// other is different, the difference is infinite.
///
/// # Errors
/// Returns the errors of [`compare`], and an error when there are too many values.
pub fn difference_page(a: &Page, b: &Page, scale: f32, store: &TileStore) -> Result<Page> {
    let (sa, sb) = (a.spec(), b.spec());
    same_size(sa, sb)?;
    let ChannelPairs { pairs, .. } = paired(a, b)?;
    let asked = u64::from(sa.width) * u64::from(sa.height) * pairs.len() as u64;
    if asked > 4 * FLIP_PIXELS {
        return Err(ViewError::Limit { what: "values of a difference", asked, max: 4 * FLIP_PIXELS });
    }
    let mut values = vec![0.0; asked as usize];
    let width = sa.width as usize;
    each_pixel(a, b, &pairs, |(x, y), k, u, v| {
        let alike = u == v || u.is_nan() && v.is_nan();
        let difference = if u.is_finite() && v.is_finite() { (u - v).abs() * scale } else { f32::INFINITY };
        values[(y as usize * width + x as usize) * pairs.len() + k] = if alike { 0.0 } else { difference };
    })?;
    // Grey is paired with each colour.
    let is_grey = pairs.len() > 1 && pairs.iter().all(|(i, _)| *i == pairs[0].0);
    let name =
        |(i, j): &(usize, usize)| if is_grey { sb.channels[*j].clone() } else { sa.channels[*i].clone() };
    Ok(page_like(sa, "difference", pairs.iter().map(name).collect(), values, store))
}

/// Calls `visit` with the position, the number of the pair and the two converted values, for each value of the largest
/// levels of two pages of one size. Tiles are visited in order.
fn each_pixel(
    a: &Page,
    b: &Page,
    pairs: &[(usize, usize)],
    mut visit: impl FnMut((u32, u32), usize, f32, f32),
) -> Result<()> {
    let size = (a.spec().width, a.spec().height);
    let decoded = a.encoded != b.encoded;
    let alpha = |name: &str| name == "A" || name.eq_ignore_ascii_case("alpha");
    let convert = |page: &Page, channel: usize, v: f32| {
        let decode = decoded && page.encoded && !alpha(&page.spec().channels[channel]);
        if decode { srgb_decode(v) } else { v }
    };
    for (ty, tx) in
        (0..size.1.div_ceil(TILE)).flat_map(|ty| (0..size.0.div_ceil(TILE)).map(move |tx| (ty, tx)))
    {
        let (p, q) = (a.pyramid.tile(0, tx, ty)?, b.pyramid.tile(0, tx, ty)?);
        for (y, x) in (0..p.height).flat_map(|y| (0..p.width).map(move |x| (y, x))) {
            let pixel = (y * p.width + x) as usize;
            for (k, (i, j)) in pairs.iter().enumerate() {
                let u = convert(a, *i, p.pixels.get(pixel * p.channels + i));
                let v = convert(b, *j, q.pixels.get(pixel * q.channels + j));
                visit((tx * TILE + x, ty * TILE + y), k, u, v);
            }
        }
    }
    Ok(())
}

/// Returns an error when two images differ in size.
fn same_size(a: &ImageSpec, b: &ImageSpec) -> Result<()> {
    if (a.width, a.height) == (b.width, b.height) {
        return Ok(());
    }
    let what =
        format!("{} x {} pixels cannot be compared with {} x {}", a.width, a.height, b.width, b.height);
    Err(ViewError::Misuse { what })
}

/// Returns the colours of the first layer in linear light, exposed and clamped to 0 to 1. NaN becomes 0.
fn linear_colors(page: &Page, exposure: f32) -> Result<Vec<[f32; 3]>> {
    let (width, height) = (page.spec().width, page.spec().height);
    let mut out = vec![[0.0; 3]; width as usize * height as usize];
    let pick = crate::Display::default().pick(&page.layers[0]);
    let gain = exposure.exp2();
    let (mut scratch, mut row) = (Vec::new(), Vec::new());
    for (ty, tx) in
        (0..height.div_ceil(TILE)).flat_map(|ty| (0..width.div_ceil(TILE)).map(move |tx| (ty, tx)))
    {
        let tile: &Tile = &*page.pyramid.tile(0, tx, ty)?;
        for y in 0..tile.height {
            row.clear();
            tile.append_row((0, tile.width, y), &pick, &mut scratch, &mut row);
            let at = (ty * TILE + y) as usize * width as usize + (tx * TILE) as usize;
            for (out, [r, g, b, _]) in out[at..].iter_mut().zip(&row) {
                *out = [*r, *g, *b].map(|v| {
                    let v = if page.encoded { srgb_decode(v) } else { v } * gain;
                    if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) }
                });
            }
        }
    }
    Ok(out)
}
