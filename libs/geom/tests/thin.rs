//! Tests of points and curves: widths, facing, ribbons, splitting and invalid input.

mod common;

use common::*;
use granita_base::shape::KnotSpan;
use granita_base::{CurveBasis, ShapeDesc, Vec3};
use granita_geom::{DiceData, SplitDirection, View};
use proptest::prelude::*;

fn toward(v: Vec3) -> impl Fn(usize, Vec3) -> View {
    move |_, _| View { toward: v, pixel: 0.5 }
}

const LINE: [f32; 12] = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0];

fn curves(basis: CurveBasis, ncurves: usize, nverts: usize) -> ShapeDesc {
    ShapeDesc::Curves { basis, ncurves, nverts }
}

#[test]
fn a_straight_curve_is_a_strip_that_faces_the_viewer() {
    let p = params(&[
        ("P", &LINE),
        ("linear float width", &[0.2, 0.4]),
        ("linear float s", &[0.0, 1.0]),
        ("vertex float y", &[0.0, 1.0, 2.0, 3.0]),
    ]);
    let pieces = build(&curves(CurveBasis::Bezier, 1, 4), &p);
    assert!(pieces[0].is_facing() && !pieces[0].must_split());
    assert_eq!(pieces[0].domain(), [0.0, 1.0, 0.0, 1.0]);
    let mut dice = pieces[0].dice(3, 5);
    for direction in [Vec3::X, Vec3::new(1.0, 0.3, -2.0)] {
        dice.turn(&toward(direction));
        check_bounds(&pieces[0], &dice);
        for j in 0..5 {
            let row = &dice.p[0][j * 3..j * 3 + 3];
            let v = j as f32 / 4.0;
            assert!((row[1] - Vec3::new(0.0, 3.0 * v, 0.0)).length() < 1e-6);
            assert!(((row[2] - row[0]).length() - (0.2 + 0.2 * v)).abs() < 1e-6);
            assert!((row[2] - row[0]).dot(direction).abs() < 1e-6);
            assert!(dice.dpdu[j * 3].cross(dice.dpdv[j * 3]).dot(direction) > 0.0);
            assert!((dice.dpdu[j * 3] - (row[2] - row[0])).length() < 1e-6);
        }
    }
    let floats = |name: &str| {
        let var = dice.primvars.iter().find(|v| &*v.name == name).unwrap();
        let DiceData::Floats { values, varying: true } = &var.data else { panic!() };
        values.clone()
    };
    assert_eq!(floats("s")[6], 0.5);
    assert_eq!(floats("y")[6], 1.5);
    assert_eq!((dice.u[2], dice.v[14]), (1.0, 1.0));
}

#[test]
fn curves_with_normals_are_ribbons() {
    let n: Vec<f32> = [[0.0, 0.0, 1.0]; 4].concat();
    let pieces = build(
        &curves(CurveBasis::BSpline, 1, 4),
        &params(&[("P", &LINE), ("vertex normal N", &n), ("width", &[2.0])]),
    );
    assert!(!pieces[0].is_facing());
    let mut dice = pieces[0].dice(2, 3);
    assert!(dice.facing.is_none());
    let before = dice.p.clone();
    dice.turn(&toward(Vec3::X));
    assert_eq!(before, dice.p);
    assert!((dice.p[0][1] - dice.p[0][0]).dot(Vec3::Z).abs() < 1e-6);
    assert!((dice.p[0][1] - dice.p[0][0]).length() > 1.99);
    assert!(dice.dpdu[0].cross(dice.dpdv[0]).z > 0.0);
    assert_eq!(dice.n.as_ref().unwrap()[3], Vec3::Z);
}

#[test]
fn curves_are_measured_where_they_are_diced() {
    let mut random = 1_u32;
    let mut next = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 8) as f32 / (1 << 24) as f32 - 0.5
    };
    let eye = Vec3::new(0.3, 0.4, 5.0);
    let view = |key: usize, p: Vec3| View { toward: eye + Vec3::X * key as f32 - p, pixel: 0.5 };
    for (basis, dim) in [
        (CurveBasis::Bezier, 3),
        (CurveBasis::BSpline, 3),
        (CurveBasis::CatmullRom, 4),
        (CurveBasis::Linear, 3),
        (CurveBasis::Bezier, 4),
    ] {
        let name = if dim == 3 { "vertex point P" } else { "vertex hpoint Pw" };
        let mut points = || -> Vec<f32> {
            (0..21 * dim).map(|i| if i % dim == 3 { 1.0 + next() } else { next() }).collect()
        };
        let (p, q) = (points(), points());
        let widths: Vec<f32> = (0..21).map(|_| next().abs()).collect();
        let keys = [&p, &q]
            .map(|p| params(&[(name, p), ("vertex float width", &widths), ("vertex float y", &widths)]));
        let (pieces, said) = try_build(&curves(basis, 3, 7), &keys.each_ref(), None);
        assert!(said.is_empty(), "{said:?}");
        for piece in diceable(pieces.unwrap()) {
            let mut dice = piece.dice(2, 6);
            let sides = Default::default();
            for faces in [false, true] {
                if faces {
                    dice.turn(&view);
                    let turned = piece.dice_towards(2, 6, &sides, &view);
                    assert_eq!((&turned.p, &turned.dpdu, &turned.dpdv), (&dice.p, &dice.dpdu, &dice.dpdv));
                    assert_eq!((&turned.u, &turned.v, &turned.primvars), (&dice.u, &dice.v, &dice.primvars));
                }
                for key in 0..2 {
                    let mut positions = Vec::new();
                    match faces {
                        true => piece.positions_towards(key, 2, 6, &view, &mut positions),
                        false => piece.positions(key, 2, 6, &mut positions),
                    }
                    assert_eq!(bits(&positions), bits(&dice.p[key]), "{basis:?}, key {key}");
                }
            }
            assert!(dice.primvars.iter().any(|v| &*v.name == "y"));
        }
    }
}

#[test]
fn the_bound_of_a_group_of_curves_contains_those_of_its_parts() {
    let p: Vec<f32> = (0..50 * 4 * 3).map(|i| ((i * 7919) % 997) as f32 * 0.01).collect();
    let keys = [&p, &p.iter().map(|x| x * 1.5 - 1.0).collect()]
        .map(|p: &Vec<f32>| params(&[("P", p), ("constant float width", &[0.1])]));
    let (pieces, _) = try_build(&curves(CurveBasis::Bezier, 50, 4), &keys.each_ref(), None);
    let mut stack = pieces.unwrap();
    let mut groups = 0;
    while let Some(piece) = stack.pop() {
        if !piece.is_group() {
            continue;
        }
        let parts = piece.split(SplitDirection::U);
        for key in 0..2 {
            let bound = piece.bound(key);
            let union = parts.iter().map(|part| part.bound(key)).reduce(|a, b| a.union(b)).unwrap();
            // Each bound has room for rounding, which grows with its coordinates.
            assert!(bound.min.cmple(union.min).all() && bound.max.cmpge(union.max).all());
            assert!((bound.max - bound.min).abs_diff_eq(union.max - union.min, 1e-4), "{bound:?} {union:?}");
        }
        groups += 1;
        stack.extend(parts);
    }
    assert_eq!(groups, 49);
}

#[test]
fn a_set_of_curves_splits_into_single_curves() {
    let mut p = Vec::new();
    for i in 0..37 {
        for k in 0..5 {
            p.extend([i as f32, k as f32, (i * k) as f32 * 0.1]);
        }
    }
    let width: Vec<f32> = (0..37).map(|i| i as f32 * 0.01).collect();
    for (basis, per_curve) in [(CurveBasis::Linear, 4), (CurveBasis::CatmullRom, 1), (CurveBasis::BSpline, 1)]
    {
        let list: &[(&str, &[f32])] = &[("P", &p), ("perpiece float width", &width)];
        let pieces = diceable(build(&curves(basis, 37, 5), &params(list)));
        assert_eq!(pieces.len(), 37 * per_curve);
        let mut faces: Vec<u32> = pieces
            .iter()
            .map(|piece| {
                let mut dice = piece.dice(2, 7);
                dice.turn(&toward(Vec3::new(1.0, 2.0, 3.0)));
                check_bounds(piece, &dice);
                let across = (dice.p[0][1] - dice.p[0][0]).length();
                assert!((across - width[dice.face as usize]).abs() < 1e-5);
                dice.face
            })
            .collect();
        faces.sort_unstable();
        faces.dedup();
        assert_eq!(faces.len(), 37);
        // Segments of one curve share their ends, also at kinks.
        if per_curve > 1 {
            let ends = |f: usize| -> Vec<_> {
                pieces
                    .iter()
                    .flat_map(|piece| {
                        let dice = piece.dice(2, 4);
                        [bits(&dice.p[0][..2]), bits(&dice.p[0][6..])].into_iter().skip(f).take(1)
                    })
                    .collect()
            };
            let (starts, stops) = (ends(0), ends(1));
            assert_eq!(stops.iter().filter(|e| starts.contains(e)).count(), 37 * 3);
        }
    }
}

#[test]
fn nurbs_curves_follow_their_knots() {
    let span = KnotSpan { n: 3, order: 3, knots: [0.0, 0.0, 0.0, 2.0, 2.0, 2.0].into(), min: 0.0, max: 2.0 };
    let h = std::f32::consts::FRAC_1_SQRT_2;
    let pw = [1.0, 0.0, 0.0, 1.0, h, h, 0.0, h, 0.0, 1.0, 0.0, 1.0];
    let shape = ShapeDesc::NurbsCurves { ncurves: 1, span };
    let pieces = build(&shape, &params(&[("vertex hpoint Pw", &pw), ("width", &[0.5])]));
    let dice = pieces[0].dice(3, 9);
    for j in 0..9 {
        let p = dice.p[0][j * 3 + 1];
        assert!((p.length() - 1.0).abs() < 1e-6);
        assert!(dice.dpdv[j * 3 + 1].dot(p).abs() < 1e-5);
        assert!((dice.p[0][j * 3].length() - dice.p[0][j * 3 + 2].length()).abs() > 0.49);
    }
    assert_eq!(dice.v[26], 2.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn split_curves_stay_equal_and_inside_their_bounds(values in prop::collection::vec(-5.0_f32..5.0, 21), width in 0.0_f32..2.0, which in 0_usize..3) {
        let basis = [CurveBasis::Bezier, CurveBasis::BSpline, CurveBasis::CatmullRom][which];
        let p = params(&[("P", &values), ("width", &[width])]);
        let piece = build(&curves(basis, 1, 7), &p).remove(0);
        let whole = piece.dice(3, 33);
        check_bounds(&piece, &whole);
        let halves = piece.split(SplitDirection::V);
        prop_assert_eq!(halves.len(), 2);
        for half in &halves {
            let mut dice = half.dice(3, 9);
            dice.turn(&toward(Vec3::new(0.2, -0.4, 0.9)));
            check_bounds(half, &dice);
            for quarter in half.split(SplitDirection::U) {
                check_bounds(&quarter, &quarter.dice(4, 4));
            }
        }
        let join = bits(&halves[0].dice(3, 9).p[0][24..]);
        prop_assert_eq!(join, bits(&halves[1].dice(3, 5).p[0][..3]));
    }
}

#[test]
fn particles_are_disks_that_face_the_viewer() {
    let p: Vec<f32> = (0..30).flat_map(|i| [i as f32, (i * i % 7) as f32, 0.0]).collect();
    let width: Vec<f32> = (0..30).map(|i| 0.1 + i as f32 * 0.1).collect();
    let list: &[(&str, &[f32])] =
        &[("P", &p), ("vertex float width", &width), ("vertex color C", &p), ("float a", &[3.0])];
    let pieces = diceable(build(&ShapeDesc::Points { n: 30 }, &params(list)));
    assert_eq!(pieces.len(), 30);
    for piece in &pieces {
        let mut dice = piece.dice(9, 9);
        let direction = Vec3::new(1.0, 2.0, -1.0);
        dice.turn(&toward(direction));
        check_bounds(piece, &dice);
        let i = dice.face as usize;
        let centre = Vec3::new(p[i * 3], p[i * 3 + 1], p[i * 3 + 2]);
        for border in borders(&dice) {
            for p in border {
                assert!(((p - centre).length() - width[i] * 0.5).abs() < 1e-5);
                assert!((p - centre).dot(direction).abs() < 1e-5);
            }
        }
        let n = dice.dpdu[0].cross(dice.dpdv[0]).normalize();
        assert!((n - direction.normalize()).length() < 1e-5);
        let small = piece.dice(2, 2);
        check_bounds(piece, &small);
        let area = (small.p[0][1] - small.p[0][0]).length() * (small.p[0][2] - small.p[0][0]).length();
        let disk = std::f32::consts::PI * width[i] * width[i] * 0.25;
        assert!((area / disk - 1.0).abs() < 1e-4);
        let c = dice.primvars.iter().find(|v| &*v.name == "C").unwrap();
        assert_eq!(c.data, DiceData::Floats { values: p[i * 3..i * 3 + 3].to_vec(), varying: false });
        for half in piece.split(SplitDirection::U) {
            check_bounds(&half, &half.dice(5, 5));
        }
    }
}

#[test]
fn raster_widths_are_multiples_of_a_pixel() {
    let list: &[(&str, &[f32])] = &[("P", &[1.0, 2.0, 3.0]), ("float rasterwidth", &[4.0])];
    let piece = build(&ShapeDesc::Points { n: 1 }, &params(list)).remove(0);
    assert!(piece.raster_width() >= 4.0 && piece.bound(0).size().max_element() < 1e-5);
    let mut out = Vec::new();
    piece.positions_towards(0, 5, 5, &toward(Vec3::Z), &mut out);
    // The width is four pixels of half a unit each.
    let far = out.iter().map(|p| (*p - Vec3::new(1.0, 2.0, 3.0)).length()).fold(0.0, f32::max);
    assert!((far - 1.0).abs() < 1e-5);
}

#[test]
fn moving_particles_keep_their_frame() {
    let shape = ShapeDesc::Points { n: 1 };
    let (a, b) =
        (params(&[("P", &[0.0; 3]), ("width", &[1.0])]), params(&[("P", &[1.0; 3]), ("width", &[3.0])]));
    let (pieces, said) = try_build(&shape, &[&a, &b], None);
    assert!(said.is_empty());
    let mut dice = pieces.unwrap()[0].dice(2, 2);
    dice.turn(&|key, _| View {
        toward: Vec3::new(1.0, 0.1, if key == 0 { 1e-3 } else { -1e-3 }),
        pixel: 1.0,
    });
    for i in 0..4 {
        let (x, y) = (dice.p[0][i], (dice.p[1][i] - Vec3::ONE) / 3.0);
        assert!((x - y).length() < 1e-2, "{x} {y}");
    }
}

#[test]
fn invalid_curves_and_points_are_reported_and_skipped() {
    let count = |shape: &ShapeDesc, list: &[(&str, &[f32])]| {
        let (pieces, said) = try_build(shape, &[&params(list)], None);
        (pieces.map(|p| diceable(p).len()), said.len())
    };
    let nan = [f32::NAN, 0.0, 0.0, 1.0, 1.0, 1.0];
    assert_eq!(count(&ShapeDesc::Points { n: 2 }, &[("P", &nan)]), (Ok(1), 1));
    assert_eq!(count(&ShapeDesc::Points { n: 0 }, &[]), (Ok(0), 0));
    assert!(count(&ShapeDesc::Points { n: usize::MAX }, &[("P", &nan)]).0.is_err());
    assert!(count(&ShapeDesc::Points { n: 3 }, &[("P", &nan)]).0.is_err());
    assert_eq!(
        count(&ShapeDesc::Points { n: 2 }, &[("P", &LINE), ("vertex float width", &[1.0])]),
        (Ok(2), 2)
    );
    assert_eq!(
        count(&curves(CurveBasis::Linear, 3, 2), &[("P", &[nan, [0.0; 6], [1.0; 6]].concat())]),
        (Ok(2), 1)
    );
    assert!(count(&curves(CurveBasis::Linear, usize::MAX, 2), &[("P", &LINE)]).0.is_err());
    assert!(count(&curves(CurveBasis::Bezier, 1, 5), &[("P", &LINE)]).0.is_err());
    assert_eq!(count(&curves(CurveBasis::Bezier, 0, 4), &[]), (Ok(0), 0));
    // All vertices are in one place. The curve has no area and must not cause a failure.
    let pieces = build(&curves(CurveBasis::Bezier, 1, 4), &params(&[("P", &[1.0; 12])]));
    let dice = pieces[0].dice(3, 3);
    assert!(dice.p[0].iter().all(|p| p.is_finite()) && dice.dpdu.iter().all(|p| p.is_finite()));
    // Invalid widths are reported.
    for width in [f32::NAN, f32::INFINITY, -1.0, 1e30] {
        let p = params(&[("P", &LINE), ("width", &[width])]);
        let (pieces, said) = try_build(&curves(CurveBasis::Bezier, 1, 4), &[&p], None);
        assert!(said.len() == 1 && said[0].contains("outside 0 to 1e12"), "{said:?}");
        assert!(pieces.unwrap()[0].dice(2, 2).p[0].iter().all(|p| p.is_finite()));
    }
}
