//! Two views of one camera (reference 4.1, 7.6).
//!
//! The eyes lie on the camera's x axis, half the separation to each side. A point at the depth of convergence is at
//! the same place in both images. A nearer point is farther right in the left image.

use super::{Attributes, CameraView, Projection};
use granita_base::{Transform, Vec3};
use granita_scene::attr;

/// The way in which the views of two eyes converge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EyeProjection {
    /// The directions of view are parallel. The screen windows are shifted so that both show the same at the depth of
    /// convergence.
    #[default]
    OffAxis,
    /// The directions of view are parallel, and each eye has the camera's own screen window.
    Parallel,
    /// The directions of view are turned towards the point of convergence.
    ToeIn,
}

/// The view from which stereo is diced and shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShadedFrom {
    /// The middle between the eyes.
    #[default]
    Center,
    /// The left eye.
    Left,
    /// The right eye.
    Right,
}

/// The stereo attributes of a camera. Lengths are in camera space units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stereo {
    /// The distance of the eyes. A negative distance exchanges them.
    pub separation: f32,
    /// The depth at which both eyes see the same; above 0 unless the projection is parallel.
    pub convergence: f32,
    /// The way in which the views converge.
    pub projection: EyeProjection,
    /// The view from which shading is done.
    pub shade: ShadedFrom,
}

impl Stereo {
    /// Resolves the attributes; `None` for a single view. Invalid values are reported.
    pub(super) fn new(get: &Attributes<'_>, projection: &Projection) -> Option<Self> {
        let separation = get.finite(attr::STEREO_SEPARATION);
        if separation == 0.0 {
            return None;
        }
        let mut eyes = match &*get.camera.get(attr::STEREO_PROJECTION) {
            "off-axis" => EyeProjection::OffAxis,
            "parallel" => EyeProjection::Parallel,
            "toe-in" => EyeProjection::ToeIn,
            other => {
                get.complain(
                    attr::STEREO_PROJECTION,
                    &format!("\"{other}\" is unknown; \"off-axis\" is used"),
                );
                EyeProjection::OffAxis
            }
        };
        let shade = match &*get.camera.get(attr::STEREO_SHADE) {
            "center" => ShadedFrom::Center,
            "left" => ShadedFrom::Left,
            "right" => ShadedFrom::Right,
            other => {
                get.complain(attr::STEREO_SHADE, &format!("\"{other}\" is unknown; \"center\" is used"));
                ShadedFrom::Center
            }
        };
        let convergence = get.finite(attr::STEREO_CONVERGENCE);
        if eyes != EyeProjection::Parallel && convergence <= 0.0 {
            let what =
                format!("{convergence} is not a depth in front of the camera; the two views are parallel");
            get.complain(attr::STEREO_CONVERGENCE, &what);
            eyes = EyeProjection::Parallel;
        }
        if eyes == EyeProjection::OffAxis && *projection == Projection::Orthographic {
            let what = "gives an orthographic camera two equal views; \"toe-in\" shows depth";
            get.complain(attr::STEREO_PROJECTION, what);
        }
        Some(Self { separation, convergence, projection: eyes, shade })
    }
}

impl CameraView {
    /// Returns the views of the left and the right eye; `None` without stereo.
    pub fn eyes(&self) -> Option<[Self; 2]> {
        self.stereo.map(|stereo| [-0.5, 0.5].map(|side| self.eye(&stereo, side * stereo.separation)))
    }

    /// Returns the view from which the scene is diced and shaded, which is the camera itself or one of its eyes
    /// ("stereo:shade").
    pub fn shading_view(&self) -> Self {
        let Some(stereo) = self.stereo else { return self.clone() };
        match stereo.shade {
            ShadedFrom::Center => Self { stereo: None, ..self.clone() },
            ShadedFrom::Left => self.eye(&stereo, -0.5 * stereo.separation),
            ShadedFrom::Right => self.eye(&stereo, 0.5 * stereo.separation),
        }
    }

    /// Returns the view from a point on the camera's x axis.
    pub fn eye(&self, stereo: &Stereo, x_cam: f32) -> Self {
        let mut to_eye = Transform::translate(Vec3::new(-x_cam, 0.0, 0.0));
        let mut screen = self.screen;
        match stereo.projection {
            EyeProjection::Parallel => (),
            EyeProjection::OffAxis => {
                // The part of the scene that the window shows at the depth of convergence must not change.
                let shift = match self.projection {
                    Projection::Perspective { cot_half_fov } => x_cam * (cot_half_fov / stereo.convergence),
                    Projection::Orthographic => x_cam,
                };
                (screen[0], screen[1]) = (screen[0] - shift, screen[1] - shift);
            }
            EyeProjection::ToeIn => {
                let reach = libm::hypotf(x_cam, stereo.convergence);
                let (sin, cos) = (-x_cam / reach, stereo.convergence / reach);
                // The axes of the eye are the columns of the matrix.
                to_eye = to_eye.then(&Transform::from_rows(&[
                    cos, 0.0, sin, 0.0, //
                    0.0, 1.0, 0.0, 0.0, //
                    -sin, 0.0, cos, 0.0, //
                    0.0, 0.0, 0.0, 1.0,
                ]));
            }
        }
        let world_to_camera = self.world_to_camera.then(&to_eye.into());
        Self { world_to_camera, screen, stereo: None, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{MotionTransform, Param, Params, Reporter};
    use granita_scene::Camera;

    fn view(projection: &str, list: &[(&str, f32)]) -> (CameraView, usize) {
        let (reporter, kept) = Reporter::collecting();
        let mut params = Params(list.iter().map(|(d, v)| Param::declared(d, *v).unwrap()).collect());
        params.set(Param::declared("string stereo:projection", projection).unwrap());
        let camera = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
        let view = CameraView::new(&camera, &reporter);
        let said = kept.lock().len();
        (view, said)
    }

    const USUAL: [(&str, f32); 3] =
        [("float stereo:separation", 0.5), ("float stereo:convergence", 4.0), ("float fov", 40.0)];

    /// Returns the raster positions of a camera space point for each eye.
    fn places(view: &CameraView, p: Vec3) -> [Vec3; 2] {
        view.eyes().unwrap().map(|eye| eye.project(eye.world_to_camera.first().point(p)))
    }

    #[test]
    fn disparities_equal_the_closed_form() {
        // The number of pixels per unit at depth 1 is half the height times the cotangent of half the field of view.
        let scale = 240.0 / 20.0_f32.to_radians().tan();
        for z in [1.0_f32, 3.9, 4.0, 7.0, 1000.0] {
            for (x, y) in [(0.0, 0.0), (-0.3, 0.2), (0.4, -0.1)] {
                let p = Vec3::new(x * z, y * z, z);
                let [l, r] = places(&view("off-axis", &USUAL).0, p);
                let exact = scale * 0.5 * (1.0 / z - 1.0 / 4.0);
                assert!((l.x - r.x - exact).abs() < 2e-3, "off-axis {} {exact} at {p}", l.x - r.x);
                assert!((l.y - r.y).abs() < 1e-3);
                let [l, r] = places(&view("parallel", &USUAL).0, p);
                assert!((l.x - r.x - scale * 0.5 / z).abs() < 2e-3, "parallel at {p}");
                // The view is turned by a = atan (0.25 / 4). For the left eye x / z becomes tan (atan ((x + 0.25) /
                // z) - a).
                let [l, r] = places(&view("toe-in", &USUAL).0, p);
                let turn = 0.0625_f32.atan();
                let seen = |eye: f32, turn: f32| 320.0 + scale * ((p.x - eye).atan2(z) - turn).tan();
                assert!((l.x - seen(-0.25, turn)).abs() < 2e-3, "toe-in left at {p}");
                assert!((r.x - seen(0.25, -turn)).abs() < 2e-3, "toe-in right at {p}");
            }
        }
        // At the depth of convergence both eyes see the same. With toe-in this holds for the point in the middle.
        let [l, r] = places(&view("off-axis", &USUAL).0, Vec3::new(1.0, 0.5, 4.0));
        assert!((l - r).length() < 1e-3);
        let [l, r] = places(&view("toe-in", &USUAL).0, Vec3::Z * 4.0);
        assert!((l.x - 320.0).abs() < 1e-3 && (r.x - 320.0).abs() < 1e-3);
    }

    #[test]
    fn without_separation_stereo_has_one_view() {
        let (camera, said) = view("off-axis", &[("float stereo:convergence", 3.0)]);
        assert!(camera.eyes().is_none() && said == 0 && camera.shading_view() == camera);
        let (camera, _) = view("toe-in", &USUAL);
        let stereo = camera.stereo.unwrap();
        let still = camera.eye(&stereo, 0.0);
        assert_eq!(still, CameraView { stereo: None, ..camera.clone() });
    }

    #[test]
    fn invalid_stereo_values_are_reported_once() {
        let parallel = view("parallel", &USUAL[..1]).0.eyes();
        let (camera, said) = view("off-axis", &USUAL[..1]);
        assert_eq!((camera.eyes(), said), (parallel, 1));
        assert_eq!(view("sideways", &USUAL).1, 1);
        let (camera, said) = view("toe-in", &[("float stereo:separation", f32::NAN)]);
        assert!(camera.eyes().is_none() && said == 1);
        assert_eq!(view("toe-in", &[USUAL[0], ("float stereo:convergence", f32::INFINITY)]).1, 1);
    }

    #[test]
    fn shading_uses_the_view_that_the_attribute_names() {
        let (mut camera, _) = view("off-axis", &USUAL);
        let [left, right] = camera.eyes().unwrap();
        let x = |view: &CameraView| view.position_world().x;
        assert!((x(&left) + 0.25).abs() < 1e-6 && (x(&right) - 0.25).abs() < 1e-6);
        assert_eq!(x(&camera.shading_view()), 0.0);
        for (shade, expected) in [(ShadedFrom::Left, &left), (ShadedFrom::Right, &right)] {
            camera.stereo = camera.stereo.map(|s| Stereo { shade, ..s });
            assert_eq!(camera.shading_view(), *expected);
        }
    }
}
