//! Convex surfaces, which rays that leave them outward cannot hit again.
//!
//! The tessellation of a surface is not the surface: a ray that leaves a ball at a low angle may hit a facet of it. And
//! where a grid of the camera continues beyond the outline of a ball, its points reflect rays into the ball. Both kinds
//! of rays would be traced and shaded for nothing. A [`ConvexSurface`] knows such rays from those that a shader sends
//! into the ball on purpose (refraction), and from those of a surface that is seen from inside.

use crate::request::Departure;
use granita_base::{ShapeDesc, Transform};
use granita_scene::Primitive;

/// The distance from the sphere, relative to its radius, from which on a viewer is outside. Viewers on the sphere
/// itself (reflections inside of a ball) are rounded.
const OUTSIDE: f32 = 1.0e-3;

/// A part of a sphere or of an ellipsoid that neither moves nor is displaced.
#[derive(Clone, Debug)]
pub(crate) struct ConvexSurface {
    /// From world space to the space in which the sphere is round.
    to_object: Transform,
    /// The radius in that space.
    radius: f32,
    /// True for a whole sphere, whose inside is not visible from outside.
    closed: bool,
}

impl ConvexSurface {
    /// Returns the surface of a primitive. `moves` is true when it moves, changes its shape or is displaced. `None`
    /// when it is not known to be convex. `to_world` places the primitive.
    pub(crate) fn new(primitive: &Primitive, to_world: &Transform, moves: bool) -> Option<Self> {
        let ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } = primitive.shape else { return None };
        let radius = radius.abs();
        let to_object = to_world.inverse();
        if moves || primitive.keys.len() > 1 || !radius.is_finite() || radius <= 0.0 {
            return None;
        }
        let (low, high) = (zmin.min(zmax), zmin.max(zmax));
        let closed = low <= -radius && high >= radius && thetamax_deg.abs() >= 360.0;
        to_object.point(granita_base::Vec3::ZERO).is_finite().then_some(Self { to_object, radius, closed })
    }

    /// True when rays of a departure from this surface do not hit it again. That holds for rays that leave it outward,
    /// whether it is whole or not. It also holds for all rays from a point of a whole sphere that its viewer, who is
    /// outside, cannot see.
    pub(crate) fn is_left(&self, departure: &Departure) -> bool {
        let p = self.to_object.point(departure.p);
        if self.to_object.vector(departure.axis).dot(p) > 0.0 {
            return true;
        }
        let Some(viewer) = departure.viewer.filter(|_| self.closed) else { return false };
        let viewer = self.to_object.point(viewer);
        viewer.length() > self.radius * (1.0 + OUTSIDE) && (p - viewer).dot(p) > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Vec3;
    use granita_fixture::Fixture;

    fn surface(zmin: f32, thetamax_deg: f32, to_world: &Transform) -> ConvexSurface {
        let mut f = Fixture::new(&[]);
        let shape = ShapeDesc::Sphere { radius: 2.0, zmin, zmax: 2.0, thetamax_deg };
        let plain = f.attributes("", &[], &[]);
        let primitive = f.add(shape, granita_base::Params::new(), plain);
        ConvexSurface::new(&primitive, to_world, false).unwrap()
    }

    fn from(p: Vec3, axis: Vec3, viewer: Option<Vec3>) -> Departure {
        Departure { primitive: 0, p, axis, viewer }
    }

    #[test]
    fn rays_leave_a_sphere_outward_and_not_inward() {
        // An ellipsoid with its centre at (10, 0, 0) and half axes of 2, 6 and 2.
        let place = Transform::scale(Vec3::new(1.0, 3.0, 1.0)).then(&Transform::translate(Vec3::X * 10.0));
        for zmin in [-2.0, 0.0] {
            let ball = surface(zmin, 360.0, &place);
            let top = Vec3::new(10.0, 6.0, 0.0);
            let eye = Vec3::new(10.0, 20.0, 0.0);
            for viewer in [None, Some(eye)] {
                assert!(ball.is_left(&from(top, Vec3::new(0.9, 0.1, 0.0), viewer)));
                // A refracted ray enters the ball.
                assert!(!ball.is_left(&from(top, Vec3::new(0.1, -0.9, 0.0), viewer)));
            }
            // On the side of the ellipsoid the normal is not the direction from its centre.
            let side = Vec3::new(10.0 + 2.0_f32.sqrt(), 3.0 * 2.0_f32.sqrt(), 0.0);
            assert!(ball.is_left(&from(side, Vec3::new(1.0, -2.9, 0.0), None)));
            assert!(!ball.is_left(&from(side, Vec3::new(1.0, -3.1, 0.0), None)));
        }
    }

    #[test]
    fn only_hidden_points_of_whole_spheres_are_left_inward() {
        let eye = Vec3::new(0.0, 0.0, 10.0);
        // Below the outline, as seen from the eye.
        let hidden = from(Vec3::new(1.98, 0.0, 0.25), Vec3::new(-0.5, 0.0, -0.8), Some(eye));
        assert!(surface(-2.0, 360.0, &Transform::IDENTITY).is_left(&hidden));
        assert!(!surface(-2.0, 359.0, &Transform::IDENTITY).is_left(&hidden));
        assert!(!surface(-1.9, 360.0, &Transform::IDENTITY).is_left(&hidden));
        // Without a viewer nothing is known to be hidden. A viewer inside of the sphere sees all of it, and so does one
        // on it.
        let ball = surface(-2.0, 360.0, &Transform::IDENTITY);
        for viewer in [None, Some(Vec3::ZERO), Some(Vec3::new(-2.0, 0.0, 0.0))] {
            assert!(!ball.is_left(&Departure { viewer, ..hidden }));
        }
    }
}
