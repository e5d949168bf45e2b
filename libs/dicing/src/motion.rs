//! The positions of a primitive at its motion keys.

use crate::{CameraView, Projection, longest_axis};
use granita_base::{Bound, DMat4, DVec3, MotionTransform, Transform, Vec3};
use granita_geom::{Surface, View};

/// The transform of a primitive to world space, and the times between which its points move on straight lines.
#[derive(Clone, Debug)]
pub struct Placement {
    /// The transform from object to world space.
    pub to_world: MotionTransform,
    /// The times, increasing. A primitive that does not move has one time, the shading time.
    times: Vec<f32>,
    /// The size of its coordinates; `None` where rounding to single precision is never visible.
    reach: Option<Reach>,
}

/// The size of coordinates in the transform from object to camera space. The products of the matrices are rounded
/// relative to this size, which may be much larger than the remaining coordinates near the eye.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// The lengths of the transformed unit axes of object space, in camera space units.
    stretch: Vec3,
    /// The sum of the lengths of the translations, in camera space units.
    offset: f32,
}

impl Reach {
    /// Returns a bound of the rounding of a camera space position, in camera space units. `largest` holds the largest
    /// object space coordinates along the axes.
    pub fn rounding(&self, largest: Vec3) -> f32 {
        f32::EPSILON * (self.stretch.dot(largest) + self.offset)
    }
}

/// Rounding of positions by less than this, in raster pixels, is not visible. The boundary edges of grids cover it.
const ROUNDING_PX: f32 = 0.02;

/// True when rounding by so many raster pixels is visible, and when the number is NaN.
pub fn shows(rounding_px: f32) -> bool {
    rounding_px > ROUNDING_PX || rounding_px.is_nan()
}

/// Returns the number of pixels per camera space unit at a depth, which is clamped to the near plane.
pub fn pixels_at(camera: &CameraView, z: f32) -> f32 {
    camera.raster_scale(z.max(camera.near)).abs().max_element()
}

/// Returns the largest object space coordinates along the axes of some pieces, at any motion key.
pub fn largest_coordinates<'p>(pieces: impl Iterator<Item = &'p dyn Surface>) -> Vec3 {
    let of_key = |(piece, key): (&dyn Surface, usize)| {
        let bound = piece.bound(key);
        if bound.is_empty() { Vec3::ZERO } else { bound.min.abs().max(bound.max.abs()) }
    };
    pieces
        .flat_map(|p| (0..p.key_times().len()).map(move |key| (p, key)))
        .map(of_key)
        .fold(Vec3::ZERO, Vec3::max)
}

/// Transforms a position in double precision by a matrix for column vectors.
pub fn precise_point(m: &DMat4, p: DVec3) -> DVec3 {
    let h = *m * p.extend(1.0);
    if h.w == 1.0 { h.truncate() } else { h.truncate() / h.w }
}

impl Placement {
    /// Combines the motion keys of the object, of `shape_times` (deformation) and of `cameras`, clipped to the
    /// shutter. The ends of the shutter are always among them when anything moves.
    pub fn new(
        to_world: &MotionTransform,
        shape_times: &[f32],
        cameras: &[&MotionTransform],
        shutter: [f32; 2],
    ) -> Self {
        let [open, close] = shutter;
        let moving =
            to_world.is_moving() || shape_times.len() > 1 || cameras.iter().any(|camera| camera.is_moving());
        let mut times = vec![open];
        if moving && close > open {
            let keys = |m: &MotionTransform| m.keys().iter().map(|k| k.0).collect::<Vec<_>>();
            times.push(close);
            // A single key is not a motion. Its time has no meaning.
            let lists = cameras.iter().copied().chain([to_world]).filter(|m| m.is_moving()).map(keys);
            let shape = (shape_times.len() > 1).then(|| shape_times.to_vec());
            times.extend(lists.chain(shape).flatten().filter(|t| *t > open && *t < close));
            times.sort_by(f32::total_cmp);
            times.dedup();
        }
        Self { to_world: to_world.clone(), times, reach: None }
    }

    /// Determines whether rounding to single precision may be visible to any of these cameras, for a primitive whose
    /// largest object space coordinates are `largest`.
    pub fn look_from<'c>(&mut self, cameras: impl Iterator<Item = &'c CameraView> + Clone, largest: Vec3) {
        let mut reach = Reach { stretch: Vec3::ZERO, offset: 0.0 };
        for camera in cameras.clone() {
            for &time in &self.times {
                let (to_world, to_camera) = (self.to_world.at(time), camera.world_to_camera.at(time));
                let length = |m: &Transform| longest_axis(|v| m.vector(v));
                let all = to_world.then(&to_camera);
                let moved = to_world.point(Vec3::ZERO).length() * length(&to_camera);
                reach.stretch =
                    reach.stretch.max([Vec3::X, Vec3::Y, Vec3::Z].map(|v| all.vector(v).length()).into());
                reach.offset = reach.offset.max(moved + to_camera.point(Vec3::ZERO).length());
            }
        }
        let px = |camera: &CameraView| reach.rounding(largest) * pixels_at(camera, camera.near);
        self.reach = cameras.into_iter().any(|camera| shows(px(camera))).then_some(reach);
    }

    /// Returns the size of its coordinates; `None` where rounding to single precision is never visible.
    pub fn reach(&self) -> Option<&Reach> {
        self.reach.as_ref()
    }

    /// Returns the matrix from object to camera space at a time in double precision, for column vectors.
    pub fn precise_to(&self, camera: &CameraView, time: f32) -> DMat4 {
        camera.world_to_camera.precise_at(time) * self.to_world.precise_at(time)
    }

    /// Returns the times between which points move on straight lines in world (and camera) space.
    pub fn times(&self) -> &[f32] {
        &self.times
    }

    /// Returns the object space bound at a time. The bounds of the keys are interpolated as their points are.
    pub fn object_bound(surface: &dyn Surface, time: f32) -> Bound {
        let (key, next, alpha) = key_at(surface.key_times(), time);
        let a = surface.bound(key);
        if alpha == 0.0 {
            return a;
        }
        let b = surface.bound(next);
        Bound { min: a.min.lerp(b.min, alpha), max: a.max.lerp(b.max, alpha) }
    }
}

/// The dicing camera in the object space of a primitive, at each of its motion keys.
#[derive(Clone, Debug)]
pub struct Viewer {
    keys: Vec<ViewerKey>,
    perspective: bool,
    /// The size of a pixel in camera space units, at distance 1 in a perspective.
    pixel_cam: f32,
}

#[derive(Clone, Copy, Debug)]
struct ViewerKey {
    /// The position of the camera, or in an orthographic view the direction towards it, in object space.
    eye: Vec3,
    /// The transform from object to camera space.
    to_camera: Transform,
    /// The object space length of one camera space unit.
    scale: f32,
}

impl Viewer {
    /// Returns `camera` in the object space of a piece with these key times.
    pub fn new(camera: &CameraView, placement: &Placement, key_times: &[f32]) -> Self {
        let perspective = matches!(camera.projection, Projection::Perspective { .. });
        let s = camera.raster_scale(1.0);
        let keys = key_times
            .iter()
            .map(|&t| {
                let time = if key_times.len() == 1 { placement.times[0] } else { t };
                let to_camera = placement.to_world.at(time).then(&camera.world_to_camera.at(time));
                let back = to_camera.inverse();
                let eye = if perspective { back.point(Vec3::ZERO) } else { back.vector(-Vec3::Z) };
                let scale = [Vec3::X, Vec3::Y, Vec3::Z].map(|a| back.vector(a).length());
                ViewerKey { eye, to_camera, scale: libm::cbrtf(scale[0] * scale[1] * scale[2]) }
            })
            .collect();
        Self { keys, perspective, pixel_cam: 1.0 / s.x.abs().max(s.y.abs()) }
    }

    /// Returns the view from a point at a motion key.
    pub fn view(&self, key: usize, p: Vec3) -> View {
        let key = &self.keys[key.min(self.keys.len() - 1)];
        if self.perspective {
            let depth = key.to_camera.point(p).z.max(1e-6);
            View { toward: key.eye - p, pixel: self.pixel_cam * depth * key.scale }
        } else {
            View { toward: key.eye, pixel: self.pixel_cam * key.scale }
        }
    }
}

/// Returns the index of the key at or before `time`, the index of the next key, and the fraction between them. Before
/// the first and after the last key the motion is constant.
#[inline]
pub fn key_at(times: &[f32], time: f32) -> (usize, usize, f32) {
    let after = times.partition_point(|t| *t <= time);
    if after == 0 {
        return (0, 0, 0.0);
    }
    if after >= times.len() {
        return (times.len() - 1, times.len() - 1, 0.0);
    }
    let (t0, t1) = (times[after - 1], times[after]);
    (after - 1, after, (time - t0) / (t1 - t0))
}

/// Returns the points of deformation keys (`keys[k][i]` at `times[k]`) at `time`, transformed.
pub fn points_at(keys: &[Vec<Vec3>], times: &[f32], time: f32, to: &Transform) -> Vec<Vec3> {
    let (a, b, alpha) = key_at(times, time);
    let (Some(first), Some(second)) = (keys.get(a), keys.get(b)) else { return Vec::new() };
    if alpha == 0.0 {
        first.iter().map(|p| to.point(*p)).collect()
    } else {
        first.iter().zip(second).map(|(p, q)| to.point(p.lerp(*q, alpha))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_times_are_clipped_to_the_shutter() {
        let moving = MotionTransform::from_keys(vec![
            (0.0, Transform::IDENTITY),
            (0.25, Transform::IDENTITY),
            (1.0, Transform::IDENTITY),
        ])
        .unwrap();
        let still = MotionTransform::default();
        assert_eq!(Placement::new(&moving, &[0.0], &[&still], [0.1, 0.5]).times(), [0.1, 0.25, 0.5]);
        assert_eq!(Placement::new(&still, &[0.0], &[&still], [0.1, 0.5]).times(), [0.1]);
        assert_eq!(Placement::new(&still, &[0.0, 0.3], &[&still], [0.1, 0.5]).times(), [0.1, 0.3, 0.5]);
        assert_eq!(Placement::new(&moving, &[0.0], &[&still], [0.1, 0.1]).times(), [0.1]);
    }

    #[test]
    fn motion_keys_blend_and_are_constant_outside() {
        assert_eq!(key_at(&[0.0, 1.0], -1.0), (0, 0, 0.0));
        assert_eq!(key_at(&[0.0, 1.0], 0.25), (0, 1, 0.25));
        assert_eq!(key_at(&[0.0, 1.0], 2.0), (1, 1, 0.0));
        assert_eq!(key_at(&[0.5], 0.7), (0, 0, 0.0));
        let keys = [vec![Vec3::ZERO], vec![Vec3::X]];
        assert_eq!(points_at(&keys, &[0.0, 2.0], 0.5, &Transform::IDENTITY), [Vec3::X * 0.25]);
    }
}
