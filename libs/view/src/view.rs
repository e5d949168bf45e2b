//! The view: the visible part of a sheet, or a direction in a panorama.

/// The part of a sheet that is on screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The width of the screen in its pixels.
    pub width: u32,
    /// The height of the screen in its pixels.
    pub height: u32,
    /// The point of the sheet in the centre of the screen.
    pub center: (f64, f64),
    /// The number of screen pixels per pixel of the sheet.
    pub zoom: f64,
    /// The direction in a panorama, which replaces the sheet.
    pub around: Option<Around>,
}

/// A direction in a panorama.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around {
    /// The angle to the right of the image's centre, in degrees.
    pub yaw_deg: f64,
    /// The angle upward, in degrees.
    pub pitch_deg: f64,
    /// The angle from the upper to the lower edge of the screen, in degrees.
    pub fov_deg: f64,
}

impl Default for Around {
    fn default() -> Self {
        Self { yaw_deg: 0.0, pitch_deg: 0.0, fov_deg: 75.0 }
    }
}

/// The least and the largest zoom.
const ZOOM: (f64, f64) = (1.0 / 1024.0, 512.0);

impl View {
    /// Returns a view of all of `bounds` (left, top, right, bottom) on a screen of this size. Small images are not
    /// enlarged.
    pub fn fit(width: u32, height: u32, bounds: [f64; 4]) -> Self {
        let [left, top, right, bottom] = bounds;
        let across = f64::from(width.max(1)) / (right - left).max(1.0);
        let down = f64::from(height.max(1)) / (bottom - top).max(1.0);
        let mut view = Self {
            width,
            height,
            center: ((left + right) / 2.0, (top + bottom) / 2.0),
            zoom: across.min(down).clamp(ZOOM.0, ZOOM.1),
            around: None,
        };
        if view.zoom > 1.0 {
            // A whole number gives all pixels the same size.
            view.zoom = view.zoom.floor();
        }
        view
    }

    /// Returns the point of the sheet at a point of the screen, which is measured from the upper left corner.
    pub fn to_sheet(&self, x: f64, y: f64) -> (f64, f64) {
        let (w, h) = (f64::from(self.width), f64::from(self.height));
        (self.center.0 + (x - w / 2.0) / self.zoom, self.center.1 + (y - h / 2.0) / self.zoom)
    }

    /// Returns the point of the screen at a point of the sheet.
    pub fn to_screen(&self, x: f64, y: f64) -> (f64, f64) {
        let (w, h) = (f64::from(self.width), f64::from(self.height));
        ((x - self.center.0) * self.zoom + w / 2.0, (y - self.center.1) * self.zoom + h / 2.0)
    }

    /// Changes the zoom and keeps the image at point (x, y) of the screen in place.
    pub fn zoom_at(&mut self, x: f64, y: f64, factor: f64) {
        if let Some(around) = &mut self.around {
            around.fov_deg = (around.fov_deg / factor).clamp(5.0, 150.0);
            return;
        }
        let before = self.to_sheet(x, y);
        self.zoom = (self.zoom * factor).clamp(ZOOM.0, ZOOM.1);
        let after = self.to_sheet(x, y);
        self.center.0 += before.0 - after.0;
        self.center.1 += before.1 - after.1;
    }

    /// Moves the image by this number of screen pixels.
    pub fn pan(&mut self, dx: f64, dy: f64) {
        if let Some(around) = &mut self.around {
            let deg = around.fov_deg / f64::from(self.height.max(1));
            around.yaw_deg = (around.yaw_deg - dx * deg + 180.0).rem_euclid(360.0) - 180.0;
            around.pitch_deg = (around.pitch_deg + dy * deg).clamp(-90.0, 90.0);
            return;
        }
        self.center.0 -= dx / self.zoom;
        self.center.1 -= dy / self.zoom;
    }

    /// Changes the size of the screen around the same centre.
    pub fn resize(&mut self, width: u32, height: u32) {
        (self.width, self.height) = (width, height);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zooming_keeps_the_point_under_the_cursor() {
        let mut view = View::fit(800, 600, [0.0, 0.0, 4000.0, 1000.0]);
        assert_eq!((view.zoom, view.center), (0.2, (2000.0, 500.0)));
        let at = view.to_sheet(100.0, 50.0);
        view.zoom_at(100.0, 50.0, 3.7);
        let after = view.to_sheet(100.0, 50.0);
        assert!((at.0 - after.0).abs() < 1e-9 && (at.1 - after.1).abs() < 1e-9);
        assert_eq!(view.to_screen(after.0, after.1), (100.0, 50.0));
        (0..200).for_each(|_| view.zoom_at(1.0, 1.0, 4.0));
        assert_eq!(view.zoom, ZOOM.1);
    }

    #[test]
    fn degenerate_bounds_give_a_finite_zoom() {
        for bounds in [[0.0; 4], [5.0, 5.0, 5.0, 9.0]] {
            let view = View::fit(0, 0, bounds);
            assert!(view.zoom > 0.0 && view.zoom.is_finite());
        }
        assert_eq!(View::fit(100, 100, [0.0, 0.0, 30.0, 30.0]).zoom, 3.0);
    }

    #[test]
    fn panning_a_panorama_wraps_and_is_clamped() {
        let mut view = View { around: Some(Around::default()), ..View::fit(100, 75, [0.0, 0.0, 8.0, 4.0]) };
        view.pan(-200.0, 500.0);
        let around = view.around.unwrap();
        assert_eq!((around.yaw_deg, around.pitch_deg), (-160.0, 90.0));
    }
}
