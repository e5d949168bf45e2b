//! Tests of Catmull-Clark meshes against B-splines and limit positions, with borders, shared edges and invalid input.

mod common;

use common::*;
use granita_base::{CurveBasis, Param, Params, ShapeDesc, Vec3};
use granita_geom::{DiceData, Piece, SplitDirection};

fn mesh(nverts: &[i32], verts: &[i32]) -> ShapeDesc {
    ShapeDesc::Mesh { subdivide: true, nverts: nverts.into(), verts: verts.into() }
}

/// Returns a bent grid of `n x n` vertices.
fn grid(n: usize) -> (ShapeDesc, Vec<f32>) {
    let p: Vec<f32> = (0..n * n)
        .flat_map(|k| {
            let (x, y) = ((k % n) as f32, (k / n) as f32);
            [x, y, (x * 1.3).sin() + (y * 0.7 + x).cos()]
        })
        .collect();
    let mut verts = Vec::new();
    for j in 0..n - 1 {
        for i in 0..n - 1 {
            let v = (j * n + i) as i32;
            verts.extend([v, v + 1, v + 1 + n as i32, v + n as i32]);
        }
    }
    (mesh(&vec![4; (n - 1) * (n - 1)], &verts), p)
}

fn with_border(p: &[f32], border: i32) -> Params {
    let mut params = params(&[("P", p)]);
    params.set(Param::declared("int border", border).expect("a declaration"));
    params
}

fn cube() -> (ShapeDesc, Vec<f32>) {
    let p: Vec<f32> =
        (0..8).flat_map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| b as f32 * 2.0 - 1.0)).collect();
    (mesh(&[4; 6], &[0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]), p)
}

#[test]
fn the_subdivided_grid_of_the_reference_is_a_bspline_patch() {
    let (shape, p) = grid(4);
    let pieces = diceable(build(&shape, &params(&[("P", &p), ("vertex float a", &p[..16])])));
    assert_eq!(pieces.len(), 1);
    let patch = ShapeDesc::Patch { u: CurveBasis::BSpline, v: CurveBasis::BSpline, nu: 4, nv: 4 };
    let reference = build(&patch, &params(&[("P", &p), ("vertex float a", &p[..16])]));
    let (a, b) = (pieces[0].dice(9, 7), reference[0].dice(9, 7));
    assert_eq!(a.face, 4);
    for i in 0..63 {
        assert!((a.p[0][i] - b.p[0][i]).length() < 2e-6);
        assert!((a.dpdu[i] - b.dpdu[i]).length() < 1e-5);
        assert!((a.dpdv[i] - b.dpdv[i]).length() < 1e-5);
    }
    let floats = |d: &granita_geom::Dice| match &d.primvars[0].data {
        DiceData::Floats { values, varying: true } => values.clone(),
        _ => panic!(),
    };
    for (x, y) in floats(&a).iter().zip(floats(&b)) {
        assert!((x - y).abs() < 1e-5);
    }
}

#[test]
fn border_modes_place_corners_and_share_edges() {
    let (shape, p) = grid(4);
    let at = |i: usize| Vec3::new(p[i * 3], p[i * 3 + 1], p[i * 3 + 2]);
    for border in [1, 2] {
        let pieces = diceable(build(&shape, &with_border(&p, border)));
        assert_eq!(pieces.len(), 9);
        let (pairs, agree) = shared_borders(&pieces, 9);
        assert!(pairs == 12 && agree == 12, "{pairs} {agree}");
        let first = pieces.iter().find(|p| p.dice(2, 2).face == 0).unwrap();
        check_bounds(first, &first.dice(17, 17));
        let corner = first.dice(3, 3).p[0][0];
        let expected = if border == 1 { at(0) } else { (at(1) + 4.0 * at(0) + at(4)) / 6.0 };
        assert!((corner - expected).length() < 1e-5, "{corner} {expected}");
        // The middle of the border is on the B-spline of the border's vertices.
        let b = (at(0) + 4.0 * at(1) + at(2)) / 6.0;
        assert!((first.dice(3, 3).p[0][2] - b).length() < 1e-5);
    }
    let (pieces, said) = try_build(&shape, &[&with_border(&p, 7)], None);
    assert_eq!((diceable(pieces.unwrap()).len(), said.len()), (1, 1));
}

#[test]
fn a_subdivided_cube_is_closed_and_in_its_limit_positions() {
    let (shape, p) = cube();
    let pieces = diceable(build(&shape, &params(&[("P", &p)])));
    assert_eq!(pieces.len(), 6);
    for n in [2, 3, 9, 12] {
        assert_eq!(shared_borders(&pieces, n), (12, 12));
    }
    for piece in &pieces {
        let dice = piece.dice(9, 9);
        check_bounds(piece, &dice);
        // The limit of a vertex with 3 faces is (9 v + 4 sum of neighbours + sum of opposites) / 24.
        let v = (9.0 + 4.0 - 1.0) / 24.0;
        for k in [0, 8, 72, 80] {
            assert!((dice.p[0][k].abs() - Vec3::splat(v)).length() < 1e-5, "{}", dice.p[0][k]);
        }
        for i in 0..81 {
            let n = dice.dpdu[i].cross(dice.dpdv[i]).normalize();
            assert!(n.dot(dice.p[0][i].normalize()) > 0.8, "{n} {}", dice.p[0][i]);
        }
        // The parts agree with the whole.
        for (k, half) in piece.split(SplitDirection::U).iter().enumerate() {
            let part = half.dice(9, 9);
            let whole = piece.dice(17, 9);
            check_bounds(half, &part);
            for i in 0..81 {
                assert_eq!(part.p[0][i], whole.p[0][i / 9 * 17 + i % 9 + 8 * k]);
            }
        }
    }
}

#[test]
fn faces_of_any_number_of_corners_are_subdivided() {
    // The mesh is a pyramid over a pentagon, with "linear" corners.
    let mut p = vec![0.0, 0.0, 2.0];
    for i in 0..5 {
        let t = i as f32 * std::f32::consts::TAU / 5.0;
        p.extend([t.cos(), t.sin(), 0.0]);
    }
    let verts = [0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5, 0, 5, 1, 5, 4, 3, 2, 1];
    let corner: Vec<f32> = (0..20).map(|i| i as f32).collect();
    let face: Vec<f32> = (0..6).map(|i| i as f32).collect();
    let list: &[(&str, &[f32])] = &[("P", &p), ("linear float c", &corner), ("perpiece float f", &face)];
    let pieces = diceable(build(&mesh(&[3, 3, 3, 3, 3, 5], &verts), &params(list)));
    assert_eq!(pieces.len(), 20);
    // The surface is closed, so that every border of every piece has its partner.
    assert_eq!(shared_borders(&pieces, 5), (40, 40));
    for piece in &pieces {
        let dice = piece.dice(3, 3);
        check_bounds(piece, &dice);
        let values = |name: &str| {
            let var = dice.primvars.iter().find(|v| &*v.name == name).unwrap();
            let DiceData::Floats { values, .. } = &var.data else { panic!() };
            values.clone()
        };
        assert_eq!(values("f"), [dice.face as f32]);
        let c = values("c");
        let range =
            if dice.face == 5 { 15.0..20.0 } else { dice.face as f32 * 3.0..dice.face as f32 * 3.0 + 3.0 };
        assert!(range.contains(&c[0]) && c[0].fract() == 0.0);
        assert!((c[8] - (range.start + range.end - 1.0) * 0.5).abs() < 1e-5);
    }
}

#[test]
fn a_refined_cube_has_the_same_limit_surface() {
    // The surface of a cube that is refined once by hand must be the same.
    let (shape, p) = cube();
    let pieces = build(&shape, &params(&[("P", &p)]));
    let all = |pieces: Vec<Piece>, n: usize| -> Vec<(Vec3, Vec3)> {
        let each = |p: &Piece| {
            let dice = p.dice(n, n);
            let normal = |i: usize| dice.dpdu[i].cross(dice.dpdv[i]).normalize();
            (0..n * n).map(|i| (dice.p[0][i], normal(i))).collect::<Vec<_>>()
        };
        diceable(pieces).iter().flat_map(each).collect()
    };
    // The refined cube has 8 vertices, 12 edge points and 6 face points.
    let vertex = |k: usize| Vec3::new(p[k * 3], p[k * 3 + 1], p[k * 3 + 2]);
    let mut points: Vec<Vec3> = Vec::new();
    let mut index = |q: Vec3| -> i32 {
        match points.iter().position(|p| (*p - q).length() < 1e-6) {
            Some(i) => i as i32,
            None => {
                points.push(q);
                points.len() as i32 - 1
            }
        }
    };
    let ShapeDesc::Mesh { verts, .. } = &shape else { panic!() };
    let mut quads = Vec::new();
    for face in verts.chunks_exact(4) {
        let c: Vec<Vec3> = face.iter().map(|&v| vertex(v as usize)).collect();
        let middle = (c[0] + c[1] + c[2] + c[3]) / 4.0;
        // The edge points of the cube are (a + b + two face points) / 4.
        let edge = |a: Vec3, b: Vec3| (a + b + (a + b) / 2.0) / 4.0;
        for i in 0..4 {
            let corner = c[i] * (5.0 / 9.0);
            let quad = [corner, edge(c[i], c[(i + 1) % 4]), middle, edge(c[i], c[(i + 3) % 4])];
            quads.extend(quad.map(&mut index));
        }
    }
    let p: Vec<f32> = points.iter().flat_map(|p| p.to_array()).collect();
    let finer = build(&mesh(&[4; 24], &quads), &params(&[("P", &p)]));
    let (a, b) = (all(pieces, 17), all(finer, 9));
    let mut worst = (0.0_f32, 1.0_f32);
    for (q, normal) in &a {
        // Points may shift within the surface, so that only distances from it are compared.
        let near = b.iter().min_by(|x, y| (x.0 - *q).length().total_cmp(&(y.0 - *q).length())).unwrap();
        worst.0 = worst.0.max((near.0 - *q).dot(near.1).abs());
        worst.1 = worst.1.min(near.1.dot(*normal));
    }
    assert!(worst.0 < 3e-4 && worst.1 > 0.998, "{worst:?}");
}

#[test]
fn irregular_meshes_give_finite_points() {
    let p = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.5, 0.5, 1.0, 0.5, 0.5, -1.0];
    let cases: &[(&[i32], &[i32])] = &[
        // The meshes have three faces on one edge, faces of opposite windings, a vertex twice in a face, and two fans
        // at one vertex.
        (&[3, 3, 3], &[0, 1, 2, 0, 1, 4, 0, 1, 5]),
        (&[3, 3], &[0, 1, 2, 0, 2, 3]),
        (&[3, 3], &[0, 1, 2, 0, 3, 2]),
        (&[4], &[0, 1, 1, 2]),
        (&[3, 3], &[0, 1, 2, 0, 4, 5]),
        (&[4], &[1, 1, 1, 1]),
        (&[4, 4], &[0, 1, 2, 3, 0, 1, 2, 3]),
    ];
    for (nverts, verts) in cases {
        for border in 0..3 {
            let (pieces, _) = try_build(&mesh(nverts, verts), &[&with_border(&p, border)], None);
            for piece in diceable(pieces.unwrap()) {
                let dice = piece.dice(5, 5);
                check_bounds(&piece, &dice);
                assert!(dice.p[0].iter().chain(&dice.dpdu).all(|p| p.is_finite()));
            }
        }
    }
    let (pieces, _) = try_build(&mesh(&[], &[]), &[&with_border(&p, 1)], None);
    assert!(pieces.unwrap().is_empty());
}

#[test]
fn subdivision_meshes_deform_and_have_holes() {
    let (shape, p) = cube();
    let moved: Vec<f32> = p.iter().map(|x| x * 2.0).collect();
    let mut first = params(&[("P", &p)]);
    first.set(Param::declared("int[2] holes", &[0, 3][..]).unwrap());
    let (pieces, _) = try_build(&shape, &[&first, &params(&[("P", &moved)])], None);
    let pieces = diceable(pieces.unwrap());
    assert_eq!(pieces.len(), 4);
    for piece in &pieces {
        let dice = piece.dice(4, 4);
        check_bounds(piece, &dice);
        for i in 0..16 {
            assert!((dice.p[1][i] - dice.p[0][i] * 2.0).length() < 1e-6);
        }
    }
}

/// Returns a disk of `n` quadrilaterals around vertex 0, whose neighbours are the odd ones: 2n + 1 vertices.
fn disk(n: usize) -> (ShapeDesc, Vec<f32>) {
    let mut p = vec![0.1, -0.2, 0.7];
    for i in 0..2 * n {
        let t = i as f32 * std::f32::consts::PI / n as f32;
        let r = if i % 2 == 0 { 1.0 } else { 1.4 };
        p.extend([r * t.cos(), r * t.sin(), (i as f32 * 0.9).sin() * 0.3]);
    }
    let mut verts = Vec::new();
    for i in 0..n {
        let at = |k: usize| (1 + (2 * i + k) % (2 * n)) as i32;
        verts.extend([0, at(0), at(1), at(2)]);
    }
    (mesh(&vec![4; n], &verts), p)
}

#[test]
fn limit_positions_are_exact_at_any_valence() {
    for n in (3..=12).chain([17, 25, 50]) {
        let (shape, p) = disk(n);
        let at = |i: usize| Vec3::new(p[i * 3], p[i * 3 + 1], p[i * 3 + 2]).as_dvec3();
        // The limit is (n^2 v + 4 sum of neighbours + sum of opposites) / (n (n + 5)).
        let ring = (1..n).fold(at(1) * 4.0 + at(2), |sum, i| sum + at(1 + 2 * i) * 4.0 + at(2 + 2 * i));
        let limit = (at(0) * (n * n) as f64 + ring) / (n * (n + 5)) as f64;
        let pieces = diceable(build(&shape, &with_border(&p, 1)));
        assert_eq!(pieces.len(), n);
        for piece in &pieces {
            let dice = piece.dice(17, 17);
            check_bounds(piece, &dice);
            let corner = dice.p[0][0].as_dvec3();
            assert!((corner - limit).length() < 2e-6, "valence {n}: {corner} is not {limit}");
            assert!(dice.dpdu.iter().zip(&dice.dpdv).all(|(u, v)| u.cross(*v).is_finite()));
            // The tangent plane is the same for all faces around.
            let normal = dice.dpdu[0].cross(dice.dpdv[0]).normalize();
            let first = pieces[0].dice(17, 17);
            let reference = first.dpdu[0].cross(first.dpdv[0]).normalize();
            assert!(normal.dot(reference) > 0.99, "valence {n}: {normal} and {reference}");
        }
        let (pairs, agree) = shared_borders(&pieces, 9);
        assert_eq!((pairs, agree), (n, n), "valence {n}");
    }
}

#[test]
fn borders_follow_the_splines_of_their_vertices() {
    // A border curve is at (a + 4 v + b) / 6 at its vertices, whatever is inside.
    for n in [3, 5, 8, 50] {
        let (shape, p) = disk(n);
        let at = |i: usize| Vec3::new(p[i * 3], p[i * 3 + 1], p[i * 3 + 2]);
        let ring = |i: usize| at(1 + i % (2 * n));
        for border in [1, 2] {
            let pieces = diceable(build(&shape, &with_border(&p, border)));
            for piece in &pieces {
                let dice = piece.dice(3, 3);
                let i = 2 * dice.face as usize;
                let on_spline = |k: usize| (ring(k + 2 * n - 1) + ring(k) * 4.0 + ring(k + 1)) / 6.0;
                // The corners of the lattice are the middle, then those around it.
                assert!((dice.p[0][2] - on_spline(i)).length() < 1e-5, "{n} {border}");
                assert!((dice.p[0][6] - on_spline(i + 2)).length() < 1e-5, "{n} {border}");
                // A vertex of one face is sharp under 1 and round under 2.
                let corner = if border == 1 { ring(i + 1) } else { on_spline(i + 1) };
                assert!((dice.p[0][8] - corner).length() < 1e-5, "{n} {border}");
            }
        }
        assert!(diceable(build(&shape, &with_border(&p, 0))).is_empty(), "all faces are at the border");
    }
}

#[test]
fn edges_of_three_faces_are_reported_and_sharp() {
    let p = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.5, 0.5, 1.0, 0.5, 0.5, -1.0];
    let shape = mesh(&[3, 3, 3], &[0, 1, 2, 1, 0, 3, 0, 1, 4]);
    let (pieces, said) = try_build(&shape, &[&with_border(&p, 1)], None);
    assert_eq!(diceable(pieces.unwrap()).len(), 9);
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("between vertices 0 and 1 with 3"), "{said:?}");
}

#[test]
fn a_vertex_of_a_hundred_thousand_faces_is_subdivided_quickly() {
    let n = 100_000;
    let mut p = vec![0.0, 0.0, 1.0];
    for i in 0..n {
        let t = i as f32 / n as f32 * std::f32::consts::TAU;
        p.extend([t.cos(), t.sin(), 0.0]);
    }
    let verts: Vec<i32> = (0..n as i32).flat_map(|i| [0, 1 + i, 1 + (i + 1) % n as i32]).collect();
    let shape = mesh(&vec![3; n], &verts);
    let pieces = build(&shape, &with_border(&p, 1));
    let bound = pieces[0].bound(0);
    assert!(bound.max.z < 1.01 && bound.min.z > -0.01, "{bound:?}");
}

/// Returns the largest angle (radians) between the normals of two pieces at the same place.
fn largest_kink(pieces: &[Piece]) -> f32 {
    let mut all: Vec<([u32; 3], Vec3)> = Vec::new();
    for piece in pieces {
        let dice = piece.dice(33, 33);
        let normals = dice.dpdu.iter().zip(&dice.dpdv).map(|(u, v)| u.cross(*v).normalize());
        all.extend(bits(&dice.p[0]).into_iter().zip(normals));
    }
    all.sort_by_key(|(place, _)| *place);
    let same = all.chunk_by(|a, b| a.0 == b.0);
    same.map(|same| same.iter().map(|(_, n)| n.angle_between(same[0].1)).fold(0.0, f32::max))
        .fold(0.0, f32::max)
}

#[test]
fn normals_are_continuous_over_edges() {
    let (shape, p) = cube();
    assert!(largest_kink(&diceable(build(&shape, &params(&[("P", &p)])))) < 2e-3);
    // The valences go up to 12, with triangles and pentagons.
    for n in [3, 5, 6, 12] {
        let (shape, p) = disk(n);
        let kink = largest_kink(&diceable(build(&shape, &with_border(&p, 1))));
        assert!(kink < 2e-3, "valence {n}: {kink}");
    }
    let mut p = vec![0.0, 0.0, 2.0];
    for i in 0..5 {
        let t = i as f32 * std::f32::consts::TAU / 5.0;
        p.extend([t.cos(), t.sin(), 0.3 * (i % 2) as f32]);
    }
    let verts = [0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5, 0, 5, 1, 5, 4, 3, 2, 1];
    let kink = largest_kink(&diceable(build(&mesh(&[3, 3, 3, 3, 3, 5], &verts), &params(&[("P", &p)]))));
    assert!(kink < 2e-3, "pyramid: {kink}");
}

/// Returns `n` quadrilaterals around a vertex, over an angle. They are not flat.
fn sector(n: usize, angle: f32) -> (ShapeDesc, Vec<f32>) {
    let mut p = vec![0.0, 0.0, 0.5];
    for i in 0..=2 * n {
        let t = i as f32 / (2 * n) as f32 * angle;
        let r = if i % 2 == 0 { 1.0 } else { 1.3 };
        p.extend([r * t.cos(), r * t.sin(), 0.3 * (i as f32 * 1.7).sin()]);
    }
    let verts: Vec<i32> = (0..n as i32).flat_map(|i| [0, 1 + 2 * i, 2 + 2 * i, 3 + 2 * i]).collect();
    (mesh(&vec![4; n], &verts), p)
}

#[test]
fn normals_are_continuous_over_edges_that_end_at_borders() {
    for border in [1, 2] {
        for (n, angle) in [(2, 3.0), (3, 3.0), (4, 3.3), (5, 2.5), (3, 4.7), (7, 6.0)] {
            let (shape, p) = sector(n, angle);
            let kink = largest_kink(&diceable(build(&shape, &with_border(&p, border))));
            assert!(kink < 2e-3, "{n} faces, border {border}: {kink}");
        }
    }
}
