//! The spaces of a camera (reference 2.5, 4.1) as matrices.

use crate::{Camera, attr};
use granita_base::Transform;

/// Returns the "screen" window of a frame of so many pixels, when "screen" is not set. y runs from -1 to 1, and x
/// follows from the numbers of pixels across and down (reference 4.1). "pixelaspect" has no effect.
pub(crate) fn default_window(resolution: [f32; 2]) -> [f32; 4] {
    let aspect = resolution[0].max(1.0) / resolution[1].max(1.0);
    [-aspect, aspect, -1.0, 1.0]
}

impl Camera {
    /// Returns the width and height of the full image in pixels, at least 1.
    pub fn resolution(&self) -> [u32; 2] {
        self.get(attr::RESOLUTION).map(|n| n.max(1) as u32)
    }

    /// Returns `xmin xmax ymin ymax` of the image in "screen" space. The default follows from the shape of the frame.
    pub fn screen_window(&self) -> [f32; 4] {
        self.get(attr::SCREEN).unwrap_or_else(|| default_window(self.resolution().map(|n| n as f32)))
    }

    /// Returns the transform from "camera" to "screen" space. It projects, and z runs from 0 at "near" to 1 at "far".
    ///
    /// The edge of the vertical field of view of a perspective camera is at y = 1.
    pub fn camera_to_screen(&self) -> Transform {
        let near = self.get(attr::NEAR);
        let far = self.get(attr::FAR);
        let depth = if far > near { far - near } else { 1.0 };
        if &*self.get(attr::PROJECTION) == "orthographic" {
            #[rustfmt::skip]
            return Transform::from_rows(&[
                1.0, 0.0, 0.0, 0.0,
                0.0, 1.0, 0.0, 0.0,
                0.0, 0.0, 1.0 / depth, 0.0,
                0.0, 0.0, -near / depth, 1.0,
            ]);
        }
        let fov = self.get(attr::FOV).clamp(1.0e-3, 179.999);
        let scale = 1.0 / libm::tanf(fov.to_radians() * 0.5);
        #[rustfmt::skip]
        return Transform::from_rows(&[
            scale, 0.0, 0.0, 0.0,
            0.0, scale, 0.0, 0.0,
            0.0, 0.0, far / depth, 1.0,
            0.0, 0.0, -far * near / depth, 0.0,
        ]);
    }

    /// Returns the transform from "camera" to "NDC" space: (0, 0) upper left, (1, 1) lower right.
    pub fn camera_to_ndc(&self) -> Transform {
        let [xmin, xmax, ymin, ymax] = self.screen_window();
        let (w, h) = (xmax - xmin, ymin - ymax);
        #[rustfmt::skip]
        let window = Transform::from_rows(&[
            1.0 / w, 0.0, 0.0, 0.0,
            0.0, 1.0 / h, 0.0, 0.0,
            0.0, 0.0, 1.0, 0.0,
            -xmin / w, -ymax / h, 0.0, 1.0,
        ]);
        self.camera_to_screen().then(&window)
    }

    /// Returns the transform from "camera" to "raster" space: pixels, (0, 0) upper left.
    pub fn camera_to_raster(&self) -> Transform {
        let [x, y] = self.resolution();
        self.camera_to_ndc().then(&Transform::scale(granita_base::Vec3::new(x as f32, y as f32, 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{Param, Params, Vec3};

    fn camera(params: &[Param]) -> Camera {
        Camera {
            name: "c".into(),
            world_to_camera: granita_base::MotionTransform::default(),
            params: params.iter().cloned().collect::<Params>(),
        }
    }

    #[test]
    fn image_corners_map_to_raster_and_ndc_corners() {
        let c = camera(&[
            Param::declared("int[2] resolution", &[200, 100][..]).unwrap(),
            Param::declared("float fov", 90.0).unwrap(),
        ]);
        let near = |a: Vec3, x: f32, y: f32| (a.x - x).abs() < 1e-3 && (a.y - y).abs() < 1e-3;
        let raster = c.camera_to_raster();
        assert!(near(raster.point(Vec3::new(-4.0, 2.0, 2.0)), 0.0, 0.0));
        assert!(near(raster.point(Vec3::new(4.0, -2.0, 2.0)), 200.0, 100.0));
        assert!(near(c.camera_to_screen().point(Vec3::new(3.0, 3.0, 3.0)), 1.0, 1.0));
        let z = |z| c.camera_to_screen().point(Vec3::new(0.0, 0.0, z)).z;
        assert!(z(0.1).abs() < 1e-6 && (z(1.0e6) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn orthographic_ignores_depth() {
        let c = camera(&[
            Param::declared("string projection", "orthographic").unwrap(),
            Param::declared("float[4] screen", &[-2.0, 2.0, -1.0, 1.0][..]).unwrap(),
        ]);
        for z in [1.0, 50.0] {
            let p = c.camera_to_ndc().point(Vec3::new(2.0, 1.0, z));
            assert!((p.x - 1.0).abs() < 1e-6 && p.y.abs() < 1e-6);
        }
    }
}
