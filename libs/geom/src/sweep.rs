//! Triangulation of a polygon with a sweep line, in n log n steps for any shape.
//!
//! The line cuts the polygon into spans, each between a left and a right edge. Diagonals at corners where spans split
//! or merge divide the polygon into polygons that are monotone in y. Their triangles are cut off when the sweep
//! reaches their corners (M. de Berg et al., "Computational Geometry", chapter 3).

use std::cmp::Ordering;
use std::collections::BTreeMap;

/// Returns the `n - 2` triangles of a counter-clockwise polygon, in its winding. Returns `None` when they do not
/// cover it exactly once, as for polygons that cross themselves or have no area.
pub(crate) fn triangulate(flat: &[[f64; 2]]) -> Option<Vec<[usize; 3]>> {
    let n = flat.len();
    if n < 3 || flat.iter().flatten().any(|x| !x.is_finite()) {
        return None;
    }
    // The order is from the top, and for equal heights from the left.
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_unstable_by(|&a, &b| downward(flat[a], flat[b]).then(a.cmp(&b)));
    let mut rank = vec![0_u32; n];
    for (r, &i) in order.iter().enumerate() {
        rank[i] = r as u32;
    }
    let mut sweep = Sweep {
        flat,
        status: BTreeMap::new(),
        spans: Vec::new(),
        left_of: vec![NONE; n],
        right_of: vec![NONE; n],
        out: Vec::with_capacity(n - 2),
    };
    for &v in &order {
        let (before, after) = ((v + n - 1) % n, (v + 1) % n);
        let bends_out = turn(flat[before], flat[v], flat[after]) > 0.0;
        match (rank[before] < rank[v], rank[after] < rank[v]) {
            (false, false) if bends_out => sweep.start(v, before),
            (false, false) => sweep.split(v, before)?,
            (true, true) if bends_out => sweep.end(v, before)?,
            (true, true) => sweep.merge(v, before)?,
            (true, false) => sweep.go_on_left(v, before)?,
            (false, true) => sweep.go_on_right(v, before)?,
        }
    }
    covers(flat, &sweep.out).then_some(sweep.out)
}

/// True when triangles cover a polygon once: none is reversed, and their areas sum up to that of the polygon.
fn covers(flat: &[[f64; 2]], triangles: &[[usize; 3]]) -> bool {
    let n = flat.len();
    let areas = triangles.iter().map(|t| turn(flat[t[0]], flat[t[1]], flat[t[2]]));
    let (mut sum, mut over) = (0.0, 0.0);
    for area in areas {
        sum += area;
        over += area.min(0.0);
    }
    let whole: f64 = (1..n - 1).map(|i| turn(flat[0], flat[i], flat[i + 1])).sum();
    let small = 1e-9 * whole;
    triangles.len() == n - 2 && whole > 0.0 && (sum - whole).abs() <= small && -over <= small
}

/// Orders places from the top, and from the left for equal heights.
fn downward(a: [f64; 2], b: [f64; 2]) -> Ordering {
    b[1].total_cmp(&a[1]).then(a[0].total_cmp(&b[0]))
}

const NONE: u32 = u32::MAX;

/// The left edge of a span. The edges on the sweep line are ordered from left to right.
struct Edge {
    upper: [f64; 2],
    lower: [f64; 2],
    number: usize,
}

impl Ord for Edge {
    fn cmp(&self, other: &Self) -> Ordering {
        if self.number == other.number {
            return Ordering::Equal;
        }
        // For two edges that do not cross, the upper end of the lower edge determines the order.
        if downward(self.upper, other.upper) == Ordering::Less {
            self.side(other)
        } else {
            other.side(self).reverse()
        }
    }
}

impl Edge {
    /// Returns the position of this edge relative to one that begins lower.
    fn side(&self, lower: &Self) -> Ordering {
        let of = |p| 0.0_f64.total_cmp(&(turn(self.upper, self.lower, p) + 0.0));
        of(lower.upper).then_with(|| of(lower.lower)).then(self.number.cmp(&lower.number))
    }
}

impl PartialOrd for Edge {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Edge {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
    }
}

impl Eq for Edge {}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// A monotone polygon that grows downward. It holds the corners whose triangles are not cut off yet. All but the
/// first are on one side.
#[derive(Default)]
struct Monotone(Vec<(usize, Side)>);

impl Monotone {
    /// Adds the next corner, on a side.
    fn feed(&mut self, v: usize, side: Side, flat: &[[f64; 2]], out: &mut Vec<[usize; 3]>) {
        let Some(&top) = self.0.last() else { return };
        if self.0.len() > 1 && top.1 != side {
            self.fan(v, out);
            self.0.clear();
            self.0.push(top);
        }
        while let [.., (a, _), (b, _)] = self.0[..] {
            let triangle = if side == Side::Left { [a, b, v] } else { [v, b, a] };
            let [p, q, r] = triangle.map(|i| flat[i]);
            if turn(p, q, r) <= 0.0 {
                break;
            }
            out.push(triangle);
            self.0.pop();
        }
        self.0.push((v, side));
    }

    /// Adds the last corner.
    fn end(&mut self, v: usize, out: &mut Vec<[usize; 3]>) {
        self.fan(v, out);
        self.0.clear();
    }

    /// Appends the triangles from all corners to one on the other side.
    fn fan(&self, v: usize, out: &mut Vec<[usize; 3]>) {
        out.extend(self.0.windows(2).map(|pair| {
            let ((a, _), (b, side)) = (pair[0], pair[1]);
            if side == Side::Left { [a, b, v] } else { [b, a, v] }
        }));
    }
}

/// The inside between two edges.
struct Span {
    /// The edge on its right, identified by the corner at which it begins.
    right: usize,
    monotone: Monotone,
    /// After a corner where two spans merged: the part to the right of the diagonal from there to the next corner.
    other: Option<Monotone>,
}

struct Sweep<'a> {
    flat: &'a [[f64; 2]],
    status: BTreeMap<Edge, u32>,
    spans: Vec<Span>,
    /// The span to the right of an edge that goes down, and to the left of one that goes up.
    left_of: Vec<u32>,
    right_of: Vec<u32>,
    out: Vec<[usize; 3]>,
}

impl Sweep<'_> {
    /// Returns the edge from a corner down to the next.
    fn edge(&self, from: usize) -> Edge {
        let to = (from + 1) % self.flat.len();
        Edge { upper: self.flat[from], lower: self.flat[to], number: from }
    }

    fn open(&mut self, v: usize, right: usize, monotone: Monotone) {
        let id = self.spans.len() as u32;
        self.spans.push(Span { right, monotone, other: None });
        (self.left_of[v], self.right_of[right]) = (id, id);
        self.status.insert(self.edge(v), id);
    }

    fn span(&mut self, id: u32) -> Option<&mut Span> {
        self.spans.get_mut(id as usize)
    }

    /// Adds a corner on the left of a span.
    fn feed_left(&mut self, id: u32, v: usize) -> Option<()> {
        let (flat, out) = (self.flat, &mut self.out);
        let span = self.spans.get_mut(id as usize)?;
        if let Some(right) = span.other.take() {
            span.monotone.end(v, out);
            span.monotone = right;
        }
        span.monotone.feed(v, Side::Left, flat, out);
        Some(())
    }

    /// Adds a corner on the right of a span.
    fn feed_right(&mut self, id: u32, v: usize) -> Option<()> {
        let (flat, out) = (self.flat, &mut self.out);
        let span = self.spans.get_mut(id as usize)?;
        if let Some(mut right) = span.other.take() {
            right.end(v, out);
        }
        span.monotone.feed(v, Side::Right, flat, out);
        Some(())
    }

    fn start(&mut self, v: usize, before: usize) {
        self.open(v, before, Monotone(vec![(v, Side::Left)]));
    }

    fn split(&mut self, v: usize, before: usize) -> Option<()> {
        let at = Edge { upper: self.flat[v], lower: self.flat[v], number: usize::MAX };
        let id = *self.status.range(..at).next_back()?.1;
        let (flat, out) = (self.flat, &mut self.out);
        let span = self.spans.get_mut(id as usize)?;
        let mut right = match span.other.take() {
            Some(right) => right,
            None => {
                // The diagonal goes to the last corner. That corner stays on its side of one part and begins the
                // other part.
                let &(last, side) = span.monotone.0.last()?;
                let begun = Monotone(vec![(last, side)]);
                if side == Side::Left { std::mem::replace(&mut span.monotone, begun) } else { begun }
            }
        };
        span.monotone.feed(v, Side::Right, flat, out);
        right.feed(v, Side::Left, flat, out);
        let old_right = std::mem::replace(&mut span.right, before);
        self.right_of[before] = id;
        self.open(v, old_right, right);
        Some(())
    }

    fn end(&mut self, v: usize, before: usize) -> Option<()> {
        let id = self.left_of[before];
        if id != self.right_of[v] {
            return None;
        }
        let out = &mut self.out;
        let span = self.spans.get_mut(id as usize)?;
        span.monotone.end(v, out);
        if let Some(mut right) = span.other.take() {
            right.end(v, out);
        }
        self.status.remove(&self.edge(before)).map(|_| ())
    }

    fn merge(&mut self, v: usize, before: usize) -> Option<()> {
        let (right, left) = (self.left_of[before], self.right_of[v]);
        if right == left {
            return None;
        }
        self.feed_right(left, v)?;
        self.feed_left(right, v)?;
        let gone = self.span(right)?;
        let (edge, monotone) = (gone.right, std::mem::take(&mut gone.monotone));
        let span = self.span(left)?;
        (span.right, span.other) = (edge, Some(monotone));
        self.right_of[edge] = left;
        self.status.remove(&self.edge(before)).map(|_| ())
    }

    fn go_on_left(&mut self, v: usize, before: usize) -> Option<()> {
        let id = self.left_of[before];
        self.feed_left(id, v)?;
        self.status.remove(&self.edge(before))?;
        self.left_of[v] = id;
        self.status.insert(self.edge(v), id);
        Some(())
    }

    fn go_on_right(&mut self, v: usize, before: usize) -> Option<()> {
        let id = self.right_of[v];
        self.feed_right(id, v)?;
        self.right_of[before] = id;
        self.span(id)?.right = before;
        Some(())
    }
}

/// Returns a positive number for a left turn at `b`.
pub(crate) fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn round(n: usize, radius: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
        let angle = |i: usize| i as f64 / n as f64 * std::f64::consts::TAU;
        (0..n).map(|i| [radius(i) * angle(i).cos(), radius(i) * angle(i).sin()]).collect()
    }

    #[test]
    fn simple_polygons_are_triangulated_completely() {
        let comb = |n: usize| {
            let teeth = (0..n).map(|i| [1.0 - i as f64 / n as f64, if i % 2 == 0 { 0.0 } else { 1.0 }]);
            [[0.0, -1.0], [1.0, -1.0]].into_iter().chain(teeth).collect::<Vec<_>>()
        };
        for polygon in [
            round(3, |_| 1.0),
            round(101, |_| 1.0),
            round(1000, |i| if i % 2 == 0 { 1.0 } else { 0.3 }),
            round(1000, |i| if i % 7 < 3 { 1.0 } else { 0.01 }),
            comb(99),
            comb(100),
            vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 2.0], [1.0, 1.0], [0.0, 1.0]],
        ] {
            let turned = |p: &[f64; 2]| [-p[1], p[0]];
            let mut polygon = polygon;
            for _ in 0..4 {
                assert!(triangulate(&polygon).is_some(), "{polygon:?}");
                polygon = polygon.iter().map(turned).collect();
            }
        }
    }

    #[test]
    fn self_intersecting_polygons_are_refused() {
        assert!(triangulate(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]).is_none());
        assert!(triangulate(&[[0.0; 2]; 9]).is_none());
        assert!(triangulate(&[[0.0, 0.0], [1.0, 0.0], [f64::NAN, 1.0]]).is_none());
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), 0.0]).collect();
        assert!(triangulate(&line).is_none());
    }

    proptest! {
        #[test]
        fn star_polygons_of_any_radii_are_triangulated(radii in prop::collection::vec(0.01..1.0, 3..200)) {
            prop_assert!(triangulate(&round(radii.len(), |i| radii[i])).is_some());
        }

        #[test]
        fn triangulation_of_random_points_ends(points in prop::collection::vec([-3i32..4, -3i32..4], 0..40)) {
            let points: Vec<[f64; 2]> = points.iter().map(|p| p.map(f64::from)).collect();
            if let Some(triangles) = triangulate(&points) {
                prop_assert_eq!(triangles.len(), points.len() - 2);
            }
        }
    }
}
