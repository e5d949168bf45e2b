//! Which sides of the faces of a mesh go on in others.

use super::*;
use parking_lot::Mutex;

/// A book half open, its back along y: two faces of two corners in common, with these normals at the six corners, if
/// any.
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
    render_with(&build, &build.view(&[]), 1, ("rgba", &[]), &Painted { paint, displace: None });
    let seen = seen.into_inner();
    assert!(seen.len() >= faces, "{seen:?}");
    seen
}

#[test]
fn smooth_meshes_go_on_beyond_their_faces_and_flat_ones_do_not() {
    let flat = |x: f32| [x, 0.0, -1.0];
    assert!(seams_of(false, 2, None).iter().all(|s| *s == [false; 4]));
    assert!(seams_of(true, 2, None).iter().all(|s| *s == [true; 4]));
    // One face alone ends where it ends.
    assert!(seams_of(false, 1, None).iter().all(|s| *s == [false; 4]));
    // The same normal for both at the back, its own at the other ends: the back goes on, and so do the sides that bend.
    let round =
        seams_of(false, 2, Some([flat(0.0), flat(0.0), flat(-1.0), flat(-1.0), flat(1.0), flat(1.0)]));
    assert!(round.iter().all(|s| s.iter().filter(|x| **x).count() == 3), "{round:?}");
    // Normals of the face itself are given, as exporters do: that is as flat as none. (Only the right face is left to
    // see here.)
    let own = seams_of(false, 2, Some([flat(-1.0); 6]));
    assert!(own.contains(&[false; 4]) && own.contains(&[true; 4]), "{own:?}");
}
