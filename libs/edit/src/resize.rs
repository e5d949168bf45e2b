//! Other sizes, and blur.

use crate::image::{Image, Shape, Source, Window};
use crate::taps::{Axis, Scale, Taps, blur_reach};
use crate::window::band;
use crate::{EditError, Result};
use granita_image::{PixelType, Pixels};
use granita_texture::make::Kernel;
use parking_lot::Mutex;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// A source filtered across and down, row after row. Rows that are filtered across are kept as long as the next rows
/// need them.
struct Filtered {
    from: Arc<dyn Source>,
    across: Taps,
    down: Taps,
    /// The index of the first kept row, and the rows.
    kept: Mutex<(u32, VecDeque<Vec<f32>>)>,
}

impl Filtered {
    fn new(from: Arc<dyn Source>, across: Taps, down: Taps) -> Self {
        Self { from, across, down, kept: Mutex::new((0, VecDeque::new())) }
    }

    /// Appends the rows `y0..y1` of the source, filtered across.
    fn filter_across(&self, y0: u32, y1: u32, out: &mut VecDeque<Vec<f32>>) -> Result<()> {
        let shape = self.from.shape();
        let step = band(&shape);
        let mut y = y0;
        while y < y1 {
            // Parts end where the blocks of files end.
            let end = ((y / step + 1) * step).min(y1);
            let rows = self.from.rows(y, end)?;
            let row = shape.row();
            let filtered: Vec<Vec<f32>> = (0..(end - y) as usize)
                .into_par_iter()
                .map_init(Vec::new, |room, i| {
                    let values = rows.floats_of(i * row..(i + 1) * row, room);
                    let mut to = vec![0.0; self.across.len() * shape.channels];
                    match shape.channels {
                        1 => across::<1>(values, &self.across, &mut to),
                        2 => across::<2>(values, &self.across, &mut to),
                        3 => across::<3>(values, &self.across, &mut to),
                        4 => across::<4>(values, &self.across, &mut to),
                        n => across_any(values, &self.across, &mut to, n),
                    }
                    to
                })
                .collect();
            out.extend(filtered);
            y = end;
        }
        Ok(())
    }
}

/// Filters a row of pixels with `N` channels.
fn across<const N: usize>(row: &[f32], taps: &Taps, out: &mut [f32]) {
    let (row, _) = row.as_chunks::<N>();
    let (out, _) = out.as_chunks_mut::<N>();
    for (o, to) in out.iter_mut().enumerate() {
        let (first, weights) = taps.at(o);
        let mut sum = [0.0; N];
        for (w, from) in weights.iter().zip(&row[first..]) {
            for c in 0..N {
                sum[c] += w * from[c];
            }
        }
        *to = sum;
    }
}

/// Filters a row of pixels with `n` channels.
fn across_any(row: &[f32], taps: &Taps, out: &mut [f32], n: usize) {
    for (o, to) in out.chunks_exact_mut(n).enumerate() {
        let (first, weights) = taps.at(o);
        for (w, from) in weights.iter().zip(row[first * n..].chunks_exact(n)) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += w * from);
        }
    }
}

impl Source for Filtered {
    fn shape(&self) -> Shape {
        Shape {
            width: self.across.len() as u32,
            height: self.down.len() as u32,
            pixel_type: PixelType::Float,
            ..self.from.shape()
        }
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let shape = self.shape();
        let row = shape.row();
        let needed = self.down.sources(y0 as usize..y1 as usize);
        // A request from another thread does not wait, and filters its rows itself.
        let mut kept = self.kept.try_lock();
        let (begin, mut rows) = match kept.as_deref_mut() {
            Some(kept) => std::mem::take(kept),
            None => Default::default(),
        };
        // Rows above are not needed again by requests of increasing rows.
        let useful = (begin..begin + rows.len() as u32).contains(&needed.start);
        if useful {
            rows.drain(..(needed.start - begin) as usize);
        } else {
            rows.clear();
        }
        let have = needed.start + rows.len() as u32;
        if have < needed.end {
            self.filter_across(have, needed.end, &mut rows)?;
        }
        let mut out = vec![0.0; (y1 - y0) as usize * row];
        out.par_chunks_mut(row.max(1)).enumerate().for_each(|(i, to)| {
            let (first, weights) = self.down.at(y0 as usize + i);
            for (j, w) in weights.iter().enumerate() {
                let from = &rows[first + j - needed.start as usize];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += w * from);
            }
        });
        if let Some(kept) = kept.as_deref_mut() {
            *kept = (needed.start, rows);
        }
        Ok(Pixels::Float(out))
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

/// A source filtered by a function of both directions.
struct Radial {
    from: Arc<dyn Source>,
    shape: Shape,
    kernel: Kernel,
    axes: [Axis; 2],
    /// The centres of destination pixels across and down, as source pixels and parts of them.
    centres: [Vec<(i64, f32)>; 2],
    ratio: (f32, f32),
    width: (f32, f32),
    reach: (i64, i64),
}

impl Source for Radial {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let [across, down] = &self.axes;
        let (columns, lines) = (&self.centres[0], &self.centres[1][y0 as usize..y1 as usize]);
        let n = self.shape.channels;
        let (rx, ry) = self.reach;
        let used = lines.iter().flat_map(|(at, _)| (at - ry..=at + ry).filter_map(|y| down.pixel(y)));
        let (Some(first), Some(last)) = (used.clone().min(), used.max()) else {
            return Ok(Pixels::zeros(PixelType::Float, (y1 - y0) as usize * self.shape.row()));
        };
        let block = crate::image::float_rows(&*self.from, first, last + 1)?;
        let width = self.from.shape().row();
        let mut out = vec![0.0; (y1 - y0) as usize * self.shape.row()];
        out.par_chunks_mut(self.shape.row().max(1)).zip(lines).for_each(|(row, (at_y, part_y))| {
            for (to, (at_x, part_x)) in row.chunks_exact_mut(n).zip(columns) {
                let mut total = 0.0;
                for j in -ry..=ry {
                    for i in -rx..=rx {
                        let place = (i as f32 - (part_x - 0.5), j as f32 - (part_y - 0.5));
                        let place = (self.ratio.0 * place.0, self.ratio.1 * place.1);
                        let w = self.kernel.weight_at(place, self.width);
                        total += w;
                        let pixel = across.pixel(at_x + i).zip(down.pixel(at_y + j));
                        if let Some((x, y)) = pixel.filter(|_| w != 0.0) {
                            let from = &block[(y - first) as usize * width + x as usize * n..][..n];
                            to.iter_mut().zip(from).for_each(|(to, from)| *to += w * from);
                        }
                    }
                }
                if total == 0.0 {
                    // A disk between pixels covers none of them.
                    if let Some((x, y)) = across.pixel(*at_x).zip(down.pixel(*at_y)) {
                        let from = &block[(y - first) as usize * width + x as usize * n..][..n];
                        to.copy_from_slice(from);
                    }
                    continue;
                }
                let total = 1.0 / total;
                to.iter_mut().for_each(|v| *v *= total);
            }
        });
        Ok(Pixels::Float(out))
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

/// The way in which an image gets another size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Resampling {
    /// A filter, or the default: `lanczos3` for a smaller image, `blackman-harris` for a larger one.
    Filter(Option<Kernel>),
    /// The nearest pixel, or with `true` the interpolation between pixels.
    Sample(bool),
}

/// The part of the window that `-fit` fills.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FillMode {
    /// The whole image is visible.
    #[default]
    Letterbox,
    /// The width of the window is filled.
    Width,
    /// The height of the window is filled.
    Height,
}

impl Image {
    fn axes(&self) -> [Axis; 2] {
        let (data, full) = (self.data(), self.full());
        [
            Axis { begin: data.x, count: data.width, full_begin: full.x, full_count: full.width },
            Axis { begin: data.y, count: data.height, full_begin: full.y, full_count: full.height },
        ]
    }

    /// Returns the image with another display window and the pixels of `data` in it. Pixels that the image does not
    /// have are 0; beyond its display window its border repeats.
    fn scaled(&self, full: &Window, data: &Window, resampling: Resampling) -> Result<Self> {
        let image = self.associated();
        let axes = image.axes();
        let to = [data.x..data.right(), data.y..data.bottom()];
        let to_full = [(full.x, full.width), (full.y, full.height)];
        let kernel = match resampling {
            Resampling::Filter(Some(kernel)) => Some(kernel),
            Resampling::Filter(None) => {
                let larger = full.width > axes[0].full_count || full.height > axes[1].full_count;
                Some(if larger { Kernel::BlackmanHarris } else { Kernel::Lanczos3 })
            }
            Resampling::Sample(_) => None,
        };
        let [columns, lines] = to;
        let source: Arc<dyn Source> = match (kernel, resampling) {
            (Some(kernel), _) if kernel.is_radial() => {
                let scale = |i: usize| Scale::new(&axes[i], to_full[i], kernel);
                let (x, y) = (scale(0), scale(1));
                Arc::new(Radial {
                    shape: Shape {
                        width: data.width,
                        height: data.height,
                        pixel_type: PixelType::Float,
                        ..image.source.shape()
                    },
                    from: image.source.clone(),
                    kernel,
                    axes,
                    centres: [columns.map(|o| x.centre(o)).collect(), lines.map(|o| y.centre(o)).collect()],
                    ratio: (x.ratio, y.ratio),
                    width: (x.width, y.width),
                    reach: (x.reach, y.reach),
                })
            }
            (Some(kernel), _) => {
                let across = Taps::resize(&axes[0], columns, to_full[0], kernel);
                let down = Taps::resize(&axes[1], lines, to_full[1], kernel);
                Arc::new(Filtered::new(image.source.clone(), across, down))
            }
            (None, sample) => {
                let linear = sample == Resampling::Sample(true);
                let across = Taps::sample(&axes[0], columns, to_full[0], linear);
                let down = Taps::sample(&axes[1], lines, to_full[1], linear);
                Arc::new(Filtered::new(image.source.clone(), across, down))
            }
        };
        image.with_source(source).placed(data.x, data.y)?.with_full(*full)
    }

    /// Returns the image with another display window. The data window is scaled with it.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when a side is 0, or a position exceeds 32 bits.
    pub fn resized(&self, full: &Window, resampling: Resampling) -> Result<Self> {
        let (old, data) = (self.full(), self.data());
        if old == *full {
            return Ok(self.clone());
        }
        if full.width == 0 || full.height == 0 {
            return Err(EditError::misuse(format!("a size of {} x {} pixels", full.width, full.height)));
        }
        let ratio = |to: u32, from: u32| to as f32 / from as f32;
        let (rx, ry) = (ratio(full.width, old.width), ratio(full.height, old.height));
        let begin =
            |to: i64, at: i64, from: i64, ratio: f32| to + ((at - from) as f32 * ratio).floor() as i64;
        let count = |n: u32, ratio: f32| ((n as f32 * ratio).ceil() as u32).max(1);
        let data = Window {
            x: begin(full.x, data.x, old.x, rx),
            y: begin(full.y, data.y, old.y, ry),
            width: count(data.width, rx),
            height: count(data.height, ry),
        };
        self.scaled(full, &data, resampling)
    }

    /// Returns the image in the largest size of its own proportions that fits into a window, in its middle. With `pad`
    /// the data window is extended by black pixels to the whole window.
    ///
    /// # Errors
    /// The errors of [`Image::resized`].
    pub fn fitted(&self, window: &Window, mode: FillMode, pad: bool, resampling: Resampling) -> Result<Self> {
        let old = self.full();
        let (w, h) = (
            f64::from(window.width) / f64::from(old.width),
            f64::from(window.height) / f64::from(old.height),
        );
        let scale = match mode {
            FillMode::Letterbox => w.min(h),
            FillMode::Width => w,
            FillMode::Height => h,
        };
        let side = |n: u32| (f64::from(n) * scale).round().clamp(1.0, f64::from(u32::MAX)) as u32;
        let (width, height) = (side(old.width), side(old.height));
        // Division that rounds towards zero, as integers do.
        let middle = |outer: u32, inner: u32| (i64::from(outer) - i64::from(inner)) / 2;
        let at = Window {
            x: window.x + middle(window.width, width),
            y: window.y + middle(window.height, height),
            width,
            height,
        };
        let image = if at == old { self.crop_to_full()? } else { self.scaled(&at, &at, resampling)? };
        let image = image.with_full(*window)?;
        if pad { image.crop_to_full() } else { Ok(image) }
    }

    /// Returns the image blurred by a filter over `width` x `height` pixels.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when a side is not from 0 to 4096.
    pub fn blurred(&self, (width, height): (f32, f32), kernel: Kernel) -> Result<Self> {
        if ![width, height].iter().all(|side| (0.0..=4096.0).contains(side)) {
            return Err(EditError::misuse(format!(
                "a blur over {width} x {height} pixels, 0 to 4096 are possible"
            )));
        }
        let image = self.associated();
        let axes = image.axes();
        let (width, height) = (width.max(1.0), height.max(1.0));
        if !kernel.is_radial() {
            let (across, down) = (Taps::blur(&axes[0], width, kernel), Taps::blur(&axes[1], height, kernel));
            return Ok(image.with_source(Arc::new(Filtered::new(image.source.clone(), across, down))));
        }
        let centres = [0, 1].map(|i| {
            let axis = &axes[i];
            (axis.begin..axis.begin + i64::from(axis.count)).map(|at| (at, 0.5)).collect()
        });
        Ok(image.with_source(Arc::new(Radial {
            shape: Shape { pixel_type: PixelType::Float, ..image.source.shape() },
            from: image.source.clone(),
            kernel,
            axes,
            centres,
            ratio: (1.0, 1.0),
            width: (width, height),
            reach: (blur_reach(width), blur_reach(height)),
        })))
    }

    /// Returns the image with `contrast` times its difference from a blurred one added, where that difference exceeds
    /// `threshold`.
    ///
    /// # Errors
    /// The errors of [`Image::blurred`].
    pub fn sharpened(&self, width: f32, kernel: Kernel, contrast: f32, threshold: f32) -> Result<Self> {
        let image = self.associated();
        let blurred = image.blurred((width, width), kernel)?;
        let from = vec![image.source.clone(), blurred.source.clone()];
        Ok(image.with_source(Arc::new(crate::pointwise::Combine::new(from, move |row, others| {
            for (v, b) in row.iter_mut().zip(others[0]) {
                let d = *v - b;
                if d.abs() > threshold {
                    *v += contrast * d;
                }
            }
        }))))
    }
}
