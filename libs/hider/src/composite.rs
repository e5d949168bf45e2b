//! Composites the surfaces of each sample.

use super::mattes::Coverage;
use super::{Fragment, NONE, SampleGrid, Seen, ShadedGrid, Surfaces};
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
    /// The matte of each primitive, by [`ShadedGrid::number`], when the mattes that samples see are requested.
    pub mattes: Option<Arc<[u32]>>,
}

/// The results of the samples of a bucket.
#[derive(Clone, Debug, Default)]
pub struct Resolved {
    /// One run of samples for each channel: channel `c` of sample `s` is at `c * samples + s`.
    pub values: Vec<f32>,
    /// The mattes that the samples see.
    pub coverage: Coverage,
}

impl Resolved {
    /// Returns the results of samples that see nothing.
    pub(super) fn new(wanted: &Wanted, samples: usize) -> Self {
        let coverage = wanted.mattes.as_ref().map(|_| Coverage::new(samples)).unwrap_or_default();
        Self { values: vec![0.0; wanted.channels() * samples], coverage }
    }
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
        let Seen { at, u, v, .. } = fragment.seen;
        Self { grid: fragment.grid(), at, place: [u, v] }
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

/// Composites all samples.
pub(super) fn resolve(surfaces: &Surfaces<'_>, wanted: &Wanted) -> Resolved {
    let n = surfaces.samples.len();
    let mut out = Resolved::new(wanted, n);
    // Most samples see one opaque surface and nothing in front of it.
    let simple = wanted.channels() == 4 && surfaces.depths.is_empty() && wanted.mattes.is_none();
    let mut fragments: Vec<Fragment> = Vec::new();
    let mut layers: Vec<Layer> = Vec::new();
    let mut sample: Vec<f32> = vec![0.0; wanted.channels()];
    for s in 0..n {
        if simple && surfaces.first[s] == NONE && resolve_opaque(surfaces, s, &mut out.values) {
            continue;
        }
        collect(surfaces, s, &mut fragments);
        layers.clear();
        layers.extend(fragments.iter().map(Layer::from));
        let depths = surfaces.depths.get(s).copied();
        resolve_sample(surfaces.scenery(), (wanted, s), &layers, depths, (&mut sample, &mut out));
    }
    out
}

/// Stores the colour of a sample that sees at most one surface, and nothing in front of it. Returns false when that is
/// not the whole result. See [`resolve_sample`].
#[inline(always)]
fn resolve_opaque(surfaces: &Surfaces<'_>, s: usize, out: &mut [f32]) -> bool {
    let Seen { grid, at, u, v } = surfaces.nearest[s];
    if grid == NONE {
        return true;
    }
    let grid = &*surfaces.grids[(grid & !Seen::RIM) as usize];
    let Some(color) = grid.only_color_at(at, [u, v]) else { return false };
    store_opaque(color, surfaces.samples.len(), s, out);
    true
}

/// Stores the channels of a sample that sees an opaque surface of this colour.
#[inline(always)]
fn store_opaque(color: Color, n: usize, s: usize, out: &mut [f32]) {
    // A sum of zero and a negative zero is zero, as where layers are added.
    for c in 0..3 {
        out[c * n + s] = 0.0 + color[c];
    }
    out[3 * n + s] = 1.0;
}

/// Composites one sample into its places of the result. `depths` are those of its first two surfaces, when depths are
/// requested.
#[inline(always)]
pub(super) fn resolve_sample(
    scenery: Scenery<'_>,
    (wanted, s): (&Wanted, usize),
    layers: &[Layer],
    depths: Option<[f32; 2]>,
    (sample, out): (&mut [f32], &mut Resolved),
) {
    if layers.is_empty() && depths.is_none() {
        return;
    }
    let n = scenery.samples.len();
    if let [Layer { grid, at, place }] = layers
        && sample.len() == 4
        && wanted.mattes.is_none()
        && let Some(color) = scenery.grids[*grid as usize].only_color_at(*at, *place)
    {
        // The same as below.
        store_opaque(color, n, s, &mut out.values);
        return;
    }
    sample.fill(0.0);
    blend(scenery, (wanted, s), layers, &mut Through::default(), (sample, &mut out.coverage));
    if wanted.depths {
        store_depths(depths, sample);
    }
    for (c, value) in sample.iter().enumerate() {
        out.values[c * n + s] = *value;
    }
}

/// Stores the depths of the first two surfaces of a sample in its channels.
pub(super) fn store_depths(depths: Option<[f32; 2]>, sample: &mut [f32]) {
    let [z, second] = depths.unwrap_or([f32::INFINITY; 2]);
    // The mean of infinity and any depth is infinity, so that a single surface gives no depth (reference 10.1.2).
    (sample[4], sample[5]) = (z, (z + second) * 0.5);
}

/// Collects the surfaces that a sample sees, nearest first, up to the first one that hides everything behind it.
pub(super) fn collect(surfaces: &Surfaces<'_>, sample: usize, layers: &mut Vec<Fragment>) {
    chain(surfaces, sample, layers);
    join_rims(layers, &surfaces.grids, &mut None);
}

/// Collects the surfaces as [`collect`], without joining boundary edges.
pub(super) fn chain(surfaces: &Surfaces<'_>, sample: usize, layers: &mut Vec<Fragment>) {
    layers.clear();
    let nearest_z = surfaces.nearest_z[sample];
    let mut next = surfaces.first[sample];
    while let Some(fragment) = surfaces.fragments.get(next as usize) {
        if fragment.z < nearest_z {
            layers.push(*fragment);
        }
        next = fragment.next;
    }
    sort(layers);
    layers.extend(surfaces.nearest[sample].fragment(nearest_z));
}

/// Sorts fragments by their depth. They come from the chain of a sample, which runs from the last to the first added.
pub(super) fn sort(layers: &mut [Fragment]) {
    // A stable sort keeps the order of adding among equal depths.
    layers.reverse();
    if !layers.is_sorted_by(|a, b| a.z.total_cmp(&b.z).is_le()) {
        layers.sort_by(|a, b| a.z.total_cmp(&b.z));
    }
}

/// A fragment on the boundary edge of a grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rim {
    z: f32,
    /// The index of its grid, or the largest number when that is not in the list of grids any more.
    pub(super) grid: u32,
    primitive: u32,
}

/// Removes fragments where the widened boundary edges of two grids of one primitive overlap, so that the surface counts
/// once. `last` is the fragment before the first one, when that is on a boundary edge, and then the last fragment.
pub(super) fn join_rims(layers: &mut Vec<Fragment>, grids: &[Arc<ShadedGrid>], last: &mut Option<Rim>) {
    if last.is_none() && !layers.iter().any(Fragment::is_rim) {
        return;
    }
    layers.retain(|fragment| {
        let z = fragment.z;
        let rim = || Rim { z, grid: fragment.grid(), primitive: grids[fragment.grid() as usize].primitive };
        let rim = fragment.is_rim().then(rim);
        let pair = std::mem::replace(last, rim).zip(rim);
        pair.is_none_or(|(last, rim)| {
            !(last.grid != rim.grid && last.primitive == rim.primitive && z - last.z <= 1e-4 * z.abs())
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
                let Seen { at, u, v, .. } = fragment.seen;
                let grid = &*surfaces.grids[fragment.grid() as usize];
                if settings.layers.is_some_and(|most| steps.len() >= most) && !grid.opaque {
                    continue;
                }
                let behind = match grid.opaque || grid.holdout != Holdout::None {
                    true => Color::ZERO,
                    false => {
                        let time = surfaces.time_for(grid, s);
                        through * (Color::ONE - grid.opacity_at(at, [u, v], time))
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

/// The state of a sample between two of its layers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Through {
    /// The share of light that passes all layers so far.
    color: Color,
    /// The number of layers so far.
    count: u32,
    /// True when a layer was seen that is not a matte.
    seen: bool,
}

impl Default for Through {
    fn default() -> Self {
        Self { color: Color::ONE, count: 0, seen: false }
    }
}

/// Composites further layers of the sample with this index, nearest first. Colours are premultiplied by their opacity.
/// The mattes of the layers are added to `coverage`. Returns true when nothing behind them is seen.
#[inline(always)]
pub(super) fn blend(
    scenery: Scenery<'_>,
    (wanted, number): (&Wanted, usize),
    layers: &[Layer],
    state: &mut Through,
    (sample, coverage): (&mut [f32], &mut Coverage),
) -> bool {
    let settings = scenery.settings;
    let most = settings.layers.and_then(|most| u32::try_from(most).ok()).unwrap_or(u32::MAX);
    let (mut color, mut alpha) = (Color::new(sample[0], sample[1], sample[2]), sample[3]);
    let mut done = false;
    for &Layer { grid, at, place } in layers {
        let grid = &*scenery.grids[grid as usize];
        if state.count >= most && !grid.opaque {
            continue;
        }
        state.count = state.count.saturating_add(1);
        let time = scenery.time_for(grid, number);
        let mut opacity = Color::ZERO;
        if grid.holdout != Holdout::Matte {
            let through = state.color;
            let of_layer;
            (of_layer, opacity) = grid.shade_at(at, place, time);
            if grid.opaque {
                opacity = Color::ONE;
            }
            color += of_layer * through;
            let covered = opacity * through;
            let share = (covered.x + covered.y + covered.z) / 3.0;
            alpha += share;
            if let Some(mattes) = &wanted.mattes
                && let Some(matte) = mattes.get(grid.number as usize)
            {
                coverage.add(number, *matte, share);
            }
            if !wanted.variables.is_empty() {
                blend_variables(grid, wanted, (at, place, time), state, sample);
            }
            state.seen = true;
        }
        state.color *= Color::ONE - opacity;
        let enough = (Color::ONE - state.color).cmpge(settings.opacity_threshold).all();
        if grid.holdout != Holdout::None || enough {
            done = true;
            break;
        }
    }
    sample[..4].copy_from_slice(&[color.x, color.y, color.z, alpha]);
    done
}

/// Composites the variables of a layer behind those of `state`.
fn blend_variables(
    grid: &ShadedGrid,
    wanted: &Wanted,
    (at, place, time): (u32, [f32; 2], f32),
    state: &Through,
    sample: &mut [f32],
) {
    for (k, variable) in wanted.variables.iter().enumerate() {
        let first = wanted.variable_channel(k);
        for c in 0..variable.width {
            let value = grid.variable_at(variable.offset + c, at, place, time);
            if variable.is_color {
                sample[first + c] += value * state.color[c % 3];
            } else if !state.seen {
                sample[first + c] = value;
            }
        }
    }
}
