//! The six faces of a cube: directions, mosaics, and texels across edges.

use crate::level::Level;
use granita_base::Vec3;
use granita_image::ImageSpec;

/// The orientation of one face as seen from the centre of the cube, as unit vectors along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// The direction to the centre of the face.
    pub forward: Vec3,
    /// The direction from there to its upper edge.
    pub up: Vec3,
    /// The direction from there to its right edge.
    pub right: Vec3,
}

const fn face(forward: [f32; 3], up: [f32; 3], right: [f32; 3]) -> Face {
    Face { forward: Vec3::from_array(forward), up: Vec3::from_array(up), right: Vec3::from_array(right) }
}

/// The names of the faces, in the order of command lines and of [`CubeLayout::faces`].
pub const FACE_NAMES: [&str; 6] = ["px", "nx", "py", "ny", "pz", "nz"];

/// The faces px nx py ny pz nz of reference 9.3, which are left handed.
const LEFT_HANDED: [Face; 6] = [
    face([1., 0., 0.], [0., 1., 0.], [0., 0., -1.]),
    face([-1., 0., 0.], [0., 1., 0.], [0., 0., 1.]),
    face([0., 1., 0.], [0., 0., -1.], [1., 0., 0.]),
    face([0., -1., 0.], [0., 0., 1.], [1., 0., 0.]),
    face([0., 0., 1.], [0., 1., 0.], [1., 0., 0.]),
    face([0., 0., -1.], [0., 1., 0.], [-1., 0., 0.]),
];

/// The same faces as OpenEXR stores them (its documentation of `ENVMAP_CUBE`), which are right handed.
const RIGHT_HANDED: [Face; 6] = [
    face([1., 0., 0.], [0., 1., 0.], [0., 0., 1.]),
    face([-1., 0., 0.], [0., 1., 0.], [0., 0., -1.]),
    face([0., 1., 0.], [0., 0., 1.], [1., 0., 0.]),
    face([0., -1., 0.], [0., 0., -1.], [1., 0., 0.]),
    face([0., 0., 1.], [0., 1., 0.], [-1., 0., 0.]),
    face([0., 0., -1.], [0., 1., 0.], [1., 0., 0.]),
];

/// The layout of six faces in one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CubeLayout {
    /// The layout of 3 x 2 faces, px py pz over nx ny nz, left handed (reference 9.2.5).
    Mosaic,
    /// The layout of 1 x 6 faces, px nx py ny pz nz from the top, right handed (reference 9.2.8).
    Column,
}

impl CubeLayout {
    /// Returns the faces in the order of [`FACE_NAMES`].
    pub fn faces(self) -> &'static [Face; 6] {
        match self {
            Self::Mosaic => &LEFT_HANDED,
            Self::Column => &RIGHT_HANDED,
        }
    }

    /// Returns the column and row of a face in the mosaic.
    pub fn cell(self, face: usize) -> (u32, u32) {
        match self {
            Self::Mosaic => ((face / 2) as u32, (face % 2) as u32),
            Self::Column => (0, face as u32),
        }
    }

    /// Returns the number of columns and rows of the mosaic.
    pub fn cells(self) -> (u32, u32) {
        match self {
            Self::Mosaic => (3, 2),
            Self::Column => (1, 6),
        }
    }

    /// Returns the layout of files of a format, by the format's name.
    pub fn of_format(format: &str) -> Self {
        if is_openexr(format) { Self::Column } else { Self::Mosaic }
    }

    /// Returns the size in texels of a face, and the step between faces, of a level that holds a cube; `None` when
    /// it cannot hold one.
    pub fn face_size(self, spec: &ImageSpec) -> Option<(u32, (u32, u32))> {
        let level = cube_level(self, spec, (spec.width, spec.height))?;
        Some((level.face_width, (level.step_x, level.step_y)))
    }

    /// Returns the point where `d` (finite, not 0) intersects the cube.
    pub fn point(self, d: Vec3) -> CubePoint {
        project(self, d)
    }
}

/// The point where a direction intersects the cube.
#[derive(Clone, Copy, Debug)]
pub struct CubePoint {
    /// The index of the face among [`FACE_NAMES`].
    pub face: usize,
    /// The fraction of the face from its left edge.
    pub s: f32,
    /// The fraction of the face from its upper edge.
    pub t: f32,
    /// The length of the direction over its component along the face's axis, from 1 to sqrt 3.
    pub stretch: f32,
}

/// Returns the face whose axis is nearest to `d`, which is finite and not 0.
pub(crate) fn face_of(d: Vec3) -> usize {
    let a = d.abs();
    if a.x >= a.y && a.x >= a.z {
        usize::from(d.x < 0.0)
    } else if a.y >= a.z {
        2 + usize::from(d.y < 0.0)
    } else {
        4 + usize::from(d.z < 0.0)
    }
}

/// Returns the point where `d` (finite, not 0) intersects the cube.
pub(crate) fn project(layout: CubeLayout, d: Vec3) -> CubePoint {
    let face = face_of(d);
    let f = &layout.faces()[face];
    let depth = d.dot(f.forward);
    CubePoint {
        face,
        s: 0.5 + 0.5 * d.dot(f.right) / depth,
        t: 0.5 - 0.5 * d.dot(f.up) / depth,
        stretch: d.length() / depth,
    }
}

/// Returns the direction through a point of a face, which may lie outside [0, 1]. Its component along the axis is
/// 1.
pub(crate) fn direction(layout: CubeLayout, face: usize, s: f32, t: f32) -> Vec3 {
    let f = &layout.faces()[face];
    f.forward + f.right * (2.0 * s - 1.0) + f.up * (1.0 - 2.0 * t)
}

/// Returns the texel at (x, y) of a face of `n` x `n` texels. When x or y is one outside, it is the adjacent texel of
/// the neighbouring face. Returns `None` for the corners, where only three faces are adjacent and no such texel exists.
pub(crate) fn texel_across(
    layout: CubeLayout,
    face: usize,
    x: i32,
    y: i32,
    n: i32,
) -> Option<(usize, i32, i32)> {
    let inside = |v: i32| (0..n).contains(&v);
    match (inside(x), inside(y)) {
        (true, true) => return Some((face, x, y)),
        (false, false) => return None,
        _ => {}
    }
    let (s, t) = ((x as f32 + 0.5) / n as f32, (y as f32 + 0.5) / n as f32);
    let p = project(layout, direction(layout, face, s, t));
    let index = |v: f32| ((v * n as f32) as i32).clamp(0, n - 1);
    Some((p.face, index(p.s), index(p.t)))
}

/// True when files of a format follow OpenEXR's conventions for environment maps.
pub(crate) fn is_openexr(format: &str) -> bool {
    matches!(format.to_ascii_lowercase().as_str(), "exr" | "openexr")
}

/// Returns the size of a face, and the step between faces, of a level that holds a cube.
pub(crate) fn cube_level(layout: CubeLayout, spec: &ImageSpec, whole: (u32, u32)) -> Option<Level> {
    let (columns, rows) = layout.cells();
    let (step_x, step_y) = (whole.0 / columns, whole.1 / rows);
    let (face_width, face_height) = match layout {
        // Faces may be padded to whole tiles. The display window is then the size of a face.
        CubeLayout::Mosaic if (1..=step_x).contains(&spec.full_width) && spec.full_height <= step_y => {
            (spec.full_width, spec.full_height.max(1))
        }
        CubeLayout::Mosaic => (step_x, step_y),
        CubeLayout::Column if whole.1 != whole.0.checked_mul(6)? => return None,
        CubeLayout::Column => (whole.0, whole.0),
    };
    (face_width > 0 && face_height > 0 && face_width == face_height).then_some(Level {
        width: whole.0,
        height: whole.1,
        face_width,
        face_height,
        step_x,
        step_y,
        tile_width: spec.tile_width,
        tile_height: spec.tile_height,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_layouts_have_their_handedness() {
        for (layout, sign) in [(CubeLayout::Mosaic, 1.0), (CubeLayout::Column, -1.0)] {
            for f in layout.faces() {
                assert_eq!(f.right.cross(f.up), f.forward * sign);
            }
        }
    }

    #[test]
    fn directions_survive_projection_to_faces_and_back() {
        for layout in [CubeLayout::Mosaic, CubeLayout::Column] {
            for face in 0..6 {
                for (s, t) in [(0.5, 0.5), (0.1, 0.8), (0.99, 0.01)] {
                    let p = project(layout, direction(layout, face, s, t) * 3.0);
                    assert_eq!(p.face, face);
                    assert!((p.s - s).abs() < 1e-6 && (p.t - t).abs() < 1e-6);
                }
            }
        }
    }

    /// Every border texel and its neighbour across the edge are neighbours of each other, and lie side by side.
    #[test]
    fn neighbours_across_cube_edges_are_mutual() {
        for layout in [CubeLayout::Mosaic, CubeLayout::Column] {
            for n in [1, 2, 5, 64] {
                for face in 0..6 {
                    for i in 0..n {
                        for (x, y, inner) in
                            [(-1, i, (0, i)), (n, i, (n - 1, i)), (i, -1, (i, 0)), (i, n, (i, n - 1))]
                        {
                            let (f, nx, ny) = texel_across(layout, face, x, y, n).unwrap();
                            assert_ne!(f, face);
                            let centre = |f: usize, x: i32, y: i32| {
                                direction(layout, f, (x as f32 + 0.5) / n as f32, (y as f32 + 0.5) / n as f32)
                            };
                            let (a, b) = (centre(face, inner.0, inner.1), centre(f, nx, ny));
                            // Both are half a texel from the common edge, at the same place along it.
                            let expected = (2.0_f32).sqrt() / n as f32;
                            assert!(((a - b).length() - expected).abs() < 1e-5, "{layout:?} {n} {face} {i}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn cube_corners_have_no_diagonal_neighbour() {
        assert!(texel_across(CubeLayout::Mosaic, 0, -1, -1, 4).is_none());
        assert!(texel_across(CubeLayout::Mosaic, 0, 4, -1, 4).is_none());
    }
}
