//! Tests of creases and corners of Catmull-Clark meshes against separate meshes, closed forms and invalid input.

mod common;

use common::*;
use granita_base::{Param, Params, ShapeDesc, Vec3};

/// Returns a bent grid of `nx x ny` vertices that begins with column `x0`.
fn grid(x0: usize, nx: usize, ny: usize) -> (ShapeDesc, Vec<f32>) {
    let p = (0..nx * ny)
        .flat_map(|k| {
            let (x, y) = ((x0 + k % nx) as f32, (k / nx) as f32);
            [x, y, (x * 1.3).sin() + (y * 0.7 + x).cos()]
        })
        .collect();
    let mut verts = Vec::new();
    for j in 0..ny - 1 {
        for i in 0..nx - 1 {
            let v = j * nx + i;
            verts.extend([v, v + 1, v + 1 + nx, v + nx].map(|v| v as i32));
        }
    }
    let nverts = vec![4; (nx - 1) * (ny - 1)];
    (ShapeDesc::Mesh { subdivide: true, nverts: nverts.into(), verts: verts.into() }, p)
}

fn cube() -> (ShapeDesc, Vec<f32>, Vec<i32>) {
    let p: Vec<f32> =
        (0..8).flat_map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|b| b as f32 * 2.0 - 1.0)).collect();
    let verts = vec![0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
    let edges = (0..8).flat_map(|a: i32| [1, 2, 4].map(|b| [a, a ^ b])).filter(|e| e[0] < e[1]).flatten();
    (ShapeDesc::Mesh { subdivide: true, nverts: [4; 6].into(), verts: verts.into() }, p, edges.collect())
}

/// Returns parameters with edges in pairs of vertices, all equally sharp.
fn creased(p: &[f32], border: i32, edges: &[i32], sharpness: f32) -> Params {
    let n = edges.len() / 2;
    let mut all = params(&[("P", p)]);
    let mut set = |name: &str, data: granita_base::ParamData| {
        all.set(Param::declared(name, data).expect("a declaration"));
    };
    set("int border", border.into());
    set(&format!("int[{n}] creaselengths"), (&vec![2; n][..]).into());
    set(&format!("int[{}] creaseindices", 2 * n), edges.into());
    set(&format!("float[{n}] creasesharpnesses"), (&vec![sharpness; n][..]).into());
    all
}

#[test]
fn a_cube_with_sharp_creases_has_flat_faces() {
    let (shape, p, edges) = cube();
    assert_eq!(edges.len(), 24);
    let pieces = diceable(build(&shape, &creased(&p, 0, &edges, 10.0)));
    assert_eq!(pieces.len(), 6);
    for piece in &pieces {
        let dice = piece.dice(9, 9);
        check_bounds(piece, &dice);
        for (k, p) in dice.p[0].iter().enumerate() {
            assert!((p.abs().max_element() - 1.0).abs() < 1e-6, "{p}");
            if matches!(k, 0 | 8 | 72 | 80) {
                assert!((p.abs() - Vec3::ONE).length() < 1e-6, "{p}");
            }
        }
    }
    assert_eq!(shared_borders(&pieces, 9), (12, 12));
}

#[test]
fn a_sharp_crease_equals_the_borders_of_two_meshes() {
    // The mesh has 5 columns of vertices and is creased along the third. The surface is the same as that of two
    // meshes of 3 columns.
    let (shape, p) = grid(0, 5, 4);
    let crease: Vec<i32> = (0..3).flat_map(|j| [j * 5 + 2, j * 5 + 7]).collect();
    let whole = diceable(build(&shape, &creased(&p, 1, &crease, f32::INFINITY)));
    assert_eq!(whole.len(), 12);
    for (x0, column) in [(0, 0), (2, 2)] {
        let (shape, p) = grid(x0, 3, 4);
        let half = diceable(build(&shape, &creased(&p, 1, &[], 0.0)));
        assert_eq!(half.len(), 6);
        for piece in half {
            let part = piece.dice(9, 9);
            let face = part.face / 2 * 4 + part.face % 2 + column;
            let same = whole.iter().map(|p| p.dice(9, 9)).find(|d| d.face == face).expect("the face");
            for (a, b) in part.p[0].iter().zip(&same.p[0]) {
                assert!((a - b).length() < 1e-5, "face {face}: {a} {b}");
            }
        }
    }
}

#[test]
fn sharpness_interpolates_between_smooth_and_sharp() {
    let (shape, p, edges) = cube();
    let corner = |params: &Params| {
        let pieces = diceable(build(&shape, params));
        assert_eq!(shared_borders(&pieces, 5), (12, 12));
        pieces[0].dice(2, 2).p[0][0].abs().x
    };
    let round = corner(&params(&[("P", &p)]));
    assert!((round - 0.5).abs() < 1e-5);
    assert_eq!(corner(&creased(&p, 0, &edges, 0.0)), round);
    let mut last = round;
    for tenths in 1..50 {
        let now = corner(&creased(&p, 0, &edges, tenths as f32 * 0.1));
        assert!(now >= last - 1e-6 && now - last < 0.07, "{tenths}: {last} {now}");
        last = now;
    }
    assert!(last > 0.99);
    // A single corner holds the surface only at that corner.
    let mut all = params(&[("P", &p)]);
    all.set(Param::declared("int[1] cornerindices", &[7][..]).expect("a declaration"));
    all.set(Param::declared("float[1] cornersharpnesses", &[f32::INFINITY][..]).expect("a declaration"));
    let pieces = diceable(build(&shape, &all));
    let dices: Vec<_> = pieces.iter().map(|p| p.dice(2, 2)).collect();
    let corners: Vec<Vec3> = dices.iter().flat_map(|d| d.p[0].clone()).collect();
    assert_eq!(corners.iter().filter(|p| (**p - Vec3::ONE).length() < 1e-6).count(), 3);
    assert!(corners.iter().filter(|p| p.max_element() < 0.9).count() > 12);
}

#[test]
fn invalid_creases_are_reported() {
    let (shape, p, _) = cube();
    for (params, expected) in [
        (creased(&p, 0, &[0, 7], 1.0), "1 creased edges and 0 corners that the mesh does not have"),
        (creased(&p, 0, &[-1, 700], f32::NAN), "1 creased edges"),
        (
            {
                let mut all = creased(&p, 0, &[0, 1], 1.0);
                all.set(Param::declared("int[1] creaselengths", &[3][..]).expect("a declaration"));
                all
            },
            "1 creases of 3 vertices, but 2 indices and 1 sharpnesses",
        ),
        (
            {
                let mut all = creased(&p, 0, &[0, 1], 1.0);
                let least = &[i32::MIN][..];
                all.set(Param::declared("int[1] creaselengths", least).expect("a declaration"));
                all
            },
            "1 creases of 0 vertices, but 2 indices and 1 sharpnesses",
        ),
        (
            {
                let mut all = params(&[("P", &p)]);
                all.set(Param::declared("int[1] cornerindices", &[3][..]).expect("a declaration"));
                all
            },
            "1 corners, but 0 sharpnesses",
        ),
    ] {
        let (pieces, said) = try_build(&shape, &[&params], None);
        assert_eq!(diceable(pieces.unwrap()).len(), 6);
        assert!(said.len() == 1 && said[0].contains(expected), "{expected}: {said:?}");
    }
}
