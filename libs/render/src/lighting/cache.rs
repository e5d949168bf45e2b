//! Indirect light and occlusion at few points, and between them.
//!
//! A [`Record`] is what the hemisphere over one point sends, and how that changes with the place and the normal. It is a
//! function of its point and of what was asked, and of nothing else: neither the grid, nor the thread, nor what
//! was computed before show. On a grid, records are placed by [`lattice::Lattice`], as few as the change allows; grids
//! that meet have the records of their common side in common.

pub(crate) mod hemisphere;
pub(crate) mod lattice;

use granita_base::{Color, Vec3};
use granita_sdb::{Key, Schema, Value};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// What is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Colours that rays bring back: `indirect ()`.
    Irradiance,
    /// Whether rays hit: `occlusion ()`.
    Occlusion,
}

impl Kind {
    /// Numbers that are interpolated with their gradients.
    pub(crate) fn channels(self) -> usize {
        match self {
            Self::Irradiance => 3,
            Self::Occlusion => 1,
        }
    }

    /// What databases of such records hold.
    pub(crate) fn schema(self) -> Schema {
        let value = match self {
            Self::Irradiance => Value::Irradiance,
            Self::Occlusion => Value::Occlusion,
        };
        Schema { key: Key::Oriented, value }
    }
}

/// What arrives at a point. All in world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Record {
    /// Irradiance; of occlusion the blocked share, in the first place.
    pub(crate) value: [f32; 3],
    /// Occlusion: mean direction of the rays that were not blocked, of length 1 or 0.
    pub(crate) open: Vec3,
    /// Change of each value per unit of distance along the surface.
    pub(crate) by_place: [Vec3; 3],
    /// Change of each value per radian that the normal turns this way.
    pub(crate) by_normal: [Vec3; 3],
    /// Second derivatives over places of the mean of the values: xx, yy, zz, xy, xz, yz.
    pub(crate) second: [f32; 6],
}

impl Record {
    /// The mean of the values.
    pub(crate) fn mean(&self, kind: Kind) -> f32 {
        match kind {
            Kind::Irradiance => (self.value[0] + self.value[1] + self.value[2]) / 3.0,
            Kind::Occlusion => self.value[0],
        }
    }

    /// The irradiance.
    pub(crate) fn color(&self) -> Color {
        Color::from_array(self.value)
    }

    /// As the numbers of a database (see [`Value::numbers`]).
    pub(crate) fn to_numbers(&self, kind: Kind) -> Vec<f32> {
        let n = kind.channels();
        let mut out = Vec::with_capacity(kind.schema().value.numbers());
        out.extend_from_slice(&self.value[..n]);
        if kind == Kind::Occlusion {
            out.extend(self.open.to_array());
        }
        out.extend(self.by_place[..n].iter().flat_map(|g| g.to_array()));
        out.extend(self.by_normal[..n].iter().flat_map(|g| g.to_array()));
        out.extend(self.second);
        out
    }

    /// From the numbers of a database.
    pub(crate) fn from_numbers(kind: Kind, numbers: &[f32]) -> Self {
        let (n, mut rest) = (kind.channels(), numbers.iter().copied());
        let mut record = Self::default();
        record.value[..n].iter_mut().zip(&mut rest).for_each(|(to, from)| *to = from);
        let mut next = || rest.next().unwrap_or(0.0);
        let mut vector = || Vec3::new(next(), next(), next());
        if kind == Kind::Occlusion {
            record.open = vector();
        }
        record.by_place[..n].iter_mut().for_each(|g| *g = vector());
        record.by_normal[..n].iter_mut().for_each(|g| *g = vector());
        let (a, b) = (vector(), vector());
        record.second = [a.x, a.y, a.z, b.x, b.y, b.z];
        record
    }

    /// Second derivative of the mean along `d`, times its squared length.
    pub(crate) fn bend(&self, d: Vec3) -> f32 {
        let [xx, yy, zz, xy, xz, yz] = self.second;
        xx * d.x * d.x
            + yy * d.y * d.y
            + zz * d.z * d.z
            + 2.0 * (xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z)
    }
}

/// Where a record lies, and what was asked there: bits of the place and the normal, then a hash of the question.
pub(crate) type Spot = [u32; 8];

/// Parts of the table that can be locked apart.
const PARTS: usize = 64;

/// Records of a frame that more than one grid may ask for.
///
/// Whoever comes first computes; what is computed does not depend on who that is.
#[derive(Debug)]
pub(crate) struct LightCache {
    parts: Vec<Mutex<HashMap<Spot, Arc<Record>>>>,
    /// Records computed.
    pub(crate) records: AtomicU64,
    /// Rays traced for them.
    pub(crate) rays: AtomicU64,
    /// Points that took their value from records.
    pub(crate) points: AtomicU64,
}

impl Default for LightCache {
    fn default() -> Self {
        Self {
            parts: (0..PARTS).map(|_| Mutex::default()).collect(),
            records: AtomicU64::new(0),
            rays: AtomicU64::new(0),
            points: AtomicU64::new(0),
        }
    }
}

impl LightCache {
    fn part(&self, spot: &Spot) -> &Mutex<HashMap<Spot, Arc<Record>>> {
        &self.parts[granita_base::hash::words(spot) as usize % PARTS]
    }

    /// A record that was computed before.
    pub(crate) fn find(&self, spot: &Spot) -> Option<Arc<Record>> {
        self.part(spot).lock().unwrap_or_else(PoisonError::into_inner).get(spot).cloned()
    }

    /// Keeps a record; `false` when there is one already, which is the same.
    pub(crate) fn keep(&self, spot: Spot, record: &Arc<Record>) -> bool {
        let mut part = self.part(&spot).lock().unwrap_or_else(PoisonError::into_inner);
        let mut new = false;
        part.entry(spot).or_insert_with(|| {
            new = true;
            record.clone()
        });
        new
    }

    /// Counts work.
    pub(crate) fn count(&self, records: usize, rays: usize) {
        self.records.fetch_add(records as u64, Ordering::Relaxed);
        self.rays.fetch_add(rays as u64, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod scenes;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_from_their_numbers() {
        let v = |k: f32| Vec3::new(k, k + 0.25, -k);
        for kind in [Kind::Irradiance, Kind::Occlusion] {
            let n = kind.channels();
            let mut record = Record { second: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], ..Record::default() };
            for c in 0..n {
                record.value[c] = 0.1 * c as f32 + 0.3;
                record.by_place[c] = v(c as f32);
                record.by_normal[c] = v(10.0 + c as f32);
            }
            if kind == Kind::Occlusion {
                record.open = Vec3::Y;
            }
            let numbers = record.to_numbers(kind);
            assert_eq!(numbers.len(), kind.schema().value.numbers());
            assert_eq!(Record::from_numbers(kind, &numbers), record);
        }
    }
}
