//! Computes which surfaces the samples of an image see, and filters pixels from the samples.
//!
//! The input is a camera and grids that are diced, displaced and shaded. The output is samples and pixels. A
//! [`SampleGrid`] holds the samples of a rectangle of pixels. Each sample has a raster position, a time and a point
//! on the lens. These are hashed from the absolute pixel and the index of the sample alone, so that every bucket
//! computes the same sample. [`Surfaces`] collects what the samples see of the grids that are added.
//! [`Surfaces::resolve`] composites each sample front to back. [`film::filter`] filters samples into pixels.
//!
//! ```
//! use granita_base::{Color, Filter, Params, Reporter, Vec3};
//! use granita_dicing::{CameraView, PixelRect};
//! use granita_hider::film::{FilterSpec, PixelFilter, Support, filter};
//! use granita_hider::{CompositeSettings, SampleGrid, SamplePattern, Shade, ShadedGrid, Surfaces, ViewedGrid, Wanted};
//! use std::sync::Arc;
//!
//! let description = granita_scene::Camera { name: "main".into(), world_to_camera: Default::default(), params: Params::new() };
//! let camera = CameraView::new(&description, &Reporter::silent());
//! // A red micropolygon that covers the right half of what an orthographic camera sees.
//! let corners = [(0.0, -2.0), (2.0, -2.0), (0.0, 2.0), (2.0, 2.0)].map(|(x, y)| Vec3::new(x, y, 3.0));
//! let view = ViewedGrid::new(&camera, 2, vec![0.0], vec![corners.to_vec()], false);
//! let shade = Shade { color: vec![Color::X; 4], ..Shade::default() };
//! let grid = Arc::new(ShadedGrid { shades: vec![shade], opaque: true, ..ShadedGrid::new(2, 2, view) });
//!
//! let pixels = PixelRect { x0: 318, y0: 240, x1: 322, y1: 241 };
//! let samples = SampleGrid::new(pixels, &SamplePattern::new(&camera, false), &camera, &[]);
//! let mut surfaces = Surfaces::new(&samples, CompositeSettings::default());
//! surfaces.add(&grid, 0);
//! let values = surfaces.resolve(&Wanted::default());
//!
//! let spec = FilterSpec { filter: PixelFilter::Weighted(Filter::Box), width: [1.0; 2] };
//! let red = filter(&Support::new(&spec, &samples.tables), &samples, &values, &[0], &pixels);
//! assert_eq!(red, [0.0, 0.0, 1.0, 1.0]);
//! ```
//!
//! # Invariants
//!
//! What a sample sees depends on the absolute pixel and the grids alone, not on the rectangle that is requested. Of
//! several surfaces at one depth, the one that was added first is seen.

#![forbid(unsafe_code)]

pub mod film;
pub mod mattes;

mod blurred;
mod candidates;
mod composite;
mod hit;
mod kept;
mod lanes;
mod raster;
mod rays;
mod samples;
mod settled;
mod streaks;
mod visible;

pub use composite::{CompositeSettings, Resolved, Wanted, WantedVariable};
pub use kept::KeptSurfaces;
pub use samples::{SampleGrid, SamplePattern, Tables};
pub use visible::{NOWHERE, Projector, Shade, ShadedGrid, ViewedGrid, pixels_of};

use granita_base::Vec2;
use granita_dicing::PixelRect;
use granita_scene::Holdout;
use hit::{Hit, Raster, Sink};

/// A surface seen through a sample.
#[derive(Clone, Copy, Debug)]
struct Fragment {
    /// The depth in camera space.
    z: f32,
    /// Its place.
    seen: Seen,
    /// The index of the next fragment of the sample, or [`NONE`].
    next: u32,
}

impl Fragment {
    /// The index among the grids of this bucket.
    fn grid(&self) -> u32 {
        self.seen.grid & !Seen::RIM
    }

    /// True when the fragment is on the boundary edge of its grid, where neighbouring grids may overlap slightly.
    fn is_rim(&self) -> bool {
        self.seen.grid & Seen::RIM != 0
    }
}

/// A place on a grid. For surfaces that hide everything behind them the depth is stored separately, so that the samples
/// of a bucket stay in the processor's cache.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// The index among the grids of this bucket, combined with the bit [`Seen::RIM`]; or [`NONE`].
    grid: u32,
    /// The index of the lower left point of the micropolygon.
    at: u32,
    /// The coordinates in the micropolygon.
    u: f32,
    v: f32,
}

impl Seen {
    const NOTHING: Self = Self { grid: NONE, at: 0, u: 0.0, v: 0.0 };
    /// The bit of `grid` that is set on the boundary edge of a grid.
    const RIM: u32 = 1 << 31;

    fn fragment(self, z: f32) -> Option<Fragment> {
        (self.grid != NONE).then_some(Fragment { z, seen: self, next: NONE })
    }
}

/// A grid that passes directly beside a sample.
#[derive(Clone, Copy, Debug)]
struct Beside {
    fragment: Fragment,
    /// The direction from the sample to the grid, of any length.
    toward: Vec2,
    /// True when another grid lies on the other side. The sample is then in a crack, and the crack has been closed.
    closed: bool,
}

const NONE: u32 = u32::MAX;

/// The largest difference in depth of the grids on both sides of a crack, relative to the depth.
const CRACK_DEPTH: f32 = 1e-2;

/// The surfaces that the samples of a bucket see.
pub struct Surfaces<'a> {
    samples: &'a SampleGrid,
    settings: CompositeSettings,
    grids: Vec<std::sync::Arc<ShadedGrid>>,
    /// For each sample: the nearest surface that hides everything behind it.
    nearest: Vec<Seen>,
    /// Its depth. The list is [`SampleGrid::PADDING`] longer than the number of samples.
    nearest_z: Vec<f32>,
    /// For each sample: the index of the first of its transparent fragments.
    first: Vec<u32>,
    fragments: Vec<Fragment>,
    /// For each sample: the index of the first of the grids beside it. Their fragments are chained.
    first_beside: Vec<u32>,
    beside: Vec<Beside>,
    /// For each sample: the depths of the nearest and the second surface above "shadow:opacitythreshold". Empty
    /// unless depths are requested.
    depths: Vec<[f32; 2]>,
    /// For each pixel: the farthest of the nearest depths; NaN when it must be computed again.
    horizon: Vec<f32>,
    /// The number of transparent fragments from which on they should be composited; see [`Surfaces::is_full`].
    full: usize,
    /// The least value of `full`; see [`Surfaces::with_layers`].
    least_full: usize,
    /// What was composited before all grids were added; `None` when nothing was.
    settled: Option<settled::Settled>,
    /// Scratch for the search for hits.
    room: blurred::Scratch,
}

impl<'a> Surfaces<'a> {
    /// Returns the state in which the samples see no surface.
    pub fn new(samples: &'a SampleGrid, settings: CompositeSettings) -> Self {
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
            full: usize::MAX,
            least_full: usize::MAX,
            settled: None,
            room: blurred::Scratch::default(),
        }
    }

    /// True when everything at depth `z` and behind it is hidden in all pixels of `rect`, which is clipped to the
    /// bucket. False for an empty rectangle.
    pub fn hides(&mut self, rect: &PixelRect, z: f32) -> bool {
        let rect = rect.intersection(&self.samples.rect);
        if rect.is_empty() {
            return false;
        }
        let (per_pixel, varies) = (self.samples.per_pixel, self.samples.varies());
        for y in rect.y0..rect.y1 {
            let first = self.samples.pixel(rect.x0, y);
            let row = &mut self.horizon[first..first + rect.width()];
            // This loop has no branches. It is false for NaN.
            if row.iter().fold(true, |hidden, horizon| hidden & (*horizon <= z)) {
                continue;
            }
            for (pixel, horizon) in (first..).zip(row) {
                if horizon.is_nan() {
                    let count = if varies { self.samples.count(pixel) } else { per_pixel };
                    *horizon = greatest(&self.nearest_z[pixel * per_pixel..][..count]);
                }
                if *horizon > z {
                    return false;
                }
            }
        }
        true
    }

    /// Samples a grid as the eye `eye` sees it. Of several surfaces at the same depth, the one that was added first
    /// is seen.
    pub fn add(&mut self, grid: &std::sync::Arc<ShadedGrid>, eye: usize) {
        let Some(index) = u32::try_from(self.grids.len()).ok().filter(|i| *i < Seen::RIM) else { return };
        self.grids.push(grid.clone());
        if !grid.opaque && self.full < usize::MAX && self.fragments.capacity() == 0 {
            // Room for what one more grid adds.
            self.fragments.reserve_exact(self.full + self.full / 8);
        }
        let hides = grid.may_hide();
        let samples = self.samples;
        let mut room = std::mem::take(&mut self.room);
        let adding = &mut Adding { surfaces: self, grid, index, hides };
        Raster { samples, grid, view: &grid.views[eye] }.each_hit(&mut room, adding);
        self.room = room;
    }

    /// Records that a grid passes directly beside a sample, in the direction `toward`. Grids share the points of
    /// their common edge, but displacement may separate these slightly when the normals differ in their last bits. A
    /// sample that has one grid directly on one side and another on the opposite side lies in such a crack. It sees
    /// the farther of the two, so that hidden surfaces stay hidden. Without a second grid on the opposite side, the
    /// grid ends there.
    #[inline(never)]
    fn hit_beside(&mut self, sample: usize, fragment: Fragment, toward: Vec2) {
        if fragment.z >= self.nearest_z[sample] && self.depths.is_empty() {
            return;
        }
        let mut k = self.first_beside[sample];
        while let Some(other) = self.beside.get_mut(k as usize) {
            k = other.fragment.next;
            let near = (other.fragment.z - fragment.z).abs() <= CRACK_DEPTH * fragment.z.abs();
            if !near || other.fragment.grid() == fragment.grid() || other.toward.dot(toward) >= 0.0 {
                continue;
            }
            if !std::mem::replace(&mut other.closed, true) {
                let first = other.fragment;
                let farther = if first.z > fragment.z { first } else { fragment };
                let grid = self.grids[farther.grid() as usize].clone();
                self.hit((&grid, true), sample, Fragment { next: NONE, ..farther });
            }
            return;
        }
        if let Ok(new) = u32::try_from(self.beside.len()) {
            let fragment = Fragment { next: self.first_beside[sample], ..fragment };
            self.beside.push(Beside { fragment, toward, closed: false });
            self.first_beside[sample] = new;
        }
    }

    /// Records that a sample sees a grid. `may_hide` is false when the grid certainly hides nothing.
    #[inline(always)]
    fn hit(&mut self, (grid, may_hide): (&ShadedGrid, bool), sample: usize, fragment: Fragment) {
        let Fragment { z, seen, .. } = fragment;
        let behind = z >= self.nearest_z[sample];
        if behind && self.depths.is_empty() {
            return;
        }
        let plain = grid.opaque && self.depths.is_empty();
        // A reference to `fragment` itself would keep it in memory, which most hits do not need.
        let hides = plain
            || (may_hide || !self.depths.is_empty())
                && self.hides_behind(grid, sample, &Fragment { z, seen, next: NONE });
        if behind {
            return;
        }
        if hides {
            self.nearest[sample] = seen;
            self.nearest_z[sample] = z;
            self.horizon[self.samples.pixel_of(sample)] = f32::NAN;
        } else if let Ok(new) = u32::try_from(self.fragments.len()) {
            self.fragments.push(Fragment { z, seen, next: self.first[sample] });
            self.first[sample] = new;
        }
    }

    /// True when a fragment hides everything behind it. Its depth is recorded when depths are requested.
    #[inline(never)]
    fn hides_behind(&mut self, grid: &ShadedGrid, sample: usize, fragment: &Fragment) -> bool {
        let (z, Seen { at, u, v, .. }) = (fragment.z, fragment.seen);
        let opacity = if grid.opaque {
            granita_base::Color::ONE
        } else {
            grid.opacity_at(at, [u, v], self.time_for(grid, sample))
        };
        if !self.depths.is_empty() && opacity.cmpge(self.settings.depth_threshold).any() {
            let [first, second] = &mut self.depths[sample];
            // The boundary edges of neighbouring grids overlap slightly. The overlap is one surface, not two.
            let same = fragment.is_rim() && (z - *first).abs() <= 1e-4 * z.abs();
            if z < *first {
                if !same {
                    *second = *first;
                }
                *first = z;
            } else if !same && z < *second {
                *second = z;
            }
        }
        grid.opaque || grid.holdout != Holdout::None || opacity.cmpge(granita_base::Color::ONE).all()
    }

    /// Returns the time of a sample when the shading of the grid varies over time, else 0.
    fn time_for(&self, grid: &ShadedGrid, sample: usize) -> f32 {
        if grid.varies_over_time() { self.samples.time(sample) } else { 0.0 }
    }

    /// Returns what layers of its samples refer to.
    fn scenery(&self) -> composite::Scenery<'_> {
        composite::Scenery { samples: self.samples, settings: &self.settings, grids: &self.grids }
    }

    /// Composites every sample. The result has one run of samples for each channel of `wanted`, in order. `wanted` is
    /// that of [`Surfaces::settle`], if that was called.
    pub fn resolve(&self, wanted: &Wanted) -> Vec<f32> {
        self.resolve_all(wanted).values
    }

    /// Composites every sample as [`Surfaces::resolve`], and returns the mattes that the samples see as well.
    pub fn resolve_all(&self, wanted: &Wanted) -> Resolved {
        match &self.settled {
            Some(settled) => settled.resolve(self, wanted),
            None => composite::resolve(self, wanted),
        }
    }

    /// Returns the texels of a volume shadow map for `pixels`, `n` numbers each, row by row (reference 10.1.3).
    pub fn volumes(&self, pixels: &PixelRect, n: usize, opaque_width: f32) -> Vec<f32> {
        composite::volumes(self, pixels, n, opaque_width)
    }
}

/// Returns the greatest of some numbers.
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

/// A grid whose hits are recorded in [`Surfaces`].
struct Adding<'s, 'a> {
    surfaces: &'s mut Surfaces<'a>,
    grid: &'s ShadedGrid,
    /// The index of the grid.
    index: u32,
    /// False when the grid certainly hides nothing.
    hides: bool,
}

impl Sink for Adding<'_, '_> {
    fn hides(&mut self, rect: &PixelRect, z: f32) -> bool {
        self.surfaces.depths.is_empty() && self.surfaces.hides(rect, z)
    }

    fn limits(&self) -> Option<&[f32]> {
        self.surfaces.depths.is_empty().then_some(&self.surfaces.nearest_z)
    }

    #[inline(always)]
    fn hit(&mut self, hit: Hit) {
        let Hit { sample, z, at, u, v, rim, beside } = hit;
        let grid = self.index | if rim { Seen::RIM } else { 0 };
        let fragment = Fragment { z, seen: Seen { grid, at, u, v }, next: NONE };
        match beside {
            Some(toward) => self.surfaces.hit_beside(sample, fragment, toward),
            None => self.surfaces.hit((self.grid, self.hides), sample, fragment),
        }
    }
}

#[cfg(test)]
mod tests;
