//! The surfaces that samples saw, kept to be composited again with other colours.

use super::composite::{self, Layer, Scenery};
use super::{CompositeSettings, Resolved, SampleGrid, ShadedGrid, Surfaces, Wanted};
use std::sync::Arc;

/// The places on grids that the samples of a bucket see, nearest first, without the grids.
///
/// It depends on the shapes and opacities of the grids. While these stay, the bucket can be composited with new colours
/// without searching for visible surfaces again. The result is that of [`Surfaces::resolve`], to the bit.
#[derive(Clone, Debug)]
pub struct KeptSurfaces {
    settings: CompositeSettings,
    /// For each sample, the number of its layers, or [`MANY`].
    counts: Vec<u8>,
    /// The numbers of layers of the samples with [`MANY`], in order.
    many: Vec<u32>,
    /// The layers of all samples, in their order.
    places: Vec<KeptPlace>,
    /// By layer, the number of its grid, where the numbers of grids and points do not fit into one word.
    grids: Vec<u32>,
    /// The number of bits of [`KeptPlace::at`] that are the index of a point.
    point_bits: u32,
    /// As in [`Surfaces`].
    depths: Vec<[f32; 2]>,
}

/// The count of a sample whose number of layers is kept apart.
const MANY: u8 = u8::MAX;

/// A layer of a sample, without the grid where that is kept apart.
#[derive(Clone, Copy, Debug)]
struct KeptPlace {
    /// The index of the lower left point of the micropolygon; above its bits, the number of the grid.
    at: u32,
    /// The coordinates in the micropolygon.
    place: [f32; 2],
}

impl KeptSurfaces {
    /// Keeps what the samples of a bucket see. The grids that some sample sees are numbered anew. Returns their numbers
    /// among all grids of the bucket as well, increasing.
    pub fn new(surfaces: &Surfaces<'_>) -> (Self, Vec<usize>) {
        Self::in_words(surfaces, u32::BITS)
    }

    /// Does the same. Numbers of grids and points are kept apart when they need more than `word` bits together.
    fn in_words(surfaces: &Surfaces<'_>, word: u32) -> (Self, Vec<usize>) {
        let n = surfaces.samples.len();
        let (mut counts, mut many) = (Vec::with_capacity(n), Vec::new());
        let mut layers: Vec<Layer> = Vec::with_capacity(n);
        let mut fragments = Vec::new();
        for sample in 0..n {
            composite::collect(surfaces, sample, &mut fragments);
            layers.extend(fragments.iter().map(Layer::from));
            counts.push(u8::try_from(fragments.len()).unwrap_or(MANY));
            if counts.last() == Some(&MANY) {
                many.push(u32::try_from(fragments.len()).unwrap_or(u32::MAX));
            }
        }
        let mut numbers = vec![u32::MAX; surfaces.grids.len()];
        let mut last_point = 0;
        for layer in &layers {
            numbers[layer.grid as usize] = 0;
            last_point = last_point.max(layer.at);
        }
        let seen: Vec<usize> = (0..numbers.len()).filter(|grid| numbers[*grid] == 0).collect();
        for (number, grid) in (0..).zip(&seen) {
            numbers[*grid] = number;
        }
        let bits = |largest: u32| u32::BITS - largest.leading_zeros();
        let (point_bits, grid_bits) = (bits(last_point), bits(seen.len() as u32));
        let apart = point_bits + grid_bits > word;
        let place = |Layer { grid, at, place }: &Layer| {
            let above = if apart { 0 } else { numbers[*grid as usize].unbounded_shl(point_bits) };
            KeptPlace { at: at | above, place: *place }
        };
        let places = layers.iter().map(place).collect();
        let grids = layers.iter().filter(|_| apart).map(|layer| numbers[layer.grid as usize]).collect();
        let (settings, depths) = (surfaces.settings, surfaces.depths.clone());
        (Self { settings, counts, many, places, grids, point_bits, depths }, seen)
    }

    /// Composites every sample, as [`Surfaces::resolve_all`]. `samples` are those of the bucket, and `grids` those that
    /// some sample sees.
    pub fn resolve(&self, samples: &SampleGrid, grids: &[Arc<ShadedGrid>], wanted: &Wanted) -> Resolved {
        let scenery = Scenery { samples, settings: &self.settings, grids };
        let mut out = Resolved::new(wanted, samples.len());
        let mut values: Vec<f32> = vec![0.0; wanted.channels()];
        let mut layers: Vec<Layer> = Vec::new();
        let (mut many, mut begin) = (self.many.iter(), 0);
        for (sample, count) in self.counts.iter().enumerate().take(samples.len()) {
            let depths = self.depths.get(sample).copied();
            let mut resolve = |layers: &[Layer]| {
                composite::resolve_sample(scenery, (wanted, sample), layers, depths, (&mut values, &mut out));
            };
            let count = match *count {
                1 => {
                    resolve(&[self.layer(begin)]);
                    begin += 1;
                    continue;
                }
                MANY => many.next().map_or(0, |count| *count as usize),
                few => usize::from(few),
            };
            layers.clear();
            layers.extend((begin..begin + count).map(|k| self.layer(k)));
            resolve(&layers);
            begin += count;
        }
        out
    }

    /// Returns a layer.
    #[inline(always)]
    fn layer(&self, k: usize) -> Layer {
        let KeptPlace { at, place } = self.places[k];
        match self.grids.get(k) {
            Some(grid) => Layer { grid: *grid, at, place },
            None => {
                let grid = at.unbounded_shr(self.point_bits);
                Layer { grid, at: at ^ grid.unbounded_shl(self.point_bits), place }
            }
        }
    }

    /// The bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.counts.capacity()
            + self.many.capacity() * size_of::<u32>()
            + self.places.capacity() * size_of::<KeptPlace>()
            + self.grids.capacity() * size_of::<u32>()
            + self.depths.capacity() * size_of::<[f32; 2]>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SamplePattern, Shade, ViewedGrid, WantedVariable};
    use granita_base::{Color, Vec3, hash};
    use granita_dicing::{CameraView, PixelRect};

    /// A number from 0 to 1.
    fn random(grid: u32, k: u32) -> f32 {
        hash::unit(hash::words(&[grid, k]))
    }

    fn color(grid: u32, k: u32) -> Color {
        Color::new(random(grid, k), random(grid, k + 1), random(grid, k + 2))
    }

    /// Returns overlapping grids. Every third one is opaque, the last is hidden, and one is beside the picture. `turn`
    /// selects the colours, but has no effect on shapes and opacities.
    fn grids(camera: &CameraView, turn: u32) -> Vec<Arc<ShadedGrid>> {
        let grid = |k: u32| {
            let (x, y) = (random(k, 0) * 4.0 - 2.0, random(k, 1) * 3.0 - 1.5);
            let (side, z, x) = match k {
                7 => (1.0, 5.0, 90.0),
                8 => (60.0, 12.0, 0.0),
                9 => (60.0, 13.0, 0.0),
                10.. => (60.0, 3.0 + 0.001 * k as f32, 0.0),
                _ => (1.2, 4.0 + 6.0 * random(k, 2), x),
            };
            let at =
                |i: usize| Vec3::new(x + side * ((i % 3) as f32 - 1.0), y + side * ((i / 3) as f32 - 1.0), z);
            let view = ViewedGrid::new(camera, 3, vec![0.0], vec![(0..9).map(at).collect()], false);
            let opaque = k % 3 == 2 || k == 9;
            let shade = Shade {
                color: (0..9).map(|i| color(k, 100 + 3 * i + 50 * turn)).collect(),
                opacity: if opaque { Vec::new() } else { (0..9).map(|i| color(k, 3 + 3 * i)).collect() },
                variables: (0..36).map(|i| random(k, 200 + i + 50 * turn)).collect(),
                ..Shade::default()
            };
            Arc::new(ShadedGrid { opaque, shades: vec![shade], ..ShadedGrid::new(3, 3, view) })
        };
        // All samples see the last ones.
        let thin = (10..270).map(grid).map(|mut grid| {
            let thin = Arc::make_mut(&mut grid);
            (thin.opaque, thin.shades[0].opacity) = (false, vec![Color::splat(1e-4); 9]);
            grid
        });
        (0..10).map(grid).chain(thin).collect()
    }

    #[test]
    fn kept_surfaces_have_the_values_of_surfaces_that_are_searched_anew() {
        let camera = crate::tests::camera(false);
        let rect = PixelRect { x0: 0, y0: 0, x1: 20, y1: 15 };
        let pattern = SamplePattern::new(&camera, false);
        let samples = SampleGrid::new(rect, &pattern, &camera, &[rect]);
        let found = |grids: &[Arc<ShadedGrid>], settings| {
            let mut surfaces = Surfaces::new(&samples, settings);
            grids.iter().for_each(|grid| surfaces.add(grid, 0));
            surfaces
        };
        let half = Color::splat(0.5);
        for (depths, layers) in [(false, None), (true, None), (false, Some(2))] {
            let settings = CompositeSettings {
                opacity_threshold: Color::splat(0.996),
                depth_threshold: half,
                layers,
                depths,
            };
            let wanted = Wanted {
                depths,
                variables: [(0, 3, true), (27, 1, false)]
                    .map(|(offset, width, is_color)| WantedVariable { offset, width, is_color })
                    .to_vec(),
                mattes: None,
            };
            let (first, second) = (grids(&camera, 0), grids(&camera, 1));
            let (kept, seen) = KeptSurfaces::new(&found(&first, settings));
            let (apart, same) = KeptSurfaces::in_words(&found(&first, settings), 4);
            assert!(kept.grids.is_empty() && apart.grids.len() == apart.places.len() && same == seen);
            assert!(kept.many.len() > 9, "{}", kept.many.len());
            assert!(seen.len() > 4 && !seen.contains(&7) && !seen.contains(&9), "{seen:?}");
            let mut images = Vec::new();
            for all in [first, second] {
                let some: Vec<_> = seen.iter().map(|grid| all[*grid].clone()).collect();
                let expected = found(&all, settings).resolve(&wanted);
                assert_eq!(kept.resolve(&samples, &some, &wanted).values, expected);
                assert_eq!(apart.resolve(&samples, &some, &wanted).values, expected);
                images.push(expected);
            }
            assert!(images[0].iter().zip(&images[1]).any(|(a, b)| a != b), "the colours are others");
        }
    }
}
