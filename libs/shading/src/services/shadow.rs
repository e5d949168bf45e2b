//! Answers `shadow ()` with the name of a geometry set (reference 10.1.6) by rays from the points to the light.
//!
//! "blur" 1 is a light of 90 degrees. "angle" is the half angle of one; when neither is given, that of the spread
//! of broad solar lights is taken. Several samples are also spread over the footprint.
//!
//! Where a single ray represents a point and neighbouring points disagree, the edge of a hard shadow passes between
//! them. There further rays are spread over the part of the surface that the point represents, so that the edge is
//! as smooth as one of geometry. Only neighbours in the point's own rectangle of the grid count, and the rays
//! follow from their places alone. The result does not depend on which points are shaded together.
//!
//! No ray begins on or beyond a boundary edge of the surface ([`Origins`]).

use super::maps::fit;
use super::origins::Origins;
use super::rays::{Aim, DIRECTION, HIT, in_footprint};
use super::{Run, count, option, samples};
use crate::object::RayScene;
use granita_base::{Color, NoiseSource, Vec3, hash, sample};
use granita_rays::sampling::{Distribution, in_cone};
use granita_rays::{Leaving, RayRequest};
use granita_shade::{Lanes3, Rect, ShadowQuery};
use granita_trace::Ray;
use std::f32::consts::FRAC_PI_4;
use std::sync::atomic::Ordering;

/// The number of rays of a point at the edge of a hard shadow.
const EDGE_RAYS: u32 = 16;
/// Hashed into their seeds.
const EDGE: u32 = 0xed6e;
/// Neighbouring points agree when their shadows differ by less than this.
const AGREEMENT: f32 = 0.125;
/// Neighbouring points look at one place of a light when their targets are no farther apart than this, relative to
/// the distance to the light. Others sample a light that has an extent.
const ONE_PLACE: f32 = 1.0e-4;

/// The rays of a lane.
struct Spread {
    lane: u32,
    samples: u32,
    seed: u32,
    /// The widths of [`RayRequest::widths`].
    widths: [f32; 2],
}

/// The parameters of a lane.
struct Asked {
    /// The half angle of the light in radians.
    half_angle: f32,
    samples: u32,
}

impl Asked {
    /// Returns those of a lane. `factor` is the attribute "render:samples".
    fn new(query: &ShadowQuery<'_>, lane: usize, factor: f32) -> Self {
        let o = &query.options;
        let blur = 0.5 * (option(o.sblur, lane, 0.0) + option(o.tblur, lane, 0.0));
        let half_angle = o.angle.map_or(blur * FRAC_PI_4, |a| a.get(lane));
        Self { half_angle, samples: samples(count(o.samples, lane), factor) }
    }

    /// True for a single ray to one place.
    fn is_hard(&self) -> bool {
        self.samples == 1 && self.half_angle <= 0.0
    }
}

/// Rays to the light, grouped by lane.
struct Bundle<'b> {
    query: &'b ShadowQuery<'b>,
    origins: &'b Origins<'b>,
    scene: &'b RayScene,
    lanes: Vec<Spread>,
    rays: Vec<Ray>,
    leaving: Vec<Leaving>,
}

/// Answers `shadow ()`: how much of the light is blocked, for each active lane.
pub(super) fn shadow(run: &mut Run<'_, '_>, query: &ShadowQuery<'_>, out: &mut Lanes3) {
    fit(out, query.batch.lanes);
    let traces = run.may_trace();
    let call = run.next_call(query.batch.active);
    for &lane in query.batch.active {
        out.set(lane as usize, Vec3::ZERO);
    }
    if !traces || query.batch.active.is_empty() {
        return;
    }
    let Some(scene) = run.frame.rays.scene(query.name, run.frame) else { return };
    let o = &query.options;
    let origins = Origins::new(run, query.batch, query.p, o.bias);
    let mut bundle = Bundle::new(query, &origins, scene);
    let mut hard = false;
    for &lane in query.batch.active {
        let i = lane as usize;
        let asked = Asked::new(query, i, run.frame.samples());
        hard = hard || asked.is_hard();
        let width = 0.5 * (option(o.swidth, i, 1.0) + option(o.twidth, i, 1.0));
        let per_ray = 1.0 / (asked.samples as f32).sqrt();
        let seed = match asked.is_hard() {
            true => run.call_seed(call, lane),
            false => run.lane_seed(NoiseSource::Lights, call, lane),
        };
        let shared = match asked.is_hard() {
            true => run.share(call, lane),
            false => run.draw(NoiseSource::Lights, call, lane),
        };
        let footprint = query.dpdx.get(i).length().max(query.dpdy.get(i).length());
        let first = bundle.rays.len();
        for index in 0..asked.samples {
            let place = shared.place(index, asked.samples);
            let [x, y] = in_footprint(asked.samples, place, shared.sequence).map(|x| x * width);
            let off = origins.inside(i, [query.dpdx.get(i) * x, query.dpdy.get(i) * y]);
            let toward = |axis: Vec3| match asked.is_hard() {
                true => axis,
                false => {
                    let directions = shared.sequence.dimension(DIRECTION);
                    in_cone(axis, asked.half_angle, Distribution::Uniform, place, directions)
                }
            };
            bundle.add(run, i, off, &toward, run.ray_time(place, shared.sequence.seed));
        }
        if bundle.rays.len() > first {
            let widths = [footprint * per_ray, 2.0 * asked.half_angle.max(0.0) * per_ray];
            bundle.lanes.push(Spread { lane, samples: asked.samples, seed, widths });
        }
    }
    bundle.trace(run, out);
    if hard && !run.sees_motion() {
        edges(run, (query, &origins), scene, call, out);
    }
}

impl<'b> Bundle<'b> {
    fn new(query: &'b ShadowQuery<'b>, origins: &'b Origins<'b>, scene: &'b RayScene) -> Self {
        Self { query, origins, scene, lanes: Vec::new(), rays: Vec::new(), leaving: Vec::new() }
    }

    /// Adds a ray of a lane from the offset `off` of its point, turned by `toward` from the direction of the light.
    /// Adds none where the light has no direction.
    fn add(&mut self, run: &Run<'_, '_>, lane: usize, off: Vec3, toward: &dyn Fn(Vec3) -> Vec3, time: f32) {
        let query = self.query;
        let (at, to_light) = (query.p.get(lane), query.to_light.get(lane));
        let Some(axis) = to_light.try_normalize() else { return };
        let lifted = run.lift.as_ref().map_or(at, |lift| lift.above(lane, at, to_light));
        let p = lifted + self.origins.inset(lane) + off;
        // The ray goes towards the light as seen from the moved point, and ends before the light's own surface.
        let (axis, tmax) = if query.light_infinite {
            (axis, f32::INFINITY)
        } else {
            let to = if p == at { to_light } else { at + to_light - p };
            (to.normalize_or(axis), (to.length() - run.frame.ray_margin(at + to_light)).max(0.0))
        };
        let bias = run.bias(query.options.bias, lane);
        self.rays.push(Aim { p, dir: toward(axis), bias, tmax, time }.ray());
        self.leaving.push(run.leaving(Some(self.scene), at));
    }

    /// Traces all rays and adds the mean blocked share to their lanes.
    fn trace(self, run: &mut Run<'_, '_>, out: &mut Lanes3) {
        let Self { query, scene, lanes, rays, leaving, .. } = self;
        if rays.is_empty() {
            return;
        }
        if scene.opaque_to_shadows {
            let of_rays = || lanes.iter().flat_map(|s| std::iter::repeat_n(s.widths, s.samples as usize));
            let widths: Vec<[f32; 2]> = if scene.is_settled() { Vec::new() } else { of_rays().collect() };
            let widths = |k: usize| widths.get(k).copied().unwrap_or_default();
            run.frame.rays.counts.shadow_rays.fetch_add(rays.len() as u64, Ordering::Relaxed);
            let blocked = scene.any(run.thread, &rays, &widths, &|k| leaving[k]);
            let mut rest = &blocked[..];
            for Spread { lane, samples, .. } in lanes {
                let (own, others) = rest.split_at(samples as usize);
                rest = others;
                let open = own.iter().filter(|blocked| !**blocked).count();
                out.set(lane as usize, Color::splat(1.0 - open as f32 / samples as f32));
            }
            return;
        }
        let named = |s: &Spread| {
            let Spread { lane, samples, seed, widths: [width, spread] } = *s;
            (0..samples).map(move |index| (lane, hash::words(&[seed, index, HIT]), width, spread))
        };
        let requests: Vec<RayRequest> = lanes
            .iter()
            .flat_map(named)
            .zip(rays.into_iter().zip(leaving))
            .map(|((lane, name, width, spread), (ray, leaving))| RayRequest {
                lane,
                name,
                leaving,
                width,
                spread,
                ..RayRequest::new(ray)
            })
            .collect();
        let purpose = run.purpose();
        let passed = run.thread.transmission(scene, &requests, purpose, query.messages);
        let mut rest = &passed[..];
        for Spread { lane, samples, .. } in lanes {
            let (own, others) = rest.split_at(samples as usize);
            rest = others;
            let mean = own.iter().fold(Color::ZERO, |sum, t| sum + *t) / samples as f32;
            out.set(lane as usize, Color::ONE - mean);
        }
    }
}

/// Samples each point of a rectangle whose neighbours disagree again, with [`EDGE_RAYS`] rays over its part of the
/// surface.
fn edges(
    run: &mut Run<'_, '_>,
    (query, origins): (&ShadowQuery<'_>, &Origins<'_>),
    scene: &RayScene,
    call: u32,
    out: &mut Lanes3,
) {
    let mut bundle = Bundle::new(query, origins, scene);
    let mut active = vec![false; query.batch.lanes];
    query.batch.active.iter().for_each(|lane| active[*lane as usize] = true);
    let rects: Vec<Rect> = run.topology.rects().collect();
    let mut rest = query.batch.active;
    for rect in rects {
        let (own, later) = rest.split_at(rest.partition_point(|lane| (*lane as usize) < rect.lanes().end));
        rest = later;
        let differs = own.windows(2).any(|w| disagree(out, w[0] as usize, w[1] as usize));
        let whole = rect.lanes().end <= active.len();
        if !differs || !whole || is_line(&rect, |lane| query.p.get(lane)) {
            continue;
        }
        for &lane in own {
            let i = lane as usize;
            if !Asked::new(query, i, run.frame.samples()).is_hard() {
                continue;
            }
            let around = Neighbours::new(&rect, i, &active);
            let at_edge = around.all().any(|k| disagree(out, i, k) && look_alike(query, i, k));
            let seed = hash::words(&[run.call_seed(call, lane), EDGE]);
            let first = bundle.rays.len();
            for index in 0..if at_edge { EDGE_RAYS } else { 0 } {
                // All points use one pattern, so that neighbours differ by the position of the edge and not by noise.
                let (x, y) = sample::square(index, 0);
                let off = origins.inside(i, around.ways(query, i, [x - 0.5, y - 0.5]));
                bundle.add(run, i, off, &|axis| axis, run.ray_time([0, 1], seed));
            }
            if bundle.rays.len() > first {
                let side = query.dpdx.get(i).length().max(query.dpdy.get(i).length());
                let widths = [side / (EDGE_RAYS as f32).sqrt(), 0.0];
                bundle.lanes.push(Spread { lane, samples: EDGE_RAYS, seed, widths });
            }
        }
    }
    bundle.trace(run, out);
}

/// True when a rectangle of points is a line and not a surface: a single row, or two rows that are closer than
/// their points, as those of a hair. Nearly all of its points lie in the shadows of other hairs, and it is too thin
/// to show an edge across.
fn is_line(rect: &Rect, p: impl Fn(usize) -> Vec3) -> bool {
    let across = |first: usize, step: usize, n: usize| {
        (0..n).map(|k| p(first + k * step).distance(p(first + (k + 1) * step))).sum::<f32>() / n as f32
    };
    let (nu, nv, first) = (rect.nu, rect.nv, rect.first);
    if nu < 2 || nv < 2 {
        return true;
    }
    // The mean distances of neighbours along u and v, on the first and last rows and columns.
    let along_u = across(first, 1, nu - 1).max(across(first + nu * (nv - 1), 1, nu - 1));
    let along_v = across(first, nu, nv - 1).max(across(first + nu - 1, nu, nv - 1));
    nu == 2 && nv > 2 && along_u < along_v || nv == 2 && nu > 2 && along_v < along_u
}

/// True when the shadows of two points differ.
fn disagree(out: &Lanes3, a: usize, b: usize) -> bool {
    (out.get(a) - out.get(b)).abs().max_element() > AGREEMENT
}

/// True when two points look at one place, or in one direction.
fn look_alike(query: &ShadowQuery<'_>, a: usize, b: usize) -> bool {
    let (to_a, to_b) = (query.to_light.get(a), query.to_light.get(b));
    if query.light_infinite {
        return to_a.normalize_or_zero().distance(to_b.normalize_or_zero()) <= ONE_PLACE;
    }
    let (a, b) = (query.p.get(a) + to_a, query.p.get(b) + to_b);
    a.distance(b) <= ONE_PLACE * to_a.length()
}

/// The neighbours of a point in its rectangle.
struct Neighbours {
    /// Before and after along u, then along v.
    beside: [Option<usize>; 4],
    across: [Option<usize>; 4],
}

impl Neighbours {
    fn new(rect: &Rect, lane: usize, active: &[bool]) -> Self {
        let (column, row) = ((lane - rect.first) % rect.nu, (lane - rect.first) / rect.nu);
        let at = |right: isize, down: isize| {
            let (column, row) = (column.checked_add_signed(right)?, row.checked_add_signed(down)?);
            let there = column < rect.nu && row < rect.nv;
            Some(rect.first + row * rect.nu + column).filter(|k| there && active[*k])
        };
        Self {
            beside: [at(-1, 0), at(1, 0), at(0, -1), at(0, 1)],
            across: [at(-1, -1), at(1, -1), at(-1, 1), at(1, 1)],
        }
    }

    fn all(&self) -> impl Iterator<Item = usize> + '_ {
        self.beside.iter().chain(&self.across).flatten().copied()
    }

    /// Returns the way from the point to a place at the fractions `x` and `y` (-0.5 to 0.5) of the way to the next
    /// points, along u and along v. Where there is no next point, the one on the other side is mirrored.
    fn ways(&self, query: &ShadowQuery<'_>, lane: usize, place: [f32; 2]) -> [Vec3; 2] {
        let p = query.p.get(lane);
        [0, 1].map(|axis| {
            let x = place[axis];
            let [before, after] = [self.beside[2 * axis], self.beside[2 * axis + 1]];
            let (next, other) = if x < 0.0 { (before, after) } else { (after, before) };
            match (next, other) {
                (Some(next), _) => (query.p.get(next) - p) * x.abs(),
                (None, Some(other)) => (p - query.p.get(other)) * x.abs(),
                (None, None) => Vec3::ZERO,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_of_curves_are_lines_and_faces_are_not() {
        let line = |nu: usize, nv: usize, du: f32, dv: f32| {
            let place = |k: usize| Vec3::new((k % nu) as f32 * du, (k / nu) as f32 * dv, 0.0);
            is_line(&Rect { first: 0, nu, nv }, place)
        };
        assert!(line(1, 9, 1.0, 1.0) && line(9, 1, 1.0, 1.0));
        assert!(line(2, 9, 0.6, 1.0) && line(9, 2, 1.0, 0.6));
        assert!(!line(2, 9, 1.0, 1.0) && !line(2, 2, 0.1, 1.0) && !line(3, 9, 0.1, 1.0));
    }

    #[test]
    fn neighbours_of_a_lane_are_in_its_rectangle() {
        let rect = Rect { first: 4, nu: 3, nv: 2 };
        let mut active = vec![true; 12];
        let all = |lane: usize, active: &[bool]| {
            let mut found: Vec<usize> = Neighbours::new(&rect, lane, active).all().collect();
            found.sort_unstable();
            found
        };
        assert_eq!(all(4, &active), [5, 7, 8]);
        assert_eq!(all(8, &active), [4, 5, 6, 7, 9]);
        active[5] = false;
        assert_eq!(all(8, &active), [4, 6, 7, 9]);
    }
}
