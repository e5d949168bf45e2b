//! Records in their order, with boxes around them for searching.
//!
//! Sixteen neighbours along the curve share a box, sixteen boxes share another, and so on to one box around all. This
//! is a packed tree without pointers (compare Kamel and Faloutsos, On Packing R-trees, CIKM 1993). Memory and files
//! hold the same numbers in the same order.

use crate::order::{Extent, sort};
use crate::{Key, Schema};
use granita_machine::memory::Map;

/// The number of records, or boxes, under one box.
pub(crate) const FAN: usize = 16;

/// A set of records that can be searched.
#[derive(Debug)]
pub struct Packed {
    schema: Schema,
    count: usize,
    /// The boxes of each level, from the boxes around records to the one around all.
    levels: Vec<Level>,
    numbers: Numbers,
}

#[derive(Debug)]
enum Numbers {
    Memory(Vec<f32>),
    File(Map),
}

/// The boxes of one level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Level {
    /// The index of the first number.
    pub(crate) from: usize,
    /// The number of boxes.
    pub(crate) count: usize,
}

/// Returns the levels of boxes over so many records, and the number of all floats; `None` when that overflows.
pub(crate) fn layout(schema: Schema, count: usize) -> Option<(Vec<Level>, usize)> {
    let wide = 2 * schema.key.numbers();
    let mut from = count.checked_mul(schema.numbers())?;
    let (mut levels, mut n) = (Vec::new(), count);
    while n > 1 || levels.is_empty() && n > 0 {
        n = n.div_ceil(FAN);
        levels.push(Level { from, count: n });
        from = from.checked_add(n.checked_mul(wide)?)?;
    }
    Some((levels, from))
}

/// Collects boxes while records are added in their order.
pub(crate) struct Boxes {
    schema: Schema,
    open: Extent,
    held: usize,
    first: Vec<Extent>,
}

impl Boxes {
    pub(crate) fn new(schema: Schema) -> Self {
        Self { schema, open: Extent::EMPTY, held: 0, first: Vec::new() }
    }

    /// Adds the next record.
    pub(crate) fn add(&mut self, record: &[f32]) {
        self.open.add(&record[..self.schema.key.numbers()]);
        self.held += 1;
        if self.held == FAN {
            self.close();
        }
    }

    fn close(&mut self) {
        self.first.push(std::mem::replace(&mut self.open, Extent::EMPTY));
        self.held = 0;
    }

    /// Returns all boxes, level by level: the lowest corner, then the highest.
    pub(crate) fn finish(mut self) -> Vec<f32> {
        if self.held > 0 {
            self.close();
        }
        let d = self.schema.key.numbers();
        let (mut out, mut level) = (Vec::new(), self.first);
        loop {
            for b in &level {
                out.extend_from_slice(&b.lo[..d]);
                out.extend_from_slice(&b.hi[..d]);
            }
            if level.len() <= 1 {
                return out;
            }
            let merged = |boxes: &[Extent]| {
                let mut all = Extent::EMPTY;
                boxes.iter().for_each(|b| all.merge(b));
                all
            };
            level = level.chunks(FAN).map(merged).collect();
        }
    }
}

impl Packed {
    /// Builds the set of records in any order. Each has the numbers of the key, then of the value, all finite.
    pub fn new(schema: Schema, records: &[f32]) -> Self {
        let n = schema.numbers();
        let mut extent = Extent::EMPTY;
        records.chunks_exact(n).for_each(|r| extent.add(&r[..schema.key.dimensions()]));
        let (mut numbers, _) = sort(schema, &extent, records);
        let mut boxes = Boxes::new(schema);
        numbers.chunks_exact(n).for_each(|r| boxes.add(r));
        let count = numbers.len() / n;
        if count > 0 {
            numbers.extend(boxes.finish());
        }
        let (levels, all) = layout(schema, count).expect("invariant: what is in memory can be counted");
        debug_assert_eq!(all, numbers.len(), "records and boxes");
        Self { schema, count, levels, numbers: Numbers::Memory(numbers) }
    }

    /// Returns the set of a file whose header was read. `map` holds all numbers of `layout`.
    pub(crate) fn mapped(schema: Schema, count: usize, levels: Vec<Level>, map: Map) -> Self {
        Self { schema, count, levels, numbers: Numbers::File(map) }
    }

    /// Returns the schema of the records.
    pub fn schema(&self) -> Schema {
        self.schema
    }

    /// The number of records.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True when there are no records.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn numbers(&self) -> &[f32] {
        match &self.numbers {
            Numbers::Memory(v) => v,
            Numbers::File(map) => map.numbers(),
        }
    }

    /// Returns record `i`, in the order of the database: the key, then the value.
    #[inline]
    pub fn record(&self, i: usize) -> &[f32] {
        let n = self.schema.numbers();
        &self.numbers()[i * n..][..n]
    }

    /// Returns the position of a record. For (s, t) the third number is 0.
    #[inline]
    pub fn position(&self, i: usize) -> [f32; 3] {
        let d = self.schema.key.dimensions();
        let mut out = [0.0; 3];
        out[..d].copy_from_slice(&self.record(i)[..d]);
        out
    }

    /// Returns the value of a record, with as many numbers as [`Value::components`](crate::Value::components). A
    /// single number is the first.
    #[inline]
    pub fn value(&self, i: usize) -> [f32; 3] {
        let n = self.schema.value.components();
        let mut out = [0.0; 3];
        out[..n].copy_from_slice(&self.all_of(i)[..n]);
        out
    }

    /// Returns all numbers of a record's value.
    #[inline]
    pub fn all_of(&self, i: usize) -> &[f32] {
        &self.record(i)[self.schema.key.numbers()..]
    }

    /// The number of levels of boxes.
    pub(crate) fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// Returns the corners of box `i` of a level.
    pub(crate) fn corners_of(&self, level: usize, i: usize) -> ([f32; 3], [f32; 3]) {
        self.corners(self.numbers(), &self.levels[level], i)
    }

    /// Returns all records, one after another.
    pub fn records(&self) -> &[f32] {
        &self.numbers()[..self.count * self.schema.numbers()]
    }

    /// Returns the box around all records: the lowest and highest corner, of which `key.dimensions ()` numbers are
    /// used. `None` when there are no records.
    pub fn bound(&self) -> Option<([f32; 3], [f32; 3])> {
        let top = self.levels.last()?;
        Some(self.corners(self.numbers(), top, 0))
    }

    /// Returns the lowest and highest corner of a box of keys.
    #[inline]
    fn keys<'n>(&self, numbers: &'n [f32], level: &Level, i: usize) -> (&'n [f32], &'n [f32]) {
        let n = self.schema.key.numbers();
        numbers[level.from + 2 * n * i..][..2 * n].split_at(n)
    }

    /// Returns the corners of a box of positions.
    #[inline]
    fn corners(&self, numbers: &[f32], level: &Level, i: usize) -> ([f32; 3], [f32; 3]) {
        let d = self.schema.key.dimensions();
        let (low, high) = self.keys(numbers, level, i);
        let (mut lo, mut hi) = ([0.0; 3], [0.0; 3]);
        lo[..d].copy_from_slice(&low[..d]);
        hi[..d].copy_from_slice(&high[..d]);
        (lo, hi)
    }

    /// Passes the numbers of all records that may count, nearest boxes first.
    pub(crate) fn search<L: Fn(f32, f32) -> f32>(&self, near: &Nearness<L>, found: &mut impl Found) {
        if let Some(top) = self.levels.len().checked_sub(1) {
            self.visit(self.numbers(), top, 0, near, found);
        }
    }

    /// Returns a lower bound of the measure of all records under a box.
    #[inline]
    fn least<L: Fn(f32, f32) -> f32>(
        &self,
        numbers: &[f32],
        level: &Level,
        i: usize,
        near: &Nearness<L>,
    ) -> f32 {
        let (lo, hi) = self.corners(numbers, level, i);
        let at = near.at;
        let squared = (0..3).map(|c| (lo[c] - at[c]).max(at[c] - hi[c]).max(0.0)).map(|x| x * x).sum();
        let cosine = match (self.schema.key, near.normal) {
            (Key::Oriented, Some(n)) => {
                let (low, high) = self.keys(numbers, level, i);
                (0..3).map(|c| (n[c] * low[3 + c]).max(n[c] * high[3 + c])).sum()
            }
            _ => 1.0,
        };
        (near.least)(squared, cosine)
    }

    fn visit<L: Fn(f32, f32) -> f32>(
        &self,
        numbers: &[f32],
        level: usize,
        node: usize,
        near: &Nearness<L>,
        found: &mut impl Found,
    ) {
        let below = if level == 0 { self.count } else { self.levels[level - 1].count };
        let children = node * FAN..((node + 1) * FAN).min(below);
        if level == 0 {
            let n = self.schema.numbers();
            found.records(children.start, &numbers[children.start * n..children.end * n]);
            return;
        }
        let inner = &self.levels[level - 1];
        // Measures are not negative, so that their bits have the same order. Boxes with equal measures are ordered by
        // their indices.
        let mut order = [0_u64; FAN];
        let (mut n, most) = (0, found.most());
        for (k, i) in children.clone().enumerate() {
            let least = self.least(numbers, inner, i, near);
            order[n] = u64::from(least.max(0.0).to_bits()) << 32 | k as u64;
            n += usize::from(least <= most);
        }
        let order = &mut order[..n];
        order.sort_unstable();
        for &key in order.iter() {
            if f32::from_bits((key >> 32) as u32) > found.most() {
                return;
            }
            self.visit(numbers, level - 1, children.start + (key & 0xffff_ffff) as usize, near, found);
        }
    }
}

/// The parameters of a search.
pub(crate) struct Nearness<L> {
    pub(crate) at: [f32; 3],
    pub(crate) normal: Option<[f32; 3]>,
    /// Returns the smallest measure of records whose squared distance is at least the first number and whose cosine
    /// of the angle to the normal is at most the second. It is not negative, and infinite when no such record counts.
    pub(crate) least: L,
}

/// Receives the results of a search.
pub(crate) trait Found {
    /// Receives some records, one after another, and the index of the first.
    fn records(&mut self, first: usize, records: &[f32]);
    /// Returns the largest measure that still counts.
    fn most(&self) -> f32;
}
