//! Sums over boxes, which combine distant records.

use crate::Packed;
use crate::packed::FAN;

/// The combined records of one box.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cluster {
    /// The sum of their values.
    pub sum: [f32; 3],
    /// The mean of their positions, weighted by the size of their values.
    pub centre: [f32; 3],
    /// The square of the diagonal of their box.
    pub diagonal_squared: f32,
    /// The lowest corner of their box.
    lo: [f32; 3],
    /// The highest corner of their box.
    hi: [f32; 3],
}

impl Cluster {
    /// The lowest and the highest corner of their box.
    #[inline]
    pub fn corners(&self) -> ([f32; 3], [f32; 3]) {
        (self.lo, self.hi)
    }
}

/// Takes the records of a database for several points, the lanes, at once. Sets of lanes are bits of words.
pub trait Lanes {
    /// Returns the lanes that take the records of a cluster one by one. The others take it as one record at its centre.
    fn open(&self, cluster: &Cluster) -> u32;
    /// Takes a record, or a cluster as one, for `lanes`.
    fn take(&mut self, at: [f32; 3], value: [f32; 3], lanes: u32);
}

/// The clusters of a database with three-component values at points.
#[derive(Debug)]
pub struct Clusters {
    /// The clusters level by level, from the boxes around records to the one around all.
    levels: Vec<Vec<Cluster>>,
}

impl Clusters {
    /// Computes the clusters of all boxes of a database.
    pub fn new(records: &Packed) -> Self {
        let mut levels: Vec<Vec<Cluster>> = Vec::new();
        for level in 0..records.level_count() {
            let inner = level.checked_sub(1).map(|inner| &levels[inner]);
            let below = inner.map_or(records.len(), Vec::len);
            let clusters = (0..below.div_ceil(FAN)).map(|node| {
                let (lo, hi) = records.corners_of(level, node);
                let (mut sum, mut centre, mut weight) = ([0.0_f64; 3], [0.0_f64; 3], 0.0_f64);
                for child in node * FAN..((node + 1) * FAN).min(below) {
                    let (value, at) = match inner {
                        None => (records.value(child), records.position(child)),
                        Some(inner) => (inner[child].sum, inner[child].centre),
                    };
                    let size: f64 = value.iter().map(|v| f64::from(v.abs())).sum::<f64>() + 1e-30;
                    weight += size;
                    for c in 0..3 {
                        sum[c] += f64::from(value[c]);
                        centre[c] += size * f64::from(at[c]);
                    }
                }
                let side = |c: usize| hi[c] - lo[c];
                Cluster {
                    sum: sum.map(|s| s as f32),
                    centre: centre.map(|x| (x / weight) as f32),
                    diagonal_squared: side(0) * side(0) + side(1) * side(1) + side(2) * side(2),
                    lo,
                    hi,
                }
            });
            let clusters = clusters.collect();
            levels.push(clusters);
        }
        Self { levels }
    }

    /// Passes all records to `lanes` points. Each of them gets the same records in the same order as without the
    /// others.
    #[inline(always)]
    pub fn gather(&self, records: &Packed, lanes: u32, to: &mut impl Lanes) {
        let Some(top) = self.levels.len().checked_sub(1) else { return };
        // The next node is the last.
        let mut nodes = vec![(top, 0, lanes)];
        while let Some((level, node, lanes)) = nodes.pop() {
            let cluster = &self.levels[level][node];
            let open = lanes & to.open(cluster);
            if open != lanes {
                to.take(cluster.centre, cluster.sum, lanes & !open);
            }
            if open == 0 {
                continue;
            }
            let below = if level == 0 { records.len() } else { self.levels[level - 1].len() };
            let children = node * FAN..((node + 1) * FAN).min(below);
            if level == 0 {
                // An iterator's own loop would not be compiled for the vectors of the caller.
                for child in children {
                    to.take(records.position(child), records.value(child), open);
                }
            } else {
                nodes.extend(children.rev().map(|child| (level - 1, child, open)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Key, Schema, Value};
    use granita_base::hash;

    /// The sum of the second numbers of all values in lane 1, and how many there are.
    #[derive(Default)]
    struct Sum {
        open: f32,
        sum: f64,
        calls: u32,
    }

    impl Lanes for Sum {
        /// Other lanes open all clusters.
        fn open(&self, cluster: &Cluster) -> u32 {
            if cluster.diagonal_squared > self.open { !0 } else { !0b10 }
        }

        fn take(&mut self, at: [f32; 3], value: [f32; 3], lanes: u32) {
            assert!(at.iter().all(|x| (0.0..=1.0).contains(x)));
            if lanes & 0b10 != 0 {
                self.sum += f64::from(value[1]);
                self.calls += 1;
            }
        }
    }

    #[test]
    fn sums_of_clusters_contain_all_records() {
        let schema = Schema { key: Key::Oriented, value: Value::Color };
        for count in [0_u32, 1, 16, 17, 700] {
            let numbers: Vec<f32> = (0..count * 9).map(|i| hash::unit(hash::words(&[i, 3]))).collect();
            let packed = Packed::new(schema, &numbers);
            let clusters = Clusters::new(&packed);
            let due = numbers.chunks(9).map(|r| f64::from(r[7])).sum::<f64>();
            for open in [0.0, 0.01, 0.3, 4.0] {
                let mut alone = Sum { open, ..Sum::default() };
                clusters.gather(&packed, 0b10, &mut alone);
                let Sum { sum, calls, .. } = alone;
                assert!((sum - due).abs() <= 1e-5 * due, "{count} {open}: {sum} {due}");
                assert!(calls <= count && (open < 4.0 || calls <= 1));
                let mut beside = Sum { open, ..Sum::default() };
                clusters.gather(&packed, 0b1011, &mut beside);
                assert_eq!((beside.sum.to_bits(), beside.calls), (sum.to_bits(), calls), "{count} {open}");
            }
        }
    }
}
