//! Samples the light of maps: `environment ()` with "sample".

use super::maps::{CHANNELS, first_channel, prepare, store};
use super::{Repeat, Run, SKY, count, option, samples};
use crate::lighting::directions::{DirectionSample, DirectionWeights, EnvironmentSampler, TOGETHER};
use granita_base::sample::Draw;
use granita_base::{NoiseSource, Transform, Vec3, hash};
use granita_shade::{EnvironmentQuery, Lanes3, LookupResult};
use granita_texture::{EnvLookup, TextureId, Up, Use};
use std::sync::Arc;

/// The largest number of samples.
const MOST: f32 = 65536.0;

/// The number of maps whose directions are kept. With more maps in one loop, directions are drawn again for each
/// sample.
const MOST_MAPS: usize = 4;

/// Directions sampled from a map that were not requested yet.
pub(super) struct SampleBatch {
    map: Map,
    /// For each lane, the key that its directions were drawn for.
    keys: Vec<Option<Key>>,
    /// The radiance and direction of each sample of all lanes, sample by sample.
    sent: Vec<Sent>,
    /// The sequence of each lane, and its part of it.
    sequences: Vec<Draw>,
}

/// The map that all directions are drawn from.
struct Map {
    name: String,
    up: String,
    /// The transformation from the map's space to "common".
    space: Option<Transform>,
    channels: usize,
    directions: Arc<EnvironmentSampler>,
}

impl Map {
    fn is_for(&self, query: &EnvironmentQuery<'_>, space: Option<Transform>) -> bool {
        self.name == query.name
            && self.up == query.options.up.unwrap_or("")
            && (self.space, self.channels) == (space, query.channels)
    }
}

/// The values that the directions of a lane depend on.
#[derive(Clone, Copy, PartialEq)]
struct Key {
    /// The index of the first of them, and the number of all.
    first: u32,
    all: u32,
    /// The bits of the axis that they are in front of.
    axis: [u32; 3],
    first_channel: u32,
    /// The bits of the value of channels that the map does not have.
    fill: u32,
}

/// The radiance that arrives from a direction.
#[derive(Clone, Copy, Default)]
struct Sent {
    /// The channels, then alpha.
    values: [f32; CHANNELS],
    /// A unit vector in "common" space.
    dir: Vec3,
}

/// The values that all lanes of a query share.
struct Drawing<'q> {
    query: &'q EnvironmentQuery<'q>,
    /// The axes of the map's space, in "common" space.
    axes: [Vec3; 3],
    up: Option<Up>,
    /// The number of channels of the result, alpha included.
    wanted: usize,
    /// Scratch, which is made for the first directions.
    room: Option<DirectionWeights>,
    /// The map, which is found by name once, when the cells do not have all channels. The inner `None` is a map that
    /// does not exist.
    texture: Option<Option<TextureId>>,
}

impl Run<'_, '_> {
    /// Returns a sample for each active lane; false when the map does not exist. `space` leads from the map's space
    /// to "common".
    ///
    /// The value is the contribution of the direction to the integral over the directions that the shader gathers:
    /// radiance over pdf (1/sr) over the number of samples. For a light whose illumination is gathered in front of
    /// surfaces, directions are drawn there.
    pub(super) fn drawn(
        &mut self,
        query: &EnvironmentQuery<'_>,
        space: Option<Transform>,
        out: &mut LookupResult,
    ) -> bool {
        let o = &query.options;
        let lanes = query.batch.lanes;
        let known = self.sky.iter().position(|ahead| ahead.map.is_for(query, space));
        let mut ahead = match known {
            Some(k) => self.sky.swap_remove(k),
            None => match self.new_batch(query, space) {
                Some(batch) => batch,
                None => return false,
            },
        };
        prepare(query.batch, query.channels, out);
        out.direction = Lanes3::zeros(lanes);
        let to_common = space.unwrap_or(Transform::IDENTITY);
        let of_all = o.samples.is_none_or(|s| s.stride == 0).then(|| count(o.samples, 0));
        let mut drawing = Drawing {
            query,
            axes: [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| to_common.vector(axis)),
            up: o.up.and_then(Up::from_word),
            wanted: (query.channels + 1).min(CHANNELS),
            room: None,
            texture: None,
        };
        let coincident = self.coincident.clone();
        let mut coincident = coincident.iter().peekable();
        for &lane in query.batch.active {
            let i = lane as usize;
            let number = option(o.sample, i, 0.0).clamp(0.0, MOST) as u32;
            let first = number - number % TOGETHER as u32;
            let asked = of_all.unwrap_or_else(|| count(o.samples, i));
            // The runs of a light share its samples.
            let all = samples(asked, (self.frame.samples() / self.repeat.of as f32).min(1.0));
            if number >= all && all < asked {
                // The samples that are drawn stand for the others.
                store(out, i, &[0.0; CHANNELS][..drawing.wanted]);
                out.direction.set(i, query.r.get(i).normalize_or_zero());
                continue;
            }
            let (first_channel, fill) = (first_channel(o.firstchannel, i), option(o.fill, i, 0.0));
            let axis = query.r.get(i).to_array().map(f32::to_bits);
            let key = Key { first, all, axis, first_channel, fill: fill.to_bits() };
            if ahead.keys[i] != Some(key) {
                ahead.keys[i] = Some(key);
                while coincident.next_if(|twin| twin.0 < lane).is_some() {}
                let twin = coincident.peek().filter(|twin| twin.0 == lane).map(|twin| twin.1 as usize);
                if let Some(of) = twin.filter(|of| ahead.keys[*of] == Some(key)) {
                    (0..TOGETHER).for_each(|k| ahead.sent[k * lanes + i] = ahead.sent[k * lanes + of]);
                } else {
                    self.draw_lane(&mut drawing, &mut ahead, i, &key);
                }
            }
            let Sent { values, dir } = ahead.sent[(number - first) as usize * lanes + i];
            store(out, i, &values[..drawing.wanted]);
            out.direction.set(i, dir);
        }
        if self.sky.len() == MOST_MAPS {
            self.sky.remove(0);
        }
        self.sky.push(ahead);
        true
    }

    /// Returns a batch without samples for the map of a query; `None` when the map does not exist.
    fn new_batch(&self, query: &EnvironmentQuery<'_>, space: Option<Transform>) -> Option<SampleBatch> {
        let (up, lanes) = (query.options.up, query.batch.lanes);
        let directions = self.frame.directions(query.name, up)?;
        let (name, up) = (query.name.to_owned(), up.unwrap_or("").to_owned());
        Some(SampleBatch {
            map: Map { name, up, space, channels: query.channels, directions },
            keys: vec![None; lanes],
            sent: vec![Sent::default(); lanes * TOGETHER],
            sequences: self.sequences(lanes),
        })
    }

    /// Draws directions for a lane, and stores the samples in `ahead`.
    fn draw_lane(&mut self, drawing: &mut Drawing<'_>, ahead: &mut SampleBatch, lane: usize, key: &Key) {
        let query = drawing.query;
        let [x, y, z] = drawing.axes;
        let r = query.r.get(lane);
        // A unit normal is transformed into the map's space, where cosines stay the same.
        let normal = Vec3::new(r.dot(x), r.dot(y), r.dot(z)).normalize_or_zero();
        let normal = Some(normal).filter(|n| self.gathers_in_front && *n != Vec3::ZERO);
        let draw = ahead.sequences[lane];
        let Repeat { run, of } = self.repeat;
        let (first, all) = (run.wrapping_mul(key.all).wrapping_add(key.first), key.all.saturating_mul(of));
        let point = |k: usize| draw.square(first.wrapping_add(k as u32), all);
        let drawn = ahead.map.directions.draw(
            normal,
            &std::array::from_fn(point),
            drawing.room.get_or_insert_with(DirectionWeights::new),
        );
        for (k, &DirectionSample { dir, pdf, mut seen }) in drawn.iter().enumerate() {
            // The cells hold the first channels only.
            if key.first_channel != 0 || f32::from_bits(key.fill) != 0.0 {
                self.look_up(drawing, key, dir, &mut seen[..drawing.wanted]);
            }
            let share = 1.0 / (pdf * key.all as f32);
            seen[..query.channels].iter_mut().for_each(|v| *v *= share);
            let dir = (x * dir.x + y * dir.y + z * dir.z).normalize_or_zero();
            ahead.sent[k * query.batch.lanes + lane] = Sent { values: seen, dir };
        }
    }

    /// Looks up channels of the map of a query in a direction (in the map's space). It averages over a cone of the
    /// width of a cell of the sampler. The values stay unchanged when the map does not exist.
    fn look_up(&mut self, drawing: &mut Drawing<'_>, key: &Key, dir: Vec3, values: &mut [f32]) {
        let (frame, name) = (self.frame, drawing.query.name);
        let find = || frame.textures.find_for(name, Use::Environment);
        if let Some(id) = *drawing.texture.get_or_insert_with(find) {
            let how = EnvLookup {
                r: dir,
                angle: Some(0.5 * EnvironmentSampler::cell()),
                up: drawing.up,
                first_channel: key.first_channel,
                fill: f32::from_bits(key.fill),
                ..EnvLookup::default()
            };
            self.thread.textures().environment(id, &how, values);
        }
    }

    /// Returns for each lane its sequence of directions, and its part of it ([`Run::part_of`]).
    fn sequences(&self, lanes: usize) -> Vec<Draw> {
        let seed = |lane: usize| {
            let seed = match self.seeds.of(lane) {
                Some(own) => hash::words(&[own, SKY]),
                None => hash::words(&[self.seed, SKY, lane as u32]),
            };
            self.frame.seed_of(NoiseSource::Environment, seed)
        };
        let own = |lane: usize| {
            let (first, part) = self.part_of(lane);
            Draw { sequence: self.frame.sequence(seed(first)), part }
        };
        let mut out: Vec<Draw> = (0..lanes).map(own).collect();
        for &(lane, of) in self.coincident.iter() {
            out[lane as usize] = out[of as usize];
        }
        out
    }
}
