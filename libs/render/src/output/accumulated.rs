//! The sum of the passes of an image.
//!
//! A pixel of an image of passes is the mean of its values, weighted with the weights of their filter. Sums are formed
//! in double precision and in the order of the passes. A pixel has at most one value in a pass, so that neither threads
//! nor the order of buckets change them.
//!
//! Values that have no mean are combined as their filter combines samples: the least or greatest depth of all passes,
//! the position or number of the first pass. Coverages of mattes are summed by their ids.

mod noise;

use crate::PixelRect;
use crate::output::halves::{HalfMeans, Halves, SecondPasses};
use crate::output::plan::OutputImage;
use granita_hider::film::{NO_DEPTH, PixelFilter};
use std::collections::HashSet;

/// The side of the parts of an image that get passes together, in pixels.
pub(crate) const TILE: i32 = 32;

/// The weight of a value without samples in the support of its filter. It counts when no pass has any.
const UNSEEN: f64 = 1e-30;

/// The way in which passes of a layer are combined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Combine {
    Mean,
    Least,
    Greatest,
    /// The mean of the passes that see a surface.
    Depth,
    First,
    Mattes,
}

/// Some channels of an image that are combined alike.
#[derive(Clone, Copy, Debug)]
struct Layer {
    /// The first channel, and the number of channels.
    channels: [usize; 2],
    combine: Combine,
}

/// Returns the pixels of a rectangle, row by row.
fn places(rect: &PixelRect) -> impl Iterator<Item = [i32; 2]> + use<> {
    let PixelRect { x0, x1, y0, y1 } = *rect;
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| [x, y]))
}

/// The sum of the passes of an image.
pub(crate) struct Accumulated {
    rect: PixelRect,
    channels: usize,
    layers: Vec<Layer>,
    /// The channels whose error is estimated: colours that have a mean.
    colors: Vec<usize>,
    /// The layer of each of `colors`.
    layer_of: Vec<usize>,
    /// For each pixel, channel by channel: the weighted sum, or the combined value.
    sums: Vec<f64>,
    /// For each pixel and layer: the sum of the weights.
    weights: Vec<f64>,
    /// For each pixel: the weighted sum of the squares of its colours.
    squares: Vec<f64>,
    /// For each pixel: the number of passes.
    counts: Vec<u32>,
    /// For each pixel of each layer of mattes, one layer after the other: the ids with the sums of their coverages.
    mattes: Vec<Vec<(u32, f64)>>,
    /// The values of the pass that is rendered.
    fresh: Vec<(PixelRect, Vec<f32>)>,
    /// The values of a complete pass that is not added yet.
    waiting: Vec<(PixelRect, Vec<f32>)>,
    /// For each of the first passes: the colours of all pixels, which others are compared with. Empty unless they are.
    early: Vec<Vec<f32>>,
    /// The same of the passes that the last [`Accumulated::restart`] dropped.
    coarser: Vec<Vec<f32>>,
    /// True when it keeps them.
    keeps_coarser: bool,
    /// The colours of every second pass of each pixel; `None` where there are none.
    second: Option<SecondPasses>,
}

impl Accumulated {
    /// Returns the sum of no passes of an image, over these pixels.
    pub(crate) fn new(image: &OutputImage, rect: PixelRect) -> Self {
        let mut first = 0;
        let layer = |layer: &crate::output::plan::ImageLayer| {
            let combine = match layer.filter.filter {
                _ if layer.mattes.is_some() => Combine::Mattes,
                _ if image.opaque_width.is_some() => Combine::First,
                PixelFilter::Weighted(_) => Combine::Mean,
                PixelFilter::Min => Combine::Least,
                PixelFilter::Max => Combine::Greatest,
                PixelFilter::Average => Combine::Depth,
                PixelFilter::Closest => Combine::First,
            };
            let channels = [first, layer.channels.len()];
            first += layer.channels.len();
            Layer { channels, combine }
        };
        let layers: Vec<Layer> = image.layers.iter().map(layer).collect();
        let channels = image.channels();
        let of_channel = |c: usize| {
            layers.iter().position(|l| (l.channels[0]..l.channels[0] + l.channels[1]).contains(&c))
        };
        let is_color = |(_, is_color): &(usize, bool)| *is_color || image.is_error;
        let colors = image.colors().into_iter().enumerate().filter(is_color).map(|(c, _)| c);
        let (colors, layer_of): (Vec<usize>, Vec<usize>) = colors
            .filter_map(|c| Some((c, of_channel(c)?)))
            .filter(|(_, layer)| layers[*layer].combine == Combine::Mean)
            .unzip();
        let pixels = rect.width() * rect.height();
        let second = (!colors.is_empty()).then(|| SecondPasses::new(pixels, colors.len(), layers.len()));
        let of_mattes = layers.iter().filter(|layer| layer.combine == Combine::Mattes).count();
        Self {
            rect,
            channels,
            sums: vec![0.0; pixels * channels],
            weights: vec![0.0; pixels * layers.len()],
            squares: vec![0.0; if colors.is_empty() { 0 } else { pixels }],
            counts: vec![0; pixels],
            mattes: vec![Vec::new(); pixels * of_mattes],
            fresh: Vec::new(),
            waiting: Vec::new(),
            early: Vec::new(),
            coarser: Vec::new(),
            keeps_coarser: false,
            second,
            layers,
            colors,
            layer_of,
        }
    }

    /// Returns the sum of no passes, the first `passes` of which are kept for [`Accumulated::compare`] and
    /// [`Accumulated::early`].
    pub(crate) fn keeping(mut self, passes: u32) -> Self {
        let colors = self.counts.len() * self.colors.len();
        self.early = (0..passes).map(|_| vec![0.0; colors]).collect();
        self
    }

    /// Lets the next [`Accumulated::restart`] keep the first passes that it drops.
    pub(crate) fn keep_coarser(&mut self) {
        self.keeps_coarser = true;
    }

    /// True when it has the passes that the last [`Accumulated::restart`] dropped.
    pub(crate) fn has_coarser(&self) -> bool {
        self.coarser.iter().any(|colors| !colors.is_empty())
    }

    /// Takes the colours of all pixels in one of the passes that the last [`Accumulated::restart`] dropped; none when
    /// they were not kept.
    pub(crate) fn take_coarser(&mut self, pass: usize) -> Vec<f32> {
        self.coarser.get_mut(pass).map(std::mem::take).unwrap_or_default()
    }

    /// Keeps a complete pass for [`Accumulated::restart`].
    pub(crate) fn wait(&mut self) {
        self.waiting.append(&mut self.fresh);
    }

    /// Drops all passes, and adds the one that waits.
    pub(crate) fn restart(&mut self) {
        self.sums.fill(0.0);
        self.weights.fill(0.0);
        self.squares.fill(0.0);
        self.counts.fill(0);
        self.mattes.iter_mut().for_each(Vec::clear);
        self.second.iter_mut().for_each(SecondPasses::clear);
        let keeps = std::mem::take(&mut self.keeps_coarser);
        self.coarser = if keeps { self.early.clone() } else { Vec::new() };
        let fresh = std::mem::replace(&mut self.fresh, std::mem::take(&mut self.waiting));
        self.end_pass();
        self.fresh = fresh;
    }

    /// Returns the index of a pixel.
    fn pixel(&self, x: i32, y: i32) -> usize {
        (y - self.rect.y0) as usize * self.rect.width() + (x - self.rect.x0) as usize
    }

    /// Holds the values of a bucket until the pass is complete. `values` has the interleaved channels of its pixels,
    /// followed by the weights of each layer, layer by layer.
    pub(crate) fn hold(&mut self, rect: PixelRect, values: Vec<f32>) {
        self.fresh.push((rect, values));
    }

    /// Returns the first pixel of each bucket that is held.
    pub(crate) fn held(&self) -> HashSet<[i32; 2]> {
        self.fresh.iter().map(|(rect, _)| [rect.x0, rect.y0]).collect()
    }

    /// Drops the values of a pass that was not completed. Returns their pixels.
    pub(crate) fn drop_pass(&mut self) -> Vec<PixelRect> {
        std::mem::take(&mut self.fresh).into_iter().map(|(rect, _)| rect).collect()
    }

    /// Adds the values of a complete pass.
    pub(crate) fn end_pass(&mut self) {
        for (rect, values) in std::mem::take(&mut self.fresh) {
            let pixels = rect.width() * rect.height();
            let (values, weights) = values.split_at(pixels * self.channels);
            for (k, [x, y]) in places(&rect).enumerate() {
                let own = &values[k * self.channels..][..self.channels];
                self.add(self.pixel(x, y), own, &|layer| match weights.get(layer * pixels + k) {
                    // No sample is in the support of the filter. The value stands in for those of other passes.
                    Some(0.0) => UNSEEN,
                    weight => weight.copied().unwrap_or(1.0).into(),
                });
            }
        }
    }

    /// Adds a value of a pixel. `weight` returns the weight of each layer.
    fn add(&mut self, pixel: usize, values: &[f32], weight: &dyn Fn(usize) -> f64) {
        let Self { channels, layers, sums, weights, .. } = self;
        let is_first = self.counts[pixel] == 0;
        let sums = &mut sums[pixel * *channels..][..*channels];
        let mut of_mattes = 0;
        for (k, layer) in layers.iter().enumerate() {
            let [first, n] = layer.channels;
            let (sums, own) = (&mut sums[first..first + n], &values[first..first + n]);
            let total = &mut weights[pixel * layers.len() + k];
            match layer.combine {
                Combine::Mean => {
                    let w = weight(k);
                    *total += w;
                    sums.iter_mut().zip(own).for_each(|(sum, v)| *sum += w * f64::from(*v));
                }
                Combine::First if !is_first => (),
                Combine::Depth => {
                    if own.iter().all(|v| *v < NO_DEPTH) {
                        *total += 1.0;
                        sums.iter_mut().zip(own).for_each(|(sum, v)| *sum += f64::from(*v));
                    }
                }
                Combine::Least if !is_first => {
                    sums.iter_mut().zip(own).for_each(|(sum, v)| *sum = sum.min(f64::from(*v)));
                }
                Combine::Greatest if !is_first => {
                    // A pass that sees no surface has no depth.
                    let depth = |v: f64| if v < f64::from(NO_DEPTH) { v } else { f64::NEG_INFINITY };
                    for (sum, v) in sums.iter_mut().zip(own) {
                        let most = depth(*sum).max(depth(f64::from(*v)));
                        *sum = if most.is_finite() { most } else { f64::from(NO_DEPTH) };
                    }
                }
                Combine::First | Combine::Least | Combine::Greatest => {
                    sums.iter_mut().zip(own).for_each(|(sum, v)| *sum = f64::from(*v));
                }
                Combine::Mattes => {
                    let w = weight(k);
                    *total += w;
                    let seen = &mut self.mattes[of_mattes * self.counts.len() + pixel];
                    of_mattes += 1;
                    for [id, share] in own.as_chunks::<2>().0 {
                        let (id, share) = (id.to_bits(), w * f64::from(*share));
                        match seen.binary_search_by_key(&id, |(id, _)| *id) {
                            Ok(at) => seen[at].1 += share,
                            Err(at) if share > 0.0 => seen.insert(at, (id, share)),
                            Err(_) => (),
                        }
                    }
                }
            }
        }
        if let Some(square) = self.squares.get_mut(pixel) {
            for (c, layer) in self.colors.iter().zip(&self.layer_of) {
                let v = f64::from(values[*c]);
                *square += weight(*layer) * v * v;
            }
        }
        if let Some(early) = self.early.get_mut(self.counts[pixel] as usize) {
            let early = &mut early[pixel * self.colors.len()..][..self.colors.len()];
            self.colors.iter().zip(early).for_each(|(c, early)| *early = values[*c]);
        }
        if let Some(second) = self.second.as_mut().filter(|_| self.counts[pixel] % 2 == 1) {
            let colors = self.colors.iter().zip(&self.layer_of);
            second.add(pixel, colors.map(|(c, layer)| (*layer, f64::from(values[*c]))), weight);
        }
        self.counts[pixel] += 1;
    }

    /// Drops the values of a pass that differs from the first one in the random numbers of one source. Returns the
    /// part of the mean squared error of the pixels of a rectangle that comes from the source. The noise of all sources
    /// is taken to fall alike with the number of passes.
    pub(crate) fn compare(&mut self, rect: &PixelRect) -> f64 {
        let colors = self.colors.len().max(1);
        let (all, early) = (self.drop_colors(), self.early(0));
        let (mut sum, mut pixels) = (0.0, 0_usize);
        for [x, y] in places(rect) {
            let pixel = self.pixel(x, y);
            let part = pixel * colors..(pixel + 1) * colors;
            let Some((own, early)) = all.get(part.clone()).zip(early.get(part)) else { continue };
            // Half of the squared difference of two values is their variance.
            let squares = own.iter().zip(early).map(|(a, b)| f64::from(a - b).powi(2));
            let variance = squares.sum::<f64>() / (2 * colors) as f64;
            if variance.is_finite() {
                sum += variance / f64::from(self.counts[pixel].max(1));
                pixels += 1;
            }
        }
        self.spot(rect).part_of_independent() * sum / pixels.max(1) as f64
    }

    /// Returns the colours of all pixels in one of the passes that are kept.
    pub(crate) fn early(&self, pass: usize) -> &[f32] {
        self.early.get(pass).map_or(&[], Vec::as_slice)
    }

    /// Drops the values of a pass. Returns the colours of all pixels, NaN for pixels that the pass does not have.
    pub(crate) fn drop_colors(&mut self) -> Vec<f32> {
        let colors = self.colors.len();
        let mut all = vec![f32::NAN; self.counts.len() * colors];
        for (part, values) in std::mem::take(&mut self.fresh) {
            for ([x, y], own) in places(&part).zip(values.chunks_exact(self.channels.max(1))) {
                let out = &mut all[self.pixel(x, y) * colors..][..colors];
                self.colors.iter().zip(out).for_each(|(c, out)| *out = own[*c]);
            }
        }
        all
    }

    /// Returns the part of the colours of all pixels that lies in rectangles, one rectangle after the other.
    pub(crate) fn colors_in(&self, rects: &[PixelRect], all: &[f32]) -> Vec<f32> {
        let colors = self.colors.len();
        let rects = rects.iter().map(|rect| rect.intersection(&self.rect));
        let pixels = rects.flat_map(|rect| places(&rect)).map(|[x, y]| self.pixel(x, y));
        pixels.flat_map(|pixel| &all[pixel * colors..][..colors]).copied().collect()
    }

    /// Returns the number of values of colours in a rectangle.
    pub(crate) fn values_in(&self, rect: &PixelRect) -> usize {
        let rect = rect.intersection(&self.rect);
        rect.width() * rect.height() * self.colors.len()
    }

    /// Returns the sum of the squared differences between neighbouring pixels of a rectangle.
    pub(crate) fn contrast(&self, rect: &PixelRect) -> f64 {
        let colors = self.colors.len();
        let Some(first) = self.early.first() else { return 0.0 };
        let rect = rect.intersection(&self.rect);
        let color = |x: i32, y: i32| &first[self.pixel(x, y) * colors..][..colors];
        let squares = places(&rect).map(|[x, y]| {
            let beside = [[x + 1, y], [x, y + 1]].into_iter().filter(|[x, y]| *x < rect.x1 && *y < rect.y1);
            let own = color(x, y);
            let square = |[x, y]: [i32; 2]| {
                own.iter().zip(color(x, y)).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
            };
            beside.map(square).sum::<f64>()
        });
        squares.filter(|v| v.is_finite()).sum()
    }

    /// Returns the pixels of the completed passes in a rectangle, with interleaved channels. Pixels without a pass are
    /// 0.
    pub(crate) fn pixels(&self, rect: &PixelRect) -> Vec<f32> {
        let mut out = vec![0.0; rect.width() * rect.height() * self.channels];
        for ([x, y], out) in places(rect).zip(out.chunks_exact_mut(self.channels.max(1))) {
            let pixel = self.pixel(x, y);
            if self.counts[pixel] == 0 {
                continue;
            }
            let mut of_mattes = 0;
            for (k, layer) in self.layers.iter().enumerate() {
                let [first, n] = layer.channels;
                let total = self.weights[pixel * self.layers.len() + k];
                let sums = &self.sums[pixel * self.channels + first..][..n];
                let out = &mut out[first..first + n];
                match layer.combine {
                    Combine::Mean => {
                        out.iter_mut().zip(sums).for_each(|(out, sum)| *out = (sum / total) as f32)
                    }
                    Combine::Depth if total == 0.0 => out.fill(NO_DEPTH),
                    Combine::Depth => {
                        out.iter_mut().zip(sums).for_each(|(out, sum)| *out = (sum / total) as f32)
                    }
                    Combine::Mattes => {
                        let mut seen = self.mattes[of_mattes * self.counts.len() + pixel].clone();
                        of_mattes += 1;
                        // The sort is stable. Of two ids with the same coverage, that with the lesser bits is first.
                        seen.sort_by(|a, b| b.1.total_cmp(&a.1));
                        for (pair, (id, sum)) in out.as_chunks_mut::<2>().0.iter_mut().zip(&seen) {
                            *pair = [f32::from_bits(*id), (sum / total) as f32];
                        }
                    }
                    _ => out.iter_mut().zip(sums).for_each(|(out, sum)| *out = *sum as f32),
                }
            }
        }
        out
    }

    /// Returns the pixels of a bucket as they are with the values of the present pass, for viewers.
    pub(crate) fn with(&self, rect: &PixelRect, values: &[f32]) -> Vec<f32> {
        let mut part = Self {
            rect: *rect,
            channels: self.channels,
            layers: self.layers.clone(),
            colors: Vec::new(),
            layer_of: Vec::new(),
            sums: Vec::new(),
            weights: Vec::new(),
            squares: Vec::new(),
            counts: Vec::new(),
            mattes: Vec::new(),
            fresh: vec![(*rect, values.to_vec())],
            waiting: Vec::new(),
            early: Vec::new(),
            coarser: Vec::new(),
            keeps_coarser: false,
            second: None,
        };
        let rows = || (rect.y0..rect.y1).map(|y| self.pixel(rect.x0, y));
        for row in rows() {
            let (n, layers) = (rect.width(), self.layers.len());
            part.sums.extend_from_slice(&self.sums[row * self.channels..][..n * self.channels]);
            part.weights.extend_from_slice(&self.weights[row * layers..][..n * layers]);
            part.counts.extend_from_slice(&self.counts[row..][..n]);
        }
        for of_layer in self.mattes.chunks(self.counts.len().max(1)) {
            rows().for_each(|row| part.mattes.extend_from_slice(&of_layer[row..][..rect.width()]));
        }
        part.end_pass();
        part.pixels(rect)
    }

    /// Returns the means of two halves of the passes of the pixels of a rectangle; `None` where they were not kept, and
    /// before the second pass.
    pub(crate) fn halves(&self, rect: &PixelRect) -> Option<HalfMeans> {
        let second =
            self.second.as_ref().filter(|_| places(rect).any(|[x, y]| self.counts[self.pixel(x, y)] > 1))?;
        let mut halves =
            HalfMeans { channels: self.colors.clone(), width: rect.width(), ..HalfMeans::default() };
        for [x, y] in places(rect) {
            let pixel = self.pixel(x, y);
            for (k, (c, layer)) in self.colors.iter().zip(&self.layer_of).enumerate() {
                let sum = self.sums[pixel * self.channels + c];
                let weight = self.weights[pixel * self.layers.len() + layer];
                let Halves { means, .. } = second.halves(pixel, [k, *layer], [sum, weight]);
                halves.means.iter_mut().zip(means).for_each(|(all, mean)| all.push(mean as f32));
            }
            let passes = self.counts[pixel];
            halves.shares.push(passes.div_ceil(2) as f32 / passes.max(1) as f32);
        }
        Some(halves)
    }

    /// Returns the number of values of a pixel whose error is estimated.
    pub(crate) fn colors(&self) -> usize {
        self.colors.len()
    }

    /// Returns the squares of `side` pixels that cover a rectangle, row by row, cut along multiples of `side`.
    pub(crate) fn cut(rect: &PixelRect, side: i32) -> Vec<PixelRect> {
        let cuts = |from: i32, to: i32| {
            let first = from.div_euclid(side) * side;
            (first..to).step_by(side as usize).map(move |a| [a.max(from), (a + side).min(to)])
        };
        cuts(rect.y0, rect.y1)
            .flat_map(|[y0, y1]| cuts(rect.x0, rect.x1).map(move |[x0, x1]| PixelRect { x0, x1, y0, y1 }))
            .collect()
    }

    /// Returns the index of the square of [`Accumulated::cut`] that has a pixel.
    pub(crate) fn place_in_cut(rect: &PixelRect, side: i32, [x, y]: [i32; 2]) -> usize {
        let number = |at: i32, from: i32| at.div_euclid(side) - from.div_euclid(side);
        let columns = number(rect.x1 - 1, rect.x0) + 1;
        usize::try_from(number(y, rect.y0) * columns + number(x, rect.x0)).unwrap_or(usize::MAX)
    }

    /// Returns the sum of the numbers of passes of the pixels of a rectangle.
    pub(crate) fn passes(&self, rect: &PixelRect) -> u64 {
        let row = |y| {
            self.counts[self.pixel(rect.x0, y)..][..rect.width()].iter().map(|n| u64::from(*n)).sum::<u64>()
        };
        (rect.y0..rect.y1).map(row).sum()
    }
}
