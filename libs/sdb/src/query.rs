//! Queries at a place: values between records, and the density of records.

use crate::packed::{FAN, Found, Nearness};
use crate::{Key, Packed};
use std::cmp::Ordering;
use std::f32::consts::PI;

/// The place of a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// The position. For (s, t) the first two numbers are used.
    pub p: [f32; 3],
    /// The unit normal. It is used for records that have one.
    pub n: Option<[f32; 3]>,
}

/// The parameters for values from records near a place (`spatialdbquery` with filter "value").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Between {
    /// The number of records that are needed, at least 1.
    pub minsamples: usize,
    /// The largest distance of a record.
    pub maxdist: f32,
    /// The largest error of a record. At 0.25 records as far as `maxdist` are accepted, or those with normals 20
    /// degrees apart; see [`Packed::between`].
    pub maxerror: f32,
    /// True when the nearest records are always accepted (mode "ro").
    pub always: bool,
}

/// The parameters for the density of records (`spatialdbquery` with filter "areadensity").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Density {
    /// The number of records that are needed, at least 1.
    pub minsamples: usize,
    /// The largest distance of a record.
    pub maxdist: f32,
    /// The standard error of the number of records, relative to it.
    pub maxerror: f32,
}

/// The largest number of records that one query uses.
const MOST: usize = 1 << 16;

/// The weight with which the squared distance along the normal is added to the squared distance, for densities. With
/// 3 distances along the normal count twice. Photons of a wall near a corner, or on the other side of a sheet, belong
/// to other surfaces.
const FLATTEN: f32 = 3.0;

/// A record and its measure, which is not below its distance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Near {
    far: f32,
    index: usize,
}

impl Eq for Near {}

impl Ord for Near {
    fn cmp(&self, other: &Self) -> Ordering {
        self.far.total_cmp(&other.far).then(self.index.cmp(&other.index))
    }
}

impl PartialOrd for Near {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The smallest number of records that are collected before the worst are dropped.
const SPARE: usize = 32;

/// The best records of a search so far, and some more. The additional records are dropped together when there are
/// many, which costs less than keeping the best in order.
struct Best<M> {
    count: usize,
    /// The number of floats of a record.
    stride: usize,
    kept: Vec<Near>,
    most: f32,
    measure: M,
}

impl<M: Fn(&[f32]) -> f32> Best<M> {
    /// Drops all records except the best.
    fn thin(&mut self) {
        if self.kept.len() > self.count {
            self.kept.select_nth_unstable(self.count - 1);
            self.kept.truncate(self.count);
        }
        if self.kept.len() == self.count {
            self.most = self.kept.iter().fold(0.0, |most, near| near.far.max(most));
        }
    }
}

impl<M: Fn(&[f32]) -> f32> Found for Best<M> {
    fn records(&mut self, first: usize, records: &[f32]) {
        let before = self.kept.len();
        for (k, record) in records.chunks_exact(self.stride).enumerate() {
            let far = (self.measure)(record);
            if far <= self.most {
                self.kept.push(Near { far, index: first + k });
            }
        }
        let spare = self.count.max(SPARE);
        let is_first = before < self.count && self.kept.len() >= self.count;
        if is_first || self.kept.len() >= self.count + spare {
            self.thin();
        }
    }

    fn most(&self) -> f32 {
        self.most
    }
}

fn dot(a: [f32; 3], b: &[f32]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Packed {
    /// Returns the `count` (1 or more) records of smallest `measure`, at most `most`, nearest first, and in the order
    /// of the database for equal measures. `measure` receives the square of the distance, the vector to the record,
    /// and the record. Its result is not below the value of `least` for the record's box (see [`Nearness`]), or NaN
    /// for records that do not count.
    fn nearest(
        &self,
        probe: &Probe,
        count: usize,
        most: f32,
        least: impl Fn(f32, f32) -> f32,
        measure: impl Fn(f32, [f32; 3], &[f32]) -> f32,
    ) -> Vec<Near> {
        let d = self.schema().key.dimensions();
        let at = probe.p;
        let mut best = Best {
            count,
            stride: self.schema().numbers(),
            kept: Vec::with_capacity(count.min(64) + count.clamp(SPARE, 64) + FAN),
            most,
            measure: |record: &[f32]| {
                let mut to = [0.0; 3];
                for c in 0..d {
                    to[c] = record[c] - at[c];
                }
                measure(dot(to, &to), to, record)
            },
        };
        self.search(&Nearness { at, normal: probe.n, least }, &mut best);
        best.thin();
        let mut kept = best.kept;
        kept.sort_unstable();
        kept
    }

    /// Returns the value at a place, from the `minsamples` records with the smallest errors there; `None` when there
    /// are fewer, or when the place is not finite.
    ///
    /// A record's error is `distance / (4 maxdist)`, plus `sqrt (1 - cos (angle))` for normals. It may be at most
    /// `maxerror`. Weights fall to 0 at the error of the next best record, so that values change smoothly when the
    /// set of used records changes (compare Ward, Rubinstein and Clear, A Ray Tracing Solution for Diffuse
    /// Interreflection, SIGGRAPH 1988, for the error).
    pub fn between(&self, probe: &Probe, how: &Between) -> Option<[f32; 3]> {
        let shares = self.shares(probe, how)?;
        let mut sum = [0.0_f32; 3];
        let mut total = 0.0_f32;
        for (index, w) in shares {
            total += w;
            for (s, v) in sum.iter_mut().zip(self.value(index)) {
                *s += w * v;
            }
        }
        Some(sum.map(|s| s / total))
    }

    /// Does the same as [`Packed::between`] for all numbers of the values.
    pub fn all_between(&self, probe: &Probe, how: &Between) -> Option<Vec<f32>> {
        let shares = self.shares(probe, how)?;
        let mut sum = vec![0.0_f32; self.schema().value.numbers()];
        let mut total = 0.0_f32;
        for (index, w) in shares {
            total += w;
            for (s, v) in sum.iter_mut().zip(self.all_of(index)) {
                *s += w * v;
            }
        }
        sum.iter_mut().for_each(|s| *s /= total);
        Some(sum)
    }

    /// Returns the first record that is exactly at this place, including its normal; `None` when there is none.
    pub fn exactly(&self, probe: &Probe) -> Option<&[f32]> {
        if !probe.p.iter().chain(probe.n.iter().flatten()).all(|x| x.is_finite()) {
            return None;
        }
        let least = |squared: f32, _: f32| squared;
        let d = self.schema().key.dimensions();
        let found = self.nearest(probe, 1, 0.0, least, |_, _, record| {
            let same = record[..d] == probe.p[..d] && probe.n.is_none_or(|n| record[d..].starts_with(&n));
            if same { 0.0 } else { f32::NAN }
        });
        found.first().map(|near| self.all_of(near.index))
    }

    /// Returns the records and their weights.
    fn shares(&self, probe: &Probe, how: &Between) -> Option<Vec<(usize, f32)>> {
        if !probe.p.iter().all(|x| x.is_finite()) {
            return None;
        }
        let wanted = how.minsamples.clamp(1, MOST);
        let scale = 4.0 * how.maxdist.max(f32::MIN_POSITIVE);
        let most = if how.always { f32::MAX } else { how.maxerror * scale };
        let turned = |cosine: f32| (1.0 - cosine).max(0.0).sqrt();
        // The value is slightly less than the bound, because normals are not exactly of unit length.
        let least = |squared: f32, cosine: f32| squared.sqrt() + scale * (turned(cosine) - 1e-3).max(0.0);
        let best = self.nearest(probe, wanted + 1, most, least, |squared, _, record| {
            let distance = squared.sqrt();
            let cosine = match (self.schema().key, probe.n) {
                (Key::Oriented, Some(n)) => dot(n, &record[3..6]),
                _ => 1.0,
            };
            if how.always || distance <= how.maxdist { distance + scale * turned(cosine) } else { f32::NAN }
        });
        if best.len() < wanted && (!how.always || best.is_empty()) {
            return None;
        }
        let reach =
            if best.len() > wanted { best[wanted].far } else { most.min(2.0 * best[best.len() - 1].far) };
        let weight = |near: &Near| {
            let x = if reach > 0.0 { near.far / reach } else { 1.0 };
            (1.0 - x * x).max(0.0)
        };
        let used = &best[..best.len().min(wanted)];
        // Records as far away as the next best one have no weight. When all of them are, they have equal weights.
        let equal = used.iter().all(|near| weight(near) <= 0.0);
        Some(used.iter().map(|near| (near.index, if equal { 1.0 } else { weight(near) })).collect())
    }

    /// Returns the sum of values per area around a place; `None` when fewer than `minsamples` records are near.
    ///
    /// The number of records balances bias and variance. `max (minsamples, 1 / maxerror^2)` records are used, because
    /// the relative standard error of a count of N is 1 / sqrt (N). The radius of their circle is the distance of the
    /// next record, and at most `maxdist` (the bias). Within the circle the weights are 2 (1 - (d / r)^2)
    /// (Epanechnikov's kernel). Given the next record, the records inside are uniformly distributed, so that the
    /// estimate has no bias where the density is uniform. Records with normals count when these are less than 60
    /// degrees from the probe's. Distances along the normal count twice.
    pub fn density(&self, probe: &Probe, how: &Density) -> Option<[f32; 3]> {
        if !probe.p.iter().all(|x| x.is_finite()) || how.maxdist.is_nan() || how.maxdist <= 0.0 {
            return None;
        }
        let wanted = how.minsamples.max((1.0 / (how.maxerror * how.maxerror)).ceil() as usize).clamp(1, MOST);
        let normal = probe.n.filter(|_| self.schema().key == Key::Oriented);
        let least = |squared: f32, cosine: f32| if cosine < 0.499 { f32::INFINITY } else { squared.sqrt() };
        let best = self.nearest(probe, wanted + 1, how.maxdist, least, |squared, to, record| match normal {
            Some(n) if dot(n, &record[3..6]) < 0.5 => f32::NAN,
            _ => {
                let along = probe.n.map_or(0.0, |n| dot(n, &to));
                (squared + FLATTEN * along * along).sqrt()
            }
        });
        let (used, reach) = match best.split_last() {
            Some((next, used)) if best.len() > wanted => (used, next.far),
            _ => (&best[..], how.maxdist),
        };
        if used.len() < how.minsamples.max(1) || reach <= 0.0 {
            return None;
        }
        let mut sum = [0.0_f32; 3];
        for near in used {
            let x = near.far / reach;
            let w = 2.0 * (1.0 - x * x);
            for (s, v) in sum.iter_mut().zip(self.value(near.index)) {
                *s += w * v;
            }
        }
        let share = 1.0 / (PI * reach * reach);
        Some(sum.map(|s| s * share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Schema, Value};
    use granita_base::hash;

    fn unit(i: u32, k: u32) -> f32 {
        hash::unit(hash::words(&[i, k]))
    }

    const PHOTONS: Schema = Schema { key: Key::Oriented, value: Value::Color };

    /// Returns records on the plane z = 0, in the unit square, of value (1, 2, 3).
    fn plane(count: u32) -> Packed {
        let record = |i| [unit(i, 0), unit(i, 1), 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 3.0];
        Packed::new(PHOTONS, &(0..count).flat_map(record).collect::<Vec<f32>>())
    }

    #[test]
    fn the_nearest_records_equal_brute_force() {
        let schema = Schema { key: Key::Point, value: Value::Float };
        for count in [1_u32, 2, 15, 16, 17, 255, 257, 3000] {
            let records: Vec<f32> =
                (0..count).flat_map(|i| [unit(i, 0), unit(i, 1), unit(i, 2) * 0.01, i as f32]).collect();
            let packed = Packed::new(schema, &records);
            for q in 0..50 {
                let at = [unit(q, 5) * 2.0 - 0.5, unit(q, 6), unit(q, 7) * 0.02];
                let wanted = 1 + q as usize % 9;
                let probe = Probe { p: at, n: None };
                let got = packed.nearest(
                    &probe,
                    wanted,
                    0.4,
                    |squared, _| squared.sqrt(),
                    |squared, _, _| squared.sqrt(),
                );
                let mut all: Vec<Near> = (0..packed.len())
                    .map(|index| {
                        let r = packed.record(index);
                        let to = [r[0] - at[0], r[1] - at[1], r[2] - at[2]];
                        Near { far: dot(to, &to).sqrt(), index }
                    })
                    .filter(|n| n.far <= 0.4)
                    .collect();
                all.sort();
                all.truncate(wanted);
                assert_eq!(got, all, "{count} records, query {q}");
            }
        }
    }

    #[test]
    fn a_uniform_density_is_estimated() {
        let packed = plane(100_000);
        let (mut sum, mut n) = (0.0_f64, 0);
        for q in 0..400 {
            let p = [0.2 + 0.6 * unit(q, 8), 0.2 + 0.6 * unit(q, 9), 0.0];
            let how = Density { minsamples: 10, maxdist: 0.1, maxerror: 0.1 };
            let found = packed.density(&Probe { p, n: Some([0.0, 0.0, 1.0]) }, &how).unwrap();
            assert!((found[0] / 1e5 - 1.0).abs() < 0.5, "{found:?}");
            assert!((found[1] / found[0] - 2.0).abs() < 1e-4 && (found[2] / found[0] - 3.0).abs() < 1e-4);
            sum += f64::from(found[0]);
            n += 1;
        }
        let mean = sum / f64::from(n) / 1e5;
        assert!((mean - 1.0).abs() < 0.01, "{mean}");
    }

    #[test]
    fn density_counts_records_of_its_side_within_the_distance() {
        let packed = plane(1000);
        let how = Density { minsamples: 5, maxdist: 0.2, maxerror: 0.25 };
        let at = |p, n| packed.density(&Probe { p, n: Some(n) }, &how);
        assert!(at([0.5, 0.5, 0.0], [0.0, 0.0, 1.0]).is_some());
        assert!(at([0.5, 0.5, 0.0], [0.0, 0.0, -1.0]).is_none(), "the other side");
        assert!(at([0.5, 0.5, 0.11], [0.0, 0.0, 1.0]).is_none(), "along the normal ways count twice");
        assert!(at([2.0, 0.5, 0.0], [0.0, 0.0, 1.0]).is_none(), "too far");
        assert!(at([f32::NAN, 0.5, 0.0], [0.0, 0.0, 1.0]).is_none());
    }

    #[test]
    fn values_come_from_the_nearest_records() {
        let packed = plane(500);
        let how = Between { minsamples: 3, maxdist: 0.2, maxerror: 0.25, always: false };
        let p = [0.4, 0.6, 0.0];
        let found = packed.between(&Probe { p, n: Some([0.0, 0.0, 1.0]) }, &how).unwrap();
        assert!((found[0] - 1.0).abs() < 1e-6 && (found[2] - 3.0).abs() < 1e-5);
        // Records that are turned away or distant are used only when they must be.
        for probe in [Probe { p, n: Some([1.0, 0.0, 0.0]) }, Probe { p: [9.0; 3], n: None }] {
            assert_eq!(packed.between(&probe, &how), None);
            assert!(packed.between(&probe, &Between { always: true, ..how }).is_some());
        }
        let empty = Packed::new(PHOTONS, &[]);
        let probe = Probe { p, n: None };
        assert_eq!(empty.between(&probe, &Between { always: true, ..how }), None);
        // As many records are used as requested, and at most as many as there are.
        let few = Packed::new(PHOTONS, packed.record(0));
        assert_eq!(few.between(&Probe { p: [unit(0, 0); 3], n: None }, &how), None);
    }

    #[test]
    fn interpolated_values_are_continuous() {
        let schema = Schema { key: Key::Surface, value: Value::Float };
        let records: Vec<f32> = (0..400).flat_map(|i| [unit(i, 0), unit(i, 1), unit(i, 0)]).collect();
        let packed = Packed::new(schema, &records);
        let how = Between { minsamples: 4, maxdist: 0.3, maxerror: 0.25, always: false };
        let at = |x: f32| packed.between(&Probe { p: [x, 0.5, 0.0], n: None }, &how).unwrap()[0];
        let (mut before, mut jump) = (at(0.1), 0.0_f32);
        for i in 1..=4000 {
            let x = 0.1 + 0.8 * i as f32 / 4000.0;
            let now = at(x);
            assert!((now - x).abs() < 0.05, "{x}: {now}");
            jump = jump.max((now - before).abs());
            before = now;
        }
        assert!(jump < 0.01, "{jump}");
    }

    #[test]
    fn at_a_record_the_result_is_its_value() {
        let schema = Schema { key: Key::Surface, value: Value::Float };
        let packed = Packed::new(schema, &[0.5, 0.5, 7.0, 0.6, 0.5, 9.0]);
        let how = Between { minsamples: 1, maxdist: 0.3, maxerror: 0.25, always: false };
        assert_eq!(packed.between(&Probe { p: [0.5, 0.5, 0.0], n: None }, &how), Some([7.0, 0.0, 0.0]));
        // Half way between them both are used.
        let two = Between { minsamples: 2, ..how };
        let middle = packed.between(&Probe { p: [0.55, 0.5, 0.0], n: None }, &two).unwrap()[0];
        assert!((middle - 8.0).abs() < 1e-3, "{middle}");
    }
}
