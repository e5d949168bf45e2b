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
