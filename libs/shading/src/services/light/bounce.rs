//! Indirect light where rays of indirect light hit: the bounces after the first ("indirect:maxdepth").
//!
//! Space is divided into cells. The hits of one cell, on one object and one side of it, share a record, so that a
//! bounce takes a few records and not many rays for each hit. A record is computed at a point that depends on the cell
//! alone: where a line through the cell crosses the surface. So it does not matter which hit asks first, and the cache
//! may drop it.
//!
//! A hit asks a cell that is chosen at random near it, which replaces interpolation (Binder, Fricke, Keller: Fast Path
//! Space Filtering by Jittered Spatial Hashing, 2018, where cells hold the mean of their hits). Where no line crosses
//! the surface (small objects, hair, borders), a hit traces one ray of its own.

use super::{Ask, Gatherer, Question, count, option};
use crate::lighting::cache::lattice::Tolerance;
use crate::lighting::cache::{Kind, Record, Spot};
use crate::object::RayScene;
use crate::services::Run;
use crate::services::origins::Origins;
use crate::services::rays::{TracingLanes, unknown_set};
use granita_base::{Color, NoiseSource, Vec3, hash};
use granita_rays::{RayRequest, SetHit, mesh_hit};
use granita_scene::attr;
use granita_sdb::Mode;
use granita_shade::{Batch, GatherQuery, Lane, Lane3, Lanes3};
use granita_trace::Ray;
use std::collections::HashMap;
use std::sync::Arc;

/// The width of a cell, relative to the largest distance between records that the camera sees.
const CELL_WIDTH: f32 = 2.0;
/// The part of the samples that a record of a cell takes. Each record that the camera sees averages many of them.
const SAMPLES_PART: u32 = 2;
/// The least number of samples of a record of a cell. With fewer, it would have no derivatives.
const LEAST_SAMPLES: u32 = 16;
/// The origin of the cells, in cells. Walls stand often at round numbers, and would lie on borders.
const ORIGIN: f32 = 0.382;
/// How far from the centre of a cell its line is searched for the surface, in cells. A surface that crosses the cell at
/// less than 55 degrees to its base crosses the line within this distance.
const SEARCH: f32 = 1.5;
/// The smallest cosine between the line and the normal of the surface that it crosses.
const LEAST_COS: f32 = 0.35;
/// The lines of a cell, as offsets from its centre in cells.
const LINES: [[f32; 2]; 5] = [[0.0, 0.0], [0.25, 0.25], [-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25]];

// Dimensions of random numbers of one hit.
const ACROSS: u32 = 11;
const ALONG: u32 = 12;

/// Marks the keys of cells in the cache.
const CELLS: u32 = 0xce11;

/// A cube of space, seen from one of six directions.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    at: [i32; 3],
    /// The binary logarithm of its width in world units.
    exponent: i8,
    /// The axis of space that is nearest to the normal.
    axis: u8,
    /// True when the normal points to the positive side of that axis.
    positive: bool,
    /// True when light arrives on the front side of the surface.
    front: bool,
}

impl Cell {
    /// Returns the cell of a place with a unit normal, and `width` units wide or up to half of it. The place is first
    /// moved across the normal by `jitter`, in cells. `None` where coordinates or width are unusable.
    fn of(p: Vec3, n: Vec3, front: bool, width: f32, jitter: [f32; 2]) -> Option<Self> {
        if !p.is_finite() || !n.is_finite() || !width.is_normal() || width < 0.0 {
            return None;
        }
        // The exponent bits are the logarithm, rounded down.
        let exponent = ((width.to_bits() >> 23) as i32 - 127).clamp(-100, 100) as i8;
        let along = n.abs();
        let axis = if along.x >= along.y.max(along.z) { 0 } else { 1 + usize::from(along.z > along.y) };
        let mut cell = Self { at: [0; 3], exponent, axis: axis as u8, positive: n[axis] > 0.0, front };
        let mut moved = p / cell.width();
        moved[(axis + 1) % 3] += jitter[0];
        moved[(axis + 2) % 3] += jitter[1];
        cell.at = moved.to_array().map(|x| (x + ORIGIN).floor() as i32);
        Some(cell)
    }

    /// Returns its width in world units.
    fn width(&self) -> f32 {
        f32::from_bits(((i32::from(self.exponent) + 127) as u32) << 23)
    }

    /// Returns the unit vector that its lines are searched against.
    fn up(&self) -> Vec3 {
        let mut up = Vec3::ZERO;
        up[usize::from(self.axis)] = if self.positive { 1.0 } else { -1.0 };
        up
    }

    /// Returns one of its lines as a ray, over the distance that is searched.
    fn line(&self, offset: [f32; 2]) -> Ray {
        let mut p = Vec3::from_array(self.at.map(|x| x as f32 + 0.5 - ORIGIN));
        let axis = usize::from(self.axis);
        p[(axis + 1) % 3] += offset[0];
        p[(axis + 2) % 3] += offset[1];
        let (width, up) = (self.width(), self.up());
        Ray {
            origin: p * width + up * (SEARCH * width),
            tmin: 0.0,
            dir: -up,
            tmax: 2.0 * SEARCH * width,
            time: 0.0,
        }
    }

    /// Returns the key of its record. `question` is a hash of all parameters of the record.
    fn spot(&self, object: u32, question: u32) -> Spot {
        let [x, y, z] = self.at.map(|x| x as u32);
        let sides = u32::from(self.positive) | u32::from(self.front) << 1 | u32::from(self.axis) << 2;
        [x, y, z, (self.exponent as u8).into(), sides, object, question, CELLS]
    }

    /// Returns the point of its record on an object, and the unit normal there, on the side that light arrives on.
    fn place(&self, run: &mut Run<'_, '_>, scene: &RayScene) -> Option<[Vec3; 2]> {
        LINES.iter().find_map(|offset| {
            let ray = Ray { time: run.time, ..self.line(*offset) };
            let request = RayRequest::new(ray);
            let mut found: Vec<SetHit> = Vec::new();
            let object = std::ptr::from_ref(run.object);
            scene.closest_where(run.thread, &request, &mut |hit| {
                if std::ptr::eq(Arc::as_ptr(scene.object(hit)), object) {
                    found.push(*hit);
                }
                false
            });
            // Within the cell, the outermost surface is the one that light arrives on. Outside of it, the nearest is.
            let off = |hit: &SetHit| {
                let off = (hit.t / self.width() - SEARCH).abs();
                if off <= 0.5 { 0.0 } else { off }
            };
            found.sort_by(|a, b| {
                off(a).total_cmp(&off(b)).then(a.t.total_cmp(&b.t)).then(a.order().cmp(&b.order()))
            });
            let located = scene.locate(run.thread, &found);
            found.iter().enumerate().find_map(|(k, hit)| {
                let (mesh, triangle) = located.get(k)?;
                let hit = mesh_hit(&request, hit, triangle);
                let n = mesh.normal(&hit);
                let n = if self.front { n } else { -n };
                (n.dot(self.up()) >= LEAST_COS).then_some([hit.p, n])
            })
        })
    }
}

/// The record of a cell without a point.
fn nothing() -> Record {
    Record { value: [f32::NAN; 3], ..Record::default() }
}

/// Answers `indirect ()` at hits of rays of indirect light.
pub(super) fn indirect(run: &mut Run<'_, '_>, query: &GatherQuery<'_>, out: &mut Lanes3) {
    query.batch.active.iter().for_each(|lane| out.set(*lane as usize, Color::ZERO));
    let call = run.next_call(query.batch.active);
    if !run.may_trace() || query.batch.active.is_empty() {
        return;
    }
    let Some(scene) = run.frame.rays.scene(query.set, run.frame) else { return unknown_set(run, query.set) };
    let lanes = TracingLanes::new(run, query.batch.active);
    let attributes = run.object_attributes;
    let (error, distance) = (attr::INDIRECT_MAXERROR, attr::INDIRECT_MAXPIXELDIST);
    let (maxerror, maxpixeldist) = (attributes.get(error), attributes.get(distance));
    let mut deeper = Deeper { run, scene, query, call, maxerror, maxpixeldist, parameters: None };
    deeper.parameters = deeper.uniform_parameters();
    let mut rest: Vec<u32> = lanes.traced.clone();
    if !scene.queries_parents {
        for jittered in [true, false] {
            rest = deeper.take_from_cells(rest, jittered, out);
        }
    }
    deeper.by_rays(&rest, out);
    lanes.copy3(out);
}

/// A call for indirect light at hits of indirect rays.
struct Deeper<'g, 'r, 'f, 'q> {
    run: &'g mut Run<'r, 'f>,
    scene: &'f RayScene,
    query: &'q GatherQuery<'q>,
    call: u32,
    /// The attribute "indirect:maxerror" of the object.
    maxerror: f32,
    /// The attribute "indirect:maxpixeldist" of the object.
    maxpixeldist: f32,
    /// The hash of the parameters, when all lanes have the same.
    parameters: Option<u32>,
}

/// A cell whose record is missing.
struct Missing {
    spot: Spot,
    /// A lane that asks for it.
    lane: u32,
    place: [Vec3; 2],
}

impl<'q> Deeper<'_, '_, '_, 'q> {
    /// Sets the light of lanes whose cells have a record. Returns the other lanes.
    fn take_from_cells(&mut self, lanes: Vec<u32>, jittered: bool, out: &mut Lanes3) -> Vec<u32> {
        let number = self.run.object.number;
        let spots: Vec<Option<(Cell, Spot)>> = lanes
            .iter()
            .map(|&lane| {
                let cell = self.cell(lane, jittered)?;
                Some((cell, cell.spot(number, self.parameters.unwrap_or_else(|| self.parameters_of(lane)))))
            })
            .collect();
        let mut known: HashMap<Spot, Arc<Record>> = HashMap::new();
        let mut missing: Vec<Missing> = Vec::new();
        for (&lane, of) in lanes.iter().zip(&spots) {
            let Some((cell, spot)) = of.filter(|(_, spot)| !known.contains_key(spot)) else { continue };
            if let Some((record, depends)) = self.run.frame.light_cache.find(&spot) {
                if let Some(notes) = &mut self.run.thread.notes {
                    notes.add_all(&depends);
                }
                known.insert(spot, record);
                continue;
            }
            // The entry is replaced when the record is there.
            let empty = Arc::new(nothing());
            known.insert(spot, empty.clone());
            match cell.place(self.run, self.scene) {
                Some(place) => missing.push(Missing { spot, lane, place }),
                None => self.keep(spot, &empty, &Arc::default()),
            }
        }
        for group in missing.chunk_by(|a, b| a.spot[6] == b.spot[6]) {
            let outer = self.run.thread.notes.as_mut().map(std::mem::take);
            let records = self.records(group);
            let depends = self.run.noted_since(outer);
            for (missing, record) in group.iter().zip(records) {
                let record = Arc::new(Record { open: missing.place[1], ..record });
                self.keep(missing.spot, &record, &depends);
                known.insert(missing.spot, record);
            }
        }
        let mut rest = Vec::new();
        for (lane, of) in lanes.into_iter().zip(spots) {
            let record = of.and_then(|(_, spot)| known.get(&spot)).filter(|record| !record.value[0].is_nan());
            match record {
                Some(record) => out.set(lane as usize, turned(record, self.axis(lane))),
                None => rest.push(lane),
            }
        }
        rest
    }

    /// Sets the light of lanes from one ray each.
    fn by_rays(&mut self, lanes: &[u32], out: &mut Lanes3) {
        let asks: Vec<Ask> = lanes
            .iter()
            .map(|&lane| Ask {
                lane,
                seed: self.run.lane_seed(NoiseSource::Indirect, self.call, lane),
                samples: 1,
            })
            .collect();
        let question = question(self.query, true);
        let (scene, call) = (self.scene, self.call);
        let mut gatherer = Gatherer { run: self.run, scene: Some(scene), question, call };
        let found = gatherer.trace(scene, &asks);
        for (lane, (record, _)) in lanes.iter().zip(found) {
            out.set(*lane as usize, record.color().max(Color::ZERO));
        }
    }

    /// Returns the records of cells whose questions have the same parameters.
    fn records(&mut self, cells: &[Missing]) -> Vec<Record> {
        let Some(lane) = cells.first().map(|missing| missing.lane as usize) else { return Vec::new() };
        let points = |k: usize| cells.iter().map(|missing| missing.place[k]).collect::<Vec<Vec3>>();
        let [positions, axes] = [0, 1].map(|k| Lanes3::from_points(&points(k)));
        let active: Vec<u32> = (0..cells.len() as u32).collect();
        let asked = count(Some(self.query.samples), lane);
        let samples = [(asked / SAMPLES_PART).max(LEAST_SAMPLES.min(asked)) as f32];
        // All cells have the values of the first lane.
        let uniform = |of: Lane<'q>| Lane { values: &of.values[lane * of.stride..], stride: 0 };
        let query = GatherQuery {
            batch: Batch { lanes: cells.len(), active: &active, ..self.query.batch },
            set: self.query.set,
            p: Lane3::over(&positions),
            axis: Lane3::over(&axes),
            angle: uniform(self.query.angle),
            samples: Lane { values: &samples, stride: 0 },
            options: self.query.options.map(uniform, Some),
            messages: &[],
        };
        let question = question(&query, false);
        let mut gatherer = Gatherer { run: self.run, scene: Some(self.scene), question, call: self.call };
        gatherer.sample(&active)
    }

    fn keep(&self, spot: Spot, record: &Arc<Record>, depends: &Arc<crate::memo::Dependencies>) {
        if !self.run.frame.is_stopped() {
            self.run.frame.light_cache.keep(spot, record, depends);
        }
    }

    fn axis(&self, lane: u32) -> Vec3 {
        self.query.axis.get(lane as usize).normalize_or_zero()
    }

    /// Returns the cell that a lane asks. `None` where records are not shared: "maxpixeldist" or "maxerror" is 0.
    fn cell(&self, lane: u32, jittered: bool) -> Option<Cell> {
        let (i, o) = (lane as usize, &self.query.options);
        let or = |value: Option<Lane<'_>>, attribute: f32| {
            value.map(|v| v.get(i)).filter(|v| *v >= 0.0).unwrap_or(attribute)
        };
        let distance = or(o.maxpixeldist, self.maxpixeldist);
        if or(o.maxerror, self.maxerror) <= 0.0 {
            return None;
        }
        let (p, n) = (self.query.p.get(i), self.axis(lane));
        let front = self.run.surface.as_ref().is_none_or(|surface| surface.ng.get(i).dot(n) >= 0.0);
        let seed = self.run.lane_seed(NoiseSource::Indirect, self.call, lane);
        let sequence = self.run.frame.sequence(seed);
        let place = [ACROSS, ALONG].map(|dimension| hash::unit(sequence.dimension(dimension).seed));
        // Points without a cell draw their directions from the sequence itself.
        let within = sequence.dimension(ACROSS).moved(place);
        let offset = if jittered { within.map(|x| x - 0.5) } else { [0.0; 2] };
        let width = CELL_WIDTH * distance / self.run.pixels_per_unit(p);
        Cell::of(p, n, front, width, offset).filter(|_| n != Vec3::ZERO)
    }

    /// Returns the hash of the parameters, when no option differs between lanes.
    fn uniform_parameters(&self) -> Option<u32> {
        let o = &self.query.options;
        let options = [o.adaptive, o.bias, o.maxhitdist, o.falloff, o.falloffmode];
        let all = [self.query.angle, self.query.samples].into_iter().chain(options.into_iter().flatten());
        let first = *self.query.batch.active.first()?;
        all.map(|lanes| lanes.stride).all(|stride| stride == 0).then(|| self.parameters_of(first))
    }

    /// Returns a hash of everything that decides the record of a cell, besides the cell and the object.
    fn parameters_of(&self, lane: u32) -> u32 {
        let (run, i) = (&*self.run, lane as usize);
        let mut words = vec![
            hash::bytes64(self.query.set.as_bytes()) as u32,
            run.time.to_bits(),
            run.dtime.to_bits(),
            run.shadow_bias.to_bits(),
            u32::from(run.ray_motion),
            run.ray.bounces,
            self.query.angle.get(i).to_bits(),
            self.query.samples.get(i).to_bits(),
        ];
        let o = &self.query.options;
        let numbers = [o.adaptive, o.bias, o.maxhitdist, o.falloff, o.falloffmode];
        words.extend(numbers.iter().map(|n| option(*n, i, f32::NAN).to_bits()));
        words.push(hash::bytes64(o.spread().as_bytes()) as u32);
        hash::words(&words)
    }
}

/// Returns a question that no file answers.
fn question<'q>(query: &'q GatherQuery<'q>, full: bool) -> Question<'q> {
    Question {
        kind: Kind::Irradiance,
        query,
        tolerance: Tolerance { maxerror: 0.0, maxpixeldist: 0.0, minsamples: 0 },
        full,
        database: "",
        mode: Mode::default(),
        known: None,
        translational: !full,
        hash: 0,
        origins: Origins::at_points(query.p),
    }
}

/// Returns the light of a record for another normal. The correction is bounded, because derivatives are noisy.
fn turned(record: &Record, axis: Vec3) -> Color {
    let turn = axis - record.open;
    let value = |c: usize| {
        let value = record.value[c].max(0.0);
        (value + record.rotational[c].dot(turn)).clamp(0.0, 2.0 * value)
    };
    Color::new(value(0), value(1), value(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_one_cell_have_its_key() {
        let n = Vec3::new(0.1, -0.9, 0.3).normalize();
        let of = |p: Vec3| Cell::of(p, n, true, 1.7, [0.0; 2]).unwrap();
        let cell = of(Vec3::new(0.1, 0.2, 0.3));
        assert_eq!((cell.exponent, cell.width(), cell.axis, cell.positive), (0, 1.0, 1, false));
        assert_eq!(cell, of(Vec3::new(0.6, 0.5, -0.3)));
        // Places around a round number are in one cell.
        assert_eq!(of(Vec3::splat(1e-6)), of(Vec3::splat(-1e-6)));
        let others = [
            of(Vec3::new(0.7, 0.2, 0.3)),
            Cell::of(Vec3::new(0.1, 0.2, 0.3), -n, true, 1.7, [0.0; 2]).unwrap(),
            Cell::of(Vec3::new(0.1, 0.2, 0.3), n, false, 1.7, [0.0; 2]).unwrap(),
            Cell::of(Vec3::new(0.1, 0.2, 0.3), n, true, 2.7, [0.0; 2]).unwrap(),
            Cell::of(Vec3::new(0.1, 0.2, 0.3), n, true, 1.7, [0.0, 0.6]).unwrap(),
        ];
        for (k, other) in others.iter().enumerate() {
            assert_ne!(cell.spot(1, 2), other.spot(1, 2), "{k}");
        }
        assert_ne!(cell.spot(1, 2), cell.spot(2, 2));
        assert_ne!(cell.spot(1, 2), cell.spot(1, 3));
        // Jitter moves across the normal only.
        let moved = Cell::of(Vec3::new(0.1, 0.2, 0.3), n, true, 1.7, [3.0, 5.0]).unwrap();
        assert_eq!(moved.at, [cell.at[0] + 5, cell.at[1], cell.at[2] + 3]);
    }

    #[test]
    fn unusable_places_have_no_cell() {
        let n = Vec3::Z;
        for (p, n, width) in [
            (Vec3::splat(f32::NAN), n, 1.0),
            (Vec3::ZERO, Vec3::splat(f32::NAN), 1.0),
            (Vec3::ZERO, n, 0.0),
            (Vec3::ZERO, n, -1.0),
            (Vec3::ZERO, n, f32::INFINITY),
            (Vec3::ZERO, n, f32::NAN),
        ] {
            assert_eq!(Cell::of(p, n, true, width, [0.0; 2]), None, "{p} {n} {width}");
        }
    }

    #[test]
    fn lines_cross_the_whole_cell() {
        let cell = Cell::of(Vec3::new(5.1, 0.2, 0.3), Vec3::X, true, 4.0, [0.0; 2]).unwrap();
        let line = cell.line([0.25, -0.25]);
        assert_eq!((line.dir, line.tmax), (-Vec3::X, 12.0));
        let middle = line.origin + line.dir * 6.0;
        assert_eq!(Cell::of(middle, Vec3::X, true, 4.0, [0.0; 2]), Some(cell));
    }

    #[test]
    fn turned_light_stays_within_bounds() {
        let record = Record {
            value: [1.0, 2.0, 0.0],
            open: Vec3::Z,
            rotational: [Vec3::X * 9.0; 3],
            ..Record::default()
        };
        assert_eq!(turned(&record, Vec3::Z), Color::new(1.0, 2.0, 0.0));
        assert_eq!(turned(&record, Vec3::X), Color::new(2.0, 4.0, 0.0));
        assert_eq!(turned(&record, -Vec3::X), Color::ZERO);
    }
}
