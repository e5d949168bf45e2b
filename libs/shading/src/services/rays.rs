//! Rays that shaders request: reflections and `trace`, and the code that they share with shadows, occlusion and
//! indirect light.

use super::maps::{fit, prepare};
use super::origins::Origins;
use super::{Run, count, option, samples};
use crate::object::RayScene;
use crate::thread::{MAX_RAY_LEVELS, MORE_NESTED};
use crate::trace::RayPurpose;
use granita_base::sample::{Draw, Sequence};
use granita_base::{Color, NoiseSource, Vec3, hash};
use granita_dicing::Projection;
use granita_rays::sampling::{Distribution, in_cone};
use granita_rays::{Departure, Leaving, RayRequest};
use granita_scene::attr;
use granita_shade::{
    EnvironmentQuery, HitValues, Lane, Lanes3, LookupResult, Primvar, RayKind, RayPath, TraceQuery,
    TraceResult,
};
use granita_trace::Ray;
use std::f32::consts::FRAC_PI_4;

/// "hitdist" of `environment ()` when nothing is hit (reference 5.8.10).
pub(super) const NO_HIT: f32 = 1.0e38;
/// "hitdist" of `trace` when nothing is hit (reference 5.5.5).
const NO_TRACE_HIT: f32 = 1.0e30;
/// The smallest distance of a hit relative to the coordinates of the ray's origin, which is the precision of the
/// origin in single precision.
const PRECISION: f32 = 4.0e-6;

// Dimensions of random numbers of one ray.
pub(super) const DIRECTION: u32 = 1;
const FOOTPRINT: u32 = 2;
const TIME: u32 = 3;
pub(super) const HIT: u32 = 4;
const ROULETTE: u32 = 5;

/// The value of "shading:view" for shading as the camera sees the points.
const DEFAULT_VIEW: &str = "camera";

/// The origin, direction and reach of a ray.
pub(super) struct Aim {
    pub(super) p: Vec3,
    /// A unit vector.
    pub(super) dir: Vec3,
    pub(super) bias: f32,
    pub(super) tmax: f32,
    pub(super) time: f32,
}

impl Aim {
    pub(super) fn ray(self) -> Ray {
        let tmin = self.bias.max(PRECISION * self.p.abs().max_element());
        Ray { origin: self.p, tmin, dir: self.dir, tmax: self.tmax, time: self.time }
    }
}

impl Run<'_, '_> {
    /// Returns the time of sample `index` of the `of` samples of a lane. Times are spread over the shutter when the
    /// object's rays see motion. Otherwise it is the time of the grid, clamped to the time when the shutter is open.
    pub(super) fn ray_time(&self, [index, of]: [u32; 2], seed: u32) -> f32 {
        let [open, close] = self.frame.camera.shutter;
        if self.sees_motion() {
            let seed = self.frame.seed_of(NoiseSource::Motion, hash::words(&[seed, TIME]));
            (open + (close - open) * self.frame.sequence(seed).line(index, of)).min(close)
        } else {
            // Motion and geometry are defined only while the shutter is open.
            self.time.clamp(open, close)
        }
    }

    /// True when rays are spread over the shutter.
    pub(super) fn sees_motion(&self) -> bool {
        let [open, close] = self.frame.camera.shutter;
        self.ray_motion && close > open
    }

    /// Returns the surface that a ray against a set leaves at `p`.
    pub(super) fn leaving(&self, scene: Option<&RayScene>, p: Vec3) -> Leaving {
        match scene {
            Some(scene) if scene.is_rough(self.object) => Leaving::new(self.object, self.frame.ray_margin(p)),
            _ => Leaving::default(),
        }
    }

    /// Returns "maxhitdist", which is infinite when absent or not positive.
    pub(super) fn reach(option: Option<Lane<'_>>, lane: usize) -> f32 {
        match option.map(|d| d.get(lane)) {
            Some(d) if d > 0.0 => d,
            _ => f32::INFINITY,
        }
    }

    /// True when rays may be traced. Shaders that run while ray structures are being built trace none, nor do those
    /// that are nested too deeply.
    pub(super) fn may_trace(&mut self) -> bool {
        if self.thread.nested > MAX_RAY_LEVELS + MORE_NESTED {
            self.report_depth();
            return false;
        }
        if self.frame.is_stopped() {
            return false;
        }
        if self.thread.builds_rays {
            self.frame.unsupported("tracing rays from a displacement shader of an object that rays see");
        }
        !self.thread.builds_rays
    }

    /// True when a shader at this ray level may not spawn rays that shade (reference 4.3.5).
    pub(super) fn is_too_deep(&self) -> bool {
        let allowed = self.frame.rays.limits.max_depth;
        if self.ray.level >= MAX_RAY_LEVELS && allowed > MAX_RAY_LEVELS {
            self.report_depth();
        }
        self.ray.level >= allowed.min(MAX_RAY_LEVELS)
    }

    fn report_depth(&self) {
        let Self { frame, owner, .. } = self;
        frame.reporter.once(
            "rays too deep",
            granita_base::Severity::Warning,
            &granita_base::Location::default(),
            format!(
                "object \"{owner}\": rays are followed {MAX_RAY_LEVELS} levels deep only (\"ray:maxdepth\" is {})",
                frame.rays.limits.max_depth
            ),
        );
    }

    pub(super) fn purpose(&self) -> RayPurpose {
        let RayKind { indirect, bounces, .. } = self.ray;
        RayPurpose { parent: self.ray, indirect, bounces, shade: true, dtime: self.dtime }
    }

    /// Returns the path of rays to a lane.
    pub(super) fn path(&self, lane: usize) -> RayPath {
        self.paths.get(lane).copied().unwrap_or_default()
    }
}

/// The lanes that trace, and the lanes that copy the result of another one.
///
/// Among the hits of a ray and their neighbours, which exist for derivatives only, the hits alone trace.
pub(super) struct TracingLanes {
    /// The lanes in increasing order.
    pub(super) traced: Vec<u32>,
    /// Pairs of a lane and the lane that it copies its result from.
    copied: Vec<(usize, usize)>,
}

impl TracingLanes {
    pub(super) fn new(run: &Run<'_, '_>, active: &[u32]) -> Self {
        let Some(n) = run.centres else { return Self { traced: active.to_vec(), copied: Vec::new() } };
        let (mut traced, mut copied) =
            (Vec::with_capacity(n as usize), Vec::with_capacity(active.len().saturating_sub(n as usize)));
        for &lane in active {
            let centre = lane % n;
            if lane != centre && active.binary_search(&centre).is_ok() {
                copied.push((lane as usize, centre as usize));
            } else {
                traced.push(lane);
            }
        }
        Self { traced, copied }
    }

    /// Removes coincident lanes that make the `same` request as the lane that they coincide with (in pairs, in
    /// increasing order). They copy its result.
    pub(super) fn without_coincident(
        mut self,
        coincident: &[(u32, u32)],
        same: &dyn Fn(usize, usize) -> bool,
    ) -> Self {
        if coincident.is_empty() {
            return self;
        }
        let mut rest = coincident.iter().peekable();
        let traced = std::mem::take(&mut self.traced);
        for &lane in &traced {
            while rest.next_if(|twin| twin.0 < lane).is_some() {}
            let of = rest.peek().filter(|twin| twin.0 == lane).map(|twin| twin.1);
            match of.filter(|of| traced.binary_search(of).is_ok() && same(lane as usize, *of as usize)) {
                Some(of) => self.copied.push((lane as usize, of as usize)),
                None => self.traced.push(lane),
            }
        }
        self
    }

    /// Copies values of an array to the copying lanes.
    pub(super) fn copy3(&self, lanes: &mut Lanes3) {
        for &(to, from) in &self.copied {
            lanes.set(to, lanes.get(from));
        }
    }

    /// Copies values of an array to the copying lanes.
    pub(super) fn copy<T: Clone>(&self, lanes: &mut [T]) {
        for &(to, from) in &self.copied {
            lanes[to] = lanes[from].clone();
        }
    }
}

/// The rays of one point of a call.
struct Branch {
    /// Their number.
    samples: u32,
    /// The index of the first one in the sequence of random numbers.
    first: u32,
    /// The seed of the sequence.
    seed: u32,
    /// The number of rays that share the sequence.
    rays: f32,
}

impl Branch {
    /// Returns the number of rays that share the sequence.
    fn of(&self) -> u32 {
        self.rays.ceil() as u32
    }

    /// Returns the path of a ray with an index in the sequence, whose results have this weight.
    fn path(&self, index: u32, weight: f32) -> RayPath {
        RayPath { rays: self.rays, index, seed: self.seed, weight }
    }
}

impl Run<'_, '_> {
    /// Returns the rays that a lane of `environment ()` traces for `asked` samples.
    ///
    /// A hit of one of many rays of a point traces its share of the samples, at least one ("ray:deepsamples"). All
    /// those hits draw from one sequence of random numbers, so that their rays are stratified together.
    fn branch(&self, lane: usize, seed: u32, asked: u32) -> Branch {
        let path = self.path(lane);
        if path.rays <= 1.0 {
            return Branch { samples: asked, first: 0, seed, rays: asked as f32 };
        }
        let share = asked as f32 * self.frame.rays.limits.deep_samples / path.rays;
        let samples = (share.round() as u32).clamp(1, asked);
        let call = self.lane_calls.get(lane).copied().unwrap_or(self.calls);
        Branch {
            samples,
            first: path.index.wrapping_mul(samples),
            seed: hash::words(&[path.seed, self.ray.level, call]),
            rays: path.rays * samples as f32,
        }
    }

    /// Returns how reflected rays around an axis leave the surface at a lane.
    fn departure(&self, lane: usize, p: Vec3, axis: Vec3) -> Option<Departure> {
        let surface = self.surface.as_ref()?;
        let primitive = match surface.primitives[..] {
            [one] => one,
            _ => {
                let rect = self.topology.rects().position(|rect| rect.lanes().contains(&lane))?;
                *surface.primitives.get(rect)?
            }
        };
        Some(Departure { primitive, p, axis, viewer: self.viewer(lane, p, surface.i.get(lane)) })
    }

    /// Returns the position that a lane is seen from. `None` when shading looks from elsewhere.
    fn viewer(&self, lane: usize, p: Vec3, i: Vec3) -> Option<Vec3> {
        if self.ray.level > 0 {
            return (lane < self.paths.len()).then_some(p - i);
        }
        if &*self.object_attributes.get(attr::SHADING_VIEW) != DEFAULT_VIEW {
            return None;
        }
        let eye = self.frame.eye_world;
        match self.frame.camera.projection {
            Projection::Perspective { .. } => Some(eye),
            // The point of the plane of the camera on the line of sight.
            Projection::Orthographic => Some(p - i * ((p - eye).dot(i) / i.length_squared())),
        }
    }
}

/// A call of `environment ()` that traces its rays.
struct Kept {
    /// The factor of its result, which makes up for calls that trace none.
    scale: f32,
    /// The weight of its rays.
    weight: f32,
}

/// Decides whether the rays of a call whose result has the weight `weight` in its image are traced. Below `least`, they
/// are traced with a probability of `weight / least`, so that the mean stays the same (Arvo and Kirk, Particle
/// Transport and Image Synthesis, SIGGRAPH 1990).
fn roulette(weight: f32, least: f32, sequence: Sequence) -> Option<Kept> {
    if weight >= least || weight.is_nan() || least.is_nan() {
        return Some(Kept { scale: 1.0, weight });
    }
    let probability = weight / least;
    let chance = sequence.dimension(ROULETTE);
    let survives = chance.moved_on_line(hash::unit(chance.seed)) < probability;
    survives.then_some(Kept { scale: 1.0 / probability, weight: least })
}

/// Returns a place in the footprint, from -0.5 to 0.5 in both directions. A single sample of a point takes its centre.
/// `index` is that of one of `of` samples of the sequence.
pub(super) fn in_footprint(samples: u32, [index, of]: [u32; 2], sequence: Sequence) -> [f32; 2] {
    if samples <= 1 {
        return [0.0; 2];
    }
    let (x, y) = sequence.dimension(FOOTPRINT).square(index, of);
    [x - 0.5, y - 0.5]
}

/// Answers `environment ()` with the name of a geometry set (reference 10.2.2).
///
/// `samples` rays are spread over the cone of "angle" (or "blur") and, when there are several, over the footprint
/// between neighbouring points. Colour and opacity are their means.
pub(super) fn environment(run: &mut Run<'_, '_>, query: &EnvironmentQuery<'_>, out: &mut LookupResult) {
    let lanes = query.batch.lanes;
    prepare(query.batch, query.channels, out);
    out.hitdist = vec![NO_HIT; lanes];
    out.p_hit = Lanes3::zeros(lanes);
    out.n_hit = Lanes3::zeros(lanes);
    let o = &query.options;
    let traces = !run.is_too_deep() && run.may_trace();
    let call = run.next_call(query.batch.active);
    let scene = if traces { run.frame.rays.scene(query.name, run.frame) } else { None };
    let shade = o.shade.is_none_or(|s| query.batch.active.iter().any(|l| s.get(*l as usize) != 0.0));
    let purpose = RayPurpose { shade, ..run.purpose() };
    let shared = Shared { scene, purpose, messages: query.messages };
    let most = if run.ray.level < DEEP { RAYS } else { RAYS_WHERE_DEEP };
    let origins = Origins::new(run, query.batch, query.p, o.bias);
    let mut rays: Vec<RayRequest> = Vec::new();
    let mut sums: Vec<Sum> = Vec::new();
    for &lane in query.batch.active {
        let i = lane as usize;
        let value = if traces { Color::ZERO } else { run.frame.rays.limits.max_depth_color };
        (0..query.channels)
            .for_each(|c| out.value[c][i] = if query.channels == 1 { value.x } else { value[c] });
        out.alpha[i] = 0.0;
        // With "Kr" 0 the result is multiplied by zero, so no ray is traced.
        let kr = option(o.kr, i, 1.0);
        let Some(r) = query.r.get(i).try_normalize().filter(|_| traces && kr != 0.0) else {
            continue;
        };
        let seed = run.lane_seed(NoiseSource::Rays, call, lane);
        let path = run.path(i);
        let Some(kept) =
            roulette(path.weight * kr.abs(), run.frame.rays.limits.min_weight, run.frame.sequence(seed))
        else {
            continue;
        };
        let length = query.r.get(i).length();
        let blur = 0.5 * (option(o.sblur, i, 0.0) + option(o.tblur, i, 0.0));
        let half_angle = o.angle.map_or(blur * FRAC_PI_4, |a| a.get(i));
        let width = 0.5 * (option(o.swidth, i, 1.0) + option(o.twidth, i, 1.0));
        let (dpdx, dpdy) = (query.dpdx.get(i) * width, query.dpdy.get(i) * width);
        let (drdx, drdy) = (query.drdx.get(i) * (width / length), query.drdy.get(i) * (width / length));
        let asked = samples(count(o.samples, i), run.frame.samples());
        let per_ray = 1.0 / (asked as f32).sqrt();
        let branch = run.branch(i, seed, asked);
        // Points that the camera sees share sequences, and so do the hits of one of them.
        let draw = match path.rays <= 1.0 {
            true => run.draw(NoiseSource::Rays, call, lane),
            false => Draw::alone(run.frame.sequence(branch.seed)),
        };
        let directions = draw.sequence.dimension(DIRECTION);
        let departure = run.departure(i, query.p.get(i), r);
        sums.push(Sum::new(lane, branch.samples, kept.scale));
        for k in 0..branch.samples {
            let index = branch.first + k;
            let place = draw.place(index, branch.of());
            let [x, y] = in_footprint(asked, place, draw.sequence);
            let axis = (r + drdx * x + drdy * y).normalize_or(r);
            let dir = in_cone(axis, half_angle, Distribution::Uniform, place, directions);
            let aim = Aim {
                p: origins.at(i) + origins.inside(i, [dpdx * x, dpdy * y]),
                dir,
                bias: run.bias(o.bias, i),
                tmax: Run::reach(o.maxhitdist, i),
                time: run.ray_time(place, draw.sequence.seed),
            };
            rays.push(RayRequest {
                lane,
                name: hash::words(&[seed, k, HIT]),
                ray: aim.ray(),
                leaving: run.leaving(scene, query.p.get(i)),
                departure,
                path: branch.path(index, kept.weight),
                width: dpdx.length().max(dpdy.length()) * per_ray,
                spread: (drdx.length().max(drdy.length()) + 2.0 * half_angle.max(0.0)) * per_ray,
            });
            if rays.len() == most {
                trace_into(run, &shared, &mut rays, &mut sums);
            }
        }
    }
    trace_into(run, &shared, &mut rays, &mut sums);
    if scene.is_none() {
        return;
    }
    for sum in sums {
        let i = sum.lane as usize;
        let share = sum.scale / sum.samples as f32;
        let (color, opacity) = (sum.color * share, sum.opacity * share);
        (0..query.channels).for_each(|c| out.value[c][i] = color[c.min(2)]);
        out.alpha[i] = (opacity.x + opacity.y + opacity.z) / 3.0;
        if sum.hits > 0 {
            let mean = 1.0 / sum.hits as f32;
            out.hitdist[i] = sum.distance * mean;
            out.p_hit.set(i, sum.p * mean);
            out.n_hit.set(i, sum.n * mean);
        }
    }
}

/// The largest number of rays of one `environment ()` that are traced at once. They stay allocated while their hits
/// are shaded.
const RAYS: usize = 1 << 14;
/// The same from level [`DEEP`] on, because the rays of each level before stay allocated, too.
const RAYS_WHERE_DEEP: usize = 1 << 10;
const DEEP: u32 = 8;

/// The sums over the rays of a lane so far.
struct Sum {
    lane: u32,
    samples: u32,
    /// The factor of the mean of the samples.
    scale: f32,
    color: Color,
    opacity: Color,
    /// The number of hits, and the sums of their distances, places and normals.
    hits: u32,
    distance: f32,
    p: Vec3,
    n: Vec3,
}

impl Sum {
    fn new(lane: u32, samples: u32, scale: f32) -> Self {
        let (color, opacity) = (Color::ZERO, Color::ZERO);
        Self { lane, samples, scale, color, opacity, hits: 0, distance: 0.0, p: Vec3::ZERO, n: Vec3::ZERO }
    }
}

/// The parameters that all rays of one call share.
struct Shared<'q> {
    scene: Option<&'q RayScene>,
    purpose: RayPurpose,
    messages: &'q [Primvar],
}

/// Traces rays, in the order of the lanes in `sums`, and adds their results. Empties `rays`.
fn trace_into(run: &mut Run<'_, '_>, shared: &Shared<'_>, rays: &mut Vec<RayRequest>, sums: &mut [Sum]) {
    if let (Some(scene), Some(first)) = (shared.scene, rays.first()) {
        let mut at = sums.partition_point(|sum| sum.lane < first.lane);
        let found = run.thread.radiance(scene, rays, shared.purpose, shared.messages);
        for (ray, found) in rays.iter().zip(found) {
            while sums[at].lane != ray.lane {
                at += 1;
            }
            let sum = &mut sums[at];
            sum.color += found.color;
            sum.opacity += found.opacity;
            if found.distance.is_finite() {
                sum.hits += 1;
                sum.distance += found.distance;
                sum.p += found.p;
                sum.n += found.n;
            }
        }
    }
    rays.clear();
}

/// Returns the rays of one sample of each active lane of a `trace` loop or a probe, and their lanes.
fn probe(
    run: &mut Run<'_, '_>,
    query: &TraceQuery<'_>,
    scene: Option<&RayScene>,
    call: u32,
    index: u32,
) -> (Vec<u32>, Vec<RayRequest>) {
    let distribution = Distribution::from_word(query.options.spread());
    let origins = Origins::new(run, query.batch, query.p, query.options.bias);
    let mut lanes = Vec::new();
    let mut rays = Vec::new();
    for &lane in query.batch.active {
        let i = lane as usize;
        let samples = count(Some(query.samples), i);
        let Some(axis) = query.axis.get(i).try_normalize().filter(|_| index < samples) else { continue };
        let seed = run.lane_seed(NoiseSource::Rays, call, lane);
        let angle = query.angle.get(i);
        let shared = run.draw(NoiseSource::Rays, call, lane);
        let directions = shared.sequence.dimension(DIRECTION);
        let place = shared.place(index, samples);
        let aim = Aim {
            p: origins.at(i),
            dir: in_cone(axis, angle, distribution, place, directions),
            bias: run.bias(query.options.bias, i),
            tmax: Run::reach(query.options.maxhitdist, i),
            time: run.ray_time(place, shared.sequence.seed),
        };
        lanes.push(lane);
        let spread = 2.0 * angle.max(0.0) / (samples as f32).sqrt();
        let name = hash::words(&[seed, index, HIT]);
        let leaving = run.leaving(scene, query.p.get(i));
        let path = run.path(i);
        let branch = Branch { samples, first: 0, seed, rays: path.rays * samples as f32 };
        let path = branch.path(index, path.weight);
        rays.push(RayRequest { lane, name, leaving, path, spread, ..RayRequest::new(aim.ray()) });
    }
    (lanes, rays)
}

/// Fills the result of a query of which no ray hits anything.
pub(super) fn no_hits(query: &TraceQuery<'_>, out: &mut TraceResult) {
    let n = query.batch.lanes;
    out.hit.resize(n, false);
    out.hitdist.resize(n, NO_TRACE_HIT);
    for lanes in [&mut out.l, &mut out.ps, &mut out.cl, &mut out.ol, &mut out.p] {
        fit(lanes, n);
    }
    for &lane in query.batch.active {
        let i = lane as usize;
        out.hit[i] = false;
        out.hitdist[i] = NO_TRACE_HIT;
        out.l.set(i, query.axis.get(i));
        out.ps.set(i, query.p.get(i));
        out.cl.set(i, Color::ZERO);
        out.ol.set(i, Color::ZERO);
    }
}

/// Answers `trace` with one ray per lane.
pub(super) fn trace(run: &mut Run<'_, '_>, query: &TraceQuery<'_>, out: &mut TraceResult) {
    let n = query.batch.lanes;
    no_hits(query, out);
    let traces = run.may_trace();
    // All iterations of a loop count as the same call, so that their samples form one sequence.
    if query.sample == 0 {
        run.next_call(query.batch.active);
    }
    let call = run.calls;
    let is_set = run.frame.rays.is_set(query.set);
    let scene = if traces && is_set { run.frame.rays.scene(query.set, run.frame) } else { None };
    let (lanes, rays) = probe(run, query, scene, call, query.sample);
    for (lane, request) in lanes.iter().zip(&rays) {
        out.l.set(*lane as usize, request.ray.dir);
    }
    if !is_set {
        unknown_set(run, query.set);
        return;
    }
    let Some(scene) = scene.filter(|_| !rays.is_empty()) else { return };
    let wants = query.options.shade.is_none_or(|s| lanes.iter().any(|l| s.get(*l as usize) != 0.0));
    let too_deep = run.is_too_deep();
    let purpose = RayPurpose { shade: wants && !too_deep, ..run.purpose() };
    let (found, values) = run.thread.radiance_and(scene, &rays, purpose, query.messages, query.wanted);
    // Values are stored by ray and are copied to lanes.
    for ((_, ty), of_rays) in query.wanted.iter().zip(values) {
        let mut of_lanes = HitValues { there: vec![false; n], values: vec![0.0; ty.components() * n] };
        for (k, lane) in lanes.iter().enumerate() {
            let lane = *lane as usize;
            of_lanes.there[lane] = of_rays.there[k];
            for c in 0..ty.components() {
                of_lanes.values[c * n + lane] = of_rays.values[c * rays.len() + k];
            }
        }
        out.others.push(of_lanes);
    }
    let beyond = run.frame.rays.limits.max_depth_color;
    for (lane, r) in lanes.iter().zip(found) {
        let i = *lane as usize;
        if r.distance.is_finite() {
            out.hit[i] = true;
            out.hitdist[i] = r.distance;
            out.p.set(i, r.p);
            out.cl.set(i, if wants && too_deep { beyond } else { r.color });
            out.ol.set(i, r.opacity);
        }
    }
}

/// Reports that a geometry set has no members.
pub(super) fn unknown_set(run: &Run<'_, '_>, set: &str) {
    run.frame.reporter.once(
        &format!("no geometry set {set}"),
        granita_base::Severity::Warning,
        &granita_base::Location::default(),
        format!("no object is in the geometry set \"{set}\""),
    );
}
