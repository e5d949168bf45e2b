//! Positions and directions of lights, in world space and in the image.

use granita_base::{MotionTransform, Transform, Vec3};
use granita_scene::{Camera, attr};

/// A camera that converts between world space and pixels of its full image. (0, 0) is the upper left corner.
#[derive(Clone, Debug)]
pub(crate) struct Eye {
    world_to_camera: Transform,
    camera_to_world: Transform,
    /// xmin, xmax, ymin, ymax of the image in "screen" space.
    window: [f32; 4],
    resolution: [f32; 2],
    /// The tangent of half the vertical field of view; `None` for an orthographic camera.
    tangent: Option<f32>,
    near: f32,
}

impl Eye {
    /// Returns the camera at its first time.
    pub(crate) fn new(camera: &Camera) -> Self {
        let world_to_camera = *camera.world_to_camera.first();
        let orthographic = &*camera.get(attr::PROJECTION) == "orthographic";
        let fov_deg = camera.get(attr::FOV).clamp(1.0e-3, 179.999);
        Self {
            world_to_camera,
            camera_to_world: world_to_camera.inverse(),
            window: camera.screen_window(),
            resolution: camera.resolution().map(|n| n as f32),
            tangent: (!orthographic).then(|| libm::tanf((0.5 * fov_deg).to_radians())),
            near: camera.get(attr::NEAR),
        }
    }

    /// Returns the pixel coordinates of a point in world space, and its depth along z of the camera; `None` when it is
    /// not before the camera.
    pub(crate) fn project(&self, p_world: Vec3) -> Option<[f32; 3]> {
        let p = self.world_to_camera.point(p_world);
        if !p.is_finite() || p.z <= self.near {
            return None;
        }
        let scale = self.tangent.map_or(1.0, |tangent| 1.0 / (tangent * p.z));
        let [xmin, xmax, ymin, ymax] = self.window;
        let x = (p.x * scale - xmin) / (xmax - xmin) * self.resolution[0];
        let y = (ymax - p.y * scale) / (ymax - ymin) * self.resolution[1];
        (x.is_finite() && y.is_finite()).then_some([x, y, p.z])
    }

    /// Returns the point in world space at pixel coordinates and a depth along z of the camera.
    pub(crate) fn point(&self, [x, y]: [f32; 2], depth: f32) -> Vec3 {
        let [xmin, xmax, ymin, ymax] = self.window;
        let scale = self.tangent.map_or(1.0, |tangent| tangent * depth);
        let x = (xmin + x / self.resolution[0] * (xmax - xmin)) * scale;
        let y = (ymax - y / self.resolution[1] * (ymax - ymin)) * scale;
        self.camera_to_world.point(Vec3::new(x, y, depth))
    }

    /// Returns the width and height of the full image in pixels.
    pub(crate) fn resolution(&self) -> [f32; 2] {
        self.resolution
    }

    /// Returns the position of the camera in world space.
    pub(crate) fn position(&self) -> Vec3 {
        self.camera_to_world.point(Vec3::ZERO)
    }
}

/// Returns the world transformation that moves by a vector.
pub(crate) fn moved(by: Vec3) -> MotionTransform {
    Transform::translate(by).into()
}

/// Returns the world transformation that turns the direction `from` into `to`, around a point.
pub(crate) fn turned(around: Vec3, from: Vec3, to: Vec3) -> Option<MotionTransform> {
    let (from, to) = (from.try_normalize()?, to.try_normalize()?);
    let cross = from.cross(to);
    let angle_rad = libm::atan2f(cross.length(), from.dot(to));
    if angle_rad == 0.0 {
        return None;
    }
    // Of opposite directions any perpendicular axis leads from one to the other.
    let axis = cross.try_normalize().unwrap_or_else(|| from.any_orthonormal_vector());
    let turn = Transform::rotate(angle_rad, axis);
    Some(Transform::translate(-around).then(&turn).then(&Transform::translate(around)).into())
}

/// Returns the angles of a direction in degrees: around the y axis from z towards x, and above the plane of x and z.
pub(crate) fn angles_deg(direction: Vec3) -> [f32; 2] {
    let flat = libm::hypotf(direction.x, direction.z);
    [libm::atan2f(direction.x, direction.z).to_degrees(), libm::atan2f(direction.y, flat).to_degrees()]
}

/// Returns the direction of two angles, see [`angles_deg`].
pub(crate) fn direction([around_deg, above_deg]: [f32; 2]) -> Vec3 {
    let (sin, cos) = libm::sincosf(around_deg.to_radians());
    let (up, flat) = libm::sincosf(above_deg.to_radians());
    Vec3::new(sin * flat, up, cos * flat)
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{Param, Params};

    fn eye(more: &[Param]) -> (Eye, Camera) {
        let params = [Param::declared("int[2] resolution", &[320, 200][..]).unwrap()];
        let camera = Camera {
            name: "c".into(),
            world_to_camera: Transform::rotate(0.4, Vec3::new(1.0, 2.0, 0.5))
                .then(&Transform::translate(Vec3::new(1.0, -2.0, 7.0)))
                .into(),
            params: params.into_iter().chain(more.iter().cloned()).collect::<Params>(),
        };
        (Eye::new(&camera), camera)
    }

    #[test]
    fn pixels_are_those_of_the_camera_and_lead_back_to_the_point() {
        let perspective = [Param::declared("float fov", 40.0).unwrap()];
        let window = Param::declared("float[4] screen", &[-3.0, 2.0, -1.0, 4.0][..]).unwrap();
        let orthographic = [Param::declared("string projection", "orthographic").unwrap(), window];
        for params in [&perspective[..], &orthographic[..]] {
            let (eye, camera) = eye(params);
            for p in [Vec3::new(0.5, 0.25, 1.0), Vec3::ZERO, Vec3::new(-2.0, 1.0, 3.0)] {
                let [x, y, depth] = eye.project(p).unwrap();
                let raster = camera.world_to_camera.first().then(&camera.camera_to_raster()).point(p);
                assert!((raster.x - x).abs() < 0.01 && (raster.y - y).abs() < 0.01, "{raster} {x} {y}");
                assert!((eye.point([x, y], depth) - p).length() < 1.0e-4);
            }
            assert!(eye.project(eye.position()).is_none());
            assert!(eye.project(Vec3::NAN).is_none());
        }
    }

    #[test]
    fn a_turn_leads_to_the_direction_around_the_position() {
        let at = Vec3::new(1.0, 2.0, 3.0);
        for (from, to) in
            [(Vec3::Z, Vec3::X), (Vec3::Z, -Vec3::Z), (Vec3::new(1.0, 2.0, -0.5), Vec3::new(-3.0, 0.1, 0.0))]
        {
            let turn = *turned(at, from, to).unwrap().first();
            assert!((turn.point(at) - at).length() < 1.0e-5);
            let aimed = turn.vector(from.normalize());
            assert!((aimed - to.normalize()).length() < 1.0e-5, "{aimed}");
        }
        assert!(turned(at, Vec3::Z, Vec3::ZERO).is_none() && turned(at, Vec3::Z, Vec3::Z).is_none());
    }

    #[test]
    fn angles_are_those_of_the_direction() {
        for angles in [[0.0, 0.0], [90.0, 30.0], [-120.0, -60.0]] {
            let back = angles_deg(direction(angles));
            assert!(back.iter().zip(angles).all(|(a, b)| (a - b).abs() < 1.0e-3), "{back:?}");
        }
    }
}
