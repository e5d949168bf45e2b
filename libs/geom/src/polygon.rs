//! Cutting polygons into triangles.

/// Corners of the triangles of a polygon, in its winding.
///
/// Convex polygons are cut into a fan of ears; concave ones by ear clipping in the plane of the Newell normal. What
/// cannot be cut properly (crossing edges, no area) is cut anyhow: there are always `n - 2` triangles.
pub(crate) fn triangulate(points: &[[f64; 3]]) -> Vec<[usize; 3]> {
    let n = points.len();
    if n < 3 {
        return Vec::new();
    }
    let flat = project(points);
    let mut ring: Vec<usize> = (0..n).collect();
    let mut triangles = Vec::with_capacity(n - 2);
    // Where to look for the next ear; going round avoids slivers around one corner.
    let mut at = 0;
    let mut convex = false;
    while ring.len() > 3 {
        let m = ring.len();
        let reflex: Vec<usize> = (0..if convex { 0 } else { m })
            .filter(|&i| turn(flat[ring[(i + m - 1) % m]], flat[ring[i]], flat[ring[(i + 1) % m]]) <= 0.0)
            .map(|i| ring[i])
            .collect();
        let corners = |i: usize| [ring[(i + m - 1) % m], ring[i], ring[(i + 1) % m]];
        let is_ear = |i: usize| {
            let [a, b, c] = corners(i);
            turn(flat[a], flat[b], flat[c]) > 0.0
                && reflex
                    .iter()
                    .all(|&r| r == a || r == b || r == c || !inside(flat[r], [flat[a], flat[b], flat[c]]))
        };
        let ear = (0..m).map(|k| (at + k) % m).find(|&i| is_ear(i));
        // Without an ear the polygon crosses itself or has no area.
        let i = ear.unwrap_or(at % m);
        triangles.push(corners(i));
        ring.remove(i);
        at = i % ring.len();
        if reflex.is_empty() {
            // Convex polygons stay convex: every other corner is cut off, without searching.
            convex = true;
            at = (i + 1) % ring.len();
        }
    }
    triangles.push([ring[0], ring[1], ring[2]]);
    triangles
}

/// Whether a quadrilateral bends inward at a corner, seen along its Newell normal.
pub(crate) fn is_concave(points: &[[f64; 3]; 4]) -> bool {
    let flat = project(points);
    (0..4).any(|i| turn(flat[(i + 3) % 4], flat[i], flat[(i + 1) % 4]) < 0.0)
}

/// The Newell normal: twice the vector area.
pub(crate) fn newell(points: &[[f64; 3]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let origin = points[0];
    for (i, p) in points.iter().enumerate() {
        let q = points[(i + 1) % points.len()];
        // Relative to a corner, so that far away polygons do not cancel.
        let (p, q): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|c| p[c] - origin[c]), std::array::from_fn(|c| q[c] - origin[c]));
        sum[0] += p[1] * q[2] - p[2] * q[1];
        sum[1] += p[2] * q[0] - p[0] * q[2];
        sum[2] += p[0] * q[1] - p[1] * q[0];
    }
    sum
}

/// The polygon seen along its Newell normal: counter-clockwise, in the two axes that show most of it.
fn project(points: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let normal = newell(points);
    let axis = (0..3).fold(0, |best, i| if normal[i].abs() > normal[best].abs() { i } else { best });
    let (mut x, mut y) = ((axis + 1) % 3, (axis + 2) % 3);
    if normal[axis] < 0.0 {
        std::mem::swap(&mut x, &mut y);
    }
    points.iter().map(|p| [p[x] - points[0][x], p[y] - points[0][y]]).collect()
}

/// Positive for a left turn at `b`.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

/// Whether `p` is in a counter-clockwise triangle or on its border.
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
    fn degenerate_polygons_do_not_hang() {
        assert_eq!(triangulate(&[[0.0; 3]; 7]).len(), 5);
        let line: Vec<[f64; 3]> = (0..6).map(|i| [i as f64, 0.0, 0.0]).collect();
        assert_eq!(triangulate(&line).len(), 4);
        assert!(triangulate(&[[0.0; 3]; 2]).is_empty());
    }

    #[test]
    fn arrowheads_are_concave() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(!is_concave(&square));
        let arrow = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 2.0, 0.0]];
        assert!(is_concave(&arrow));
    }
}
