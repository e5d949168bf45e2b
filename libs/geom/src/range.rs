//! The range of a parameter that a piece covers, in whole numbers.
//!
//! Places in a lattice are ratios of whole numbers, rounded once. Every piece that evaluates a place of an edge, in
//! either direction, gets the same two weights.

/// A run of whole segments, or a dyadic part of one segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Range {
    /// The first segment.
    first: u32,
    /// The number of segments; 1 when `level > 0`.
    count: u32,
    /// The index of the part of the segment, of `2^level` parts.
    k: u64,
    /// The number of times that the segment was halved.
    level: u8,
}

/// The largest number of halvings of a segment. A ground of 1e8 units below an eye one unit above it needs 32. With
/// 4096 steps of each part the numbers of [`Range::place`] occupy 62 bits.
const MAX_LEVEL: u8 = 50;

/// A place in a segment. `a + b = 1`, and `b = 0` at the start. Exchanging `a` and `b` reverses the segment exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    /// The segment.
    pub(crate) segment: u32,
    /// The distance to the end of the segment.
    pub(crate) a: f64,
    /// The distance from the start of the segment.
    pub(crate) b: f64,
}

impl Place {
    /// Returns the place counted in segments. It is exact wherever two ranges may share an end.
    pub(crate) fn coordinate(&self) -> f64 {
        f64::from(self.segment) + self.b
    }
}

impl Range {
    /// Returns the range of all of `count` segments.
    pub(crate) fn whole(count: u32) -> Self {
        Self { first: 0, count, k: 0, level: 0 }
    }

    /// The number of segments that the range touches.
    pub(crate) fn count(&self) -> u32 {
        self.count
    }

    /// Returns the segments that the range touches.
    pub(crate) fn segments(&self) -> std::ops::Range<u32> {
        self.first..self.first + self.count
    }

    /// Returns the start and end within the first and last segment.
    pub(crate) fn ends(&self) -> (f64, f64) {
        // Both numbers are below 2^53, so that they are exact.
        let parts = (1_u64 << self.level) as f64;
        (self.k as f64 / parts, (self.k + 1) as f64 / parts)
    }

    /// Returns the start and end, counted in segments. They are exact.
    pub(crate) fn span(&self) -> (f64, f64) {
        let (start, end) = self.ends();
        (f64::from(self.first) + start, f64::from(self.first + self.count - 1) + end)
    }

    /// True when the range covers whole segments.
    pub(crate) fn is_whole(&self) -> bool {
        self.level == 0
    }

    /// Returns point `i` of `n` points that are spread evenly (`n >= 2`).
    pub(crate) fn place(&self, i: usize, n: usize) -> Place {
        let steps = (n.max(2) - 1) as u64;
        let i = (i as u64).min(steps);
        let den = steps << self.level;
        let num = (self.k * steps + i) * u64::from(self.count);
        // The end belongs to the last segment.
        let whole = (num / den).min(u64::from(self.count) - 1);
        let rest = num - whole * den;
        Place {
            segment: self.first + whole as u32,
            a: (den - rest) as f64 / den as f64,
            b: rest as f64 / den as f64,
        }
    }

    /// Returns the two halves, divided between segments when there are several. `None` when the range is too small.
    pub(crate) fn halves(&self) -> Option<(Self, Self)> {
        if self.count > 1 {
            let left = self.count / 2;
            return Some((
                Self { count: left, ..*self },
                Self { first: self.first + left, count: self.count - left, ..*self },
            ));
        }
        (self.level < MAX_LEVEL).then(|| {
            let (k, level) = (self.k * 2, self.level + 1);
            (Self { k, level, ..*self }, Self { k: k + 1, level, ..*self })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_halves_are_points_of_the_whole() {
        let whole = Range::whole(1);
        let (left, right) = whole.halves().unwrap();
        for i in 0..=6 {
            assert_eq!(left.place(i, 7), whole.place(i, 13));
            assert_eq!(right.place(i, 7), whole.place(i + 6, 13));
        }
    }

    #[test]
    fn reversed_ranges_have_the_same_points() {
        let range = Range::whole(3).halves().unwrap().1;
        for n in 2..20 {
            for i in 0..n {
                let (p, q) = (range.place(i, n), range.place(n - 1 - i, n));
                if p.b != 0.0 && p.a != 0.0 {
                    assert_eq!((p.a, p.b), (q.b, q.a));
                }
            }
        }
    }

    #[test]
    fn ranges_of_several_segments_end_at_segment_borders() {
        let range = Range::whole(4);
        assert_eq!(range.place(0, 5), Place { segment: 0, a: 1.0, b: 0.0 });
        assert_eq!(range.place(2, 5), Place { segment: 2, a: 1.0, b: 0.0 });
        assert_eq!(range.place(4, 5), Place { segment: 3, a: 0.0, b: 1.0 });
        let mut r = range;
        let mut depth = 0;
        while let Some((_, right)) = r.halves() {
            r = right;
            depth += 1;
        }
        assert_eq!(depth, 2 + usize::from(MAX_LEVEL));
        assert_eq!(r.place(1, 2), Place { segment: 3, a: 0.0, b: 1.0 });
    }
}
