//! Directions drawn by the light of maps: `environment ()` with "sample".

use super::maps::{CHANNELS, first_channel, prepare, store};
use super::{Run, SKY, count, option};
use crate::directions::{Around, Directions, Drawn};
use granita_base::{Transform, Vec3, hash, sample};
use granita_shade::{EnvironmentQuery, Lanes3, LookupResult, Rect};
use granita_texture::{EnvLookup, TextureCache, Up, Use};
use std::sync::Arc;

/// Samples of a point that are drawn together.
const TOGETHER: u32 = 16;
/// Most samples.
const MOST: f32 = 65536.0;

/// Directions that are drawn and not asked for yet.
#[derive(Default)]
pub(super) struct Ahead {
    /// The map, and its upper direction.
    map: Option<(String, String, Arc<Directions>)>,
    /// Of each lane, what its directions were drawn for.
    keys: Vec<Option<Key>>,
    /// Sample by sample, of all lanes.
    drawn: Vec<Drawn>,
    /// Of each lane, the seed of its sequence and its first sample there.
    sequences: Vec<(u32, u32)>,
}

/// What directions of a lane depend on.
#[derive(Clone, Copy, PartialEq)]
struct Key {
    /// Number of the first of them.
    first: u32,
    /// What they are in front of, in the space of the map; zero for all around.
    normal: Vec3,
}

impl Run<'_, '_> {
    /// A sample for each active lane; false when there is no such map. `space` leads from the map's space to "common".
    ///
    /// The value is what the direction adds to the integral over all that the shader gathers from: light over chance over number.
    /// In a light whose illumination is gathered from in front of surfaces, directions are drawn there.
    pub(super) fn drawn(
        &mut self,
        query: &EnvironmentQuery<'_>,
        space: Option<Transform>,
        out: &mut LookupResult,
    ) -> bool {
        let o = &query.options;
        let mut ahead = std::mem::take(&mut self.sky);
        let up = o.up.unwrap_or("");
        if ahead.map.as_ref().is_none_or(|(name, of, _)| name != query.name || of != up) {
            let directions = self.frame.directions(query.name, o.up);
            ahead.map = directions.map(|d| (query.name.to_owned(), up.to_owned(), d));
            ahead.keys.clear();
        }
        let Some((.., directions)) = &ahead.map else { return false };
        let lanes = query.batch.lanes;
        if ahead.sequences.len() != lanes {
            ahead.sequences = self.sequences(lanes);
        }
        let nowhere = Drawn { dir: Vec3::Z, chance: 1.0, seen: [0.0; 4] };
        if ahead.keys.len() != lanes {
            ahead.keys = vec![None; lanes];
            ahead.drawn.resize(lanes * TOGETHER as usize, nowhere);
        }
        prepare(query.batch, query.channels, out);
        out.direction = Lanes3::zeros(lanes);
        let to_common = space.unwrap_or(Transform::IDENTITY);
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| to_common.vector(axis));
        let samples = count_of_all(query);
        let mut around = Around::new();
        let twins = self.twins.clone();
        let mut twins = twins.iter().peekable();
        let mut rest = Rest { textures: &self.frame.textures, query };
        for &lane in query.batch.active {
            let i = lane as usize;
            let number = option(o.sample, i, 0.0).clamp(0.0, MOST) as u32;
            let first = number - number % TOGETHER;
            let r = query.r.get(i);
            // The cosine with a direction of the map is that of this and the direction.
            let normal = Vec3::new(r.dot(x), r.dot(y), r.dot(z)).normalize_or_zero();
            let normal = if self.gathers_in_front { normal } else { Vec3::ZERO };
            let key = Key { first, normal };
            let (seed, before) = ahead.sequences[i];
            while twins.next_if(|twin| twin.0 < lane).is_some() {}
            let twin = twins.peek().filter(|twin| twin.0 == lane).map(|twin| twin.1 as usize);
            if ahead.keys[i] == Some(key) {
                // Drawn already.
            } else if let Some(of) = twin.filter(|of| ahead.keys[*of] == Some(key)) {
                ahead.keys[i] = Some(key);
                for k in 0..TOGETHER as usize {
                    ahead.drawn[k * lanes + i] = ahead.drawn[k * lanes + of];
                }
            } else {
                ahead.keys[i] = Some(key);
                let all = samples.unwrap_or_else(|| count(o.samples, i));
                let before = before.wrapping_mul(all.next_power_of_two());
                let among = if normal == Vec3::ZERO {
                    directions.whole()
                } else {
                    directions.before(normal, &mut around);
                    &around
                };
                for k in 0..TOGETHER.min(all.saturating_sub(first).max(1)) {
                    let (x, y) = sample::square(before.wrapping_add(first + k), seed);
                    ahead.drawn[k as usize * lanes + i] = directions.at(among, x, y);
                }
            }
            let Drawn { dir, chance, seen } = ahead.drawn[(number - first) as usize * lanes + i];
            let mut values = seen;
            rest.look(i, dir, &mut values);
            let share = 1.0 / (chance * samples.unwrap_or_else(|| count(o.samples, i)) as f32);
            values[..query.channels].iter_mut().for_each(|v| *v *= share);
            store(out, i, &values[..(query.channels + 1).min(CHANNELS)]);
            out.direction.set(i, (x * dir.x + y * dir.y + z * dir.z).normalize_or_zero());
        }
        self.sky = ahead;
        true
    }

    /// Of each lane, the seed of its sequence of directions, and its place among those that share the sequence.
    ///
    /// Points of a rectangle share one, in the order of a curve that keeps neighbours together: what one of them draws is
    /// spread between what those around it draw (after Ahmed, Wonka: Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error
    /// via Hierarchical Ordering of Pixels, SIGGRAPH Asia 2020).
    fn sequences(&self, lanes: usize) -> Vec<(u32, u32)> {
        let seed = |lane: usize| match self.names.get(lane) {
            Some(name) => hash::words(&[*name, SKY]),
            None => hash::words(&[self.seed, SKY, lane as u32]),
        };
        let mut out: Vec<(u32, u32)> = Vec::with_capacity(lanes);
        for Rect { first, nu, nv } in self.topology.rects() {
            out.extend((out.len()..first).map(|lane| (seed(lane), 0)));
            let own = seed(first);
            let at = |k: usize| (own, spread((k % nu) as u32) | spread((k / nu) as u32) << 1);
            out.extend((0..nu * nv).map(at));
        }
        out.extend((out.len()..lanes).map(|lane| (seed(lane), 0)));
        for &(lane, of) in self.twins.iter() {
            out[lane as usize] = out[of as usize];
        }
        out
    }
}

/// The number of samples, where it is the same for all lanes.
fn count_of_all(query: &EnvironmentQuery<'_>) -> Option<u32> {
    query.options.samples.is_none_or(|s| s.stride == 0).then(|| count(query.options.samples, 0))
}

/// The bits of a number, two places apart.
fn spread(x: u32) -> u32 {
    (0..16).fold(0, |out, bit| out | (x >> bit & 1) << (2 * bit))
}

/// What the cells of a map do not know: other channels than the first.
struct Rest<'q> {
    textures: &'q TextureCache,
    query: &'q EnvironmentQuery<'q>,
}

impl Rest<'_> {
    fn look(&mut self, lane: usize, r: Vec3, values: &mut [f32; CHANNELS]) {
        let o = &self.query.options;
        let (first_channel, fill) = (first_channel(o.firstchannel, lane), option(o.fill, lane, 0.0));
        if first_channel == 0 && fill == 0.0 {
            return;
        }
        let Some(id) = self.textures.find_for(self.query.name, Use::Environment) else { return };
        let angle = Some(0.5 * Directions::cell());
        let up = o.up.and_then(Up::from_word);
        let lookup = EnvLookup { r, angle, up, first_channel, fill, ..EnvLookup::default() };
        let wanted = (self.query.channels + 1).min(CHANNELS);
        self.textures.reader().environment(id, &lookup, &mut values[..wanted]);
    }
}
