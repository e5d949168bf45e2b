//! Grids that are shaded together have the same results, to the bit, as each alone.

use crate::fixture::*;
use granita_base::{BaseType, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_shade::{Grid, Primvar, PrimvarData, Topology, Uneven};

/// Returns a square of this many points at a position that depends on `k`, with a variable for each point and one for
/// all.
fn grid(nu: usize, nv: usize, k: u32) -> Grid {
    let mut grid = square(nu, nv);
    let n = grid.len();
    let shift = k as f32 * 0.37;
    for i in 0..n {
        let p =
            grid.p.get(i) + granita_base::Vec3::new(shift, (i as f32 * 1.3 + shift).sin() * 0.1, shift * 0.2);
        grid.p.set(i, p);
    }
    grid.seed = 77 + k;
    let primvar = |name: &str, values: Vec<f32>, varying: bool| Primvar {
        name: name.into(),
        ty: ParamType::of(BaseType::Float),
        data: PrimvarData::Floats { values, varying },
    };
    grid.primvars = vec![
        primvar("mine", vec![shift], false),
        primvar("each", (0..n).map(|i| i as f32 * 0.01 + shift).collect(), true),
    ];
    if nu > 2 && nv > 2 {
        grid.uneven = vec![Uneven { lane: 1, of: [[0.5, 0.25], [0.0, 2.0]] }];
    }
    grid
}

const SHADERS: [&str; 7] = [
    "r = deltau (each * each) + 10 * deltav (P[1]) + filterwidth (each + mine) + deltau (mine);",
    "point q = P + (vector) N * each; r = samplearea (q) + length (surfacenormal (P)) + dot (normalize (surfacenormal (q)), vector (1, 0, 0));",
    "r = random () + 2 * random () + noise (P * 7);",
    "if (each > 0.5) { r = random () + deltau (each); } r += 10 * random ();",
    "float k = 0; while (k < each * 10) { k += 1; r += random () * k; } r += deltav (r);",
    "displace (0.1 * each); r = N[0] + 10 * N[1] + 100 * P[2];",
    "setmessage (\"m\", each); r = mine > 0.5 ? deltau (P[1]) : deltav (P[1] * each);",
];

#[test]
fn batched_grids_give_the_results_of_single_grids() {
    let grids: Vec<Grid> = [(2, 2), (3, 3), (2, 5), (4, 3), (1, 3), (3, 3)]
        .iter()
        .zip(0..)
        .map(|(&(nu, nv), k)| grid(nu, nv, k))
        .collect();
    for body in SHADERS {
        let kind = if body.contains("displace") { "displacement" } else { "surface" };
        let source =
            format!("{kind} t (float mine = 0, float each = 0, output float r = -1) {{ r = 0; {body} }}");
        let group = link(&[(&source, Params::new())], &[]);
        assert!(!group.is_gridwise() && !group.may_save());
        let run = |part: &[Grid]| {
            let mut grid = Grid::batched(part);
            let values = output(&group, &mut grid, &mut Double::default(), "r", ValueType::Float);
            assert_eq!(values.len(), part.iter().map(Grid::len).sum::<usize>());
            values.into_iter().map(f32::to_bits).collect::<Vec<u32>>()
        };
        let alone: Vec<u32> = grids.iter().flat_map(|grid| run(std::slice::from_ref(grid))).collect();
        assert_eq!(run(&grids), alone, "{body}");
        let pairs: Vec<u32> = grids.chunks(2).flat_map(run).collect();
        assert_eq!(pairs, alone, "{body}");
        assert!(alone.iter().any(|bits| *bits != alone[0]), "{body}");
    }
}

#[test]
fn rectangles_of_batched_grids_have_their_lanes() {
    let grids = [grid(2, 3, 0), grid(3, 3, 1), grid(2, 2, 2)];
    let batched = Grid::batched(&grids);
    assert_eq!(batched.len(), 19);
    let rects: Vec<_> = batched.topology.rects().collect();
    assert_eq!(rects.iter().map(|r| r.lanes()).collect::<Vec<_>>(), [0..6, 6..15, 15..19]);
    for (k, rect) in rects.iter().enumerate() {
        assert!(rect.lanes().all(|lane| batched.topology.rect_of(lane) == Some(*rect)));
        let lanes = rect.lanes();
        assert_eq!(batched.p.part(lanes.clone()), grids[k].p);
        let PrimvarData::Floats { values, varying: true } = &batched.primvars[0].data else { panic!("{k}") };
        assert!(values[lanes].iter().all(|v| *v == k as f32 * 0.37));
    }
    assert_eq!(batched.uneven, [Uneven { lane: 7, of: [[0.5, 0.25], [0.0, 2.0]] }]);
    assert_eq!(Grid::batched(&grids[..1]).topology, Topology::Rect { nu: 2, nv: 3 });
}

#[test]
fn only_compatible_grids_are_batched() {
    let one = grid(2, 2, 0);
    assert!(one.may_batch(&grid(3, 2, 5)));
    let change = |f: &dyn Fn(&mut Grid)| {
        let mut other = grid(2, 2, 1);
        f(&mut other);
        assert!(!one.may_batch(&other) && !other.may_batch(&one));
    };
    change(&|g| g.time = 0.5);
    change(&|g| g.flip_normals = !g.flip_normals);
    change(&|g| g.ray.level = 1);
    change(&|g| g.object = "other".into());
    change(&|g| _ = g.primvars.pop());
    change(&|g| g.primvars[0].name = "other".into());
    change(&|g| g.primvars[0].data = PrimvarData::Strings(vec!["a".into()]));
    change(&|g| g.topology = Topology::Scattered { n: 4 });
    change(&|g| g.names = vec![1; 4]);
}

#[test]
fn groups_that_use_whole_grids_are_marked() {
    let is = |body: &str| {
        let source = format!("surface t (string file = \"\", string mode = \"\") {{ {body} }}");
        let group = link(&[(&source, Params::new())], &[]);
        (group.is_gridwise(), group.may_save())
    };
    for body in [
        "C = gridmax (u);",
        "C = gridn ();",
        "if (gridany (u)) C = 0;",
        "C = randomgrid ();",
        "printf (\"x\\n\");",
    ] {
        assert_eq!(is(body), (true, false), "{body}");
    }
    assert_eq!(is("spatialdbsave (\"a\", P, C);"), (false, true));
    let indirect = |options: &str| is(&format!("C = indirect (\"s\", P, N, {options}\"samples\", 4);"));
    assert_eq!(indirect(""), (false, false));
    // Parameters that are empty do not name a file.
    assert_eq!(indirect("\"filename\", file, \"filemode\", mode, "), (false, false));
    assert_eq!(indirect("\"filename\", \"\", "), (false, false));
    assert_eq!(indirect("\"filemode\", \"w\", "), (false, true));
    assert_eq!(indirect("\"filename\", concat (file, \"x\"), "), (false, true));
    // Values that are given with the instance are used.
    let source = "surface t (string file = \"\") { C = indirect (\"s\", P, N, \"filename\", file); }";
    let given = |name: &str| {
        let value = granita_base::Param::declared("string file", name).unwrap();
        link(&[(source, Params(vec![value]))], &[]).may_save()
    };
    assert!(given("a.sdb") && !given(""));
}
