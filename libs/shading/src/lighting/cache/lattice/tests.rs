//! Tests records of known functions on grids.

use super::*;

/// Returns a flat grid over a rectangle, with ten raster pixels per unit.
fn flat(nu: usize, nv: usize, lo: [f32; 2], hi: [f32; 2]) -> Points {
    let step = |k: usize, n: usize| if n > 1 { k as f32 / (n - 1) as f32 } else { 0.0 };
    let at = |i: usize, j: usize| {
        Vec3::new(lo[0] + (hi[0] - lo[0]) * step(i, nu), lo[1] + (hi[1] - lo[1]) * step(j, nv), 0.0)
    };
    let n = nu * nv;
    Points {
        rects: vec![Rect { first: 0, nu, nv }],
        p: (0..n).map(|k| at(k % nu, k / nu)).collect(),
        n: vec![Vec3::Z; n],
        active: vec![true; n],
        scale: vec![10.0; n],
    }
}

/// Returns the record of a function of position with its exact derivatives.
fn of(f: &dyn Fn(Vec3) -> f32, p: Vec3) -> Arc<Record> {
    let h = 1e-2;
    let (dx, dy) = (Vec3::X * h, Vec3::Y * h);
    let first = |d: Vec3| (f(p + d) - f(p - d)) / (2.0 * h);
    let second =
        |a: Vec3, b: Vec3| (f(p + a + b) - f(p + a - b) - f(p - a + b) + f(p - a - b)) / (4.0 * h * h);
    Arc::new(Record {
        value: [f(p); 3],
        translational: [Vec3::new(first(dx), first(dy), 0.0); 3],
        second: [second(dx, dx), second(dy, dy), 0.0, second(dx, dy), 0.0, 0.0],
        ..Record::default()
    })
}

fn filled(
    points: &Points,
    f: &dyn Fn(Vec3) -> f32,
    tolerance: Tolerance,
) -> (Vec<Option<Arc<Record>>>, usize) {
    Lattice::fill(Kind::Irradiance, points, tolerance, &mut |wanted| {
        wanted.iter().map(|w| of(f, points.p[w.lane as usize])).collect()
    })
}

const USUAL: Tolerance = Tolerance { maxerror: 0.25, maxpixeldist: 1000.0, minsamples: 3 };

#[test]
fn linear_functions_need_records_at_corners_only() {
    let points = flat(17, 13, [0.0, 0.0], [1.0, 1.0]);
    let f = |p: Vec3| 1.0 + 0.3 * p.x - 0.2 * p.y;
    let (known, records) = filled(&points, &f, USUAL);
    assert_eq!(records, 4);
    for (k, p) in known.iter().zip(&points.p) {
        assert!((k.as_ref().unwrap().value[1] - f(*p)).abs() < 1e-5);
    }
    // The pixel distance bounds the spacing, and a minimal number of records may be requested.
    assert_eq!(filled(&points, &f, Tolerance { maxpixeldist: 7.2, ..USUAL }).1, 9);
    assert!(filled(&points, &f, Tolerance { minsamples: 20, ..USUAL }).1 >= 20);
    assert_eq!(filled(&points, &f, Tolerance { maxpixeldist: 1e-6, ..USUAL }).1, 17 * 13);
    assert_eq!(filled(&points, &f, Tolerance { minsamples: usize::MAX, ..USUAL }).1, 4 + 15 * 11);
}

#[test]
fn interpolation_errors_follow_the_error_bound() {
    let points = flat(65, 65, [0.0, 0.0], [2.0, 2.0]);
    let f = |p: Vec3| 1.0 + (1.5 * p.x).sin() * p.y.cos() * 0.5;
    let mut many = 0;
    for maxerror in [0.5, 0.25, 0.1] {
        let (known, records) = filled(&points, &f, Tolerance { maxerror, ..USUAL });
        let error = known
            .iter()
            .zip(&points.p)
            .map(|(k, p)| (k.as_ref().unwrap().value[0] - f(*p)).abs())
            .fold(0.0, f32::max);
        assert!(error < maxerror * maxerror && records >= many, "{maxerror}: {error}");
        many = records;
    }
    assert!(many < 65 * 65 / 2, "{many}");
}

#[test]
fn shared_edges_are_interpolated_alike_from_both_grids() {
    // Two grids of different fineness lie side by side, one of them reversed. Their shared edge has points of its
    // own.
    let f = |p: Vec3| 1.0 + (4.0 * p.x * p.y).sin();
    let left = flat(9, 17, [0.0, 0.0], [1.0, 2.0]);
    let mut right = flat(33, 17, [1.0, 0.0], [3.0, 2.0]);
    right.p.reverse();
    let (a, b) = (filled(&left, &f, USUAL).0, filled(&right, &f, USUAL).0);
    for j in 0..17 {
        let (one, other) = (j * 9 + 8, (16 - j) * 33 + 32);
        assert_eq!(left.p[one], right.p[other]);
        assert_eq!(a[one].as_ref().unwrap().value, b[other].as_ref().unwrap().value);
    }
}

#[test]
fn repeated_points_of_an_edge_count_once() {
    // Every second point of the lower side coincides with its neighbour, as where a finer grid borders a coarser
    // one.
    let f = |p: Vec3| 1.0 + (4.0 * p.x).sin() * 0.5;
    let coarse = flat(9, 2, [0.0, 0.0], [2.0, -1.0]);
    let mut fine = flat(17, 9, [0.0, 0.0], [2.0, 1.0]);
    for i in 0..8 {
        fine.p[2 * i + 1] = fine.p[2 * i];
    }
    let (a, b) = (filled(&coarse, &f, USUAL).0, filled(&fine, &f, USUAL).0);
    for i in 0..9 {
        assert_eq!(a[i].as_ref().unwrap().value, b[2 * i].as_ref().unwrap().value);
    }
    assert!(b.iter().all(Option::is_some));
}

#[test]
fn lattice_cells_of_different_sizes_join_continuously() {
    // The function varies quickly at one corner, so large cells border small ones. Neighbouring points differ by as
    // much as the function does.
    let points = flat(65, 65, [0.01, 0.01], [1.0, 1.0]);
    let f = |p: Vec3| 1.0 + 0.5 / (0.15 + p.length());
    let (known, records) = filled(&points, &f, USUAL);
    assert!(records > 8 && records < 65 * 65 / 8, "{records}");
    for j in 0..65 {
        for i in 1..65 {
            let at = |i: usize| (known[j * 65 + i].as_ref().unwrap().value[0], f(points.p[j * 65 + i]));
            let ((a, ea), (b, eb)) = (at(i - 1), at(i));
            assert!((a - b).abs() < 1.5 * (ea - eb).abs() + 0.02, "{i} {j}: {a} {b} for {ea} {eb}");
        }
    }
}

#[test]
fn inactive_points_are_skipped() {
    let mut points = flat(9, 9, [0.0, 0.0], [1.0, 1.0]);
    let f = |p: Vec3| 1.0 + p.x;
    for k in [0, 10, 40, 80] {
        points.active[k] = false;
        points.p[k] = Vec3::NAN;
    }
    let (known, records) = filled(&points, &f, USUAL);
    for (k, record) in known.iter().enumerate() {
        assert_eq!(record.is_some(), points.active[k]);
        if let Some(r) = record {
            assert!((r.value[0] - f(points.p[k])).abs() < 1e-5);
        }
    }
    assert!(records < 81);
    let none = Points { active: vec![false; 81], ..points };
    assert_eq!(filled(&none, &f, USUAL).1, 0);
}

#[test]
fn small_grids_are_filled() {
    let f = |p: Vec3| 1.0 + p.x * p.x;
    for (nu, nv) in [(1, 1), (1, 5), (5, 1), (2, 2), (2, 9)] {
        let points = flat(nu, nv, [0.0, 0.0], [1.0, 1.0]);
        let (known, _) = filled(&points, &f, USUAL);
        assert!(known.iter().all(Option::is_some), "{nu} x {nv}");
    }
    // All points coincide, as at a pole.
    let points = flat(5, 4, [1.0, 1.0], [1.0, 1.0]);
    assert!(filled(&points, &f, USUAL).0.iter().all(Option::is_some));
}

#[test]
fn the_rotational_gradient_interpolates_bumps() {
    // Light comes from a sky that is brighter at the top. The irradiance (1 + n . up) / 2 is linear in the normal.
    let mut points = flat(17, 17, [0.0, 0.0], [1.0, 1.0]);
    for (k, n) in points.n.iter_mut().enumerate() {
        *n = Vec3::new(0.1 * (k as f32).sin(), 0.1 * (k as f32 * 1.7).cos(), 1.0).normalize();
    }
    let up = Vec3::new(0.8, 0.0, 0.6);
    let f = |n: Vec3| 0.5 + 0.5 * n.dot(up);
    let (known, records) = Lattice::fill(Kind::Irradiance, &points, USUAL, &mut |wanted| {
        let record = |w: &Wanted| {
            let value = [f(points.n[w.lane as usize]); 3];
            Arc::new(Record { value, rotational: [up * 0.5; 3], ..Record::default() })
        };
        wanted.iter().map(record).collect()
    });
    assert!(records < 30, "{records}");
    for (k, n) in known.iter().zip(&points.n) {
        assert!((k.as_ref().unwrap().value[0] - f(*n)).abs() < 1e-3);
    }
}
