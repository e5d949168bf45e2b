//! The surfaces that samples saw, kept to be composited again with other colours.

use super::composite::{self, Layer, Scenery};
use super::{CompositeSettings, SampleGrid, ShadedGrid, Surfaces, Wanted};
use std::sync::Arc;

/// The places on grids that the samples of a bucket see, nearest first, without the grids.
///
/// It depends on the shapes and opacities of the grids. While these stay, the bucket can be composited with new colours
/// without searching for visible surfaces again. The result is that of [`Surfaces::resolve`], to the bit.
#[derive(Clone, Debug)]
pub struct KeptSurfaces {
    settings: CompositeSettings,
    /// For each sample: the end of its layers. Samples that follow each other often see one layer.
    ends: Vec<u32>,
    layers: Vec<Layer>,
    /// As in [`Surfaces`].
    depths: Vec<[f32; 2]>,
}

impl KeptSurfaces {
    /// Keeps what the samples of a bucket see.
    pub fn new(surfaces: &Surfaces<'_>) -> Self {
        let n = surfaces.samples.len();
        let mut ends = Vec::with_capacity(n);
        let mut layers = Vec::with_capacity(n);
        let mut fragments = Vec::new();
        for sample in 0..n {
            composite::collect(surfaces, sample, &mut fragments);
            layers.extend(fragments.iter().map(Layer::from));
            ends.push(u32::try_from(layers.len()).unwrap_or(u32::MAX));
        }
        layers.shrink_to_fit();
        Self { settings: surfaces.settings, ends, layers, depths: surfaces.depths.clone() }
    }

    /// Composites every sample, as [`Surfaces::resolve`]. `samples` are those of the bucket, and `grids` its grids in
    /// the order in which they were added.
    pub fn resolve(&self, samples: &SampleGrid, grids: &[Arc<ShadedGrid>], wanted: &Wanted) -> Vec<f32> {
        let scenery = Scenery { samples, settings: &self.settings, grids };
        let mut out = vec![0.0; wanted.channels() * samples.len()];
        let mut values: Vec<f32> = vec![0.0; wanted.channels()];
        let mut begin = 0;
        for (sample, end) in self.ends.iter().enumerate().take(samples.len()) {
            let layers = &self.layers[begin as usize..*end as usize];
            let depths = self.depths.get(sample).copied();
            composite::resolve_sample(scenery, (wanted, sample), layers, depths, (&mut values, &mut out));
            begin = *end;
        }
        out
    }

    /// Numbers the grids anew that some sample sees. Returns their old numbers, increasing. `grids` is the number of
    /// grids that were added.
    pub fn only_seen(&mut self, grids: usize) -> Vec<usize> {
        let mut new = vec![u32::MAX; grids];
        for layer in &self.layers {
            new[layer.grid as usize] = 0;
        }
        let seen: Vec<usize> = (0..grids).filter(|grid| new[*grid] == 0).collect();
        for (number, grid) in (0..).zip(&seen) {
            new[*grid] = number;
        }
        self.layers.iter_mut().for_each(|layer| layer.grid = new[layer.grid as usize]);
        seen
    }

    /// The bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.ends.capacity() * size_of::<u32>()
            + self.layers.capacity() * size_of::<Layer>()
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
        (0..10).map(grid).collect()
    }

    #[test]
    fn kept_surfaces_have_the_values_of_surfaces_that_are_searched_anew() {
        let camera = crate::tests::camera(false);
        let rect = PixelRect { x0: 0, y0: 0, x1: 32, y1: 24 };
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
            };
            let (first, second) = (grids(&camera, 0), grids(&camera, 1));
            let mut kept = KeptSurfaces::new(&found(&first, settings));
            let seen = kept.only_seen(first.len());
            assert!(seen.len() > 4 && !seen.contains(&7) && !seen.contains(&9), "{seen:?}");
            let mut images = Vec::new();
            for all in [first, second] {
                let some: Vec<_> = seen.iter().map(|grid| all[*grid].clone()).collect();
                let expected = found(&all, settings).resolve(&wanted);
                assert_eq!(kept.resolve(&samples, &some, &wanted), expected);
                images.push(expected);
            }
            assert!(images[0].iter().zip(&images[1]).any(|(a, b)| a != b), "the colours are others");
        }
    }
}
