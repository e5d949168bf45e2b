//! Tests of patches, meshes and spheres: closed forms, splitting, bounds, shared edges and invalid input.

mod common;

use common::*;
use granita_base::shape::KnotSpan;
use granita_base::{CurveBasis, ShapeDesc, TrimDesc, Vec3};
use granita_geom::{DiceData, Piece, SplitDirection};
use proptest::prelude::*;

const SPHERE: ShapeDesc = ShapeDesc::Sphere { radius: 2.0, zmin: -2.0, zmax: 2.0, thetamax_deg: 360.0 };

fn patch(u: CurveBasis, v: CurveBasis, nu: usize, nv: usize) -> ShapeDesc {
    ShapeDesc::Patch { u, v, nu, nv }
}

#[test]
fn a_sphere_is_round_and_faces_outward() {
    let pieces = build(&SPHERE, &params(&[]));
    assert_eq!(pieces.len(), 1);
    let dice = pieces[0].dice(17, 9);
    check_bounds(&pieces[0], &dice);
    for i in 0..dice.p[0].len() {
        let p = dice.p[0][i];
        assert!((p.length() - 2.0).abs() < 1e-6);
        let n = dice.dpdu[i].cross(dice.dpdv[i]).normalize();
        assert!((n - p / 2.0).length() < 2e-3, "{n} at {p}");
    }
    // The sphere is closed and the poles are points, to the bit.
    let [bottom, top, left, right] = borders(&dice);
    assert_eq!(left, right);
    assert!(bottom.iter().all(|p| *p == Vec3::new(0.0, 0.0, -2.0)), "{bottom:?}");
    assert!(top.iter().all(|p| *p == Vec3::new(0.0, 0.0, 2.0)));
}

#[test]
fn partial_spheres_have_their_bounds_and_variables() {
    let shape = ShapeDesc::Sphere { radius: 1.0, zmin: 0.0, zmax: 0.5, thetamax_deg: 90.0 };
    let pieces = build(&shape, &params(&[("linear float s", &[0.0, 1.0, 2.0, 3.0])]));
    let dice = pieces[0].dice(3, 3);
    let b = pieces[0].bound(0);
    assert!((b.max - Vec3::new(1.0, 1.0, 0.5)).length() < 1e-5, "{b:?}");
    assert!((b.min - Vec3::ZERO).length() < 1e-5);
    assert_eq!(dice.p[0][0], Vec3::X);
    let DiceData::Floats { values, varying: true } = &dice.primvars[0].data else { panic!() };
    assert_eq!(values[4], 1.5);
    assert_eq!((dice.u[1], dice.v[3]), (0.5, 0.5));
    // The sphere is turned inside out by zmax < zmin.
    let shape = ShapeDesc::Sphere { radius: 1.0, zmin: 1.0, zmax: -1.0, thetamax_deg: 360.0 };
    let dice = build(&shape, &params(&[]))[0].dice(5, 5);
    assert!(dice.dpdu[12].cross(dice.dpdv[12]).dot(dice.p[0][12]) < 0.0);
}

#[test]
fn a_bilinear_patch_equals_its_closed_form() {
    let p = params(&[
        ("vertex point P", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 1.0, 2.0, 4.0]),
        ("vertex float a", &[0.0, 1.0, 2.0, 3.0]),
        ("linear color b", &[0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0]),
        ("float c", &[7.0]),
    ]);
    let pieces = build(&patch(CurveBasis::Linear, CurveBasis::Linear, 2, 2), &p);
    let dice = pieces[0].dice(5, 3);
    let at = 5 + 1;
    assert_eq!((dice.u[at], dice.v[at]), (0.25, 0.5));
    assert_eq!(dice.p[0][at], Vec3::new(0.25, 1.0, 0.5));
    assert_eq!(dice.dpdu[at], Vec3::new(1.0, 0.0, 2.0));
    assert_eq!(dice.dpdv[at], Vec3::new(0.0, 2.0, 1.0));
    let floats = |name: &str| {
        let var = dice.primvars.iter().find(|v| &*v.name == name).unwrap();
        match &var.data {
            DiceData::Floats { values, varying } => (values.clone(), *varying),
            DiceData::Strings(_) => panic!(),
        }
    };
    assert_eq!(floats("a").0[at], 0.25 + 1.0);
    let (b, varying) = floats("b");
    assert!(varying && b.len() == 45 && (b[at], b[15 + at], b[30 + at]) == (0.25, 0.5, 0.75));
    assert_eq!(floats("c"), (vec![7.0], false));
}

#[test]
fn nurbs_cylinder_of_the_reference_is_round() {
    let pw = [
        1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 2.0, -1.0, 1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0,
        -1.0, -1.0, 0.0, 1.0, 0.0, -2.0, 0.0, 2.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, -3.0,
        1.0, 1.0, 1.0, -3.0, 1.0, 0.0, 2.0, -6.0, 2.0, -1.0, 1.0, -3.0, 1.0, -1.0, 0.0, -3.0, 1.0, -1.0,
        -1.0, -3.0, 1.0, 0.0, -2.0, -6.0, 2.0, 1.0, -1.0, -3.0, 1.0, 1.0, 0.0, -3.0, 1.0,
    ];
    let shape = ShapeDesc::Nurbs {
        u: KnotSpan {
            n: 9,
            order: 3,
            knots: [0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0].into(),
            min: 0.0,
            max: 4.0,
        },
        v: KnotSpan { n: 2, order: 2, knots: [0.0, 0.0, 1.0, 1.0].into(), min: 0.0, max: 1.0 },
    };
    let pieces = diceable(build(&shape, &params(&[("vertex hpoint Pw", &pw)])));
    assert_eq!(pieces.len(), 4);
    for (i, piece) in pieces.iter().enumerate() {
        assert_eq!(piece.domain(), [i as f32, i as f32 + 1.0, 0.0, 1.0]);
        let dice = piece.dice(9, 3);
        check_bounds(piece, &dice);
        for (k, p) in dice.p[0].iter().enumerate() {
            // The weights of the example do not give a circle, but a curve between the diamond and the square.
            let r = p.truncate().length();
            assert!((0.7..1.42).contains(&r), "{r}");
            let n = dice.dpdu[k].cross(dice.dpdv[k]);
            assert!(n.length() > 0.1);
        }
    }
    assert_eq!(shared_borders(&pieces, 9).0, shared_borders(&pieces, 9).1);
}

#[test]
fn rational_quarter_circle_is_exact() {
    let h = std::f32::consts::FRAC_1_SQRT_2;
    let pw: Vec<f32> = [
        [1.0, 0.0, 0.0, 1.0],
        [h, h, 0.0, h],
        [0.0, 1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0, 1.0],
        [h, h, h, h],
        [0.0, 1.0, 1.0, 1.0],
    ]
    .concat();
    let span = |n: usize, order: usize, knots: &[f32]| KnotSpan {
        n,
        order,
        knots: knots.into(),
        min: 0.0,
        max: 1.0,
    };
    let shape = ShapeDesc::Nurbs {
        u: span(3, 3, &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
        v: span(2, 2, &[0.0, 0.0, 1.0, 1.0]),
    };
    // A vertex variable equal to x must stay equal to x, also with weights.
    let x: Vec<f32> = vec![1.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    let pieces = build(&shape, &params(&[("vertex hpoint Pw", &pw), ("vertex float x", &x)]));
    let dice = pieces[0].dice(11, 2);
    let DiceData::Floats { values, .. } = &dice.primvars[0].data else { panic!() };
    for (i, p) in dice.p[0].iter().enumerate() {
        assert!((p.truncate().length() - 1.0).abs() < 1e-6);
        assert!(dice.dpdu[i].dot(p.with_z(0.0)).abs() < 1e-5);
        assert!((values[i] - p.x).abs() < 1e-6);
    }
    // The bounds of a tiny part are tiny too.
    let mut piece = build(&shape, &params(&[("vertex hpoint Pw", &pw)])).remove(0);
    for _ in 0..8 {
        piece = piece.split(SplitDirection::U).remove(0);
        check_bounds(&piece, &piece.dice(7, 3));
    }
    assert!(piece.bound(0).size().y < 0.01);
}

/// A patch mesh with random vertices.
fn any_patch() -> impl Strategy<Value = (ShapeDesc, Vec<f32>)> {
    let basis = prop_oneof![
        Just((CurveBasis::Linear, 4)),
        Just((CurveBasis::Bezier, 7)),
        Just((CurveBasis::BSpline, 6)),
        Just((CurveBasis::CatmullRom, 5)),
    ];
    (basis.clone(), basis).prop_flat_map(|((bu, nu), (bv, nv))| {
        let values = prop::collection::vec(-10.0_f32..10.0, nu * nv * 3);
        (Just(patch(bu, bv, nu, nv)), values)
    })
}

/// Checks that the halves of a piece have the points of the whole, to the bit, and valid bounds.
fn check_split(piece: &Piece) {
    let n = 17;
    let whole = piece.dice(n, n);
    for direction in [SplitDirection::U, SplitDirection::V] {
        let halves = piece.split(direction);
        assert_eq!(halves.len(), 2);
        for (k, half) in halves.iter().enumerate() {
            let (nu, nv) = if direction == SplitDirection::U { (9, n) } else { (n, 9) };
            let part = half.dice(nu, nv);
            check_bounds(half, &part);
            for at in 0..nu * nv {
                let (i, j) = (at % nu + k * (n - nu), at / nu + k * (n - nv));
                let same = j * n + i;
                assert_eq!(bits(&part.p[0][at..=at]), bits(&whole.p[0][same..=same]));
                assert_eq!((part.u[at], part.v[at]), (whole.u[same], whole.v[same]));
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn split_patches_stay_inside_bounds_and_share_borders((shape, values) in any_patch()) {
        let pieces = diceable(build(&shape, &params(&[("vertex point P", &values)])));
        for piece in pieces.iter().take(4) {
            check_bounds(piece, &piece.dice(8, 8));
            check_split(piece);
        }
        for n in [2, 5, 8] {
            let (pairs, agree) = shared_borders(&pieces, n);
            prop_assert!(pairs > 0 && pairs == agree, "{pairs} {agree}");
        }
    }

    #[test]
    fn parts_of_a_sphere_equal_the_whole(u in 0_usize..4, v in 0_usize..4, zmin in -2.0_f32..0.0, theta in 1.0_f32..360.0) {
        let shape = ShapeDesc::Sphere { radius: 2.0, zmin, zmax: 2.0, thetamax_deg: theta };
        let mut piece = build(&shape, &params(&[])).remove(0);
        check_split(&piece);
        for _ in 0..u { piece = piece.split(SplitDirection::U).pop().unwrap(); }
        for _ in 0..v { piece = piece.split(SplitDirection::V).remove(0); }
        check_bounds(&piece, &piece.dice(9, 9));
        check_split(&piece);
    }
}

#[test]
fn neighbouring_bezier_patches_share_borders_in_any_direction() {
    // The two patches are separate and share a border that runs in the opposite direction in the second.
    let a: Vec<[f32; 3]> =
        (0..16).map(|i| [(i % 4) as f32 * 1.1, (i / 4) as f32 * 0.9, ((i * 7) % 5) as f32 * 0.37]).collect();
    let mut b = a.clone();
    for j in 0..4 {
        for i in 0..4 {
            // Row 0 of b is column 3 of a, reversed.
            b[j * 4 + i] = a[(3 - i) * 4 + 3];
            b[j * 4 + i][0] += j as f32 * 1.3;
        }
    }
    let shape = patch(CurveBasis::Bezier, CurveBasis::Bezier, 4, 4);
    let mut pieces = build(&shape, &params(&[("P", &a.concat())]));
    pieces.extend(build(&shape, &params(&[("P", &b.concat())])));
    for n in [2, 3, 7, 16, 33] {
        assert_eq!(shared_borders(&pieces, n), (1, 1));
    }
}

#[test]
fn collapsed_edges_have_normals() {
    // The shape is a cone. Its row v = 1 is one point, as in the lid of the teapot.
    let mut p = Vec::new();
    for j in 0..4 {
        let s = 1.0 - j as f32 / 3.0;
        for [x, y] in [[1.0, 0.0], [1.0, 0.55], [0.55, 1.0], [0.0, 1.0]] {
            p.extend([x * s, y * s, j as f32]);
        }
    }
    let pieces = build(&patch(CurveBasis::Bezier, CurveBasis::Bezier, 4, 4), &params(&[("P", &p)]));
    let dice = pieces[0].dice(5, 5);
    for i in 20..25 {
        let n = dice.dpdu[i].cross(dice.dpdv[i]);
        assert!(n.length() > 0.0 && n.is_finite());
        assert!(n.normalize().x > 0.0 || n.normalize().y > 0.0);
        let before = dice.dpdu[i - 5].cross(dice.dpdv[i - 5]).normalize();
        assert!(n.normalize().dot(before) > 0.99, "{n} {before}");
    }
}

#[test]
fn deformation_keeps_all_keys() {
    let (a, b) = ([0.0; 12], [1.0; 12]);
    let shape = patch(CurveBasis::Linear, CurveBasis::Linear, 2, 2);
    let (pieces, _) = try_build(&shape, &[&params(&[("P", &a)]), &params(&[("P", &b)])], None);
    let piece = pieces.unwrap().remove(0);
    assert_eq!(piece.key_times(), [0.0, 1.0]);
    let dice = piece.dice(2, 2);
    assert_eq!((dice.p[0][3], dice.p[1][3]), (Vec3::ZERO, Vec3::ONE));
    let mut out = Vec::new();
    piece.positions(1, 3, 2, &mut out);
    assert_eq!(out, vec![Vec3::ONE; 6]);
    assert_eq!(piece.split(SplitDirection::V)[0].key_times().len(), 2);
}

#[test]
fn a_trimmed_patch_masks_its_micropolygons() {
    let trim = TrimDesc {
        ncurves: [1].into(),
        n: [5].into(),
        order: [2].into(),
        knots: [0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 4.0].into(),
        min: [0.0].into(),
        max: [4.0].into(),
        uvw: [0.25, 0.25, 1.0, 0.75, 0.25, 1.0, 0.75, 0.75, 1.0, 0.25, 0.75, 1.0, 0.25, 0.25, 1.0].into(),
    };
    let p = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    let (pieces, said) = try_build(
        &patch(CurveBasis::Linear, CurveBasis::Linear, 2, 2),
        &[&params(&[("P", &p)])],
        Some(&trim),
    );
    assert!(said.is_empty());
    let mask = pieces.unwrap()[0].dice(9, 9).mask.unwrap().micropolygons(9);
    assert_eq!(mask.len(), 64);
    assert_eq!(mask.iter().filter(|kept| !**kept).count(), 16);
}

/// Returns a cube with faces of 4 corners.
fn cube() -> (ShapeDesc, Vec<f32>) {
    let p: Vec<f32> =
        (0..8).flat_map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| b as f32 * 1.7 + 0.1)).collect();
    let verts = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
    (ShapeDesc::Mesh { subdivide: false, nverts: [4; 6].into(), verts: verts.into() }, p)
}

#[test]
fn cube_faces_point_outward_and_share_edges() {
    let (shape, p) = cube();
    let face: Vec<f32> = (0..6).map(|i| i as f32).collect();
    let corner: Vec<f32> = (0..24).map(|i| i as f32).collect();
    let list: &[(&str, &[f32])] = &[
        ("P", &p),
        ("perpiece float face", &face),
        ("linear float corner", &corner),
        ("vertex normal N", &p),
    ];
    let pieces = diceable(build(&shape, &params(list)));
    assert_eq!(pieces.len(), 6);
    for piece in &pieces {
        let dice = piece.dice(3, 3);
        check_bounds(piece, &dice);
        let n = dice.dpdu[4].cross(dice.dpdv[4]);
        assert!(n.dot(dice.p[0][4] - Vec3::splat(0.95)) > 0.0);
        assert!((dice.n.as_ref().unwrap()[4] - dice.p[0][4]).length() < 1e-6);
        let floats = |name: &str| {
            let var = dice.primvars.iter().find(|v| &*v.name == name).unwrap();
            let DiceData::Floats { values, .. } = &var.data else { panic!() };
            values.clone()
        };
        assert_eq!(floats("face"), [dice.face as f32]);
        let first = dice.face as f32 * 4.0;
        let corners = floats("corner");
        assert_eq!([corners[0], corners[2], corners[8], corners[6]], [0.0, 1.0, 2.0, 3.0].map(|c| first + c));
    }
    for n in [2, 3, 6, 17] {
        assert_eq!(shared_borders(&pieces, n), (12, 12));
    }
}

#[test]
fn polygons_of_many_corners_are_covered() {
    // The faces are a concave pentagon, a triangle and a hexagon.
    let p = [
        [0.0, 0.0, 0.0],
        [4.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [4.0, 4.0, 0.0],
        [0.0, 4.0, 0.0],
        [5.0, 2.0, 0.0],
    ];
    let verts = [0, 1, 2, 3, 4, 1, 5, 2];
    let shape = ShapeDesc::Mesh { subdivide: false, nverts: [5, 3].into(), verts: verts.into() };
    let pieces = diceable(build(&shape, &params(&[("P", &p.concat())])));
    assert_eq!(pieces.len(), 4);
    let mut area = 0.0;
    for piece in &pieces {
        let dice = piece.dice(2, 2);
        let d = |i: usize, j: usize| dice.p[0][j] - dice.p[0][i];
        area += 0.5 * d(0, 1).cross(d(0, 3)).z + 0.5 * d(0, 3).cross(d(0, 2)).z;
        for i in 0..4 {
            assert!(dice.dpdu[i].cross(dice.dpdv[i]).z > 0.0);
        }
    }
    assert!((area - (10.0 + 3.5)).abs() < 1e-4, "{area}");
}

#[test]
fn invalid_meshes_are_reported_and_skipped() {
    let (shape, p) = cube();
    let ShapeDesc::Mesh { verts, .. } = &shape else { panic!() };
    let with = |nverts: &[i32], verts: &[i32]| ShapeDesc::Mesh {
        subdivide: false,
        nverts: nverts.into(),
        verts: verts.into(),
    };
    let count = |shape: &ShapeDesc, list: &[(&str, &[f32])]| {
        let (pieces, said) = try_build(shape, &[&params(list)], None);
        (pieces.map(|p| diceable(p).len()), said.len())
    };
    let good: &[(&str, &[f32])] = &[("P", &p)];
    assert_eq!(count(&shape, good), (Ok(6), 0));
    assert_eq!(count(&shape, &[("vertex normal P", &p)]), (Ok(6), 1));
    // The cases are an index past the end, a negative index, too few corners, faces of two corners, and no faces.
    let mut bad = verts.to_vec();
    bad[5] = 8;
    assert_eq!(count(&with(&[4; 6], &bad), good), (Ok(5), 1));
    bad[5] = -1;
    assert_eq!(count(&with(&[4; 6], &bad), good), (Ok(5), 1));
    assert_eq!(count(&with(&[4; 7], verts), good), (Ok(6), 1));
    assert_eq!(count(&with(&[4, i32::MAX, -3], verts), good), (Ok(1), 1));
    assert_eq!(count(&with(&[2; 12], verts), good), (Ok(0), 1));
    assert_eq!(count(&with(&[], &[]), good), (Ok(0), 0));
    // Faces with vertices that are not finite are left out.
    let mut nan = p.clone();
    nan[0] = f32::NAN;
    assert_eq!(count(&shape, &[("P", &nan)]), (Ok(3), 1));
    // Variables of a wrong size are left out.
    for name in ["vertex color C", "linear float s", "perpiece float s", "float[3] a"] {
        assert_eq!(count(&shape, &[("P", &p), (name, &[1.0, 2.0])]), (Ok(6), 1), "{name}");
    }
    // The cases are no positions, and too few positions at another key.
    assert!(count(&shape, &[]).0.is_err());
    let (pieces, _) = try_build(&shape, &[&params(good), &params(&[("P", &p[..21])])], None);
    assert!(pieces.is_err());
    // The cases are patches with wrong counts, numbers and sizes.
    let bilinear = patch(CurveBasis::Linear, CurveBasis::Linear, 2, 2);
    assert_eq!(count(&bilinear, &[("P", &p[..12])]), (Ok(1), 0));
    assert_eq!(count(&bilinear, &[("P", &p)]), (Ok(1), 1));
    assert!(count(&bilinear, &[("P", &p[..9])]).0.is_err());
    assert!(count(&bilinear, &[("P", &nan[..12])]).0.is_err());
    assert!(count(&patch(CurveBasis::Bezier, CurveBasis::Linear, 5, 2), good).0.is_err());
    assert!(count(&patch(CurveBasis::Linear, CurveBasis::Linear, 1, 4), good).0.is_err());
    let huge = patch(CurveBasis::Linear, CurveBasis::BSpline, 4, 4);
    assert!(count(&huge, good).0.is_err());
    // The cases are invalid spheres.
    let ball = |radius, zmin, zmax, thetamax_deg| ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg };
    assert!(count(&ball(f32::NAN, -1.0, 1.0, 360.0), &[]).0.is_err());
    assert_eq!(count(&ball(0.0, -1.0, 1.0, 360.0), &[]), (Ok(0), 1));
    assert_eq!(count(&ball(1.0, 0.5, 0.5, 360.0), &[]), (Ok(0), 1));
    assert_eq!(count(&ball(1.0, -1.0, 1.0, 360.0), &[("vertex float a", &[1.0])]), (Ok(1), 1));
}

#[test]
fn holes_are_not_drawn() {
    let (shape, p) = cube();
    let mut params = params(&[("P", &p)]);
    params.set(granita_base::Param::declared("int[2] holes", &[1, 4][..]).unwrap());
    let pieces = diceable(build(&shape, &params));
    let mut faces: Vec<u32> = pieces.iter().map(|p| p.dice(2, 2).face).collect();
    faces.sort_unstable();
    assert_eq!(faces, [0, 2, 3, 5]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn star_shaped_polygons_are_covered(radii in prop::collection::vec(0.2_f32..3.0, 3..24), tilt in -1.0_f32..1.0) {
        let n = radii.len();
        let p: Vec<f32> = radii.iter().enumerate().flat_map(|(i, r)| {
            let t = i as f32 / n as f32 * std::f32::consts::TAU;
            [r * t.cos(), r * t.sin(), tilt * r * t.cos()]
        }).collect();
        let verts: Vec<i32> = (0..n as i32).collect();
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: [n as i32].into(), verts: verts.into() };
        let (mut area, mut whole) = (0.0, 0.0);
        for piece in diceable(build(&shape, &params(&[("P", &p)]))) {
            let dice = piece.dice(2, 2);
            let d = |i: usize, j: usize| dice.p[0][j] - dice.p[0][i];
            for part in [d(0, 1).cross(d(0, 3)).z, d(0, 3).cross(d(0, 2)).z] {
                prop_assert!(part > -1e-4);
                area += 0.5 * part;
            }
            check_split(&piece);
        }
        for i in 0..n {
            let (a, b) = (i * 3, (i + 1) % n * 3);
            whole += 0.5 * (p[a] * p[b + 1] - p[a + 1] * p[b]);
        }
        prop_assert!((area - whole).abs() < 1e-3 * whole.abs(), "{} {}", area, whole);
    }
}

#[test]
fn facets_of_flat_meshes_equal_the_diced_ones() {
    // The faces are a quadrilateral, a triangle, a concave face and one of five corners.
    let p: Vec<f32> = (0..17_u32)
        .flat_map(|i| {
            let corner = |n: u32, k: u32, dent: bool| {
                let t = k as f32 / n as f32 * std::f32::consts::TAU;
                let r = if dent && k == 1 { -0.5 } else { 1.0 };
                [r * t.cos() + 3.0 * n as f32, r * t.sin(), 0.1 * k as f32]
            };
            match i {
                0..4 => corner(4, i, false),
                4..7 => corner(3, i - 4, false),
                7..11 => corner(4, i - 7, true),
                _ => corner(5, (i - 11).min(4), false),
            }
        })
        .collect();
    let params = params(&[("vertex point P", &p[..])]);
    let nverts = [4, 3, 4, 5];
    let shape = ShapeDesc::Mesh { subdivide: false, nverts: nverts.into(), verts: (0..16).collect() };
    let keys = [granita_geom::ShapeKey { time: 0.0, params: &params }];
    let pieces = granita_geom::build(&shape, &keys, None, &mut |_, _| {}).unwrap();
    let n = pieces[0].facets();
    assert_eq!(n, 1 + 1 + 2 + 3);
    for k in 0..n {
        let piece = pieces[0].facet_piece(k).unwrap();
        assert_eq!(piece.facets(), 1);
        assert_eq!(piece.dice(2, 2).p[0], pieces[0].facet(k, 0));
    }
    assert!(pieces[0].facet_piece(n).is_none());
    let ball = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
    let none = granita_geom::build(&ball, &keys, None, &mut |_, _| {}).unwrap();
    assert_eq!(none[0].facets(), 0);
}
