// tidy: long: questions about indirect light and occlusion are gathered, sampled and answered by one type
//! Answers `indirect ()` and `occlusion ()` (reference 5.8.11), by sampling every point or by interpolation between
//! few.

mod bounce;

use super::maps::fit;
use super::origins::Origins;
use super::rays::{Aim, HIT, TracingLanes, unknown_set};
use super::{Run, count, option, samples};
use crate::lighting::cache::hemisphere::{Seen, Strata};
use crate::lighting::cache::lattice::{Lattice, Points, Tolerance, Wanted};
use crate::lighting::cache::{Kind, Record, Spot};
use crate::object::RayScene;
use crate::trace::RayPurpose;
use granita_base::{Color, Vec3, hash};
use granita_rays::{Leaving, RayRequest};
use granita_scene::attr;
use granita_sdb::{Between, Mode, Packed, Probe};
use granita_shade::{Batch, GatherQuery, Lane, Lanes3, RayKind, RayPath, Rect, approx};
use granita_trace::Ray;
use std::collections::HashMap;
use std::sync::Arc;

/// The largest number of rays that one call traces at once.
const RAYS: usize = 1 << 14;
/// The standard error that adaptive sampling leaves at "adaptive" 1. It is absolute for occlusion and relative for
/// light.
const ADAPTIVE_ERROR: f32 = 0.02;
/// The smallest number of samples that adaptive sampling reduces.
const LEAST_ADAPTIVE: u32 = 16;

/// The parameters of one call, which all of its points share.
struct Question<'q> {
    kind: Kind,
    query: &'q GatherQuery<'q>,
    tolerance: Tolerance,
    /// True when every point is sampled.
    full: bool,
    database: &'q str,
    mode: Mode,
    /// The records of the file.
    known: Option<Arc<Packed>>,
    /// True when a record is a function of the place alone. It is then kept for other grids or in a file.
    translational: bool,
    /// A hash of everything that decides the record at a place.
    hash: u32,
    origins: Origins<'q>,
}

/// A point that must be sampled.
#[derive(Clone, Copy)]
struct Ask {
    lane: u32,
    seed: u32,
    samples: u32,
}

impl<'q> Question<'q> {
    fn new(run: &Run<'_, '_>, kind: Kind, query: &'q GatherQuery<'q>, name: &'q str, listens: bool) -> Self {
        let o = &query.options;
        let attributes = run.object_attributes;
        let first = query.batch.active.first().map_or(0, |l| *l as usize);
        let at_least_0 =
            |value: Option<f32>, attribute: f32| value.filter(|v| *v >= 0.0).unwrap_or(attribute);
        let (error, distance, least) = match kind {
            Kind::Irradiance => {
                (attr::INDIRECT_MAXERROR, attr::INDIRECT_MAXPIXELDIST, attr::INDIRECT_MINSAMPLES)
            }
            Kind::Occlusion => {
                (attr::OCCLUSION_MAXERROR, attr::OCCLUSION_MAXPIXELDIST, attr::OCCLUSION_MINSAMPLES)
            }
        };
        let maxerror = at_least_0(o.maxerror.map(|v| v.get(first)), attributes.get(error));
        let maxerror = maxerror * run.frame.tolerance();
        let maxpixeldist = at_least_0(o.maxpixeldist.map(|v| v.get(first)), attributes.get(distance));
        let minsamples = usize::try_from(attributes.get(least)).unwrap_or(0);
        let tolerance = Tolerance { maxerror, maxpixeldist, minsamples };
        let word = o.filemode.unwrap_or("");
        let mode = run.frame.database_mode(name, word);
        // Records at the hits of indirect rays are not kept, because there are many more of them than visible
        // points.
        let mode = Mode { write: mode.write && run.thread.keeps_saved() && !run.ray.indirect, ..mode };
        let lattice = run.topology.rects().next().is_some();
        let full = !lattice || listens || maxerror.is_nan() || maxerror <= 0.0 || maxpixeldist <= 0.0;
        let mut words = vec![
            kind as u32,
            hash::bytes64(query.set.as_bytes()) as u32,
            hash::bytes64(query.options.spread().as_bytes()) as u32,
            run.time.to_bits(),
            run.ray.level,
        ];
        let lanes = [
            Some(query.angle),
            Some(query.samples),
            o.adaptive,
            o.bias,
            o.maxhitdist,
            o.falloff,
            o.falloffmode,
        ];
        words.extend(lanes.iter().map(|l| l.map_or(f32::NAN, |l| l.get(first)).to_bits()));
        // The rough surface that rays leave is part of the key of a record.
        let scene = run.frame.rays.scene(query.set, run.frame);
        let rough = scene.is_some_and(|scene| scene.is_rough(run.object));
        let object = if rough { std::ptr::from_ref(run.object).addr() } else { 0 };
        words.extend([object as u32, (object >> 32) as u32]);
        words.extend([
            run.shadow_bias.to_bits(),
            u32::from(run.ray_motion),
            u32::from(mode.write),
            u32::from(full),
        ]);
        Self {
            kind,
            query,
            tolerance,
            full,
            database: name,
            mode,
            known: None,
            // It is always true at ray hits, so that they look the same whether a file is written or not.
            translational: !full || mode.write || run.ray.level > 0,
            hash: hash::words(&words),
            origins: Origins::clear(run, query.batch, query.p, query.options.bias),
        }
    }

    fn spot(&self, lane: u32) -> Spot {
        let i = lane as usize;
        let (p, n) = (self.origins.at(i), self.axis(i));
        let [px, py, pz] = p.to_array().map(f32::to_bits);
        let [nx, ny, nz] = n.to_array().map(f32::to_bits);
        [px, py, pz, nx, ny, nz, self.hash, self.kind as u32]
    }

    /// Returns the unit axis of a lane; zero when it has none. Where other grids or files may have the same record, it
    /// is rounded, because the normals of two grids at a point that they share differ in their last bits.
    fn axis(&self, lane: usize) -> Vec3 {
        let axis = self.query.axis.get(lane).normalize_or_zero();
        if self.translational || self.mode.read { rounded(axis) } else { axis }
    }

    /// Returns the seed of a record. It depends on the place alone, so that a normal that differs slightly on another
    /// grid changes the result only slightly.
    fn seed(&self, run: &Run<'_, '_>, call: u32, lane: u32) -> u32 {
        if !self.translational {
            return run.lane_seed(self.kind.noise(), call, lane);
        }
        let [x, y, z] = self.origins.at(lane as usize).to_array().map(f32::to_bits);
        let seed = run.frame.seed_in_pass(hash::words(&[x, y, z, self.kind as u32]));
        run.frame.seed_of(self.kind.noise(), seed)
    }

    /// Returns by how much the width of a ray of a point grows per unit of distance.
    #[inline(always)]
    fn ray_spread(&self, ask: &Ask) -> f32 {
        2.0 * self.query.angle.get(ask.lane as usize).max(0.0) / (ask.samples.max(1) as f32).sqrt()
    }

    /// Returns the record that the file holds for a point.
    fn in_file(&self, run: &Run<'_, '_>, lane: u32) -> Option<Record> {
        let records = self.known.as_ref()?;
        let i = lane as usize;
        let p = self.origins.at(i);
        let filed = run.frame.camera.place_in_world(p);
        let probe = Probe { p: filed.to_array(), n: Some(self.axis(i).to_array()) };
        if let Some(numbers) = records.exactly(&probe) {
            return Some(Record::from_numbers(self.kind, numbers));
        }
        let how = Between {
            minsamples: self.tolerance.minsamples.max(1),
            maxdist: self.tolerance.maxpixeldist / run.pixels_per_unit(p),
            maxerror: self.tolerance.maxerror,
            always: self.mode.readonly,
        };
        let numbers = records.all_between(&probe, &how)?;
        Some(Record::from_numbers(self.kind, &numbers))
    }
}

/// Returns a unit vector whose direction is at most 5e-4 radians from that of a unit vector. Vectors that differ in
/// their last bits mostly have the same.
fn rounded(axis: Vec3) -> Vec3 {
    const STEPS: f32 = 2048.0;
    ((axis * STEPS).round() / STEPS).normalize_or_zero()
}

impl Run<'_, '_> {
    /// Returns the number of raster pixels that a world unit at `p` covers.
    fn pixels_per_unit(&self, p: Vec3) -> f32 {
        let camera = &self.frame.camera;
        let distance = self.frame.eye_world.distance(p).max(camera.near);
        camera.raster_scale(distance).abs().max_element()
    }
}

/// Answers `occlusion ()`: the blocked share of the cone (weighted by the cosine unless "distribution" overrides
/// it), and the mean unblocked direction (the axis when everything is blocked).
pub(super) fn occlusion(
    run: &mut Run<'_, '_>,
    query: &GatherQuery<'_>,
    out: &mut [f32],
    unoccluded: &mut Lanes3,
) {
    fit(unoccluded, query.batch.lanes);
    let found = gather(run, Kind::Occlusion, query);
    for &lane in query.batch.active {
        let i = lane as usize;
        let record = found.as_ref().and_then(|f| f[i].as_deref());
        out[i] = record.map_or(0.0, |r| r.value[0].clamp(0.0, 1.0));
        let open = record.and_then(|r| r.open.try_normalize());
        unoccluded.set(i, open.unwrap_or_else(|| query.axis.get(i).normalize_or_zero()));
    }
}

/// Answers `indirect ()`: the mean colour seen by cosine-distributed rays over the hemisphere around the axis. This
/// is irradiance in the units in which a light of colour `Cl` that faces the surface gives `Cl`.
///
/// Where rays of indirect light hit, it is the light of one bounce less. There is none beyond "indirect:maxdepth"
/// bounces.
pub(super) fn indirect(run: &mut Run<'_, '_>, query: &GatherQuery<'_>, out: &mut Lanes3) {
    fit(out, query.batch.lanes);
    let ends = run.ray.bounces >= run.frame.rays.limits.indirect_depth;
    if !ends && run.ray.bounces > 0 {
        return bounce::indirect(run, query, out);
    }
    let gathers = !ends && !run.is_too_deep();
    let found = if gathers { gather(run, Kind::Irradiance, query) } else { None };
    for &lane in query.batch.active {
        let record = found.as_ref().and_then(|f| f[lane as usize].as_deref());
        out.set(lane as usize, record.map_or(Color::ZERO, |r| r.color().max(Color::ZERO)));
    }
}

/// Returns the record of each active point; `None` when nothing can be gathered.
fn gather(run: &mut Run<'_, '_>, kind: Kind, query: &GatherQuery<'_>) -> Option<Vec<Option<Arc<Record>>>> {
    let call = run.next_call(query.batch.active);
    if !run.may_trace() || query.batch.active.is_empty() {
        return None;
    }
    let database = match kind {
        Kind::Irradiance => attr::INDIRECT_SPATIALDB,
        Kind::Occlusion => attr::OCCLUSION_SPATIALDB,
    };
    let name = match query.options.filename.filter(|name| !name.is_empty()) {
        Some(name) => name.to_owned(),
        None => run.object_attributes.get(database).to_string(),
    };
    if !varies(query, run) {
        return gather_alike(run, kind, query, &name, call);
    }
    // Each rectangle is gathered separately, with the options of its first point.
    let mut out = vec![None; query.batch.lanes];
    let mut rest = query.batch.active;
    for rect in run.topology.rects().collect::<Vec<Rect>>() {
        let (active, later) = rest.split_at(rest.partition_point(|i| (*i as usize) < rect.lanes().end));
        rest = later;
        if !active.is_empty() {
            let query = GatherQuery { batch: Batch { active, ..query.batch }, ..*query };
            let found = gather_alike(run, kind, &query, &name, call)?;
            active.iter().for_each(|&i| out[i as usize] = found[i as usize].clone());
        }
    }
    Some(out)
}

/// True when points on several rectangles have different options.
fn varies(query: &GatherQuery<'_>, run: &Run<'_, '_>) -> bool {
    let o = &query.options;
    let lanes = [
        Some(query.angle),
        Some(query.samples),
        o.maxerror,
        o.maxpixeldist,
        o.adaptive,
        o.bias,
        o.maxhitdist,
        o.falloff,
        o.falloffmode,
    ];
    let bits = |lane: &Lane<'_>, i: u32| lane.get(i as usize).to_bits();
    let changes = |lane: &Lane<'_>| {
        lane.stride != 0 && query.batch.active.windows(2).any(|w| bits(lane, w[0]) != bits(lane, w[1]))
    };
    run.topology.rects().nth(1).is_some() && lanes.iter().flatten().any(changes)
}

/// Gathers points that all use the options of the first one, as [`gather`].
fn gather_alike(
    run: &mut Run<'_, '_>,
    kind: Kind,
    query: &GatherQuery<'_>,
    name: &str,
    call: u32,
) -> Option<Vec<Option<Arc<Record>>>> {
    let scene = run.frame.rays.scene(query.set, run.frame);
    let listens = kind == Kind::Irradiance && scene.is_some_and(|s| s.queries_parents);
    let mut question = Question::new(run, kind, query, name, listens);
    if question.mode.read && !name.is_empty() {
        run.note_file(name);
        question.known = run.frame.database(name, question.mode).filter(|records| {
            let fits = records.schema() == kind.schema();
            if !fits {
                let text = format!(
                    "spatial database \"{name}\" holds {}: it cannot be used for {}",
                    records.schema().words(),
                    kind.schema().words()
                );
                granita_shade::Messages::say(run, granita_base::Severity::Warning, &text);
            }
            fits
        });
    }
    if scene.is_none() && question.known.is_none() {
        unknown_set(run, query.set);
        return None;
    }
    let mut gatherer = Gatherer { run, scene, question, call };
    Some(if gatherer.question.full { gatherer.everywhere() } else { gatherer.on_lattice() })
}

struct Gatherer<'g, 'r, 'f, 'q> {
    run: &'g mut Run<'r, 'f>,
    scene: Option<&'f RayScene>,
    question: Question<'q>,
    call: u32,
}

impl Gatherer<'_, '_, '_, '_> {
    fn everywhere(&mut self) -> Vec<Option<Arc<Record>>> {
        let query = self.question.query;
        let spot = |lane: usize| self.question.spot(lane as u32);
        let lanes = TracingLanes::new(self.run, query.batch.active)
            .without_coincident(&self.run.coincident, &|a, b| spot(a) == spot(b));
        let shared = self.question.mode.write;
        let wanted: Vec<Wanted> = lanes.traced.iter().map(|&lane| Wanted { lane, shared }).collect();
        let mut out = vec![None; query.batch.lanes];
        for (w, record) in wanted.iter().zip(self.records(&wanted)) {
            out[w.lane as usize] = Some(record);
        }
        lanes.copy(&mut out);
        out
    }

    fn on_lattice(&mut self) -> Vec<Option<Arc<Record>>> {
        let query = self.question.query;
        let n = query.batch.lanes;
        let mut active = vec![false; n];
        for &lane in query.batch.active {
            let i = lane as usize;
            active[i] = self.question.origins.at(i).is_finite() && self.question.axis(i) != Vec3::ZERO;
        }
        let points = Points {
            rects: self.run.topology.rects().collect(),
            p: (0..query.batch.lanes).map(|i| self.question.origins.at(i)).collect(),
            n: (0..n).map(|i| self.question.axis(i)).collect(),
            scale: (0..n).map(|i| self.run.pixels_per_unit(query.p.get(i))).collect(),
            active,
        };
        let (kind, tolerance) = (self.question.kind, self.question.tolerance);
        let (found, _) = Lattice::fill(kind, &points, tolerance, &mut |wanted| self.records(wanted));
        let points = &self.run.frame.light_cache.points;
        points.fetch_add(query.batch.active.len() as u64, std::sync::atomic::Ordering::Relaxed);
        found
    }

    /// Returns the record that another grid computed.
    fn known(&mut self, wanted: &Wanted) -> Option<Arc<Record>> {
        let cache = &self.run.frame.light_cache;
        let (record, depends) = cache.find(&self.question.spot(wanted.lane)).filter(|_| wanted.shared)?;
        if let Some(notes) = &mut self.run.thread.notes {
            notes.add_all(&depends);
        }
        Some(record)
    }

    /// Returns the records of points: from the file, from other grids, or new ones.
    fn records(&mut self, wanted: &[Wanted]) -> Vec<Arc<Record>> {
        let cache = &self.run.frame.light_cache;
        let mut out: Vec<Option<Arc<Record>>> = wanted
            .iter()
            .map(|w| {
                let filed = self.question.in_file(self.run, w.lane).map(Arc::new);
                filed.or_else(|| self.known(w))
            })
            .collect();
        // A point that several rectangles share is sampled once.
        let mut first_at: HashMap<Spot, usize> = HashMap::new();
        let mut missing = Vec::new();
        let mut again = Vec::new();
        for k in (0..wanted.len()).filter(|&k| out[k].is_none()) {
            let first = if wanted[k].shared {
                *first_at.entry(self.question.spot(wanted[k].lane)).or_insert(k)
            } else {
                k
            };
            if first == k { missing.push(k) } else { again.push((k, first)) }
        }
        let outer = self.run.thread.notes.as_mut().map(std::mem::take);
        let made = self.sample(&missing.iter().map(|&k| wanted[k].lane).collect::<Vec<u32>>());
        let depends = self.run.noted_since(outer);
        let mut saved = Vec::new();
        for (&k, record) in missing.iter().zip(made) {
            let Wanted { lane, shared } = wanted[k];
            let record = Arc::new(record);
            let spot = self.question.spot(lane);
            if shared && !self.run.frame.is_stopped() {
                cache.keep(spot, &record, &depends);
            }
            // What several grids have in common is saved once.
            if self.question.mode.write && (!shared || cache.is_first_to_save(spot)) {
                // Files are read by frames whose "common" space may begin elsewhere.
                let p = self.question.origins.at(lane as usize);
                saved.extend(self.run.frame.camera.place_in_world(p).to_array());
                saved.extend(self.question.axis(lane as usize).to_array());
                saved.extend(record.to_numbers(self.question.kind));
            }
            out[k] = Some(record);
        }
        for (k, first) in again {
            out[k] = out[first].clone();
        }
        if !saved.is_empty() {
            let Question { kind, database, mode, .. } = self.question;
            self.run.frame.databases.save(database, kind.schema(), mode, None, &saved);
        }
        out.into_iter().map(Option::unwrap_or_default).collect()
    }

    /// Samples points.
    fn sample(&mut self, lanes: &[u32]) -> Vec<Record> {
        let Some(scene) = self.scene else { return vec![Record::default(); lanes.len()] };
        let options = &self.question.query.options;
        let asks: Vec<Ask> = lanes
            .iter()
            .map(|&lane| Ask {
                lane,
                seed: self.question.seed(self.run, self.call, lane),
                samples: samples(
                    count(Some(self.question.query.samples), lane as usize),
                    self.run.frame.samples(),
                ),
            })
            .collect();
        let all_rays = self.run.frame.traces_all_rays();
        // The first pass traces a quarter of the rays. Where they agree, no more are traced.
        let looks = |ask: &Ask| {
            ask.samples >= LEAST_ADAPTIVE
                && !all_rays
                && option(options.adaptive, ask.lane as usize, 1.0) > 0.0
        };
        let (first, rest): (Vec<usize>, Vec<usize>) = (0..asks.len()).partition(|&k| looks(&asks[k]));
        let mut out = vec![Record::default(); asks.len()];
        let mut again: Vec<(usize, Option<Record>)> = rest.into_iter().map(|k| (k, None)).collect();
        if !first.is_empty() {
            let quarter = |k: &usize| Ask {
                samples: asks[*k].samples / 4,
                seed: hash::words(&[asks[*k].seed, 4]),
                ..asks[*k]
            };
            let looked: Vec<Ask> = first.iter().map(quarter).collect();
            for (&k, (record, spread)) in first.iter().zip(self.trace(scene, &looked)) {
                let bound = ADAPTIVE_ERROR * option(options.adaptive, asks[k].lane as usize, 1.0);
                let scale =
                    if self.question.kind == Kind::Occlusion { 1.0 } else { record.mean(Kind::Irradiance) };
                // Rays that found no light at all do not count as agreement, because they may have missed a small
                // bright opening.
                if spread < asks[k].samples as f32 * bound * bound * scale * scale {
                    out[k] = record;
                } else {
                    again.push((k, Some(record)));
                }
            }
            again.sort_by_key(|a| a.0);
        }
        let whole: Vec<Ask> = again.iter().map(|a| asks[a.0]).collect();
        let traced = self.trace(scene, &whole);
        for ((k, before), (mut record, _)) in again.into_iter().zip(traced) {
            if let Some(before) = before {
                // A fifth of all rays was traced in the first pass.
                for (v, b) in record.value.iter_mut().zip(before.value) {
                    *v += 0.2 * (b - *v);
                }
                record.open = record.open.lerp(before.open, 0.2).normalize_or_zero();
            }
            out[k] = record;
        }
        self.run.frame.light_cache.count(asks.len(), 0);
        out
    }

    /// Traces all rays of some points. Returns their records and the variance of the samples of each.
    fn trace(&mut self, scene: &RayScene, asks: &[Ask]) -> Vec<(Record, f32)> {
        let mut out = Vec::with_capacity(asks.len());
        let mut rest = asks;
        while let Some(first) = rest.first() {
            let most = (RAYS / first.samples.max(1) as usize).max(1);
            let (now, later) = rest.split_at(most.min(rest.len()));
            rest = later;
            self.trace_together(scene, now, &mut out);
        }
        out
    }

    /// Traces the rays of some points at once. Appends their records and the variance of the samples of each.
    fn trace_together(&mut self, scene: &RayScene, asks: &[Ask], out: &mut Vec<(Record, f32)>) {
        let bundle = self.aimed(scene, asks);
        self.run.frame.light_cache.count(0, bundle.rays.len());
        let found = match self.question.kind {
            Kind::Irradiance => self.radiance(scene, asks, &bundle),
            Kind::Occlusion => self.blocked(scene, asks, &bundle),
        };
        let question = &self.question;
        let (kind, o) = (question.kind, &question.query.options);
        let mut traced = bundle.rays.iter().zip(found);
        for (ask, (cells, axis)) in asks.iter().zip(&bundle.strata) {
            let i = ask.lane as usize;
            let fall = Falloff::new(
                option(o.falloff, i, 0.0),
                option(o.falloffmode, i, 0.0),
                Run::reach(o.maxhitdist, i),
            );
            let seen: Vec<Seen> = traced
                .by_ref()
                .take(ray_count(cells, *axis) as usize)
                .map(|(ray, (value, distance))| Seen {
                    dir: ray.dir,
                    value: if distance.is_finite() { value * fall.at(distance) } else { value },
                    distance,
                })
                .collect();
            let record = cells.record(kind, *axis, &seen, !question.full);
            out.push((record, variance(kind, &seen)));
        }
    }

    /// Returns the rays of some points.
    fn aimed(&self, scene: &RayScene, asks: &[Ask]) -> RayBundle {
        let question = &self.question;
        let query = question.query;
        let o = &query.options;
        let most = asks.iter().map(|ask| ask.samples as usize).sum();
        let mut rays: Vec<Ray> = Vec::with_capacity(most);
        let mut strata = Vec::with_capacity(asks.len());
        let mut left: Vec<Leaving> = Vec::with_capacity(most);
        for ask in asks {
            let i = ask.lane as usize;
            let angle = query.angle.get(i);
            let cells = Strata::new(ask.samples, angle, query.options.spread() != "uniform");
            let axis = question.axis(i);
            let p = question.origins.at(i);
            let (bias, leaving) = (self.run.bias(o.bias, i), self.run.leaving(Some(scene), p));
            let tmax = Run::reach(o.maxhitdist, i);
            if axis != Vec3::ZERO {
                let (sequence, of) = (self.run.frame.sequence(ask.seed), cells.len());
                cells.directions(axis, sequence, &mut |index, dir| {
                    let time = self.run.ray_time([index, of], ask.seed);
                    rays.push(Aim { p, dir, bias, tmax, time }.ray());
                });
            }
            strata.push((cells, axis));
            left.resize(rays.len(), leaving);
        }
        RayBundle { rays, left, strata }
    }

    /// Returns the radiance along each ray, and the distance of its hit.
    fn radiance(&mut self, scene: &RayScene, asks: &[Ask], bundle: &RayBundle) -> Vec<(Color, f32)> {
        let question = &self.question;
        let request = |((ask, index), (ray, leaving)): ((Ask, u32), (&Ray, &Leaving))| {
            let name = hash::words(&[ask.seed, index, HIT]);
            let (ray, leaving) = (*ray, *leaving);
            let path = RayPath { rays: ask.samples as f32, index, seed: ask.seed, weight: 1.0 };
            let spread = question.ray_spread(&ask);
            RayRequest { lane: ask.lane, name, leaving, path, spread, ..RayRequest::new(ray) }
        };
        let requests: Vec<RayRequest> =
            bundle.sources(asks).zip(bundle.rays.iter().zip(&bundle.left)).map(request).collect();
        let bounces = self.run.ray.bounces + 1;
        // Records at hits are those of any point, whatever the rays before did.
        let level = if bounces > 1 { 0 } else { self.run.ray.level };
        let parent = RayKind { level, ..self.run.ray };
        let purpose = RayPurpose { parent, indirect: true, bounces, ..self.run.purpose() };
        let found = self.run.thread.radiance(scene, &requests, purpose, question.query.messages);
        found.into_iter().map(|r| (r.color, r.distance)).collect()
    }

    /// Returns 1 or 0 in all channels for each ray that is or is not blocked, and the distance of its hit. The
    /// distance is 0 for every hit when nothing depends on it.
    fn blocked(&mut self, scene: &RayScene, asks: &[Ask], bundle: &RayBundle) -> Vec<(Color, f32)> {
        let question = &self.question;
        let (rays, left) = (&bundle.rays, &bundle.left);
        let widths: Vec<[f32; 2]> = if scene.is_settled() {
            Vec::new()
        } else {
            bundle.sources(asks).map(|(ask, _)| [0.0, question.ray_spread(&ask)]).collect()
        };
        let widths = |k: usize| widths.get(k).copied().unwrap_or_default();
        let falls = |ask: &Ask| option(question.query.options.falloff, ask.lane as usize, 0.0) > 0.0;
        // The distance of a hit matters only to derivatives and falloff.
        if question.full && !asks.iter().any(falls) {
            let hits = scene.any(self.run.thread, rays, &widths, &|k| left[k]);
            let of = |hit| if hit { (Color::ONE, 0.0) } else { (Color::ZERO, f32::INFINITY) };
            hits.into_iter().map(of).collect()
        } else {
            let distances = scene.distances(self.run.thread, rays, &widths, &|k| left[k]);
            let of = |t: f32| (Color::splat(f32::from(u8::from(t.is_finite()))), t);
            distances.into_iter().map(of).collect()
        }
    }
}

/// The rays of some points, point by point.
struct RayBundle {
    rays: Vec<Ray>,
    /// The surface that each ray leaves.
    left: Vec<Leaving>,
    /// For each point: the strata, and the unit axis, which is zero for a point without one.
    strata: Vec<(Strata, Vec3)>,
}

impl RayBundle {
    /// Returns for each ray its point and its index among the rays of the point.
    fn sources(&self, asks: &[Ask]) -> impl Iterator<Item = (Ask, u32)> {
        let of = |(ask, (cells, axis)): (&Ask, &(Strata, Vec3))| {
            let ask = *ask;
            (0..ray_count(cells, *axis)).map(move |index| (ask, index))
        };
        asks.iter().zip(&self.strata).flat_map(of)
    }
}

/// Returns the number of rays of a point. A point without an axis has none.
#[inline(always)]
fn ray_count(cells: &Strata, axis: Vec3) -> u32 {
    if axis == Vec3::ZERO { 0 } else { cells.len() }
}

/// The decrease of influence with distance (reference 5.8.11; `exp (-falloff dist)` where it has a division, see
/// the errata).
#[derive(Clone, Copy)]
struct Falloff {
    falloff: f32,
    power: bool,
    reach: f32,
}

impl Falloff {
    fn new(falloff: f32, mode: f32, reach: f32) -> Self {
        Self { falloff, power: mode == 1.0, reach }
    }

    fn at(&self, distance: f32) -> f32 {
        if self.falloff.is_nan() || self.falloff <= 0.0 {
            return 1.0;
        }
        match self.power {
            true => approx::pow((1.0 - distance / self.reach).clamp(0.0, 1.0), self.falloff),
            false => approx::exp(-self.falloff * distance),
        }
    }
}

/// Returns the variance of single rays, of the mean of the channels.
fn variance(kind: Kind, seen: &[Seen]) -> f32 {
    let one = |s: &Seen| match kind {
        Kind::Irradiance => (s.value.x + s.value.y + s.value.z) / 3.0,
        Kind::Occlusion => s.value.x,
    };
    let n = seen.len().max(1) as f32;
    let mean = seen.iter().map(one).sum::<f32>() / n;
    seen.iter().map(|s| (one(s) - mean).powi(2)).sum::<f32>() / n
}
