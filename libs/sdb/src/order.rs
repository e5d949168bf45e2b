//! The order of records: along a curve through space, then by their bits. It depends on the records alone, not on the
//! threads or the order in which they were added.

use crate::Schema;
use std::cmp::Ordering;

/// A box around keys: positions, and normals if there are any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extent {
    pub(crate) lo: [f32; 6],
    pub(crate) hi: [f32; 6],
}

impl Extent {
    pub(crate) const EMPTY: Self = Self { lo: [f32::INFINITY; 6], hi: [f32::NEG_INFINITY; 6] };

    /// Extends the box to contain a key, or the position in it.
    pub(crate) fn add(&mut self, key: &[f32]) {
        for (i, &x) in key.iter().enumerate() {
            self.lo[i] = self.lo[i].min(x);
            self.hi[i] = self.hi[i].max(x);
        }
    }

    /// Extends the box to contain another box.
    pub(crate) fn merge(&mut self, other: &Self) {
        for i in 0..6 {
            self.lo[i] = self.lo[i].min(other.lo[i]);
            self.hi[i] = self.hi[i].max(other.hi[i]);
        }
    }
}

/// Returns the lowest 21 bits of `v`, each followed by two zero bits.
fn spread(v: u64) -> u64 {
    let v = v & 0x1f_ffff;
    let v = (v | v << 32) & 0x1f_0000_0000_ffff;
    let v = (v | v << 16) & 0x1f_0000_ff00_00ff;
    let v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    let v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// Returns the place of a position on the Morton curve through `extent`, a cube with 21 bits in each direction.
pub(crate) fn place(extent: &Extent, position: &[f32]) -> u64 {
    let side =
        (0..position.len()).map(|i| f64::from(extent.hi[i]) - f64::from(extent.lo[i])).fold(0.0, f64::max);
    let scale = if side > 0.0 { f64::from(0x1f_ffff_u32) / side } else { 0.0 };
    let cell =
        |i: usize| position.get(i).map_or(0, |&x| ((f64::from(x) - f64::from(extent.lo[i])) * scale) as u64);
    spread(cell(0)) | spread(cell(1)) << 1 | spread(cell(2)) << 2
}

/// Returns the order of two records at the same place.
pub(crate) fn by_bits(a: &[f32], b: &[f32]) -> Ordering {
    a.iter().map(|x| x.to_bits()).cmp(b.iter().map(|x| x.to_bits()))
}

/// Sorts records. Returns them with the place of each.
pub(crate) fn sort(schema: Schema, extent: &Extent, records: &[f32]) -> (Vec<f32>, Vec<u64>) {
    let (n, d) = (schema.numbers(), schema.key.dimensions());
    let mut order: Vec<(u64, u32)> =
        records.chunks_exact(n).enumerate().map(|(i, r)| (place(extent, &r[..d]), i as u32)).collect();
    let record = |i: u32| &records[i as usize * n..][..n];
    order.sort_unstable_by(|a, b| {
        // The indices are compared last. Equal records have no visible order.
        a.0.cmp(&b.0).then_with(|| by_bits(record(a.1), record(b.1))).then(a.1.cmp(&b.1))
    });
    let mut sorted = Vec::with_capacity(records.len());
    for &(_, i) in &order {
        sorted.extend_from_slice(record(i));
    }
    (sorted, order.into_iter().map(|(place, _)| place).collect())
}

/// Returns the numbers of positions along a curve through the box around them, so that neighbours in the list are near
/// each other.
pub fn along_curve(positions: &[[f32; 3]]) -> Vec<usize> {
    let mut extent = Extent::EMPTY;
    positions.iter().for_each(|p| extent.add(p));
    let mut order: Vec<(u64, usize)> =
        positions.iter().enumerate().map(|(i, p)| (place(&extent, p), i)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Key, Value};

    #[test]
    fn bits_are_interleaved() {
        let extent = Extent { lo: [0.0; 6], hi: [2_097_151.0; 6] };
        for (x, y, z) in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (5, 3, 2_097_151), (2_097_151, 2, 7)] {
            let code = place(&extent, &[x as f32, y as f32, z as f32]);
            let back = |shift: u32| (0..21).map(|b| (code >> (3 * b + shift) & 1) << b).sum::<u64>();
            assert_eq!((back(0), back(1), back(2)), (x, y, z));
        }
        assert_eq!(place(&Extent { lo: [3.0; 6], hi: [3.0; 6] }, &[3.0, 3.0]), 0);
    }

    #[test]
    fn the_order_depends_on_the_records_only() {
        let schema = Schema { key: Key::Surface, value: Value::Float };
        let records = [0.5, 0.5, 1.0, 0.1, 0.2, 2.0, 0.5, 0.5, -1.0, 0.1, 0.2, 2.0, 0.9, 0.0, 3.0];
        let mut extent = Extent::EMPTY;
        records.chunks(3).for_each(|r| extent.add(&r[..2]));
        let (sorted, places) = sort(schema, &extent, &records);
        let reversed: Vec<f32> = records.chunks(3).rev().flatten().copied().collect();
        assert_eq!(sort(schema, &extent, &reversed), (sorted, places.clone()));
        assert!(places.is_sorted());
    }
}
