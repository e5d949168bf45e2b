//! Tests of differences over grids, at borders, at hits and at poles, and of displacement.

use crate::fixture::*;
use granita_base::{Params, Vec3};
use granita_gsl::ir::ValueType;
use granita_shade::{Grid, Lanes3, Topology};

fn on(grid: &mut Grid, body: &str) -> Vec<f32> {
    let source = format!("surface t (output float r = -1) {{ {body} }}");
    let group = link(&[(&source, Params::new())], &[]);
    assert!(group.needs_derivatives());
    output(&group, grid, &mut Double::default(), "r", ValueType::Float)
}

#[test]
fn linear_functions_have_the_same_difference_everywhere() {
    let d = on(&mut square(5, 3), "r = deltau (u) + 10 * deltav (v) + 100 * deltav (u) + 1000 * deltau (7);");
    assert!(d.iter().all(|x| (x - 5.25).abs() < 1e-5), "{d:?}");
    let d = on(&mut square(5, 3), "r = length (deltau (P)) + length ((vector) deltav (color (u, v, 0)));");
    assert!(d.iter().all(|x| (x - 0.75).abs() < 1e-5), "{d:?}");
}

#[test]
fn derivatives_agree_across_borders_of_grids() {
    // Two grids share the column x = 1. The slope at it is the same from both sides.
    let at = |x0: f32, k: usize| {
        let mut grid = square(5, 2);
        for i in 0..10 {
            grid.p.xyz[0][i] = x0 + grid.u[i];
        }
        on(&mut grid, "r = deltau (P[0] * P[0] - 3 * P[0]);")[k]
    };
    assert!((at(0.0, 4) - at(1.0, 0)).abs() < 1e-5, "{} {}", at(0.0, 4), at(1.0, 0));
    assert!((at(0.0, 4) - 0.25 * (2.0 - 3.0)).abs() < 1e-5);
}

#[test]
fn filter_widths_and_areas_are_exact_on_planes() {
    let mut grid = square(3, 3);
    let w = on(&mut grid, "r = filterwidth (u + v);");
    assert!(w.iter().all(|x| (x - (0.5_f32 * 0.5 * 2.0).sqrt()).abs() < 1e-5), "{w:?}");
    let a = on(&mut grid, "r = samplearea (P);");
    assert!(a.iter().all(|x| (x - 0.25).abs() < 1e-5), "{a:?}");
}

#[test]
fn derivatives_of_hits_use_their_neighbour_lanes() {
    let mut grid = Grid::new(Topology::Triplets { n: 2 });
    grid.u = vec![1.0, 2.0, 1.5, 2.25, 1.0, 2.0];
    grid.v = vec![5.0, 6.0, 5.0, 6.0, 5.125, 6.5];
    assert_eq!(on(&mut grid, "r = deltau (u);"), [0.5, 0.25, 0.5, 0.25, 0.5, 0.25]);
    assert_eq!(on(&mut grid, "r = deltav (v);"), [0.125, 0.5, 0.125, 0.5, 0.125, 0.5]);
    let mut grid = Grid::new(Topology::Scattered { n: 3 });
    grid.u = vec![1.0, 2.0, 3.0];
    assert_eq!(on(&mut grid, "r = deltau (u) + filterwidth (u) + samplearea (P);"), [0.0; 3]);
}

#[test]
fn inactive_neighbours_do_not_count() {
    // Where the function is not computed it is NaN.
    let d = on(
        &mut square(5, 1),
        "r = 0; if (u < 0.6) { float f = sqrt (0.5 - u) * 0 + u * 4; r = deltau (f); }",
    );
    assert!((d[0] - 1.0).abs() < 1e-5 && (d[2] - 1.0).abs() < 1e-5 && d[4] == 0.0, "{d:?}");
}

#[test]
fn surface_normals_follow_the_orientation() {
    let n = on(&mut square(3, 3), "normal n = normalize (surfacenormal (P)); r = n[2];");
    assert!(n.iter().all(|z| (z + 1.0).abs() < 1e-5), "{n:?}");
    let mut grid = square(3, 3);
    grid.flip_normals = false;
    let n = on(&mut grid, "normal n = normalize (surfacenormal (P)); r = n[2];");
    assert!(n.iter().all(|z| (z - 1.0).abs() < 1e-5), "{n:?}");
}

#[test]
fn normals_at_poles_are_finite() {
    // The first row of points is one point, the tip of a cone.
    let mut grid = square(5, 4);
    for j in 0..4 {
        for i in 0..5 {
            let (r, a) = (j as f32 / 3.0, i as f32 / 4.0);
            grid.p.set(j * 5 + i, Vec3::new(r * a.cos(), r * a.sin(), r));
        }
    }
    grid.flip_normals = false;
    let n = on(
        &mut grid,
        "normal n = normalize (surfacenormal (P)); r = dot (n, vector (P[0], P[1], 0)) - n[2] * 10;",
    );
    let length = on(&mut grid, "r = length (normalize (surfacenormal (P)));");
    assert!(length.iter().all(|l| (l - 1.0).abs() < 1e-5), "{length:?}");
    // The tip's normals are those of the row below it.
    let z = on(&mut grid, "normal n = normalize (surfacenormal (P)); r = n[2];");
    assert!((z[1] - z[6]).abs() < 0.05, "{z:?} {n:?}");
    // A grid that is a single point uses the geometric normal.
    let mut point = square(2, 2);
    point.p = Lanes3::zeros(4);
    assert_eq!(on(&mut point, "normal n = normalize (surfacenormal (P)); r = n[2];"), [-1.0; 4]);
}

fn displaced(body: &str, grid: &mut Grid) -> Double {
    let source = format!("displacement t () {{ {body} }}");
    let group = link(&[(&source, Params::new())], &[]);
    let mut services = Double::default();
    granita_shade::Executor::new().run(&group, grid, &mut services, &[]);
    services
}

#[test]
fn displacement_moves_along_the_normal() {
    for (body, z) in [
        ("displace (0.5);", -0.5),
        ("displace (vector (0, 0, 3));", 3.0),
        ("displace (\"double\", 0.5);", -1.0),
        ("displace (\"cm\", 1);", -2.0),
        ("bump (0.5);", 0.0),
        ("bump (\"double\", 0.5);", 0.0),
        ("bump (vector (0, 0, 3));", 0.0),
    ] {
        let mut grid = square(4, 4);
        displaced(body, &mut grid);
        assert!(grid.p.xyz[2].iter().all(|p| (p - z).abs() < 1e-6), "{body} {:?}", grid.p.xyz[2]);
        // All points moved equally. Normals stay as they were, to the bit.
        assert_eq!(grid.n, Lanes3::splat(-Vec3::Z, 16), "{body}");
    }
}

#[test]
fn displacement_slopes_tilt_normals() {
    for body in [
        "displace (u);",
        "bump (u);",
        "bump (vector (0, 0, -u));",
        "bump (\"double\", 0.5 * u);",
        "P -= vector (0, 0, u); N = normalize (surfacenormal (P));",
    ] {
        let mut grid = square(5, 3);
        displaced(body, &mut grid);
        let expected = Vec3::new(-1.0, 0.0, -1.0).normalize();
        for i in 0..15 {
            assert!((grid.n.get(i) - expected).length() < 1e-5, "{body} {}", grid.n.get(i));
        }
        let moved = grid.p.xyz[2][4] != 0.0;
        assert_eq!(moved, !body.starts_with("bump"), "{body}");
    }
}

#[test]
fn interpolated_normals_stay_without_displacement() {
    // The facet has normals of the curved surface that it represents. Without displacement they do not change.
    let mut grid = square(3, 3);
    for i in 0..9 {
        grid.n.set(i, Vec3::new(grid.u[i] - 0.5, 0.0, -1.0));
    }
    let before = grid.n.clone();
    displaced("displace (0);", &mut grid);
    assert_eq!(grid.n, before);
    displaced("if (u > 5) displace (1);", &mut grid);
    assert_eq!(grid.n, before);
}
