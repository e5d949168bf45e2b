//! Triangulation of polygons.

use crate::sweep::{self, turn};

/// The largest number of corner tests, for each corner of a polygon and as a minimum. A polygon that needs more is
/// triangulated by sweeping over it. Where that fails, because the polygon crosses itself or has no area, it is
/// triangulated without regard to its shape.
const TESTS_PER_CORNER: usize = 256;
const TESTS_OF_ANY: usize = 1 << 20;

/// Returns the corners of the triangles of a polygon, in its winding.
///
/// Convex polygons are cut into rounds of ears at every other corner. Concave polygons are cut by ear clipping in the
/// plane of the Newell normal, or by [`sweep`] where ear clipping would take long. Polygons without a valid
/// triangulation (crossing edges, no area) are cut in an arbitrary way. There are always `n - 2` triangles.
pub(crate) fn triangulate(points: &[[f64; 3]]) -> Vec<[usize; 3]> {
    if points.len() < 3 {
        return Vec::new();
    }
    cut(&project(points)).0
}

/// Does the same for a polygon in its plane, and also returns the number of corners that were tested.
fn cut(flat: &[[f64; 2]]) -> (Vec<[usize; 3]>, usize) {
    let n = flat.len();
    let most_tests = TESTS_OF_ANY + TESTS_PER_CORNER * n;
    let mut shapeless = false;
    let mut ring = Ring::new(n);
    let bends_in = |ring: &Ring, i: usize| {
        let [a, b, c] = ring.corners(i);
        turn(flat[a], flat[b], flat[c]) <= 0.0
    };
    let mut reflex: Vec<usize> = (0..n).filter(|&i| bends_in(&ring, i)).collect();
    let mut near = Nearby::new(flat, &reflex);
    let (mut tests, mut looked_up_at) = (0_usize, n);
    let mut triangles = Vec::with_capacity(n - 2);
    // The corner at which the search for the next ear begins. Beginning behind the last ear avoids slivers around one
    // corner.
    let mut at = 0;
    let mut since_ear = 0;
    while ring.left > 3 {
        if !reflex.is_empty() && ring.left < looked_up_at / 4 * 3 {
            looked_up_at = ring.left;
            reflex.retain(|&i| ring.is_in(i) && bends_in(&ring, i));
            near = Nearby::new(flat, &reflex);
        }
        tests += 1;
        if tests > most_tests && !shapeless {
            if let Some(swept) = sweep::triangulate(flat) {
                return (swept, tests);
            }
            shapeless = true;
        }
        let [a, b, c] = ring.corners(at);
        let triangle = [flat[a], flat[b], flat[c]];
        // Corners that no longer bend inward cannot lie in an ear.
        let blocks = |r: usize| {
            ring.is_in(r) && r != a && r != b && r != c && inside(flat[r], triangle) && bends_in(&ring, r)
        };
        let is_ear = reflex.is_empty()
            || shapeless
            || (turn(triangle[0], triangle[1], triangle[2]) > 0.0 && !near.any(triangle, &mut tests, blocks));
        // A polygon without any ear crosses itself or has no area.
        if is_ear || since_ear >= ring.left {
            triangles.push([a, b, c]);
            ring.remove(at);
            since_ear = 0;
            // The next search skips the corner behind, which would continue the fan around `a`.
            at = ring.corners(c)[2];
        } else {
            since_ear += 1;
            at = c;
        }
    }
    triangles.push(ring.corners(at));
    (triangles, tests)
}

/// The corners that are not cut off yet, in order.
struct Ring {
    before: Vec<u32>,
    after: Vec<u32>,
    left: usize,
}

const OUT: u32 = u32::MAX;

impl Ring {
    fn new(n: usize) -> Self {
        let step = |by: usize| (0..n).map(|i| ((i + by) % n) as u32).collect();
        Self { before: step(n - 1), after: step(1), left: n }
    }

    /// Returns a corner between its neighbours.
    fn corners(&self, i: usize) -> [usize; 3] {
        [self.before[i] as usize, i, self.after[i] as usize]
    }

    fn is_in(&self, i: usize) -> bool {
        self.before[i] != OUT
    }

    fn remove(&mut self, i: usize) {
        let [a, _, c] = self.corners(i);
        (self.after[a], self.before[c]) = (c as u32, a as u32);
        self.before[i] = OUT;
        self.left -= 1;
    }
}

/// Corners by their positions, in the cells of a square lattice.
struct Nearby {
    lo: [f64; 2],
    /// The numbers of cells per unit, and along each side.
    scale: [f64; 2],
    cells: usize,
    starts: Vec<u32>,
    list: Vec<u32>,
}

impl Nearby {
    fn new(flat: &[[f64; 2]], corners: &[usize]) -> Self {
        let cells = ((corners.len() as f64).sqrt() as usize).clamp(1, 1024);
        let mut lo = [f64::INFINITY; 2];
        let mut hi = [f64::NEG_INFINITY; 2];
        for &i in corners {
            for x in 0..2 {
                lo[x] = lo[x].min(flat[i][x]);
                hi[x] = hi[x].max(flat[i][x]);
            }
        }
        let scale = [0, 1].map(|x| if hi[x] > lo[x] { cells as f64 / (hi[x] - lo[x]) } else { 0.0 });
        let mut near = Self { lo, scale, cells, starts: vec![0; cells * cells + 1], list: Vec::new() };
        let cell_of: Vec<u32> = corners
            .iter()
            .map(|&i| (near.cell(flat[i][1], 1) * cells + near.cell(flat[i][0], 0)) as u32)
            .collect();
        for &cell in &cell_of {
            near.starts[cell as usize + 1] += 1;
        }
        for k in 0..cells * cells {
            near.starts[k + 1] += near.starts[k];
        }
        let mut next = near.starts.clone();
        near.list = vec![0; corners.len()];
        for (&i, &cell) in corners.iter().zip(&cell_of) {
            near.list[next[cell as usize] as usize] = i as u32;
            next[cell as usize] += 1;
        }
        near
    }

    /// Returns the row or column of a position. Positions outside belong to the outermost cells.
    fn cell(&self, x: f64, axis: usize) -> usize {
        (((x - self.lo[axis]) * self.scale[axis]).max(0.0) as usize).min(self.cells - 1)
    }

    /// True when `does` holds for any corner in the cells that a triangle touches. `tests` counts the corners.
    fn any(&self, triangle: [[f64; 2]; 3], tests: &mut usize, does: impl Fn(usize) -> bool) -> bool {
        let span = |axis: usize| {
            let [a, b, c] = triangle.map(|p| p[axis]);
            self.cell(a.min(b).min(c), axis)..self.cell(a.max(b).max(c), axis) + 1
        };
        let columns = span(0);
        for row in span(1) {
            let (first, last) = (row * self.cells + columns.start, row * self.cells + columns.end);
            let list = &self.list[self.starts[first] as usize..self.starts[last] as usize];
            *tests += list.len() + 1;
            if list.iter().any(|&i| does(i as usize)) {
                return true;
            }
        }
        false
    }
}

/// True when a quadrilateral bends inward at a corner, seen along its Newell normal.
pub(crate) fn is_concave(points: &[[f64; 3]; 4]) -> bool {
    let flat = project(points);
    (0..4).any(|i| turn(flat[(i + 3) % 4], flat[i], flat[(i + 1) % 4]) < 0.0)
}

/// Returns the Newell normal, which is twice the vector area.
pub(crate) fn newell(points: &[[f64; 3]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let origin = points[0];
    for (i, p) in points.iter().enumerate() {
        let q = points[(i + 1) % points.len()];
        // Positions relative to a corner avoid cancellation for polygons far away.
        let (p, q): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|c| p[c] - origin[c]), std::array::from_fn(|c| q[c] - origin[c]));
        sum[0] += p[1] * q[2] - p[2] * q[1];
        sum[1] += p[2] * q[0] - p[0] * q[2];
        sum[2] += p[0] * q[1] - p[1] * q[0];
    }
    sum
}

/// Projects the polygon along its Newell normal: counter-clockwise, in the two axes in which its area is largest.
fn project(points: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let normal = newell(points);
    let axis = (0..3).fold(0, |best, i| if normal[i].abs() > normal[best].abs() { i } else { best });
    let (mut x, mut y) = ((axis + 1) % 3, (axis + 2) % 3);
    if normal[axis] < 0.0 {
        std::mem::swap(&mut x, &mut y);
    }
    points.iter().map(|p| [p[x] - points[0][x], p[y] - points[0][y]]).collect()
}

/// True when `p` is in a counter-clockwise triangle or on its border.
fn inside(p: [f64; 2], [a, b, c]: [[f64; 2]; 3]) -> bool {
    turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[[f64; 3]], triangles: &[[usize; 3]]) -> (f64, f64) {
        let of = |list: &[usize]| newell(&list.iter().map(|&i| points[i]).collect::<Vec<_>>())[2];
        let all: Vec<usize> = (0..points.len()).collect();
        let parts: Vec<f64> = triangles.iter().map(|t| of(t)).collect();
        assert!(parts.iter().all(|&a| a >= -1e-12), "{parts:?}");
        (parts.iter().sum(), of(&all))
    }

    #[test]
    fn concave_polygons_are_covered_once() {
        let comb: Vec<[f64; 3]> = (0..40)
            .map(|i| [i as f64, if i % 2 == 0 { 0.0 } else { 5.0 }, 1.0])
            .chain((0..40).rev().map(|i| [i as f64, 8.0 - (i % 3) as f64, 1.0]))
            .collect();
        let star: Vec<[f64; 3]> = (0..10)
            .map(|i| {
                let (r, t) = (if i % 2 == 0 { 1.0 } else { 0.3 }, i as f64 * 0.628_318);
                [r * t.cos(), r * t.sin(), 1e6]
            })
            .collect();
        for polygon in [comb, star] {
            let triangles = triangulate(&polygon);
            assert_eq!(triangles.len(), polygon.len() - 2);
            let (parts, whole) = area(&polygon, &triangles);
            assert!((parts - whole).abs() < 1e-9 * whole.abs(), "{parts} {whole}");
        }
    }

    #[test]
    fn degenerate_polygons_are_triangulated() {
        assert_eq!(triangulate(&[[0.0; 3]; 7]).len(), 5);
        let line: Vec<[f64; 3]> = (0..6).map(|i| [i as f64, 0.0, 0.0]).collect();
        assert_eq!(triangulate(&line).len(), 4);
        assert!(triangulate(&[[0.0; 3]; 2]).is_empty());
    }

    #[test]
    fn a_million_corners_are_triangulated_quickly() {
        let n = 1_000_000;
        let round = |i: usize, r: f64| {
            let t = i as f64 / n as f64 * std::f64::consts::TAU;
            [r * t.cos(), r * t.sin(), 0.0]
        };
        // The polygons are a convex one and a cog wheel.
        let convex: Vec<[f64; 3]> = (0..n).map(|i| round(i, 1.0)).collect();
        let cog: Vec<[f64; 3]> = (0..n).map(|i| round(i, if i / 3 % 2 == 0 { 1.0 } else { 0.99 })).collect();
        for polygon in [convex, cog] {
            let triangles = triangulate(&polygon);
            assert_eq!(triangles.len(), n - 2);
            let parts: f64 = triangles.iter().map(|t| newell(&t.map(|i| polygon[i]))[2]).sum();
            let whole = newell(&polygon)[2];
            assert!((parts / whole - 1.0).abs() < 1e-9, "{parts} {whole}");
        }
    }

    /// The corners of any polygon are tested at most some hundred times each.
    #[test]
    fn no_shape_of_polygon_takes_quadratic_time() {
        const N: usize = 90_000;
        let at = |i: usize, r: f64| {
            let (y, x) = (i as f64 / N as f64 * std::f64::consts::TAU).sin_cos();
            [r * x, r * y]
        };
        let star: Vec<[f64; 2]> = (0..N).map(|i| at(i, if i % 2 == 0 { 1.0 } else { 0.3 })).collect();
        let spiked: Vec<[f64; 2]> = (0..N).map(|i| at(i, 0.01 + ((i * i) % 1009) as f64)).collect();
        let line: Vec<[f64; 2]> = (0..N).map(|i| [i as f64, 0.0]).collect();
        let again: Vec<[f64; 2]> = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].repeat(N / 4);
        let wound: Vec<[f64; 2]> = (0..N).map(|i| at(i * 34_377, 1.0)).collect();
        // Simple polygons are covered. The others are cut in an arbitrary way.
        for (polygon, simple) in [
            (star, true),
            (spiked, true),
            (line, false),
            (again, false),
            (vec![[0.0; 2]; N], false),
            (wound, false),
        ] {
            let (triangles, tests) = cut(&polygon);
            assert_eq!(triangles.len(), N - 2);
            // The last search may exceed the limit.
            assert!(tests < TESTS_OF_ANY + (TESTS_PER_CORNER + 3) * N, "{tests}");
            let of = |t: &[usize; 3]| turn(polygon[t[0]], polygon[t[1]], polygon[t[2]]);
            let parts: f64 = triangles.iter().map(|t| of(t).abs()).sum();
            let whole: f64 = (1..N - 1).map(|i| turn(polygon[0], polygon[i], polygon[i + 1])).sum();
            assert!(!simple || (parts / whole - 1.0).abs() < 1e-9, "{parts} {whole}");
        }
    }

    #[test]
    fn arrowheads_are_concave_and_squares_are_not() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(!is_concave(&square));
        let arrow = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 2.0, 0.0]];
        assert!(is_concave(&arrow));
    }

    #[test]
    fn no_corner_of_a_round_polygon_has_many_triangles() {
        const N: usize = 1000;
        let points: Vec<[f64; 3]> = (0..N)
            .map(|i| (i as f64 * std::f64::consts::TAU / N as f64).sin_cos())
            .map(|(y, x)| [x, y, 0.0])
            .collect();
        let triangles = triangulate(&points);
        let mut at = [0; N];
        triangles.iter().flatten().for_each(|&i| at[i] += 1);
        assert_eq!(triangles.len(), N - 2);
        assert!(at.iter().max() <= Some(&(2 * N.ilog2())), "{at:?}");
        let (whole, parts) = area(&points, &triangles);
        assert!((whole - parts).abs() < 1e-9);
    }
}
