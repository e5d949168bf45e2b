//! Indirect light and occlusion at few points, and their interpolation.
//!
//! A [`Record`] holds the light of the hemisphere over one point, and its derivatives over position and normal. It
//! is a function of its point and of the parameters of the query only. It does not depend on the grid, the thread
//! or earlier results. On a grid, records are placed by [`lattice::Lattice`], as few as the change permits. Grids
//! that share an edge share the records of that edge.

pub(crate) mod hemisphere;
pub(crate) mod lattice;

use crate::memo::{Changes, Dependencies};
use granita_base::{Color, NoiseSource, Vec3};
use granita_sdb::{Key, Schema, Value};
use parking_lot::{Mutex, MutexGuard};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// The kind of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The colours that rays return: `indirect ()`.
    Irradiance,
    /// Whether rays hit: `occlusion ()`.
    Occlusion,
}

impl Kind {
    /// Returns what the random numbers of the rays are counted as.
    pub(crate) fn noise(self) -> NoiseSource {
        match self {
            Self::Irradiance => NoiseSource::Indirect,
            Self::Occlusion => NoiseSource::Occlusion,
        }
    }

    /// Returns the number of values that are interpolated with their gradients.
    pub(crate) fn channels(self) -> usize {
        match self {
            Self::Irradiance => 3,
            Self::Occlusion => 1,
        }
    }

    /// Returns the schema of databases of such records.
    pub(crate) fn schema(self) -> Schema {
        let value = match self {
            Self::Irradiance => Value::Irradiance,
            Self::Occlusion => Value::Occlusion,
        };
        Schema { key: Key::Oriented, value }
    }
}

/// The light that arrives at a point. All vectors are in world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Record {
    /// The irradiance. For occlusion, the first value is the blocked share.
    pub(crate) value: [f32; 3],
    /// For occlusion, the mean direction of the rays that were not blocked, of length 1 or 0.
    pub(crate) open: Vec3,
    /// The translational gradient of each value, per world unit along the surface.
    pub(crate) translational: [Vec3; 3],
    /// The rotational gradient of each value, per radian that the normal turns this way.
    pub(crate) rotational: [Vec3; 3],
    /// The Hessian over position of the mean of the values: xx, yy, zz, xy, xz, yz.
    pub(crate) second: [f32; 6],
}

impl Record {
    /// Returns the mean of the values.
    pub(crate) fn mean(&self, kind: Kind) -> f32 {
        match kind {
            Kind::Irradiance => (self.value[0] + self.value[1] + self.value[2]) / 3.0,
            Kind::Occlusion => self.value[0],
        }
    }

    /// Returns the irradiance.
    pub(crate) fn color(&self) -> Color {
        Color::from_array(self.value)
    }

    /// Returns the record as the numbers of a database (see [`Value::numbers`]).
    pub(crate) fn to_numbers(&self, kind: Kind) -> Vec<f32> {
        let n = kind.channels();
        let mut out = Vec::with_capacity(kind.schema().value.numbers());
        out.extend_from_slice(&self.value[..n]);
        if kind == Kind::Occlusion {
            out.extend(self.open.to_array());
        }
        out.extend(self.translational[..n].iter().flat_map(|g| g.to_array()));
        out.extend(self.rotational[..n].iter().flat_map(|g| g.to_array()));
        out.extend(self.second);
        out
    }

    /// Reads a record from the numbers of a database.
    pub(crate) fn from_numbers(kind: Kind, numbers: &[f32]) -> Self {
        let (n, mut rest) = (kind.channels(), numbers.iter().copied());
        let mut record = Self::default();
        record.value[..n].iter_mut().zip(&mut rest).for_each(|(to, from)| *to = from);
        let mut next = || rest.next().unwrap_or(0.0);
        let mut vector = || Vec3::new(next(), next(), next());
        if kind == Kind::Occlusion {
            record.open = vector();
        }
        record.translational[..n].iter_mut().for_each(|g| *g = vector());
        record.rotational[..n].iter_mut().for_each(|g| *g = vector());
        let (a, b) = (vector(), vector());
        record.second = [a.x, a.y, a.z, b.x, b.y, b.z];
        record
    }

    /// Returns the second derivative of the mean along `d`, times its squared length.
    pub(crate) fn hessian(&self, d: Vec3) -> f32 {
        let [xx, yy, zz, xy, xz, yz] = self.second;
        xx * d.x * d.x
            + yy * d.y * d.y
            + zz * d.z * d.z
            + 2.0 * (xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z)
    }
}

/// The key of a record: the bits of its position and normal, then a hash of the parameters.
pub(crate) type Spot = [u32; 8];

/// The number of parts of the table, each with a lock of its own.
const PARTS: usize = 64;

/// Bytes of records that a frame keeps by default.
const CACHE_BYTES: usize = 1 << 29;

/// Bytes that a record takes in the table, about: the record, its counts, its key, and the free places of a hash map.
const RECORD_BYTES: usize = 2 * (size_of::<Record>() + size_of::<Spot>() + 32);

/// Records of a frame that more than one grid may ask for.
///
/// The first grid that asks computes a record. The record does not depend on which grid that is, so the cache may drop
/// records at any time: a dropped one is computed again, to the bit. At most about [`CACHE_BYTES`] are kept. When half
/// of that is full, the records that nothing asked for since the last time are dropped.
#[derive(Debug)]
pub(crate) struct IrradianceCache {
    parts: Vec<Mutex<Part>>,
    /// The number of records that each generation of a part may hold.
    limit: AtomicUsize,
    /// Records computed.
    pub(crate) records: AtomicU64,
    /// The number of rays traced for them.
    pub(crate) rays: AtomicU64,
    /// The number of points that took their value from records.
    pub(crate) points: AtomicU64,
}

/// A record, and what it depends on besides geometry.
type Kept = (Arc<Record>, Arc<Dependencies>);

/// One part of the table.
#[derive(Debug, Default)]
struct Part {
    /// Records computed or asked for since the last change of generations.
    young: HashMap<Spot, Kept>,
    /// Those of the generation before.
    old: HashMap<Spot, Kept>,
    /// The places of records that went to a database. They stay, so that each goes there once.
    saved: HashSet<Spot>,
}

impl Part {
    fn insert(&mut self, spot: Spot, record: Kept, limit: usize) {
        if self.young.len() >= limit {
            self.old = std::mem::take(&mut self.young);
        }
        self.young.insert(spot, record);
    }
}

impl Default for IrradianceCache {
    fn default() -> Self {
        let cache = Self {
            parts: (0..PARTS).map(|_| Mutex::default()).collect(),
            limit: AtomicUsize::new(0),
            records: AtomicU64::new(0),
            rays: AtomicU64::new(0),
            points: AtomicU64::new(0),
        };
        cache.set_limit(CACHE_BYTES);
        cache
    }
}

impl IrradianceCache {
    /// Keeps about so many bytes of records from now on.
    pub(crate) fn set_limit(&self, bytes: usize) {
        let records = bytes / RECORD_BYTES / PARTS / 2;
        self.limit.store(records.max(1), Ordering::Relaxed);
    }

    fn part(&self, spot: &Spot) -> MutexGuard<'_, Part> {
        let part = &self.parts[granita_base::hash::words(spot) as usize % PARTS];
        part.lock()
    }

    /// A record that was computed before and is still kept.
    pub(crate) fn find(&self, spot: &Spot) -> Option<(Arc<Record>, Arc<Dependencies>)> {
        let mut part = self.part(spot);
        if let Some(record) = part.young.get(spot) {
            return Some(record.clone());
        }
        let record = part.old.remove(spot)?;
        part.insert(*spot, record.clone(), self.limit.load(Ordering::Relaxed));
        Some(record)
    }

    /// Keeps a record that depends on `depends`. Where there is one already, it is the same.
    pub(crate) fn keep(&self, spot: Spot, record: &Arc<Record>, depends: &Arc<Dependencies>) {
        let kept = (record.clone(), depends.clone());
        self.part(&spot).insert(spot, kept, self.limit.load(Ordering::Relaxed));
    }

    /// Drops the records that depend on something that changed. Returns their number.
    pub(crate) fn forget(&self, changes: &Changes) -> usize {
        let mut dropped = 0;
        for part in &self.parts {
            let Part { young, old, .. } = &mut *part.lock();
            for records in [young, old] {
                let before = records.len();
                records.retain(|_, (_, depends)| !changes.touch(depends));
                dropped += before - records.len();
            }
        }
        dropped
    }

    /// Drops all records. The places of those that went to a database stay.
    pub(crate) fn clear(&self) {
        for part in &self.parts {
            let Part { young, old, .. } = &mut *part.lock();
            (*young, *old) = (HashMap::default(), HashMap::default());
        }
    }

    /// True for the first call for a place: its record is to be saved now.
    pub(crate) fn is_first_to_save(&self, spot: Spot) -> bool {
        self.part(&spot).saved.insert(spot)
    }

    /// Adds to the counts of records and rays.
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
    fn irradiance_records_survive_encoding() {
        let v = |k: f32| Vec3::new(k, k + 0.25, -k);
        for kind in [Kind::Irradiance, Kind::Occlusion] {
            let n = kind.channels();
            let mut record = Record { second: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], ..Record::default() };
            for c in 0..n {
                record.value[c] = 0.1 * c as f32 + 0.3;
                record.translational[c] = v(c as f32);
                record.rotational[c] = v(10.0 + c as f32);
            }
            if kind == Kind::Occlusion {
                record.open = Vec3::Y;
            }
            let numbers = record.to_numbers(kind);
            assert_eq!(numbers.len(), kind.schema().value.numbers());
            assert_eq!(Record::from_numbers(kind, &numbers), record);
        }
    }

    #[test]
    fn the_irradiance_cache_keeps_used_records_within_its_limit() {
        let cache = IrradianceCache::default();
        cache.set_limit(RECORD_BYTES * PARTS * 2 * 10);
        let spot = |k: u32| [k, 0, 0, 0, 0, 0, 0, 0];
        let record = |k: u32| Arc::new(Record { value: [k as f32; 3], ..Record::default() });
        for k in 0..20_000 {
            cache.keep(spot(k), &record(k), &Arc::default());
            // The first one is asked for all the time.
            assert_eq!(cache.find(&spot(0)).map(|r| r.0.value[0]), Some(0.0), "{k}");
        }
        let held = (0..20_000).filter(|k| cache.find(&spot(*k)).is_some()).count();
        assert!((PARTS * 5..=PARTS * 20).contains(&held), "{held}");
        let counts = cache.parts.iter().map(|part| part.lock());
        assert!(counts.into_iter().all(|part| part.young.len() <= 10 && part.old.len() <= 10));
        assert!(cache.is_first_to_save(spot(1)) && !cache.is_first_to_save(spot(1)));
    }
}
