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
    /// Returns the square of the distance of a position from the box; 0 inside.
    pub fn distance_squared(&self, p: [f32; 3]) -> f32 {
        (0..3).map(|c| (self.lo[c] - p[c]).max(p[c] - self.hi[c]).max(0.0)).map(|x| x * x).sum()
    }
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

    /// Passes all records to `each`, as position and value. Records are passed one by one when `opens` is true for
    /// their cluster, and otherwise combined at the centre. The order is always the same.
    pub fn gather(
        &self,
        records: &Packed,
        opens: &dyn Fn(&Cluster) -> bool,
        each: &mut dyn FnMut([f32; 3], [f32; 3]),
    ) {
        if let Some(top) = self.levels.len().checked_sub(1) {
            self.visit(records, top, 0, opens, each);
        }
    }

    fn visit(
        &self,
        records: &Packed,
        level: usize,
        node: usize,
        opens: &dyn Fn(&Cluster) -> bool,
        each: &mut dyn FnMut([f32; 3], [f32; 3]),
    ) {
        let cluster = &self.levels[level][node];
        if !opens(cluster) {
            return each(cluster.centre, cluster.sum);
        }
        let below = if level == 0 { records.len() } else { self.levels[level - 1].len() };
        for child in node * FAN..((node + 1) * FAN).min(below) {
            match level {
                0 => each(records.position(child), records.value(child)),
                _ => self.visit(records, level - 1, child, opens, each),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Key, Schema, Value};
    use granita_base::hash;

    #[test]
    fn sums_of_clusters_contain_all_records() {
        let schema = Schema { key: Key::Oriented, value: Value::Color };
        for count in [0_u32, 1, 16, 17, 700] {
            let numbers: Vec<f32> = (0..count * 9).map(|i| hash::unit(hash::words(&[i, 3]))).collect();
            let packed = Packed::new(schema, &numbers);
            let clusters = Clusters::new(&packed);
            let due = numbers.chunks(9).map(|r| f64::from(r[7])).sum::<f64>();
            for open in [0.0, 0.01, 0.3, 4.0] {
                let (mut sum, mut calls) = (0.0_f64, 0);
                clusters.gather(&packed, &|c| c.diagonal_squared > open, &mut |at, value| {
                    assert!(at.iter().all(|x| (0.0..=1.0).contains(x)));
                    sum += f64::from(value[1]);
                    calls += 1;
                });
                assert!((sum - due).abs() <= 1e-5 * due, "{count} {open}: {sum} {due}");
                assert!(calls <= count && (open < 4.0 || calls <= 1));
            }
        }
    }
}
