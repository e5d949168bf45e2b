//! Tracing of batches.
//!
//! Coherent rays that follow each other in a batch are traversed together, see [`crate::packet`], the others one by
//! one, see [`crate::single`]. The kernel is written once and compiled for each kind of machine, see `simd`.

use crate::layout::Link;
use crate::packet::{Packet, RAYS, is_coherent};
use crate::probe::{Met, Probe, Wide};
use crate::scene::Scene;
use crate::single::{Best, RayScratch, Verdict, through};
use crate::{Hit, Ray};
use granita_machine::simd::{Kernel, Simd, dispatch};

/// Rays to be traced.
pub(crate) struct Batch<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) rays: &'a [Ray],
    /// The indices of the rays in the order in which to trace them; `None` for their own order.
    pub(crate) order: Option<&'a [u32]>,
}

/// The requested result.
pub(crate) enum Task<'a> {
    /// The closest hit of each ray.
    Closest(&'a mut [Hit]),
    /// One flag for each ray, true when the ray hits anything.
    Any(&'a mut [bool]),
    /// The closest hit of the first ray that is accepted.
    Where(&'a mut Hit, &'a mut dyn FnMut(&Hit) -> bool),
}

/// A batch, the requested result, and scratch for the traversal.
struct Tracing<'a, 'b, 't>(&'a Batch<'b>, Task<'t>, &'a mut RayScratch);

impl Kernel for Tracing<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.0.run(s, self.1, self.2);
    }
}

impl Batch<'_> {
    /// Traces the rays with the widest vectors of the machine.
    #[inline]
    pub(crate) fn trace(&self, task: Task<'_>, room: &mut RayScratch) {
        dispatch(Tracing(self, task, room));
    }

    #[inline(always)]
    pub(crate) fn run<S: Simd>(&self, s: S, task: Task<'_>, stack: &mut RayScratch) {
        let scene = self.scene;
        match task {
            Task::Closest(hits) => {
                self.all::<S, _, false>(
                    s,
                    stack,
                    hits,
                    (Hit::MISS, |probe, best| scene.best_hit(probe, best)),
                );
            }
            Task::Any(blocked) => {
                self.all::<S, _, true>(s, stack, blocked, (false, |_, best| best.id != u32::MAX));
            }
            Task::Where(hit, accept) => {
                let Some(probe) =
                    self.rays.first().and_then(|ray| Probe::new(ray, scene.scale, &scene.bounds))
                else {
                    return;
                };
                let mut judge = |probe: &Probe, met: &Met, id: u32| {
                    if accept(&scene.hit(probe, met, id)) { Verdict::Take } else { Verdict::Pass }
                };
                let best = self.one(s, &probe, self.rays[0].time, stack, &mut judge);
                *hit = scene.best_hit(&probe, &best);
            }
        }
    }

    /// Traces all rays, and stores the answers to their best hits: the closest ones, or any.
    #[inline(always)]
    fn all<S: Simd, T: Copy, const ANY: bool>(
        &self,
        s: S,
        scratch: &mut RayScratch,
        out: &mut [T],
        (miss, answer): (T, impl Fn(&Probe, &Best) -> T),
    ) {
        let verdict = if ANY { Verdict::Stop } else { Verdict::Take };
        let (rays, scene) = (self.rays, self.scene);
        let mut packet: Option<Packet> = None;
        for first in (0..rays.len()).step_by(RAYS) {
            let end = rays.len().min(first + RAYS);
            if self.order.is_some() || !is_coherent(&rays[first..end], scene) {
                for k in first..end {
                    let (i, soon) = self.at(s, k);
                    s.prefetch(&out[soon]);
                    out[i] = miss;
                    let Some(probe) = self.probe(&rays[i]) else { continue };
                    let best = self.one(s, &probe, rays[i].time, scratch, &mut |_, _, _| verdict);
                    out[i] = answer(&probe, &best);
                }
                continue;
            }
            let packet = packet.get_or_insert_with(Packet::new);
            let mut left = packet.load(&rays[first..end], scene);
            out[first..end].fill(miss);
            while left != 0 {
                let some = packet.select(left);
                left &= !some;
                packet.enclose(s, some);
                packet.through::<S, ANY>(s, &scene.still, some, scratch);
                for i in (first..end).filter(|i| some >> (i - first) & 1 != 0) {
                    if !scene.moving.is_empty() {
                        let moving = scene.moving.at(rays[i].time);
                        packet.single::<S, ANY>(s, &moving, Link::node(0), i - first, scratch);
                    }
                    let (probe, best) = packet.result(i - first);
                    out[i] = answer(&probe, &best);
                }
            }
        }
    }

    /// Returns the index of the ray that is traced as `k`-th, and that of one that follows soon.
    #[inline(always)]
    fn at<S: Simd>(&self, s: S, k: usize) -> (usize, usize) {
        let Some(order) = self.order else { return (k, k) };
        let soon = order[(k + 4).min(order.len() - 1)] as usize;
        s.prefetch(&self.rays[soon]);
        (order[k] as usize, soon)
    }

    #[inline(always)]
    fn probe(&self, ray: &Ray) -> Option<Probe> {
        Probe::new(ray, self.scene.scale, &self.scene.bounds)
    }

    /// Returns the best hit of one ray.
    #[inline(always)]
    fn one<S: Simd>(
        &self,
        s: S,
        probe: &Probe,
        time: f32,
        stack: &mut RayScratch,
        judge: &mut impl FnMut(&Probe, &Met, u32) -> Verdict,
    ) -> Best {
        let mut best = Best::none(probe);
        let wide = Wide::new(s, probe);
        let root = Link::node(0);
        let more = through(s, (&self.scene.still, root), (probe, &wide), stack, &mut best, judge);
        if more && !self.scene.moving.is_empty() {
            let moving = self.scene.moving.at(time);
            through(s, (&moving, root), (probe, &wide), stack, &mut best, judge);
        }
        best
    }
}
