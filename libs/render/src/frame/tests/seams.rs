//! Tests which sides of the faces of a mesh continue in other faces.

use super::*;
use parking_lot::Mutex;

/// Returns for each grid of a half open book which of its sides continue in other faces. The back of the book lies
/// along y. Its one or two faces share two corners and have these normals at the six corners, if any.
fn seams_of(subdivide: bool, faces: usize, normals: Option<[[f32; 3]; 6]>) -> Vec<[bool; 4]> {
    let mut build = flat_camera();
    let points =
        [0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 1.0, -1.0];
    let shape = ShapeDesc::Mesh {
        subdivide,
        nverts: vec![4; faces].into(),
        verts: [0, 2, 3, 1, 4, 0, 1, 5][..4 * faces].into(),
    };
    let mut params = Params(vec![param("vertex point P", &points[..6 * (faces + 1)])]);
    params.set(Param::declared("int border", 2).unwrap());
    if let Some(normals) = normals {
        params.set(param("vertex normal N", normals.as_flattened()));
    }
    build.add(shape, params, attributes(&[], at(0.0, 0.0, 5.0)));
    let seen = Mutex::new(Vec::new());
    let paint = |grid: &mut Grid| seen.lock().extend(grid.seams.iter().copied());
    render_with(&build, &build.view(&[]), 1, ("rgba", &[]), &Painted::new(paint));
    let seen = seen.into_inner();
    assert!(seen.len() >= faces, "{seen:?}");
    seen
}

#[test]
fn smooth_edges_are_shared_edges_and_flat_ones_are_not() {
    let flat = |x: f32| [x, 0.0, -1.0];
    assert!(seams_of(false, 2, None).iter().all(|s| *s == [false; 4]));
    assert!(seams_of(true, 2, None).iter().all(|s| *s == [true; 4]));
    // A single face ends at all its sides.
    assert!(seams_of(false, 1, None).iter().all(|s| *s == [false; 4]));
    // Both faces have the same normal at the back and their own normals at the other ends. The back continues, and so
    // do the sides that bend.
    let round =
        seams_of(false, 2, Some([flat(0.0), flat(0.0), flat(-1.0), flat(-1.0), flat(1.0), flat(1.0)]));
    assert!(round.iter().all(|s| s.iter().filter(|x| **x).count() == 3), "{round:?}");
    // The normals of the face itself are given, as exporters do. It is then as flat as without normals. Only the right
    // face is visible here.
    let own = seams_of(false, 2, Some([flat(-1.0); 6]));
    assert!(own.contains(&[false; 4]) && own.contains(&[true; 4]), "{own:?}");
}
