//! Where the smooth surface lies that the normals of flat faces tell of.
//!
//! Shading by interpolated normals says of points on a face that turns from a light that they are lit, while the face itself keeps the
//! light from them: shadow rays that begin on faces make the terminator of a mesh jagged. They begin on a smooth surface instead, as in
//! Johannes Hanika, "Hacking the Shadow Terminator", chapter 4 of Ray Tracing Gems II (Apress, 2021): a point is projected to the tangent
//! planes at the corners of its face, where these lie above it, and the results are weighted as the corners are.

use granita_base::Vec3;
use granita_shade::{Grid, Lanes3, Topology};
use std::sync::Arc;

/// Corners (0,0), (1,0), (0,1) and (1,1) of a face with their normals, of any length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SmoothFace {
    pub(crate) p: [Vec3; 4],
    pub(crate) n: [Vec3; 4],
}

impl SmoothFace {
    /// From a point of the face, at these weights of its corners, to about where the smooth surface lies: on the side of the normals,
    /// or on the other `side`. Never through the face.
    pub(crate) fn lift(&self, p: Vec3, weights: [f32; 4], side: f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (k, weight) in weights.into_iter().enumerate() {
            let n = self.n[k].normalize_or_zero() * side;
            let above = (p - self.p[k]).dot(n);
            if above < 0.0 {
                sum -= n * (above * weight);
            }
        }
        if sum.is_finite() { sum } else { Vec3::ZERO }
    }

    /// Both sides: that of the normals first.
    pub(crate) fn lifts(&self, p: Vec3, weights: [f32; 4]) -> [Vec3; 2] {
        [self.lift(p, weights, 1.0), self.lift(p, weights, -1.0)]
    }
}

/// Weights of the corners for a place in a face.
pub(crate) fn bilinear(u: f32, v: f32) -> [f32; 4] {
    [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v]
}

/// [`Grid::lift`] of a rectangle of points on a flat face, whose parameters run from 0 to 1 over it. The corners of the face follow from
/// those of the rectangle: position and normal are bilinear.
pub(crate) fn of_face(grid: &Grid) -> Option<Arc<[Lanes3; 2]>> {
    let Topology::Rect { nu, nv } = grid.topology else { return None };
    let lanes = [0, nu - 1, (nv - 1) * nu, nu * nv - 1];
    let [u0, u1, v0, v1] = [grid.u[lanes[0]], grid.u[lanes[3]], grid.v[lanes[0]], grid.v[lanes[3]]];
    let (du, dv) = (u1 - u0, v1 - v0);
    if du == 0.0 || dv == 0.0 {
        return None;
    }
    let corner = |of: &Lanes3, k: usize| {
        let (u, v) = (((k & 1) as f32 - u0) / du, ((k >> 1) as f32 - v0) / dv);
        let weights = bilinear(u, v);
        (0..4).map(|k| of.get(lanes[k]) * weights[k]).sum::<Vec3>()
    };
    let face = SmoothFace {
        p: [0, 1, 2, 3].map(|k| corner(&grid.p, k)),
        n: [0, 1, 2, 3].map(|k| corner(&grid.n, k)),
    };
    let mut both = [Lanes3::zeros(nu * nv), Lanes3::zeros(nu * nv)];
    for lane in 0..nu * nv {
        let lifts = face.lifts(grid.p.get(lane), bilinear(grid.u[lane], grid.v[lane]));
        for (lanes, lift) in both.iter_mut().zip(lifts) {
            lanes.set(lane, lift);
        }
    }
    Some(Arc::new(both))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of a sphere of radius 1, `half` its half side, seen along z.
    fn of_sphere(half: f32) -> SmoothFace {
        let p = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .map(|[x, y]: [f32; 2]| Vec3::new(x * half, y * half, (1.0 - 2.0 * half * half).sqrt()));
        SmoothFace { p, n: p }
    }

    #[test]
    fn the_middle_of_a_face_rises_towards_the_sphere() {
        for half in [0.05, 0.1, 0.3] {
            let face = of_sphere(half);
            let middle = Vec3::new(0.0, 0.0, face.p[0].z);
            let lift = face.lift(middle, [0.25; 4], 1.0);
            // Tangent planes lie above the sphere: at least as far as the sphere, at most twice as far and a little.
            let gap = 1.0 - middle.z;
            assert!(lift.z >= gap * 0.99 && lift.z < 2.2 * gap, "{half}: {lift} {gap}");
            assert!(lift.truncate().length() < 1e-6);
            // From inside nothing is in the way of the face.
            assert_eq!(face.lift(middle, [0.25; 4], -1.0), Vec3::ZERO);
            // Corners are where they are.
            assert!(face.lift(face.p[1], [0.0, 1.0, 0.0, 0.0], 1.0).length() < 1e-6);
        }
    }

    #[test]
    fn a_flat_face_stays() {
        let p = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE - Vec3::Z];
        let face = SmoothFace { p, n: [Vec3::Z; 4] };
        let at = Vec3::new(0.25, 0.5, 0.0);
        assert_eq!(face.lifts(at, bilinear(0.25, 0.5)), [Vec3::ZERO; 2]);
        let face = SmoothFace { p, n: [Vec3::NAN; 4] };
        assert_eq!(face.lifts(at, bilinear(0.25, 0.5)), [Vec3::ZERO; 2]);
    }

    #[test]
    fn parts_of_a_face_lift_as_the_whole_does() {
        // The whole face in 5 x 5 points, and the part of it from its middle on.
        let whole = of_sphere(0.3);
        let grid = |from: f32| {
            let mut grid = Grid::new(Topology::Rect { nu: 5, nv: 5 });
            for lane in 0..25 {
                let at = |k: usize| from + (1.0 - from) * k as f32 / 4.0;
                let (u, v) = (at(lane % 5), at(lane / 5));
                let weights = bilinear(u, v);
                let mix = |list: &[Vec3; 4]| (0..4).map(|k| list[k] * weights[k]).sum::<Vec3>();
                (grid.u[lane], grid.v[lane]) = (u, v);
                grid.p.set(lane, mix(&whole.p));
                grid.n.set(lane, mix(&whole.n));
            }
            of_face(&grid).unwrap()
        };
        let (all, part) = (grid(0.0), grid(0.5));
        for (of_all, of_part) in [(12, 0), (14, 4), (22, 20), (18, 12)] {
            let (a, b) = (all[0].get(of_all), part[0].get(of_part));
            // Lane 18 is at three quarters, as the middle of the part is.
            assert!((a - b).length() < 1e-5, "{of_all}: {a} {b}");
        }
    }
}
