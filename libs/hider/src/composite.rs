//! Composites the surfaces of each sample.

use super::{Fragment, NONE, SampleGrid, ShadedGrid, Surfaces};
use granita_base::Color;
use granita_dicing::PixelRect;
use granita_scene::Holdout;
use granita_texture::VolumePixel;
use std::sync::Arc;

/// The settings that depend on attributes of the whole scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CompositeSettings {
    /// The attribute "limits:opacitythreshold".
    pub opacity_threshold: Color,
    /// The attribute "shadow:opacitythreshold".
    pub depth_threshold: Color,
    /// The attribute "limits:transparentlayers"; `None` when there is no limit.
    pub layers: Option<usize>,
    /// True when depths are requested.
    pub depths: bool,
}

/// A shader variable that is requested in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WantedVariable {
    /// The index of its first component in [`super::Shade::variables`].
    pub offset: usize,
    /// The number of its components.
    pub width: usize,
    /// True for colours, which are composited as `C` is. Of other values the foremost is taken.
    pub is_color: bool,
}

/// The channels of a resolved sample. They are red, green, blue and alpha, then the depth and the mean of the first
/// two depths when requested, then the components of the variables.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// True when the depth channels are requested.
    pub depths: bool,
    /// The requested variables.
    pub variables: Vec<WantedVariable>,
}

impl Wanted {
    /// The number of channels of a sample.
    pub fn channels(&self) -> usize {
        self.variable_channel(self.variables.len())
    }

    /// The first channel of a variable.
    pub fn variable_channel(&self, index: usize) -> usize {
        4 + 2 * usize::from(self.depths) + self.variables[..index].iter().map(|v| v.width).sum::<usize>()
    }
}

/// A layer of a sample: a place on a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layer {
    /// The index among the grids of the bucket.
    pub(super) grid: u32,
    /// The index of the lower left point of the micropolygon.
    pub(super) at: u32,
    /// The coordinates in the micropolygon.
    pub(super) place: [f32; 2],
}

impl From<&Fragment> for Layer {
    fn from(fragment: &Fragment) -> Self {
        Self { grid: fragment.grid, at: fragment.at, place: [fragment.u, fragment.v] }
    }
}

/// The samples and grids that layers refer to.
#[derive(Clone, Copy)]
pub(super) struct Scenery<'a> {
    pub(super) samples: &'a SampleGrid,
    pub(super) settings: &'a CompositeSettings,
    pub(super) grids: &'a [Arc<ShadedGrid>],
}

impl Scenery<'_> {
    /// Returns the time of a sample when the shading of the grid varies over time, else 0.
    fn time_for(&self, grid: &ShadedGrid, sample: usize) -> f32 {
        if grid.varies_over_time() { self.samples.time(sample) } else { 0.0 }
    }
}

/// Composites all samples. Channel `c` of sample `s` is at `c * samples + s`.
pub(super) fn resolve(surfaces: &Surfaces<'_>, wanted: &Wanted) -> Vec<f32> {
    let n = surfaces.samples.len();
    let mut out = vec![0.0; wanted.channels() * n];
    let mut fragments: Vec<Fragment> = Vec::new();
    let mut layers: Vec<Layer> = Vec::new();
    let mut sample: Vec<f32> = vec![0.0; wanted.channels()];
    for s in 0..n {
        collect(surfaces, s, &mut fragments);
        layers.clear();
        layers.extend(fragments.iter().map(Layer::from));
        let depths = surfaces.depths.get(s).copied();
        resolve_sample(surfaces.scenery(), (wanted, s), &layers, depths, (&mut sample, &mut out));
    }
    out
}

/// Composites one sample into its places of the result. `depths` are those of its first two surfaces, when depths are
/// requested.
#[inline(always)]
pub(super) fn resolve_sample(
    scenery: Scenery<'_>,
    (wanted, s): (&Wanted, usize),
    layers: &[Layer],
    depths: Option<[f32; 2]>,
    (sample, out): (&mut [f32], &mut [f32]),
) {
    if layers.is_empty() && depths.is_none() {
        return;
    }
    let n = scenery.samples.len();
    if let [Layer { grid, at, place }] = layers
        && sample.len() == 4
        && let Some(color) = scenery.grids[*grid as usize].only_color_at(*at, *place)
    {
        // The same as below. A sum of zero and a negative zero is zero.
        for c in 0..3 {
            out[c * n + s] = 0.0 + color[c];
        }
        out[3 * n + s] = 1.0;
        return;
    }
    sample.fill(0.0);
    blend(scenery, (wanted, s), layers, sample);
    if wanted.depths {
        let [z, second] = depths.unwrap_or([f32::INFINITY; 2]);
        // The mean of infinity and any depth is infinity, so that a single surface gives no depth
        // (reference 10.1.2).
        (sample[4], sample[5]) = (z, (z + second) * 0.5);
    }
    for (c, value) in sample.iter().enumerate() {
        out[c * n + s] = *value;
    }
}

/// Collects the surfaces that a sample sees, nearest first, up to the first one that hides everything behind it.
pub(super) fn collect(surfaces: &Surfaces<'_>, sample: usize, layers: &mut Vec<Fragment>) {
    let nearest_z = surfaces.nearest_z[sample];
    layers.clear();
    let mut next = surfaces.first[sample];
    while next != NONE {
        let fragment = surfaces.fragments[next as usize];
        if fragment.z < nearest_z {
            layers.push(fragment);
        }
        next = fragment.next;
    }
    // The chain runs from the last to the first added. A stable sort keeps the order of adding among equal depths.
    layers.reverse();
    layers.sort_by(|a, b| a.z.total_cmp(&b.z));
    layers.extend(surfaces.nearest[sample].fragment(nearest_z));
    // Where the widened boundary edges of two grids of one primitive overlap, the surface counts once.
    let mut last: Option<Fragment> = None;
    let primitive = |fragment: &Fragment| surfaces.grids[fragment.grid as usize].primitive;
    layers.retain(|fragment| {
        last.replace(*fragment).is_none_or(|last| {
            !(fragment.rim
                && last.rim
                && last.grid != fragment.grid
                && primitive(&last) == primitive(fragment)
                && fragment.z - last.z <= 1e-4 * fragment.z.abs())
        })
    });
}

/// Returns the texels of a volume shadow map, row by row (reference 10.1.3). The samples of each pixel of `pixels`
/// give `texel` numbers.
pub(super) fn volumes(
    surfaces: &Surfaces<'_>,
    pixels: &PixelRect,
    texel: usize,
    opaque_width: f32,
) -> Vec<f32> {
    let (samples, settings) = (surfaces.samples, &surfaces.settings);
    let mut out = vec![0.0; pixels.width() * pixels.height() * texel];
    let mut layers: Vec<Fragment> = Vec::new();
    let mut steps: Vec<(f32, f32)> = Vec::new();
    let mut volume = VolumePixel::default();
    let places = (pixels.y0..pixels.y1).flat_map(|y| (pixels.x0..pixels.x1).map(move |x| (x, y)));
    for (texel, (x, y)) in out.chunks_exact_mut(texel).zip(places) {
        let pixel = samples.pixel(x, y);
        let first = pixel * samples.per_pixel;
        for s in first..first + samples.count(pixel) {
            collect(surfaces, s, &mut layers);
            steps.clear();
            let mut through = Color::ONE;
            let mut opaque = f32::INFINITY;
            for fragment in &layers {
                let grid = &*surfaces.grids[fragment.grid as usize];
                if settings.layers.is_some_and(|most| steps.len() >= most) && !grid.opaque {
                    continue;
                }
                let behind = match grid.opaque || grid.holdout != Holdout::None {
                    true => Color::ZERO,
                    false => {
                        let (place, time) = ([fragment.u, fragment.v], surfaces.time_for(grid, s));
                        through * (Color::ONE - grid.opacity_at(fragment.at, place, time))
                    }
                };
                if (Color::ONE - behind).cmpge(settings.opacity_threshold).all() {
                    opaque = fragment.z;
                    break;
                }
                steps.push((fragment.z, (through - behind).element_sum() / 3.0));
                through = behind;
            }
            volume.sample(steps.drain(..), opaque);
        }
        volume.finish(opaque_width, texel);
    }
    out
}

/// Composites the layers of the sample with this index, nearest first. Colours are premultiplied by their opacity.
fn blend(scenery: Scenery<'_>, (wanted, number): (&Wanted, usize), layers: &[Layer], sample: &mut [f32]) {
    let settings = scenery.settings;
    let mut through = Color::ONE;
    let mut count = 0;
    let mut seen = false;
    for &Layer { grid, at, place } in layers {
        let grid = &*scenery.grids[grid as usize];
        if settings.layers.is_some_and(|most| count >= most) && !grid.opaque {
            continue;
        }
        count += 1;
        let time = scenery.time_for(grid, number);
        let matte = grid.holdout == Holdout::Matte;
        let opacity = match (matte, grid.opaque) {
            (true, _) => Color::ZERO,
            (_, true) => Color::ONE,
            _ => grid.opacity_at(at, place, time),
        };
        if !matte {
            let color = grid.color_at(at, place, time) * through;
            let alpha = opacity * through;
            for c in 0..3 {
                sample[c] += color[c];
            }
            sample[3] += (alpha.x + alpha.y + alpha.z) / 3.0;
            for (k, variable) in wanted.variables.iter().enumerate() {
                let first = wanted.variable_channel(k);
                for c in 0..variable.width {
                    let value = grid.variable_at(variable.offset + c, at, place, time);
                    if variable.is_color {
                        sample[first + c] += value * through[c % 3];
                    } else if !seen {
                        sample[first + c] = value;
                    }
                }
            }
            seen = true;
        }
        through *= Color::ONE - opacity;
        let enough = (Color::ONE - through).cmpge(settings.opacity_threshold).all();
        if grid.holdout != Holdout::None || enough {
            break;
        }
    }
}
