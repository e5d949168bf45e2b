//! Converts polygons with holes to polygons without holes. A cut joins each hole to the outline.

/// The largest number of cuts that are tried for one hole.
const MOST_TRIALS: usize = 400;

/// The largest product of the numbers of holes and corners. With more, the conversion would take too long, and the
/// holes are left out.
const MOST_WORK: usize = 50_000_000;

/// Returns the corners of one polygon that covers the inside of the first loop and the outside of the others. Loops are
/// lists of corners. A corner is an index into `verts`, which holds the indices of points in `p`, with three floats
/// each.
pub(crate) fn joined(loops: &[Vec<usize>], verts: &[i32], p: &[f32]) -> Vec<usize> {
    let Some((outline, holes)) = loops.split_first() else { return Vec::new() };
    let mut polygon = outline.clone();
    let holes: Vec<&Vec<usize>> = holes.iter().filter(|h| h.len() >= 3).collect();
    let corners: usize = loops.iter().map(Vec::len).sum();
    if holes.is_empty() || polygon.len() < 3 || holes.len().saturating_mul(corners) > MOST_WORK {
        return polygon;
    }
    let point = |corner: usize| -> [f64; 3] {
        let v = verts.get(corner).and_then(|v| usize::try_from(*v).ok()).unwrap_or(0);
        std::array::from_fn(|c| p.get(3 * v + c).copied().map_or(0.0, f64::from))
    };
    let normal = newell(outline.iter().map(|c| point(*c)));
    let flat = |corner: usize| {
        let [x, y, z] = point(corner);
        let n = normal.map(f64::abs);
        if n[2] >= n[0] && n[2] >= n[1] {
            [x, y]
        } else if n[1] >= n[0] {
            [z, x]
        } else {
            [y, z]
        }
    };
    let turned = area(&polygon, &flat) < 0.0;
    let mut holes: Vec<Vec<usize>> = holes
        .into_iter()
        .map(|hole| {
            let mut hole = hole.clone();
            if (area(&hole, &flat) < 0.0) == turned {
                hole.reverse();
            }
            hole
        })
        .collect();
    // The holes are joined from left to right, so that no cut crosses a later hole.
    let left = |hole: &Vec<usize>| hole.iter().map(|c| flat(*c)[0]).fold(f64::INFINITY, f64::min);
    holes.sort_by(|a, b| left(a).total_cmp(&left(b)));
    for k in 0..holes.len() {
        let hole = holes[k].clone();
        let least = |a: &usize, b: &usize| flat(hole[*a])[0].total_cmp(&flat(hole[*b])[0]);
        let Some(start) = (0..hole.len()).min_by(least) else { continue };
        let from = flat(hole[start]);
        let distance = |corner: usize| {
            let to = flat(corner);
            (to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2)
        };
        let mut targets: Vec<usize> = (0..polygon.len()).collect();
        let nearer = |a: &usize, b: &usize| distance(polygon[*a]).total_cmp(&distance(polygon[*b]));
        if targets.len() > MOST_TRIALS {
            targets.select_nth_unstable_by(MOST_TRIALS, nearer);
            targets.truncate(MOST_TRIALS);
        }
        targets.sort_by(nearer);
        let free = |target: &&usize| {
            let to = flat(polygon[**target]);
            let mut edges = std::iter::once(&polygon)
                .chain(&holes[k..])
                .flat_map(|ring| (0..ring.len()).map(move |i| (ring[i], ring[(i + 1) % ring.len()])));
            !edges.any(|(a, b)| cross_each_other(from, to, flat(a), flat(b)))
        };
        let target = targets.iter().find(free).or(targets.first()).copied().unwrap_or(0);
        let around = hole[start..].iter().chain(&hole[..=start]).copied();
        let cut: Vec<usize> = around.chain([polygon[target]]).collect();
        polygon.splice(target + 1..target + 1, cut);
    }
    polygon
}

fn newell(points: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let points: Vec<[f64; 3]> = points.collect();
    let mut n = [0.0; 3];
    for (i, a) in points.iter().enumerate() {
        let b = points[(i + 1) % points.len()];
        for (c, sum) in n.iter_mut().enumerate() {
            let (d, e) = ((c + 1) % 3, (c + 2) % 3);
            *sum += (a[d] - b[d]) * (a[e] + b[e]);
        }
    }
    n
}

fn area(ring: &[usize], flat: &dyn Fn(usize) -> [f64; 2]) -> f64 {
    (0..ring.len())
        .map(|i| {
            let (a, b) = (flat(ring[i]), flat(ring[(i + 1) % ring.len()]));
            a[0] * b[1] - b[0] * a[1]
        })
        .sum()
}

/// True when two segments cross, or touch at a point that is not a common end.
fn cross_each_other(a: [f64; 2], b: [f64; 2], c: [f64; 2], d: [f64; 2]) -> bool {
    let side = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        let (left, right) = ((q[0] - p[0]) * (r[1] - p[1]), (q[1] - p[1]) * (r[0] - p[0]));
        i32::from(left > right) - i32::from(left < right)
    };
    let shared = |p: [f64; 2]| p == a || p == b;
    if shared(c) || shared(d) {
        return false;
    }
    let (s1, s2, s3, s4) = (side(a, b, c), side(a, b, d), side(c, d, a), side(c, d, b));
    s1 * s2 <= 0 && s3 * s4 <= 0 && (s1, s2) != (0, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_connected_to_the_outline() {
        // A square has two square holes, with the orientation of the outline.
        let square = |x: f32, y: f32, s: f32| [[x, y], [x + s, y], [x + s, y + s], [x, y + s]];
        let corners = [square(0.0, 0.0, 10.0), square(6.0, 6.0, 2.0), square(2.0, 2.0, 2.0)];
        let p: Vec<f32> = corners.iter().flatten().flat_map(|[x, y]| [*x, *y, 1.0]).collect();
        let verts: Vec<i32> = (0..12).collect();
        let loops: Vec<Vec<usize>> = (0..3).map(|k| (4 * k..4 * k + 4).collect()).collect();
        let polygon = joined(&loops, &verts, &p);
        assert_eq!(polygon.len(), 4 + 6 + 6);
        let flat = |c: usize| [f64::from(p[3 * c]), f64::from(p[3 * c + 1])];
        assert!((area(&polygon, &flat) * 0.5 - 92.0).abs() < 1e-9);
        assert_eq!(joined(&loops[..1], &verts, &p), loops[0]);
        assert!(joined(&[], &verts, &p).is_empty());
    }
}
