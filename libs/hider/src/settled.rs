//! Composites the nearest surfaces of samples before all grids were added, so that memory stays bounded.
//!
//! Grids come nearest first. When there are many transparent fragments, those before the nearest grid that is still to
//! come are composited, and only the state of each sample is kept. The sums are formed in the same order as at once.

use super::composite::{self, Layer, Resolved, Rim, Through, Wanted};
use super::mattes::Coverage;
use super::{CRACK_DEPTH, Fragment, NONE, Seen, Surfaces};

/// The bytes of transparent fragments from which on they should be composited, at most.
const MOST_BYTES: usize = 32 << 20;

/// The mean number of fragments of a sample from which on they should be composited, at most. They are then still in
/// the processor's cache.
const MOST_LAYERS: usize = 8;

/// What was composited of samples.
#[derive(Clone, Debug)]
pub(super) struct Settled {
    /// The channels so far, those of a sample side by side.
    channels: Vec<f32>,
    /// For each sample: its state.
    states: Vec<State>,
    /// The mattes so far.
    coverage: Coverage,
}

/// The state of a sample.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    through: Through,
    /// The last fragment, when it is on a boundary edge.
    last: Option<Rim>,
    /// True when nothing behind the last fragment is seen.
    done: bool,
}

/// Lists for one sample, kept from one to the next.
#[derive(Default)]
struct Scratch {
    fragments: Vec<Fragment>,
    layers: Vec<Layer>,
}

impl<'a> Surfaces<'a> {
    /// Bounds the memory of transparent fragments. `layers` is the mean number of fragments of a sample from which on
    /// [`Surfaces::is_full`] is true; more than 8 count as 8, and [`usize::MAX`] sets no bound. The number is lower
    /// for large buckets, so that fragments take at most 32 MiB.
    #[must_use]
    pub fn with_layers(mut self, layers: usize) -> Self {
        self.least_full = match layers {
            usize::MAX => usize::MAX,
            _ => {
                let fragments = self.samples.len().saturating_mul(layers.min(MOST_LAYERS));
                fragments.clamp(1, MOST_BYTES / size_of::<Fragment>())
            }
        };
        self.full = self.least_full;
        self
    }

    /// True when [`Surfaces::settle`] should be called. Always false without [`Surfaces::with_layers`].
    pub fn is_full(&self) -> bool {
        self.fragments.len() >= self.full
    }

    /// Composites what samples see before the depth `z`. No part of a grid that is added later may be nearer than
    /// `z`. The result of [`Surfaces::resolve`] is unchanged, to the bit.
    ///
    /// Samples through which nothing more is seen count as hidden from then on, unless depths are requested.
    /// [`Surfaces::volumes`] and [`super::KeptSurfaces`] need all fragments and must not be used afterwards.
    pub fn settle(&mut self, z: f32, wanted: &Wanted) {
        let n = self.samples.len();
        let mut settled = self.settled.take().unwrap_or_else(|| Settled {
            channels: vec![0.0; wanted.channels() * n],
            states: vec![State::default(); n],
            coverage: Resolved::new(wanted, n).coverage,
        });
        let mut room = Scratch::default();
        let old = std::mem::take(&mut self.fragments);
        for s in 0..n {
            self.split_chain(s, (z, settled.states[s].done), &old, &mut room.fragments);
            let opaque = self.nearest_z[s] < z;
            if (room.fragments.is_empty() && !opaque) || settled.states[s].done {
                continue;
            }
            if opaque {
                room.fragments.extend(self.nearest[s].fragment(self.nearest_z[s]));
            }
            settled.add(self, (wanted, s), &mut room);
            if opaque || settled.states[s].done {
                settled.states[s].done = true;
                self.finish(s);
            }
        }
        // The list keeps its capacity.
        let rest = std::mem::replace(&mut self.fragments, old);
        self.fragments.clear();
        self.fragments.extend_from_slice(&rest);
        self.forget_beside(z);
        self.forget_grids(&mut settled);
        self.settled = Some(settled);
        // What cannot be composited yet is not looked at again and again.
        self.full = self.least_full.max(2 * self.fragments.len());
    }

    /// Moves the fragments of a sample that are before the depth `z` to `before`, sorted, and keeps those behind it.
    /// Keeps none when the sample is done.
    fn split_chain(
        &mut self,
        s: usize,
        (z, done): (f32, bool),
        old: &[Fragment],
        before: &mut Vec<Fragment>,
    ) {
        before.clear();
        let nearest_z = self.nearest_z[s];
        let mut next = std::mem::replace(&mut self.first[s], NONE);
        // The chain of those that stay is stored in one piece, in its order.
        let kept = self.fragments.len();
        while let Some(fragment) = old.get(next as usize) {
            next = fragment.next;
            if done || fragment.z >= nearest_z {
                continue;
            }
            if fragment.z < z {
                before.push(*fragment);
            } else {
                let following = self.fragments.len() as u32 + 1;
                self.fragments.push(Fragment { next: following, ..*fragment });
            }
        }
        if self.fragments.len() > kept {
            self.first[s] = kept as u32;
            if let Some(last) = self.fragments.last_mut() {
                last.next = NONE;
            }
        }
        composite::sort(before);
    }

    /// Hides everything from a sample through which nothing more is seen.
    fn finish(&mut self, s: usize) {
        self.nearest[s] = Seen::NOTHING;
        if self.depths.is_empty() {
            self.nearest_z[s] = f32::NEG_INFINITY;
            self.horizon[s / self.samples.per_pixel] = f32::NAN;
        }
    }

    /// Removes grids beside samples that are too far before the depth `z` to be at a crack.
    fn forget_beside(&mut self, z: f32) {
        let depths = !self.depths.is_empty();
        // Twice the distance leaves room for rounding.
        let least = if z > 0.0 { z * (1.0 - 2.0 * CRACK_DEPTH) } else { f32::NEG_INFINITY };
        let mut kept = Vec::new();
        for (first, nearest_z) in self.first_beside.iter_mut().zip(&self.nearest_z) {
            let mut next = std::mem::replace(first, NONE);
            let begin = kept.len();
            while let Some(beside) = self.beside.get(next as usize) {
                next = beside.fragment.next;
                if beside.fragment.z >= least && (depths || *nearest_z > f32::NEG_INFINITY) {
                    let mut beside = *beside;
                    beside.fragment.next = kept.len() as u32 + 1;
                    kept.push(beside);
                }
            }
            if let Some(last) = kept[begin..].last_mut() {
                last.fragment.next = NONE;
                *first = begin as u32;
            }
        }
        self.beside = kept;
    }

    /// Removes the grids that nothing refers to any more.
    fn forget_grids(&mut self, settled: &mut Settled) {
        let mut new = vec![NONE; self.grids.len()];
        let beside = self.beside.iter().map(|beside| beside.fragment.seen.grid);
        let nearest = self.nearest.iter().map(|seen| seen.grid).filter(|grid| *grid != NONE);
        for grid in self.fragments.iter().map(|fragment| fragment.seen.grid).chain(beside).chain(nearest) {
            new[(grid & !Seen::RIM) as usize] = 0;
        }
        for (number, new) in (0..).zip(new.iter_mut().filter(|new| **new == 0)) {
            *new = number;
        }
        let mut at = new.iter();
        self.grids.retain(|_| at.next().is_some_and(|new| *new != NONE));
        let renumber = |grid: &mut u32| *grid = (*grid & Seen::RIM) | new[(*grid & !Seen::RIM) as usize];
        self.fragments.iter_mut().for_each(|fragment| renumber(&mut fragment.seen.grid));
        self.beside.iter_mut().for_each(|beside| renumber(&mut beside.fragment.seen.grid));
        self.nearest.iter_mut().filter(|seen| seen.grid != NONE).for_each(|seen| renumber(&mut seen.grid));
        for last in settled.states.iter_mut().filter_map(|state| state.last.as_mut()) {
            last.grid = new.get(last.grid as usize).copied().unwrap_or(NONE);
        }
    }
}

impl Settled {
    /// Composites the fragments of a sample in `room`, which are the next ones behind those that were composited.
    fn add(&mut self, surfaces: &Surfaces<'_>, (wanted, s): (&Wanted, usize), room: &mut Scratch) {
        let Scratch { fragments, layers } = room;
        let State { through, last, done } = &mut self.states[s];
        composite::join_rims(fragments, &surfaces.grids, last);
        layers.clear();
        layers.extend(fragments.iter().map(Layer::from));
        let width = wanted.channels();
        let channels = &mut self.channels[s * width..][..width];
        *done |= composite::blend(
            surfaces.scenery(),
            (wanted, s),
            layers,
            through,
            (channels, &mut self.coverage),
        );
    }

    /// Composites the rest of all samples. See [`Surfaces::resolve_all`].
    pub(super) fn resolve(&self, surfaces: &Surfaces<'_>, wanted: &Wanted) -> Resolved {
        let (n, width) = (self.states.len(), wanted.channels());
        let mut all = self.clone();
        let mut room = Scratch::default();
        let mut out = vec![0.0; width * n];
        for s in 0..n {
            if !all.states[s].done {
                composite::chain(surfaces, s, &mut room.fragments);
                all.add(surfaces, (wanted, s), &mut room);
            }
            let channels = &mut all.channels[s * width..][..width];
            if wanted.depths {
                composite::store_depths(surfaces.depths.get(s).copied(), channels);
            }
            for (c, value) in channels.iter().enumerate() {
                out[c * n + s] = *value;
            }
        }
        Resolved { values: out, coverage: all.coverage }
    }
}

#[cfg(test)]
mod tests {
    use crate::composite::{CompositeSettings, Wanted, WantedVariable};
    use crate::{SampleGrid, SamplePattern, Shade, ShadedGrid, Surfaces, ViewedGrid};
    use granita_base::{Color, Vec3, hash};
    use granita_dicing::{CameraView, PixelRect};
    use granita_scene::Holdout;
    use std::sync::Arc;

    /// A number from 0 to 1.
    fn random(grid: u32, k: u32) -> f32 {
        hash::unit(hash::words(&[grid, k]))
    }

    /// Returns grids in pairs that share an edge, nearest first. Some move, some are opaque, some are mattes, and some
    /// were shaded twice.
    fn grids(camera: &CameraView, lens: bool, moving: bool) -> Vec<(f32, Arc<ShadedGrid>)> {
        let grid = |k: u32| {
            let (pair, second) = (k / 2, (k % 2) as f32);
            // The second grid lies beside the first one, or overlaps it, or there is a crack between both.
            let (offset, behind, slope) = match pair % 4 {
                1 => (1.5, 1.0 + 5e-5 * second, 0.0),
                3 => (3.008, 1.0 + 5e-3 * second, 0.0),
                _ => (3.0, 1.0, 0.3),
            };
            let x = random(pair, 0) * 4.0 - 2.0 + offset * second;
            let (y, z) = (random(pair, 1) * 3.0 - 1.5, (4.0 + 6.0 * random(pair, 2)) * behind);
            let at = |t: f32, i: usize| {
                let (u, v) = ((i % 3) as f32, (i / 3) as f32);
                let side = if pair % 5 == 1 { 4.0 } else { 1.5 };
                Vec3::new(x + 1.5 * u + t, y + side * v, z + slope * v + 0.5 * t)
            };
            let times = if moving && pair % 2 == 0 { vec![0.0, 1.0] } else { vec![0.0] };
            let p_cam = times.iter().map(|t| (0..9).map(|i| at(*t, i)).collect()).collect();
            let mut view = ViewedGrid::new(camera, 3, times, p_cam, lens);
            view.rim_px = 0.05;
            view.z_min = view.p_cam.iter().flatten().map(|p| p.z).fold(f32::INFINITY, f32::min);
            let opaque = pair % 9 == 7;
            let color = |k: u32| Color::new(random(pair, k), random(pair, k + 1), random(pair, k + 2));
            let shade = |time: f32, k: u32| Shade {
                time,
                color: (0..9).map(|i| color(100 + 3 * i + k)).collect(),
                opacity: if opaque { Vec::new() } else { (0..9).map(|i| color(3 + 3 * i + k)).collect() },
                variables: (0..36).map(|i| random(k, 200 + i)).collect(),
            };
            let mut shades = vec![shade(0.0, 0)];
            if moving && pair % 4 == 0 {
                shades.push(shade(1.0, 500));
            }
            let holdout = if pair % 11 == 10 { Holdout::Matte } else { Holdout::None };
            let grid = ShadedGrid { shades, opaque, holdout, primitive: pair, ..ShadedGrid::new(3, 3, view) };
            (grid.views[0].z_min, Arc::new(grid))
        };
        let mut grids: Vec<_> = (0..120).map(grid).collect();
        grids.sort_by(|a, b| a.0.total_cmp(&b.0));
        grids
    }

    fn settings(threshold: f32, layers: Option<usize>, depths: bool) -> CompositeSettings {
        let opacity_threshold = Color::splat(threshold);
        CompositeSettings { opacity_threshold, depth_threshold: Color::splat(0.5), layers, depths }
    }

    fn wanted(depths: bool) -> Wanted {
        let variable = |(offset, width, is_color)| WantedVariable { offset, width, is_color };
        Wanted { depths, variables: [(0, 3, true), (3, 1, false)].map(variable).to_vec(), mattes: None }
    }

    #[test]
    fn layers_that_are_composited_early_have_the_values_of_layers_composited_at_once() {
        let rect = PixelRect { x0: 0, y0: 0, x1: 32, y1: 24 };
        for (lens, moving) in [(false, false), (true, false), (false, true), (true, true)] {
            let camera = crate::tests::camera(lens);
            let samples = SampleGrid::new(rect, &SamplePattern::new(&camera, moving), &camera, &[rect]);
            let grids = grids(&camera, lens, moving);
            for settings in [
                settings(1.0, None, false),
                settings(0.9, None, false),
                settings(0.9, None, true),
                settings(0.9, Some(3), false),
            ] {
                let wanted = wanted(settings.depths);
                let resolved = |layers: Option<usize>| {
                    let mut surfaces =
                        Surfaces::new(&samples, settings).with_layers(layers.unwrap_or(usize::MAX));
                    let (mut most, mut settled) = (0, 0);
                    for (z, grid) in &grids {
                        if surfaces.is_full() {
                            surfaces.settle(*z, &wanted);
                            settled += 1;
                        }
                        surfaces.add(grid, 0);
                        most = most.max(surfaces.grids.len());
                    }
                    (surfaces.resolve(&wanted), settled, most)
                };
                let (expected, none, _) = resolved(None);
                assert!(none == 0 && expected.iter().any(|value| *value != 0.0));
                for layers in [0, 1] {
                    let (values, settled, most) = resolved(Some(layers));
                    assert!(settled > 1, "{settled} times, {layers} layers");
                    assert!(layers > 0 || most < grids.len(), "grids are released");
                    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                    assert!(
                        bits(&values) == bits(&expected),
                        "lens {lens}, moving {moving}, {settings:?}, {layers}"
                    );
                }
            }
        }
    }

    #[test]
    fn samples_through_which_nothing_is_seen_hide_what_follows() {
        let camera = crate::tests::camera(false);
        let rect = PixelRect { x0: 12, y0: 8, x1: 20, y1: 16 };
        let samples = SampleGrid::new(rect, &SamplePattern::new(&camera, false), &camera, &[]);
        let layer = |k: u32| {
            let z = 4.0 + k as f32;
            let at = |i: usize| Vec3::new((i % 2) as f32 * 200.0 - 100.0, (i / 2) as f32 * 200.0 - 100.0, z);
            let view = ViewedGrid::new(&camera, 2, vec![0.0], vec![(0..4).map(at).collect()], false);
            let shade = Shade { opacity: vec![Color::splat(0.5); 4], ..Shade::default() };
            (z, Arc::new(ShadedGrid { shades: vec![shade], ..ShadedGrid::new(2, 2, view) }))
        };
        for (depths, threshold, hidden) in [(false, 0.9, true), (false, 1.0, false), (true, 0.9, false)] {
            let mut surfaces = Surfaces::new(&samples, settings(threshold, None, depths)).with_layers(1);
            for (z, grid) in (0..6).map(layer) {
                surfaces.settle(z, &Wanted { depths, ..Wanted::default() });
                surfaces.add(&grid, 0);
            }
            assert_eq!(surfaces.hides(&rect, 20.0), hidden, "depths {depths}, threshold {threshold}");
        }
    }
}
