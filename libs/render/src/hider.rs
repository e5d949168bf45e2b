//! What is seen where: samples, micropolygons, and what lies before what.
//!
//! A [`SampleGrid`] holds the samples of a rectangle of pixels. Each one has a place, a time and a point on
//! the lens, hashed from the absolute pixel and the number of the sample alone, so that a sample is the same
//! one whichever bucket computes it. [`Surfaces`] collects what the samples see of the grids handed to it;
//! [`Surfaces::resolve`] composites it front to back.

mod blurred;
mod composite;
mod hit;
mod lanes;
mod raster;
mod samples;
mod streaks;
mod visible;

pub(crate) use composite::{CompositeSettings, Wanted, WantedVariable};
pub(crate) use samples::{SampleGrid, SamplePattern, Tables};
pub(crate) use visible::{Holdout, NOWHERE, Projector, Shade, ShadedGrid, ViewedGrid, pixels_of};

use granita_base::Vec2;
use hit::{Hit, Raster, Sink};

/// One surface seen through a sample.
#[derive(Clone, Copy, Debug)]
struct Fragment {
    /// Camera space depth.
    z: f32,
    /// Index among the grids of this bucket.
    grid: u32,
    /// Lower left point of the micropolygon.
    at: u32,
    /// Place in the micropolygon.
    u: f32,
    v: f32,
    /// Next fragment of the sample, or [`NONE`].
    next: u32,
    /// On the rim of its grid, where neighbouring grids may overlap by a hair.
    rim: bool,
}

/// A [`Fragment`] that hides all behind it, in the little room that the samples of a bucket should have in a cache; its
/// depth is kept apart.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Index among the grids of this bucket, and above it [`Seen::RIM`]; or [`NONE`].
    grid: u32,
    at: u32,
    u: f32,
    v: f32,
}

impl Seen {
    const NOTHING: Self = Self { grid: NONE, at: 0, u: 0.0, v: 0.0 };
    /// The bit that says so.
    const RIM: u32 = 1 << 31;

    fn new(fragment: &Fragment) -> Self {
        let Fragment { grid, at, u, v, rim, .. } = *fragment;
        Self { grid: grid | if rim { Self::RIM } else { 0 }, at, u, v }
    }

    fn fragment(self, z: f32) -> Option<Fragment> {
        let Self { grid, at, u, v } = self;
        let found = Fragment { z, grid: grid & !Self::RIM, at, u, v, next: NONE, rim: grid & Self::RIM != 0 };
        (grid != NONE).then_some(found)
    }
}

/// A grid right beside a sample.
#[derive(Clone, Copy, Debug)]
struct Beside {
    fragment: Fragment,
    /// Where it is from there, of any length.
    toward: Vec2,
    /// Another grid is there on the other side: what lies between is a crack, and has been closed.
    closed: bool,
}

const NONE: u32 = u32::MAX;

/// Grids on both sides of a crack are no farther apart in depth than this part of it.
const CRACK_DEPTH: f32 = 1e-2;

/// What the samples of a bucket see.
pub(crate) struct Surfaces<'a> {
    samples: &'a SampleGrid,
    settings: CompositeSettings,
    grids: Vec<std::sync::Arc<ShadedGrid>>,
    /// Per sample: the nearest surface that hides all behind it.
    nearest: Vec<Seen>,
    /// Its depth; [`SampleGrid::PADDING`] longer.
    nearest_z: Vec<f32>,
    /// Per sample: first of its transparent fragments.
    first: Vec<u32>,
    fragments: Vec<Fragment>,
    /// Per sample: first of the grids right beside it. Their fragments are chained.
    first_beside: Vec<u32>,
    beside: Vec<Beside>,
    /// Per sample: depths of the nearest and second surface above "shadow:opacitythreshold"; empty unless asked for.
    depths: Vec<[f32; 2]>,
    /// Per pixel: the farthest of the nearest depths; NaN when it must be computed anew.
    horizon: Vec<f32>,
}

impl<'a> Surfaces<'a> {
    /// Nothing seen yet.
    pub(crate) fn new(samples: &'a SampleGrid, settings: CompositeSettings) -> Self {
        let n = samples.len();
        Self {
            samples,
            settings,
            grids: Vec::new(),
            nearest: vec![Seen::NOTHING; n],
            nearest_z: vec![f32::INFINITY; n + SampleGrid::PADDING],
            first: vec![NONE; n],
            fragments: Vec::new(),
            first_beside: vec![NONE; n],
            beside: Vec::new(),
            depths: if settings.depths { vec![[f32::INFINITY; 2]; n] } else { Vec::new() },
            horizon: vec![f32::INFINITY; samples.pixels()],
        }
    }

    /// Whether everything at depth `z` and behind it is hidden in all pixels of `rect` (clipped to the
    /// bucket). Never true for an empty rectangle.
    pub(crate) fn hides(&mut self, rect: &crate::PixelRect, z: f32) -> bool {
        let rect = rect.intersection(&self.samples.rect);
        if rect.is_empty() {
            return false;
        }
        let per_pixel = self.samples.per_pixel;
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let pixel = self.samples.pixel(x, y);
                if self.horizon[pixel].is_nan() {
                    let seen = &self.nearest_z[pixel * per_pixel..][..self.samples.count(pixel)];
                    self.horizon[pixel] = greatest(seen);
                }
                if self.horizon[pixel] > z {
                    return false;
                }
            }
        }
        true
    }

    /// Samples a grid as the eye `eye` sees it. Of surfaces at the same depth the one that came first is seen.
    pub(crate) fn add(&mut self, grid: &std::sync::Arc<ShadedGrid>, eye: usize) {
        let Some(index) = u32::try_from(self.grids.len()).ok().filter(|i| *i < Seen::RIM) else { return };
        self.grids.push(grid.clone());
        let samples = self.samples;
        Raster { samples, grid, view: &grid.views[eye] }.each_hit(&mut Adding {
            surfaces: self,
            grid,
            index,
        });
    }

    /// A grid passes right beside a sample, `toward` which it is. Grids meet in the same points, but these may be displaced by a
    /// hair's difference (normals that differ in their last bits): a sample with one grid right on this side and another right on that
    /// side lies in such a crack and sees the farther of the two (so that what is hidden stays hidden). A grid
    /// beside which there is no other ends there.
    fn hit_beside(&mut self, sample: usize, fragment: Fragment, toward: Vec2) {
        if fragment.z >= self.nearest_z[sample] && self.depths.is_empty() {
            return;
        }
        let mut k = self.first_beside[sample];
        while let Some(other) = self.beside.get_mut(k as usize) {
            k = other.fragment.next;
            let near = (other.fragment.z - fragment.z).abs() <= CRACK_DEPTH * fragment.z.abs();
            if !near || other.fragment.grid == fragment.grid || other.toward.dot(toward) >= 0.0 {
                continue;
            }
            if !std::mem::replace(&mut other.closed, true) {
                let first = other.fragment;
                let farther = if first.z > fragment.z { first } else { fragment };
                let grid = self.grids[farther.grid as usize].clone();
                self.hit(&grid, sample, Fragment { next: NONE, ..farther });
            }
            return;
        }
        if let Ok(new) = u32::try_from(self.beside.len()) {
            let fragment = Fragment { next: self.first_beside[sample], ..fragment };
            self.beside.push(Beside { fragment, toward, closed: false });
            self.first_beside[sample] = new;
        }
    }

    fn hit(&mut self, grid: &ShadedGrid, sample: usize, fragment: Fragment) {
        let z = fragment.z;
        let behind = z >= self.nearest_z[sample];
        if behind && self.depths.is_empty() {
            return;
        }
        let opacity = if grid.opaque {
            granita_base::Color::ONE
        } else {
            grid.opacity_at(fragment.at, [fragment.u, fragment.v], self.time_for(grid, sample))
        };
        let hides =
            grid.opaque || grid.holdout != Holdout::None || opacity.cmpge(granita_base::Color::ONE).all();
        if !self.depths.is_empty() && opacity.cmpge(self.settings.depth_threshold).any() {
            let [first, second] = &mut self.depths[sample];
            // The rims of neighbouring grids overlap by a hair: that is one surface, not two.
            let same = fragment.rim && (z - *first).abs() <= 1e-4 * z.abs();
            if z < *first {
                if !same {
                    *second = *first;
                }
                *first = z;
            } else if !same && z < *second {
                *second = z;
            }
        }
        if behind {
            return;
        }
        if hides {
            self.nearest[sample] = Seen::new(&fragment);
            self.nearest_z[sample] = z;
            self.horizon[sample / self.samples.per_pixel] = f32::NAN;
        } else if let Ok(new) = u32::try_from(self.fragments.len()) {
            self.fragments.push(Fragment { next: self.first[sample], ..fragment });
            self.first[sample] = new;
        }
    }

    /// The time of a sample, where a grid shows it.
    fn time_for(&self, grid: &ShadedGrid, sample: usize) -> f32 {
        if grid.varies_over_time() { self.samples.time(sample) } else { 0.0 }
    }

    /// Composites every sample; the result is one run of samples per channel of `wanted`, in order.
    pub(crate) fn resolve(&self, wanted: &Wanted) -> Vec<f32> {
        composite::resolve(self, wanted)
    }

    /// Texels of `n` numbers of a volume shadow map for `pixels`, row by row (reference 10.1.3).
    pub(crate) fn volumes(&self, pixels: &crate::PixelRect, n: usize, opaque_width: f32) -> Vec<f32> {
        composite::volumes(self, pixels, n, opaque_width)
    }
}

/// The greatest number.
fn greatest(numbers: &[f32]) -> f32 {
    let greater = |a: f32, b: f32| if a > b { a } else { b };
    let (eights, rest) = numbers.as_chunks::<8>();
    let mut lanes = [f32::NEG_INFINITY; 8];
    for eight in eights {
        for (lane, number) in lanes.iter_mut().zip(eight) {
            *lane = greater(*number, *lane);
        }
    }
    lanes.iter().chain(rest).copied().fold(f32::NEG_INFINITY, greater)
}

/// A grid whose hits are taken.
struct Adding<'s, 'a> {
    surfaces: &'s mut Surfaces<'a>,
    grid: &'s ShadedGrid,
    /// Its index.
    index: u32,
}

impl Sink for Adding<'_, '_> {
    fn hides(&mut self, rect: &crate::PixelRect, z: f32) -> bool {
        self.surfaces.depths.is_empty() && self.surfaces.hides(rect, z)
    }

    fn limits(&self) -> Option<&[f32]> {
        self.surfaces.depths.is_empty().then_some(&self.surfaces.nearest_z)
    }

    fn hit(&mut self, hit: Hit) {
        let Hit { sample, z, at, u, v, rim, beside } = hit;
        let fragment = Fragment { z, grid: self.index, at, u, v, next: NONE, rim };
        match beside {
            Some(toward) => self.surfaces.hit_beside(sample, fragment, toward),
            None => self.surfaces.hit(self.grid, sample, fragment),
        }
    }
}

#[cfg(test)]
mod tests;
