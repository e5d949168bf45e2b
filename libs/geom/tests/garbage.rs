//! Tests that no declaration causes a panic, and that diced lattices have the requested sizes.

mod common;

use common::*;
use granita_base::shape::KnotSpan;
use granita_base::{CurveBasis, Param, ParamData, Params, ShapeDesc, TrimDesc};
use granita_geom::{DiceData, Piece, SplitDirection};
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -10.0_f32..10.0,
        1 => Just(0.0),
        1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1e38_f32), Just(1e-40_f32)],
    ]
}

fn count() -> impl Strategy<Value = usize> {
    prop_oneof![12 => 0_usize..9, 1 => Just(usize::MAX), 1 => Just(1 << 40)]
}

fn basis() -> impl Strategy<Value = CurveBasis> {
    prop_oneof![
        Just(CurveBasis::Linear),
        Just(CurveBasis::Bezier),
        Just(CurveBasis::BSpline),
        Just(CurveBasis::CatmullRom)
    ]
}

fn span() -> impl Strategy<Value = KnotSpan> {
    let rising = prop::collection::vec(0.0_f32..3.0, 0..14).prop_map(|mut k| {
        k.sort_by(f32::total_cmp);
        k
    });
    let knots = prop_oneof![4 => rising, 1 => prop::collection::vec(number(), 0..14)];
    (knots, 0_usize..6, -1.0_f32..1.0, 0.0_f32..4.0, any::<bool>()).prop_map(
        |(knots, order, min, max, fits)| {
            let n = if fits { knots.len().saturating_sub(order) } else { order + 2 };
            KnotSpan { n, order, knots: knots.into(), min, max }
        },
    )
}

fn shape() -> impl Strategy<Value = ShapeDesc> {
    let index = || prop_oneof![12 => 0_i32..8, 1 => any::<i32>()];
    let faces = prop_oneof![8 => 3_i32..6, 1 => any::<i32>()];
    prop_oneof![
        (basis(), basis(), count(), count()).prop_map(|(u, v, nu, nv)| ShapeDesc::Patch { u, v, nu, nv }),
        (span(), span()).prop_map(|(u, v)| ShapeDesc::Nurbs { u, v }),
        (any::<bool>(), prop::collection::vec(faces, 0..6), prop::collection::vec(index(), 0..24)).prop_map(
            |(subdivide, nverts, verts)| ShapeDesc::Mesh {
                subdivide,
                nverts: nverts.into(),
                verts: verts.into()
            }
        ),
        count().prop_map(|n| ShapeDesc::Points { n }),
        (basis(), count(), count()).prop_map(|(basis, ncurves, nverts)| ShapeDesc::Curves {
            basis,
            ncurves,
            nverts
        }),
        (count(), span()).prop_map(|(ncurves, span)| ShapeDesc::NurbsCurves { ncurves, span }),
        (number(), number(), number(), number()).prop_map(|(radius, zmin, zmax, thetamax_deg)| {
            ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg }
        }),
    ]
}

fn any_params() -> impl Strategy<Value = Params> {
    const NAMES: [&str; 14] = [
        "vertex point P",
        "vertex point P",
        "vertex hpoint Pw",
        "P",
        "vertex normal N",
        "linear normal N",
        "vertex color C",
        "linear float[2] st",
        "perpiece float f",
        "width",
        "vertex float width",
        "linear float width",
        "rasterwidth",
        "int border",
    ];
    let param = (0..NAMES.len(), prop::collection::vec(number(), 0..200), any::<bool>());
    let list = prop::collection::vec(param, 0..5).prop_map(|list| {
        let one = |(name, mut values, long): (usize, Vec<f32>, bool)| {
            if long {
                // The list is long enough and mostly usable, so that something is built.
                values.retain(|x| x.is_finite() && x.abs() < 1e30);
                values.extend((0..300).map(|i| (i * 7 % 11) as f32));
            }
            Param::declared(NAMES[name], &values[..]).expect("a declaration")
        };
        list.into_iter().map(one).collect::<Params>()
    });
    (list, prop::collection::vec(any::<i32>(), 0..3), any::<bool>()).prop_map(|(mut list, holes, strings)| {
        list.0.push(Param::declared("int[3] holes", &holes[..]).expect("a declaration"));
        if strings {
            let words = ParamData::String(vec!["a".into(), "b".into()].into());
            list.0.push(Param::declared("perpiece string s", words).expect("a declaration"));
        }
        list
    })
}

fn any_trim() -> impl Strategy<Value = Option<TrimDesc>> {
    let small = || prop::collection::vec(-1_i32..5, 0..3);
    let floats = |n: usize| prop::collection::vec(number(), 0..n);
    let trim = (small(), small(), small(), floats(16), floats(3), floats(3), floats(24));
    prop::option::of(trim.prop_map(|(ncurves, n, order, knots, min, max, uvw)| TrimDesc {
        ncurves: ncurves.into(),
        n: n.into(),
        order: order.into(),
        knots: knots.into(),
        min: min.into(),
        max: max.into(),
        uvw: uvw.into(),
    }))
}

fn exercise(piece: &Piece, depth: u32) {
    let keys = piece.key_times().len();
    assert!(keys > 0);
    let (nu, nv) = (3, 4);
    let dice = piece.dice(nu, nv);
    let n = nu * nv;
    assert_eq!((dice.nu, dice.nv, dice.p.len()), (nu, nv, keys));
    assert!(dice.p.iter().all(|p| p.len() == n));
    assert_eq!([dice.dpdu.len(), dice.dpdv.len(), dice.u.len(), dice.v.len()], [n; 4]);
    assert!(dice.n.is_none_or(|normals| normals.len() == n));
    assert!(
        dice.mask
            .is_none_or(|mask| mask.outside.len() == (nu - 1) * (nv - 1) * mask.per_side * mask.per_side)
    );
    for var in &dice.primvars {
        match &var.data {
            DiceData::Floats { values, varying } => {
                assert_eq!(values.len(), var.ty.width() * if *varying { n } else { 1 });
            }
            DiceData::Strings(values) => assert_eq!(values.len(), var.ty.width()),
        }
    }
    let mut out = Vec::new();
    piece.positions(keys - 1, nu, nv, &mut out);
    assert_eq!(out.len(), n);
    let _ = (piece.bound(keys - 1), piece.domain(), piece.raster_width());
    if depth == 0 {
        return;
    }
    for direction in [SplitDirection::U, SplitDirection::V] {
        let parts = piece.split(direction);
        assert_eq!(parts.is_empty(), !piece.is_splittable());
        parts.iter().for_each(|part| exercise(part, depth - 1));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn random_primitives_do_not_panic(
        shape in shape(),
        first in any_params(),
        second in prop::option::of(any_params()),
        trim in any_trim(),
    ) {
        let keys: Vec<&Params> = std::iter::once(&first).chain(&second).collect();
        let (pieces, _) = try_build(&shape, &keys, trim.as_ref());
        if let Ok(pieces) = pieces {
            pieces.iter().for_each(|piece| exercise(piece, 2));
        }
    }
}
