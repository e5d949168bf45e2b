//! Plain textures by the conventions of OpenImageIO whose image is not in memory as a whole.
//!
//! Their hash and their statistics are stored before their texels, so that the rows of the image are read twice: for
//! these, and for the levels. Each level is made while the one above it is written.

use super::bump::{Content, Slopes};
use super::flat::Bump;
use super::kernel::Kernel;
use super::picture::{ChannelStatistics, RowStatistics};
use super::reduction::Reduction;
use super::scan::{HASHED_ROWS, hexadecimal, update};
use super::source::{Source, Texels};
use super::{MakeOptions, Mode};
use crate::error::{Result, TextureError};
use crate::image::Image;
use crate::pyramid::level_sizes;
use granita_image::Pixels;
use rayon::prelude::*;
use sha1::{Digest, Sha1};

/// The largest finite half.
const LARGEST_HALF: f32 = 65504.0;

/// The number of rows that one task computes together.
const ROWS: usize = 16;

/// The largest number of parts of the hash that are computed together.
const MOST_PARTS: usize = 8;

/// The number of rows of a level that are in memory together, if tiles are not higher.
const PORTION: usize = 64;

/// Makes values storable as halves, by the rules of OpenImageIO. `alpha` is the index of the alpha channel among `n`.
pub(crate) fn limit_to_halves(values: &mut [f32], n: usize, alpha: Option<usize>) {
    // NaN becomes the lowest value.
    let limited = |v: f32| if v.is_nan() { -LARGEST_HALF } else { v.clamp(-LARGEST_HALF, LARGEST_HALF) };
    values.iter_mut().for_each(|v| *v = limited(*v));
    if let Some(alpha) = alpha {
        values.iter_mut().skip(alpha).step_by(n).for_each(|v| *v = v.clamp(0.0, 1.0));
    }
}

/// The rows of the first level, which are computed from those of a file.
pub(crate) struct Rows {
    source: Source,
    texels: Texels,
    slopes: Option<Slopes>,
}

/// Rows of a file.
struct Strip {
    /// The rows of the level that can be computed from them.
    rows: std::ops::Range<usize>,
    /// The first row of the file that is there.
    first: usize,
    pixels: Pixels,
}

/// Reads strips from the top.
struct Strips<'a> {
    source: &'a Source,
    /// The number of rows above and below that a row depends on.
    margin: usize,
    next: usize,
    /// The last rows that were read, which the next strip needs, too, and their first row.
    kept: (usize, Pixels),
}

impl Strips<'_> {
    /// Returns the next `count` rows; `None` behind the last.
    fn next(&mut self, count: usize) -> Result<Option<Strip>> {
        let height = self.source.height;
        let rows = self.next..(self.next + count).min(height);
        if rows.is_empty() {
            return Ok(None);
        }
        let row = self.source.width * self.source.channels;
        let (first, end) = (rows.start.saturating_sub(self.margin), (rows.end + self.margin).min(height));
        let (kept_first, kept) = &self.kept;
        let kept_end = kept_first + kept.len() / row;
        let mut pixels = if kept_end < end { Some(self.source.rows(kept_end, end)?) } else { None };
        if first < kept_end || pixels.is_none() {
            let mut all = Pixels::zeros(kept.pixel_type(), (end - first) * row);
            let above = (kept_end - first) * row;
            all.copy_from(0, kept, (first - kept_first) * row, above);
            if let Some(read) = pixels {
                all.copy_from(above, &read, 0, read.len());
            }
            pixels = Some(all);
        }
        let pixels = pixels.unwrap_or_else(|| Pixels::zeros(kept.pixel_type(), 0));
        let keep = rows.end.saturating_sub(self.margin).max(first);
        let mut kept = Pixels::zeros(pixels.pixel_type(), (end - keep) * row);
        kept.copy_from(0, &pixels, (keep - first) * row, kept.len());
        self.kept = (keep, kept);
        self.next = rows.end;
        Ok(Some(Strip { rows, first, pixels }))
    }
}

/// What has to be known of the first level before it is written.
pub(crate) struct Scanned {
    pub(crate) statistics: Vec<ChannelStatistics>,
    /// True when a value is not finite.
    pub(crate) is_broken: bool,
    /// The hash in hexadecimal digits.
    pub(crate) hash: String,
}

impl Rows {
    /// True when the first level of a texture is the image of this file, perhaps as slopes, and its rows alone decide
    /// over it.
    pub(crate) fn suit(source: &Source, options: &MakeOptions) -> bool {
        let (spec, flat) = (&source.spec, &options.flat);
        let (width, height) = (spec.width, spec.height);
        let full = (spec.full_width, spec.full_height);
        let kernel = flat.filter.as_ref().map_or(Kernel::Box, |filter| filter.kernel);
        options.mode == Mode::Plain
            && flat.is_peer()
            && !options.hash
            && !kernel.is_radial()
            && (source.width, source.height) == (width as usize, height as usize)
            && (full == (width, height) || full.0 == 0 || full.1 == 0)
            && [spec.x, spec.y, spec.full_x, spec.full_y] == [0; 4]
            && !(options.resize && !(width.is_power_of_two() && height.is_power_of_two()))
            && flat.channels.is_none_or(|count| flat.bump.is_none() && count == source.channels)
            && !(flat.probe || flat.drop_opaque || flat.drop_equal || flat.compress_highlights)
            && flat.sharpen == 0.0
            && flat.distribution.is_none()
            && flat.neighbours.is_empty()
            && flat.level_files.is_empty()
    }

    /// Returns the rows of an image, or those of its slopes.
    ///
    /// # Errors
    /// Returns an error when the file cannot be read, or when the image has no slopes.
    pub(crate) fn new(source: Source, texels: Texels, bump: Option<&Bump>) -> Result<Self> {
        let mut rows = Self { source, texels, slopes: None };
        if let Some(bump) = bump {
            let source = &rows.source;
            let (size, n) = ((source.width, source.height), source.channels);
            let content = if bump.depends_on_content(n) { Some(rows.content()?) } else { None };
            let slopes = Slopes::new(bump, size, n, || content.unwrap_or(Content::NONE));
            let malformed = |what| TextureError::Malformed { path: source.path.clone(), what };
            rows.slopes = Some(slopes.map_err(malformed)?);
        }
        Ok(rows)
    }

    /// Returns the bytes of memory that such a texture takes: those of two levels after the first, and of rows.
    pub(crate) fn bytes(source: &Source, options: &MakeOptions) -> u64 {
        let channels = if options.flat.bump.is_some() { 6 } else { source.channels };
        let level = (source.width as u64 / 2).saturating_mul(source.height as u64 / 2);
        let strip = HASHED_ROWS * rayon::current_num_threads().clamp(1, MOST_PARTS);
        let rows = (source.width as u64).saturating_mul(2 * strip as u64);
        (level + level / 2).saturating_add(rows).saturating_mul(4 * channels as u64)
    }

    /// The file.
    pub(crate) fn source(&self) -> &Source {
        &self.source
    }

    /// Returns the file.
    pub(crate) fn into_source(self) -> Source {
        self.source
    }

    /// The width and the height in texels.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.source.width, self.source.height)
    }

    /// The number of channels.
    pub(crate) fn channels(&self) -> usize {
        if self.slopes.is_some() { 6 } else { self.source.channels }
    }

    /// Calls `each` with strips of `count` rows from the top. While one is used, the next one is read.
    fn strips(&self, count: usize, mut each: impl FnMut(Strip) -> Result<()> + Send) -> Result<()> {
        let kept = (0, Pixels::zeros(self.source.spec.pixel_type, 0));
        let margin = usize::from(self.slopes.is_some());
        let mut strips = Strips { source: &self.source, margin, next: 0, kept };
        let mut strip = strips.next(count)?;
        while let Some(current) = strip {
            let (next, done) = rayon::join(|| strips.next(count), || each(current));
            done?;
            strip = next?;
        }
        Ok(())
    }

    /// Returns what the interpretation of a map of slopes depends on.
    fn content(&self) -> Result<Content> {
        let (width, n) = (self.source.width, self.source.channels);
        let (mut is_grey, mut has_negative) = (true, false);
        self.strips(HASHED_ROWS, |strip| {
            let rows = (0..strip.rows.len()).into_par_iter().map(|y| {
                let mut row = vec![0.0; width * n];
                self.texels.fill(&strip.pixels, y * width * n, &mut row);
                let is_grey = row.chunks_exact(n).all(|texel| texel.iter().all(|v| *v == texel[0]));
                (is_grey, row.iter().any(|v| v.is_finite() && *v < 0.0))
            });
            let (grey, negative) = rows.reduce(|| (true, false), |a, b| (a.0 && b.0, a.1 || b.1));
            (is_grey, has_negative) = (is_grey && grey, has_negative || negative);
            Ok(())
        })?;
        Ok(Content { is_grey, has_negative })
    }

    /// Computes rows from `y` on, as many as `out` holds.
    fn fill(&self, strip: &Strip, y: usize, out: &mut [f32]) {
        let row = self.source.width * self.source.channels;
        let Some(slopes) = &self.slopes else {
            return self.texels.fill(&strip.pixels, (y - strip.first) * row, out);
        };
        let out_row = self.source.width * 6;
        let count = out.len() / out_row;
        let (top, end) = (y.saturating_sub(1), (y + count + 1).min(self.source.height));
        let mut linear = vec![0.0; (end - top) * row];
        self.texels.fill(&strip.pixels, (top - strip.first) * row, &mut linear);
        for (i, out) in out.chunks_exact_mut(out_row).enumerate() {
            let near = |y: usize| &linear[(y.clamp(top, end - 1) - top) * row..][..row];
            let above = (y + i).saturating_sub(1);
            slopes.row([near(above), near(y + i), near(y + i + 1)], self.source.channels, out);
        }
    }

    /// Returns the hash and the statistics. `words` are the options that are part of the hash.
    pub(crate) fn scan(&self, words: &str) -> Result<Scanned> {
        let ((width, height), n) = (self.size(), self.channels());
        let mut rows = Vec::with_capacity(height);
        let mut parts: Vec<Sha1> = Vec::new();
        // One task computes the rows whose hash is one part.
        self.strips(HASHED_ROWS * rayon::current_num_threads().clamp(1, MOST_PARTS), |strip| {
            let tops: Vec<usize> = strip.rows.clone().step_by(HASHED_ROWS).collect();
            let done: Vec<(Sha1, Vec<RowStatistics>)> = tops
                .into_par_iter()
                .map(|top| {
                    let end = (top + HASHED_ROWS).min(strip.rows.end);
                    let (mut sha1, mut rows) = (Sha1::new(), Vec::with_capacity(end - top));
                    let mut values = vec![0.0; ROWS * width * n];
                    for y in (top..end).step_by(ROWS) {
                        let values = &mut values[..ROWS.min(end - y) * width * n];
                        self.fill(&strip, y, values);
                        update(&mut sha1, values);
                        rows.extend(values.chunks(width * n).map(|row| RowStatistics::of(row, n)));
                    }
                    (sha1, rows)
                })
                .collect();
            for (sha1, mut some) in done {
                parts.push(sha1);
                rows.append(&mut some);
            }
            Ok(())
        })?;
        let is_broken = rows.iter().any(|row| row.finite() < width as u64);
        let hash = hash_of_parts(parts, words);
        Ok(Scanned { statistics: RowStatistics::total(&rows, n), is_broken, hash })
    }
}

/// Returns the hash of an image from those of its parts and the words of options. The hash of an image of one part is
/// not that of a text.
pub(crate) fn hash_of_parts(parts: Vec<Sha1>, words: &str) -> String {
    let mut all = Sha1::new();
    match <[Sha1; 1]>::try_from(parts) {
        Ok([part]) => all = part,
        Err(parts) => parts.into_iter().for_each(|part| all.update(hexadecimal(part))),
    }
    all.update(words);
    hexadecimal(all)
}

/// A texture whose levels are made while they are written.
pub(crate) struct Bands {
    pub(crate) rows: Rows,
    pub(crate) kernel: Kernel,
    /// True when there are MIP levels after the first.
    pub(crate) levels: bool,
    /// The index of the alpha channel.
    pub(crate) alpha: Option<usize>,
    /// True when values have to be storable as halves.
    pub(crate) halves: bool,
}

impl Bands {
    /// Returns the sizes of all levels.
    pub(crate) fn sizes(&self) -> Vec<(usize, usize)> {
        let (width, height) = self.rows.size();
        if self.levels { level_sizes(width, height) } else { vec![(width, height)] }
    }

    /// Returns the reduction from one level to the next.
    fn reduction(&self, from: (usize, usize), to: (usize, usize)) -> Reduction {
        let n = self.rows.channels();
        let resampling = match self.kernel {
            Kernel::Box => None,
            kernel => Reduction::resampling(from, to, n, kernel),
        };
        resampling.unwrap_or_else(|| Reduction::interpolation(from, to, n, false))
    }

    /// Calls `each` with the index of a level and its next rows, for all levels. The rows of all portions but the last
    /// of a level fill whole tiles of `tile_height`.
    ///
    /// # Errors
    /// Returns an error when the file cannot be read, and that of `each`.
    pub(crate) fn write(
        &self,
        tile_height: usize,
        mut each: impl FnMut(usize, Vec<f32>) -> Result<()> + Send,
    ) -> Result<()> {
        let sizes = self.sizes();
        let n = self.rows.channels();
        let count = PORTION.next_multiple_of(tile_height.max(1));
        let mut above: Option<Image> = None;
        for (level, size) in sizes.iter().enumerate() {
            let mut next = sizes.get(level + 1).map(|to| self.reduction(*size, *to));
            let row = size.0 * n;
            let mut portion = |mut values: Vec<f32>| {
                if self.halves {
                    let chunks = values.par_chunks_mut(ROWS * row);
                    chunks.for_each(|values| limit_to_halves(values, n, self.alpha));
                }
                if let Some(next) = &mut next {
                    next.push(&values);
                }
                each(level, values)
            };
            match above.take() {
                None => self.rows.strips(count, |strip| {
                    let mut values = vec![0.0; strip.rows.len() * row];
                    values
                        .par_chunks_mut(ROWS * row)
                        .enumerate()
                        .for_each(|(i, values)| self.rows.fill(&strip, strip.rows.start + i * ROWS, values));
                    portion(values)
                })?,
                Some(image) => {
                    image.data.chunks(count * row).try_for_each(|values| portion(values.to_vec()))?;
                }
            }
            above = next.map(Reduction::finish);
        }
        Ok(())
    }
}
