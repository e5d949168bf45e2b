//! Where a camera stands that shows all of some points.

use granita_base::{Transform, Vec3};
use std::f32::consts::TAU;

/// The part of the image that the objects may fill, from the middle to the border, across and up.
const FILLED: [f32; 2] = [0.82, 0.78];
/// The direction of the camera: turned about the vertical axis from the front, and raised above the floor, in degrees.
const TURNED_DEG: f32 = 28.0;
const RAISED_DEG: f32 = 17.0;
/// The largest number of positions of a turntable that are examined.
const MOST_TURNS: u32 = 24;

/// The axis of the space of the objects that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// The y axis, as in glTF and most OBJ files.
    #[default]
    Y,
    /// The z axis, as in most STL files.
    Z,
}

/// The space of the objects.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Space {
    pub(crate) up: Up,
    /// True where the y axis, seen with the x axis to the right and the z axis up, points away, as in mesh files.
    pub(crate) right_handed: bool,
}

/// The directions of a view, in world space. All have length 1.
#[derive(Clone, Copy, Debug)]
struct Axes {
    right: Vec3,
    up: Vec3,
    forward: Vec3,
}

impl Axes {
    /// Returns the view from the front, along the floor.
    fn front(space: Space) -> Self {
        let (right, up) = match space.up {
            Up::Y => (Vec3::X, Vec3::Y),
            Up::Z => (Vec3::X, Vec3::Z),
        };
        let forward = if space.right_handed { up.cross(right) } else { right.cross(up) };
        Self { right, up, forward }
    }

    /// Returns the view from farther to the right.
    fn turned(self, angle_rad: f32) -> Self {
        let (sin, cos) = libm::sincosf(angle_rad);
        let Self { right, up, forward } = self;
        Self { right: right * cos + forward * sin, up, forward: forward * cos - right * sin }
    }

    /// Returns the view from farther up.
    fn raised(self, angle_rad: f32) -> Self {
        let (sin, cos) = libm::sincosf(angle_rad);
        let Self { right, up, forward } = self;
        Self { right, up: up * cos + forward * sin, forward: forward * cos - up * sin }
    }

    /// Returns the coordinates of a vector: right, up, forward.
    fn coordinates(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.right.dot(v), self.up.dot(v), self.forward.dot(v))
    }

    /// Returns the transformation from the space of these axes, in a unit of `scale`, to world space.
    fn to_world(self, origin: Vec3, scale: f32) -> [f32; 16] {
        let Self { right, up, forward } = self;
        let row = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
        let rows =
            [row(right * scale, 0.0), row(up * scale, 0.0), row(forward * scale, 0.0), row(origin, 1.0)];
        let mut all = [0.0; 16];
        all.iter_mut().zip(rows.iter().flatten()).for_each(|(to, from)| *to = *from);
        all
    }
}

/// How a camera projects.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Lens {
    /// The tangent of half the vertical field of view.
    Perspective(f32),
    Orthographic,
}

/// A camera and a studio around objects.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Framing {
    /// The transformation from camera space to world.
    pub(crate) camera: [f32; 16],
    /// Half the height of what an orthographic camera shows.
    pub(crate) half_height: f32,
    /// The distances of the near and the far clipping plane.
    pub(crate) range: [f32; 2],
    /// The transformation from the space of the studio to world: the origin is on the floor below the objects, y points
    /// up, z away from the camera, and the ball around the objects has the radius 1.
    pub(crate) studio: [f32; 16],
    /// The radius of that ball in world units.
    pub(crate) radius: f32,
    /// The middle of the objects.
    center: Vec3,
    up: Vec3,
    /// The signed direction of a turn.
    sign: f32,
}

impl Framing {
    /// Frames balls (positions with radii) in an image that is `aspect` times as wide as high, in each of `turns`
    /// positions of a turntable. Returns `None` without any ball.
    pub(crate) fn new(
        balls: &[(Vec3, f32)],
        space: Space,
        lens: Lens,
        aspect: f32,
        turns: u32,
    ) -> Option<Self> {
        let front = Axes::front(space);
        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (p, radius) in balls {
            let p = front.coordinates(*p);
            min = min.min(p - *radius);
            max = max.max(p + *radius);
        }
        if !min.cmple(max).all() {
            return None;
        }
        let to_world = |p: Vec3| front.right * p.x + front.up * p.y + front.forward * p.z;
        let middle = (min + max) * 0.5;
        let center = to_world(middle);
        let floor = to_world(Vec3::new(middle.x, min.y, middle.z));
        let radius = balls.iter().map(|(p, r)| p.distance(center) + r).fold(0.0, f32::max);
        let radius = if radius > 0.0 { radius } else { 1.0 };
        let flat = front.turned(TURNED_DEG.to_radians());
        let view = flat.raised(RAISED_DEG.to_radians());
        let tangent = match lens {
            Lens::Perspective(tangent) => tangent,
            Lens::Orthographic => 0.0,
        };
        let window = match lens {
            Lens::Perspective(tangent) => [FILLED[0] * tangent * aspect, FILLED[1] * tangent],
            Lens::Orthographic => [0.0, 0.0],
        };
        // The widest of each side of the view, over all positions of the turntable.
        let mut side = [[f32::NEG_INFINITY; 2]; 2];
        let mut nearest = f32::INFINITY;
        let turns = turns.clamp(1, MOST_TURNS);
        for k in 0..turns {
            let axes = flat.turned(TAU * k as f32 / turns as f32).raised(RAISED_DEG.to_radians());
            for (p, r) in balls {
                let p = axes.coordinates(*p - center);
                nearest = nearest.min(p.z - r);
                for (axis, t) in window.into_iter().enumerate() {
                    let grown = r * (1.0 + t * t).sqrt();
                    side[axis][0] = side[axis][0].max(-p[axis] - t * p.z + grown);
                    side[axis][1] = side[axis][1].max(p[axis] - t * p.z + grown);
                }
            }
        }
        let [x, y] = side.map(|[low, high]| 0.5 * (high - low));
        let [wide, high] = side.map(|[low, high]| 0.5 * (low + high));
        let z = match lens {
            Lens::Perspective(_) => (-wide / window[0]).min(-high / window[1]),
            Lens::Orthographic => -4.0 * radius,
        };
        // The near clipping plane must not cut the objects.
        let z = z.min(nearest - 0.05 * radius);
        let eye = center + view.right * x + view.up * y + view.forward * z;
        let half_height = (wide / FILLED[0] / aspect).max(high / FILLED[1]).max(1.0e-6 * radius);
        let distance = center.distance(eye);
        let near = 0.5 * (nearest - z).max(1.0e-3 * distance).min(distance);
        let range = [near, distance + 1.0e3 * radius * (1.0 + tangent)];
        Some(Self {
            camera: view.to_world(eye, 1.0),
            half_height,
            range,
            studio: flat.to_world(floor, radius),
            radius,
            center,
            up: front.up,
            sign: if space.right_handed { 1.0 } else { -1.0 },
        })
    }

    /// Returns the transformation of the camera and the studio, in world space, for a part of a whole turn. The objects
    /// seem to turn by it.
    pub(crate) fn turn(&self, part: f32) -> Transform {
        let turn = Transform::rotate(self.sign * TAU * part, self.up);
        Transform::translate(-self.center).then(&turn).then(&Transform::translate(self.center))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MESH: Space = Space { up: Up::Y, right_handed: true };

    /// Returns the largest screen coordinates of balls in an image of 4 x 3, as fractions of its half sides.
    fn extent(framing: &Framing, balls: &[(Vec3, f32)], tangent: f32, turn: f32) -> [f32; 2] {
        let camera = Transform::from_rows(&framing.camera).then(&framing.turn(turn));
        let to_camera = camera.try_inverse().unwrap();
        balls.iter().fold([0.0f32; 2], |most, (p, _)| {
            let p = to_camera.point(*p);
            assert!(p.z > framing.range[0] && p.z < framing.range[1], "{p} {:?}", framing.range);
            let [x, y] = [p.x / (p.z * tangent * 4.0 / 3.0), p.y / (p.z * tangent)];
            [most[0].max(x.abs()), most[1].max(y.abs())]
        })
    }

    fn cloud(scale: Vec3, offset: Vec3) -> Vec<(Vec3, f32)> {
        let point = |i: u32| {
            let at = |k: u32| granita_base::hash::words(&[i, k]) as f32 / u32::MAX as f32 - 0.5;
            (Vec3::new(at(0), at(1), at(2)) * scale + offset, 0.0)
        };
        (0..200).map(point).collect()
    }

    #[test]
    fn objects_of_any_shape_and_place_fill_the_image_and_none_is_cut() {
        let tangent = 15f32.to_radians().tan();
        for (scale, offset) in [
            (Vec3::ONE, Vec3::ZERO),
            (Vec3::new(10.0, 0.1, 0.1), Vec3::new(100.0, 0.0, -50.0)),
            (Vec3::new(0.0, 3.0e-5, 0.0), Vec3::ZERO),
            (Vec3::new(7.0e4, 0.0, 7.0e4), Vec3::new(0.0, 1.0e5, 0.0)),
        ] {
            let balls = cloud(scale, offset);
            for up in [Up::Y, Up::Z] {
                for right_handed in [true, false] {
                    let space = Space { up, right_handed };
                    let f = Framing::new(&balls, space, Lens::Perspective(tangent), 4.0 / 3.0, 1).unwrap();
                    let [x, y] = extent(&f, &balls, tangent, 0.0);
                    let fills = (x / FILLED[0] - 1.0).abs() < 0.02 || (y / FILLED[1] - 1.0).abs() < 0.02;
                    assert!(
                        fills && x < FILLED[0] * 1.02 && y < FILLED[1] * 1.02,
                        "{space:?} {scale} {x} {y}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_turntable_shows_everything_at_each_angle() {
        let tangent = 15f32.to_radians().tan();
        let balls = cloud(Vec3::new(4.0, 1.0, 0.5), Vec3::new(3.0, 0.0, 2.0));
        let f = Framing::new(&balls, MESH, Lens::Perspective(tangent), 4.0 / 3.0, 36).unwrap();
        let all: Vec<_> = (0..12).map(|k| extent(&f, &balls, tangent, k as f32 / 12.0)).collect();
        assert!(all.iter().all(|[x, y]| *x < FILLED[0] * 1.03 && *y < FILLED[1] * 1.03), "{all:?}");
        assert!(all.iter().any(|[x, _]| *x > FILLED[0] * 0.95), "{all:?}");
    }

    #[test]
    fn the_camera_stands_in_front_and_above_and_the_floor_is_below() {
        let balls = [(Vec3::ZERO, 1.0)];
        let f = Framing::new(&balls, MESH, Lens::Perspective(0.3), 1.0, 1).unwrap();
        let [.., x, y, z, _] = f.camera;
        assert!(x > 0.5 && y > 0.5 && z > 2.0, "{x} {y} {z}");
        assert!((f.studio[13] + 1.0).abs() < 1.0e-6 && (f.radius - 1.0).abs() < 1.0e-6);
        let pyg = Space { up: Up::Y, right_handed: false };
        let [.., z, _] = Framing::new(&balls, pyg, Lens::Perspective(0.3), 1.0, 1).unwrap().camera;
        assert!(z < -2.0, "{z}");
        let solid = Space { up: Up::Z, right_handed: true };
        let [.., y, z, _] = Framing::new(&balls, solid, Lens::Perspective(0.3), 1.0, 1).unwrap().camera;
        assert!(y < -2.0 && z > 0.5, "{y} {z}");
        assert!(Framing::new(&[], MESH, Lens::Orthographic, 1.0, 1).is_none());
    }

    #[test]
    fn an_orthographic_camera_shows_everything() {
        let balls = cloud(Vec3::new(4.0, 1.0, 0.5), Vec3::new(3.0, 0.0, 2.0));
        let f = Framing::new(&balls, MESH, Lens::Orthographic, 2.0, 1).unwrap();
        let to_camera = Transform::from_rows(&f.camera).try_inverse().unwrap();
        let most = balls.iter().map(|(p, _)| to_camera.point(*p)).fold([0.0f32; 2], |most, p| {
            assert!(p.z > f.range[0]);
            [most[0].max(p.x.abs() / (2.0 * f.half_height)), most[1].max(p.y.abs() / f.half_height)]
        });
        assert!(most[0] <= FILLED[0] * 1.01 && most[1] <= FILLED[1] * 1.01, "{most:?}");
        assert!(most[0] > FILLED[0] * 0.98 || most[1] > FILLED[1] * 0.98, "{most:?}");
    }
}
