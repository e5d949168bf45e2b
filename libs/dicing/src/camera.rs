// tidy: long: one type holds what a camera is, with what is projected, moved and bounded by it
//! The camera, resolved from its attributes (reference 4.1, 7.1, 7.2): projection, windows and sampling.

mod stereo;

pub use stereo::{EyeProjection, ShadedFrom, Stereo};

use crate::PixelRect;
use granita_base::{Location, MotionTransform, Param, Params, Reporter, Severity, Transform, Vec2, Vec3};
use granita_scene::attribute::{AttributeValue, Key, scope};
use granita_scene::{Camera, Primitive, Scene, attr};
use std::sync::Arc;

/// The largest number of shading samples per raster unit that "shadingquality" and "preview" may request.
pub const MAX_QUALITY: f32 = 100.0;

/// The projection of three dimensions to two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Lines of sight intersect in the camera. `cot_half_fov` scales camera space at z = 1 to "screen" space.
    Perspective {
        /// 1 / tan (fov / 2), where fov is the vertical field of view for the default screen window.
        cot_half_fov: f32,
    },
    /// Lines of sight are parallel. "screen" x and y are those of "camera" space.
    Orthographic,
}

/// The parts of the scene that preview mode omits or simplifies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreviewLimits {
    /// The attribute "preview:thincurves": one of this many curves is drawn.
    pub thincurves: u32,
    /// The attribute "preview:thinpoints": one of this many points is drawn.
    pub thinpoints: u32,
    /// The attribute "preview:limitpixelsize": objects whose boxes cover fewer pixels are drawn as boxes.
    pub limitpixelsize: f32,
    /// The attribute "preview:limitdistance": objects farther than this from the camera are drawn as boxes.
    pub limitdistance: f32,
}

/// A thin lens (reference 7.1.4). Lengths are in camera space units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// The radius of the aperture: focallength / (2 fstop).
    pub radius: f32,
    /// The depth that is in sharp focus.
    pub focal_distance: f32,
}

/// A camera with all attributes resolved that a frame needs.
///
/// Raster space has its origin at the upper left. One unit is a pixel. "screen" and raster z are 0 on the near and 1
/// on the far plane, and hyperbolic between them for a perspective projection.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraView {
    /// The name of the camera, which is also the name of its geometry set.
    pub name: Arc<str>,
    /// The transform from "common" to camera space. "common" space is world space unless it has another origin
    /// (`common_origin`).
    pub world_to_camera: MotionTransform,
    /// The origin of "common" space in the world. All world space values of this type are relative to it.
    pub common_origin: Vec3,
    /// The projection.
    pub projection: Projection,
    /// The resolution of the whole image in pixels.
    pub resolution: [u32; 2],
    /// The width of a pixel over its height, as it is written to files. It has no other effect.
    pub pixelaspect: f32,
    /// The "screen" window: xmin, xmax, ymin, ymax.
    pub screen: [f32; 4],
    /// The pixels to render, inside of the resolution.
    pub crop: PixelRect,
    /// The camera space z of the near clipping plane.
    pub near: f32,
    /// The camera space z of the far clipping plane.
    pub far: f32,
    /// The times at which the shutter opens and closes; equal without motion blur.
    pub shutter: [f32; 2],
    /// True when no shutter is given. Moving objects are then drawn at the earliest time of their motion.
    pub is_timeless: bool,
    /// The lens for depth of field; `None` for a pinhole.
    pub lens: Option<Lens>,
    /// The numbers of samples across and down a pixel.
    pub spatialquality: [u32; 2],
    /// The least number of different times in a pixel.
    pub temporalquality: u32,
    /// The least number of different lens positions in a pixel.
    pub dofquality: u32,
    /// The attribute "limits:autopassreduction". When true, pixels in which nothing blurs are not sampled in time and
    /// on the lens.
    pub autopassreduction: bool,
    /// The size of a bucket in pixels.
    pub bucketsize: [u32; 2],
    /// The bucket order: "horizontal", "vertical" or "spiral".
    pub bucketorder: Arc<str>,
    /// The number of buckets along each side of the clusters that are rendered one after the other.
    pub bucketblocksize: u32,
    /// The quality of preview mode, which replaces "shadingquality" when it is not 0.
    pub preview: f32,
    /// The "dice:curvature" of preview mode, in degrees.
    pub preview_dicecurvature_deg: f32,
    /// The omissions of preview mode; `None` outside of it.
    pub preview_limits: Option<PreviewLimits>,
    /// The stereo settings, for two views instead of one.
    pub stereo: Option<Stereo>,
}

/// A bound of the relative rounding error of a few operations in single precision.
const CLIP_ROUNDING: f32 = f32::EPSILON;

/// The attributes of one camera, with messages about invalid values.
struct Attributes<'a> {
    camera: &'a Camera,
    reporter: &'a Reporter,
}

impl Attributes<'_> {
    /// "screen", or the default.
    fn screen(&self, default: [f32; 4]) -> [f32; 4] {
        match self.finite(attr::SCREEN) {
            Some(s) if s[0] != s[1] && s[2] != s[3] => s,
            Some(_) => {
                self.complain(attr::SCREEN, "has no area; the default is used");
                default
            }
            None => default,
        }
    }

    /// "projection" and "fov".
    fn projection(&self) -> Projection {
        match &*self.camera.get(attr::PROJECTION) {
            "orthographic" => return Projection::Orthographic,
            "perspective" => (),
            other => {
                let text = format!("\"{other}\" is unknown; \"perspective\" is used");
                self.complain(attr::PROJECTION, &text);
            }
        }
        let least = CameraView::LEAST_FOV_DEG;
        let fov_deg = match self.finite(attr::FOV) {
            f if (least..180.0).contains(&f) => f,
            f if f > 0.0 && f < 180.0 => {
                self.complain(attr::FOV, &format!("{f:e} degrees is less than {least:e}, which is used"));
                least
            }
            f => {
                self.complain(attr::FOV, &format!("{f} is outside 0 to 180 degrees; 90 is used"));
                90.0
            }
        };
        Projection::Perspective { cot_half_fov: 1.0 / libm::tanf(fov_deg.to_radians() * 0.5) }
    }

    /// "preview", from 0 to [`MAX_QUALITY`].
    fn preview(&self) -> f32 {
        let preview = self.finite(attr::PREVIEW).max(0.0);
        if preview > MAX_QUALITY {
            self.complain(attr::PREVIEW, &format!("{preview:e} is more than {MAX_QUALITY}, which is used"));
        }
        preview.min(MAX_QUALITY)
    }

    /// The transformation of the camera; that of the origin in place of one with numbers that are not finite.
    fn world_to_camera(&self) -> MotionTransform {
        let Camera { name, world_to_camera, .. } = self.camera;
        if world_to_camera.keys().iter().all(|(_, m)| m.is_finite()) {
            return world_to_camera.clone();
        }
        let text = format!(
            "camera \"{name}\": its transformation has numbers that are not finite; the camera is placed at the origin"
        );
        self.reporter.once(&text.clone(), Severity::Error, &Location::default(), text);
        MotionTransform::default()
    }

    /// Returns the value of an attribute, or its default when the value is not finite.
    fn finite<T: AttributeValue + Finite>(&self, key: Key<scope::Camera, T>) -> T {
        let value = self.camera.get(key);
        if value.is_finite() {
            return value;
        }
        self.complain(key, "is not made of finite numbers; the default is used");
        key.default()
    }

    /// Returns counts, clamped to 1 to `max`.
    fn counts<const N: usize>(&self, key: Key<scope::Camera, [i32; N]>, max: u32) -> [u32; N]
    where
        [i32; N]: AttributeValue,
    {
        self.camera.get(key).map(|n| self.clamped(key, n, max))
    }

    /// Returns a count, clamped to 1 to `max`.
    fn count(&self, key: Key<scope::Camera, i32>, max: u32) -> u32 {
        self.clamped(key, self.camera.get(key), max)
    }

    fn clamped<T: AttributeValue>(&self, key: Key<scope::Camera, T>, n: i32, max: u32) -> u32 {
        let used = u32::try_from(n).unwrap_or(0).clamp(1, max);
        if i64::from(used) != i64::from(n) {
            self.complain(key, &format!("{n} is outside 1 to {max} and is clamped"));
        }
        used
    }

    fn complain<T: AttributeValue>(&self, key: Key<scope::Camera, T>, what: &str) {
        let name = key.name();
        let camera = &self.camera.name;
        self.reporter.once(
            &format!("camera {camera} {name}"),
            Severity::Warning,
            &Location::default(),
            format!("camera \"{camera}\": \"{name}\" {what}"),
        );
    }
}

/// Values that may be infinite or NaN.
trait Finite {
    fn is_finite(&self) -> bool;
}

impl Finite for f32 {
    fn is_finite(&self) -> bool {
        f32::is_finite(*self)
    }
}

impl<const N: usize> Finite for [f32; N] {
    fn is_finite(&self) -> bool {
        self.iter().all(|v| v.is_finite())
    }
}

impl<T: Finite> Finite for Option<T> {
    fn is_finite(&self) -> bool {
        self.as_ref().is_none_or(T::is_finite)
    }
}

impl CameraView {
    /// True when two cameras differ at most in what a re-render may change: the crop window, the numbers of samples,
    /// and the size and order of buckets (reference 11.1).
    pub fn differs_in_quality_only(&self, other: &Self) -> bool {
        let Self { crop, spatialquality, temporalquality, dofquality, .. } = *other;
        let Self { bucketsize, bucketblocksize, .. } = *other;
        let like = Self {
            crop,
            spatialquality,
            temporalquality,
            dofquality,
            bucketsize,
            bucketblocksize,
            bucketorder: other.bucketorder.clone(),
            ..self.clone()
        };
        like == *other
    }

    /// The least field of view in degrees. Positions inside of it are still distinct in single precision.
    pub const LEAST_FOV_DEG: f32 = 1e-6;

    /// The largest resolution in one direction, in pixels.
    pub const MAX_RESOLUTION: u32 = 1 << 20;

    /// Resolves the attributes of a camera. Invalid values are reported once and replaced by the defaults of
    /// reference 4.1.
    pub fn new(camera: &Camera, reporter: &Reporter) -> Self {
        let get = Attributes { camera, reporter };
        let resolution = get.counts(attr::RESOLUTION, Self::MAX_RESOLUTION);
        let pixelaspect = match get.finite(attr::PIXELASPECT) {
            a if a > 0.0 => a,
            a => {
                get.complain(attr::PIXELASPECT, &format!("{a} is not positive; 1 is used"));
                1.0
            }
        };
        // The aspect follows from the resolution alone (reference 4.1, 7.2.2). Pixels that are not square stretch
        // what the window shows.
        let aspect = resolution[0] as f32 / resolution[1] as f32;
        let screen = get.screen([-aspect, aspect, -1.0, 1.0]);
        let projection = get.projection();
        let perspective = matches!(projection, Projection::Perspective { .. });
        let (mut near, mut far) = (get.finite(attr::NEAR), get.finite(attr::FAR));
        if far <= near || perspective && near <= 0.0 {
            get.complain(
                attr::NEAR,
                &format!("{near} and far {far} leave no range of depths; 0.1 and 1e6 are used"),
            );
            (near, far) = (attr::NEAR.default(), attr::FAR.default());
        }
        let mut shutter = get.finite(attr::SHUTTER);
        if shutter[1] < shutter[0] {
            get.complain(attr::SHUTTER, "closes before it opens; the times are exchanged");
            shutter.swap(0, 1);
        }
        let preview = get.preview();
        let (spatialquality, temporalquality, dofquality, bucketsize) = if preview > 0.0 {
            (
                attr::PREVIEW_SPATIALQUALITY,
                attr::PREVIEW_TEMPORALQUALITY,
                attr::PREVIEW_DOFQUALITY,
                attr::PREVIEW_BUCKETSIZE,
            )
        } else {
            (attr::SPATIALQUALITY, attr::TEMPORALQUALITY, attr::DOFQUALITY, attr::LIMITS_BUCKETSIZE)
        };
        let lens = perspective.then(|| Self::lens(&get)).flatten();
        let stereo = Stereo::new(&get, &projection);
        let preview_limits = (preview > 0.0).then(|| PreviewLimits {
            thincurves: get.count(attr::PREVIEW_THINCURVES, u32::MAX),
            thinpoints: get.count(attr::PREVIEW_THINPOINTS, u32::MAX),
            limitpixelsize: get.finite(attr::PREVIEW_LIMITPIXELSIZE),
            limitdistance: get.finite(attr::PREVIEW_LIMITDISTANCE),
        });
        Self {
            name: camera.name.clone(),
            world_to_camera: get.world_to_camera(),
            common_origin: Vec3::ZERO,
            projection,
            resolution,
            pixelaspect,
            screen,
            crop: Self::crop_pixels(get.finite(attr::CROP), resolution),
            near,
            far,
            shutter,
            is_timeless: shutter == [0.0; 2],
            lens,
            spatialquality: get.counts(spatialquality, 256),
            temporalquality: get.count(temporalquality, 65536),
            dofquality: get.count(dofquality, 65536),
            autopassreduction: camera.get(attr::LIMITS_AUTOPASSREDUCTION),
            bucketsize: get.counts(bucketsize, Self::MAX_RESOLUTION),
            bucketorder: camera.get(attr::BUCKETORDER),
            bucketblocksize: get.count(attr::LIMITS_BUCKETBLOCKSIZE, Self::MAX_RESOLUTION),
            preview,
            preview_dicecurvature_deg: get.finite(attr::PREVIEW_DICECURVATURE),
            preview_limits,
            stereo,
        }
    }

    /// Returns the lens, when all three of its attributes enable it.
    fn lens(get: &Attributes<'_>) -> Option<Lens> {
        let fstop = get.finite(attr::FSTOP);
        let (length, distance) =
            [attr::FOCALLENGTH, attr::FOCALDISTANCE].map(|key| get.finite(key).unwrap_or(0.0)).into();
        let blurs = fstop > 0.0 && fstop < 1.0e29 && length > 0.0 && distance > 0.0;
        blurs.then(|| Lens { radius: length / (2.0 * fstop), focal_distance: distance })
    }

    /// Returns the pixels of a crop window: `ceil (xres * xmin)` to `ceil (xres * xmax - 1)` inclusive
    /// (reference 4.1), clamped to the image.
    pub fn crop_pixels(crop: [f32; 4], resolution: [u32; 2]) -> PixelRect {
        // In double precision the edge of one crop equals the edge of its neighbour for all usual fractions.
        let edge = |fraction: f32, res: u32| {
            let exact = f64::from(fraction) * f64::from(res);
            // A fraction such as 0.1 is not exact in single precision, but 0.1 of 640 must be 64, not 65.
            let near = exact.round();
            let at = if (exact - near).abs() < 1e-6 * f64::from(res).max(1.0) { near } else { exact.ceil() };
            at.clamp(0.0, f64::from(res)) as i32
        };
        PixelRect {
            x0: edge(crop[0], resolution[0]),
            x1: edge(crop[1], resolution[0]),
            y0: edge(crop[2], resolution[1]),
            y1: edge(crop[3], resolution[1]),
        }
    }

    /// Returns the camera with the shutter time for a scene that gives no shutter (reference 2.7). The time is the
    /// earliest motion key of `scene`, and at most 0. Every moving object is then drawn at the earliest time of its
    /// motion.
    pub fn at_earliest(mut self, scene: &Scene) -> Self {
        if self.is_timeless {
            let of_shapes = scene.primitives.iter().filter(|p| p.keys.len() > 1).map(|p| p.keys[0].time);
            let own = scene.primitives.iter().map(|p| &p.attributes.to_world);
            let lights = scene.lights.iter().flat_map(|l| l.group.layers.iter().map(|layer| &layer.to_world));
            let moves = own.chain(lights).chain(scene.cameras.iter().map(|c| &c.world_to_camera));
            let of_moves = moves.filter(|m| m.is_moving()).map(|m| m.keys()[0].0);
            self.shutter = [of_shapes.chain(of_moves).fold(0.0, f32::min); 2];
        }
        self
    }

    /// Returns the part of a shutter in which a primitive exists, which is the range of its motion keys
    /// (reference 2.7). `None` when it does not exist, or for no length of time.
    pub fn existence(&self, primitive: &Primitive, shutter: [f32; 2]) -> Option<[f32; 2]> {
        let [first, .., last] = &primitive.keys[..] else { return Some(shutter) };
        if self.is_timeless {
            return Some(shutter);
        }
        let [open, close] = shutter;
        let (from, to) = (open.max(first.time), close.min(last.time));
        (from < to || (from == to && open == close)).then_some([from, to])
    }

    /// Returns the same camera with its whole image.
    pub fn uncropped(&self) -> Self {
        Self { crop: Self::crop_pixels([0.0, 1.0, 0.0, 1.0], self.resolution), ..self.clone() }
    }

    /// Returns the time at which splitting, dicing and shading happen, which is when the shutter opens.
    pub fn shading_time(&self) -> f32 {
        self.shutter[0]
    }

    /// True when the lens has an effect: "dofquality" 1 makes the image of a pinhole.
    pub fn has_depth_of_field(&self) -> bool {
        self.lens.is_some() && self.dofquality > 1
    }

    /// True when the shutter is open for any length of time.
    pub fn has_motion_blur(&self) -> bool {
        self.shutter[1] > self.shutter[0]
    }

    /// Returns the transform from camera to world space at a time.
    pub fn camera_to_world(&self, time: f32) -> Transform {
        self.world_to_camera.at(time).inverse()
    }

    /// Returns the position from which shading is done, in world space. It is the position of the camera when the
    /// shutter opens.
    pub fn position_world(&self) -> Vec3 {
        self.camera_to_world(self.shading_time()).point(Vec3::ZERO)
    }

    /// Returns the direction of view in world space, a unit vector.
    pub fn direction_world(&self) -> Vec3 {
        self.camera_to_world(self.shading_time()).vector(Vec3::Z).normalize_or(Vec3::Z)
    }

    /// Returns the tangent of the largest angle between the axis and a line of sight of the image; `None` for
    /// parallel lines of sight.
    pub fn widest_tangent(&self) -> Option<f32> {
        let Projection::Perspective { cot_half_fov } = self.projection else { return None };
        let [x0, x1, y0, y1] = self.screen;
        let corner = Vec2::new(x0.abs().max(x1.abs()), y0.abs().max(y1.abs()));
        Some(corner.length() / cot_half_fov)
    }

    /// Returns the largest distance, in camera units, by which single precision may move a point before the camera on
    /// its way through world space. It is proportional to the distance between the camera and the origin of the
    /// world.
    pub fn rounding(&self) -> f32 {
        let largest = |m: &Transform| m.to_rows()[12..15].iter().fold(0.0_f32, |most, x| most.max(x.abs()));
        let keys = self.world_to_camera.keys().iter();
        4.0 * CLIP_ROUNDING * keys.map(|(_, m)| largest(m)).fold(0.0_f32, f32::max)
    }

    /// Returns the range of visible depths, in camera units. It is "near" to "far", extended on both sides by the
    /// rounding of single precision. A point in a clipping plane is therefore visible wherever the camera is,
    /// although points are rounded in proportion to their distance from the world's origin.
    pub fn clip(&self) -> [f32; 2] {
        let slack = |plane: f32| 8.0 * CLIP_ROUNDING * plane.abs() + self.rounding();
        let near = self.near - slack(self.near);
        let near = match self.projection {
            Projection::Perspective { .. } => near.max(0.5 * self.near),
            Projection::Orthographic => near,
        };
        [near, self.far + slack(self.far)]
    }

    /// Returns the transform from camera to "screen" space. `z` becomes 0 on the near and 1 on the far plane.
    pub fn camera_to_screen(&self) -> Transform {
        let (n, f) = (f64::from(self.near), f64::from(self.far));
        let depth = (1.0 / (f - n)) as f32;
        match self.projection {
            Projection::Perspective { cot_half_fov: c } => {
                let (a, b) = ((f / (f - n)) as f32, (-f * n / (f - n)) as f32);
                Transform::from_rows(&[
                    c, 0.0, 0.0, 0.0, //
                    0.0, c, 0.0, 0.0, //
                    0.0, 0.0, a, 1.0, //
                    0.0, 0.0, b, 0.0,
                ])
            }
            Projection::Orthographic => Transform::from_rows(&[
                1.0,
                0.0,
                0.0,
                0.0, //
                0.0,
                1.0,
                0.0,
                0.0, //
                0.0,
                0.0,
                depth,
                0.0, //
                0.0,
                0.0,
                -self.near * depth,
                1.0,
            ]),
        }
    }

    /// Returns the transform from "screen" to NDC space, where (0, 0) is the upper left and (1, 1) the lower right
    /// corner of the whole image.
    pub fn screen_to_ndc(&self) -> Transform {
        let [x0, x1, y0, y1] = self.screen;
        let (sx, sy) = (1.0 / (x1 - x0), -1.0 / (y1 - y0));
        Transform::from_rows(&[
            sx,
            0.0,
            0.0,
            0.0, //
            0.0,
            sy,
            0.0,
            0.0, //
            0.0,
            0.0,
            1.0,
            0.0, //
            -x0 * sx,
            -y1 * sy,
            0.0,
            1.0,
        ])
    }

    /// Returns the transform from NDC to raster space.
    pub fn ndc_to_raster(&self) -> Transform {
        Transform::scale(Vec3::new(self.resolution[0] as f32, self.resolution[1] as f32, 1.0))
    }

    /// Returns the matrix from "common" space to a space of this camera at a time: "camera", "screen", "NDC",
    /// "raster" or "world". `None` for other names.
    pub fn world_to(&self, space: &str, time: f32) -> Option<Transform> {
        let camera = self.world_to_camera.at(time);
        Some(match space {
            "common" => Transform::IDENTITY,
            "world" => self.world_to_common().unwrap_or_default().inverse(),
            "camera" => camera,
            "screen" => camera.then(&self.camera_to_screen()),
            "NDC" => camera.then(&self.camera_to_screen()).then(&self.screen_to_ndc()),
            "raster" => {
                camera.then(&self.camera_to_screen()).then(&self.screen_to_ndc()).then(&self.ndc_to_raster())
            }
            _ => return None,
        })
    }

    /// Returns the `worldtoscreen` matrix of image metadata (reference 13.4). The image spans -1 to 1 in x and y, y
    /// upwards.
    pub fn world_to_clip(&self) -> Transform {
        let [x0, x1, y0, y1] = self.screen;
        let scale = Vec3::new(2.0 / (x1 - x0), 2.0 / (y1 - y0), 1.0);
        let shift = Vec3::new(-(x0 + x1) / (x1 - x0), -(y0 + y1) / (y1 - y0), 0.0);
        let window = Transform::scale(scale).then(&Transform::translate(shift));
        self.world_to_camera.at(self.shading_time()).then(&self.camera_to_screen()).then(&window)
    }

    /// Returns a camera space point in raster space. z stays in camera space. In a perspective the result is defined
    /// for `z > 0` only.
    pub fn project(&self, p_cam: Vec3) -> Vec3 {
        let s = self.raster_scale(p_cam.z);
        let c = self.raster_center();
        Vec3::new(c.x + p_cam.x * s.x, c.y + p_cam.y * s.y, p_cam.z)
    }

    /// Returns the raster position of the camera's axis.
    pub fn raster_center(&self) -> Vec2 {
        let [x0, x1, y0, y1] = self.screen;
        Vec2::new(-x0 / (x1 - x0) * self.resolution[0] as f32, y1 / (y1 - y0) * self.resolution[1] as f32)
    }

    /// Returns the number of pixels per camera space unit at depth `z`. y is negative, because raster y points
    /// downward.
    pub fn raster_scale(&self, z: f32) -> Vec2 {
        let [x0, x1, y0, y1] = self.screen;
        let scale = match self.projection {
            Projection::Perspective { cot_half_fov } => cot_half_fov / z,
            Projection::Orthographic => 1.0,
        };
        Vec2::new(
            scale * self.resolution[0] as f32 / (x1 - x0),
            -scale * self.resolution[1] as f32 / (y1 - y0),
        )
    }

    /// Returns the radius in pixels (x, y) of the circle of confusion at depth `z`. It is positive behind the plane
    /// in focus and negative before it. Zero for a pinhole.
    pub fn confusion(&self, z: f32) -> Vec2 {
        match self.lens {
            // A point at depth z, seen from a lens point l and projected onto the plane of focus, moves by l (1 -
            // focus / z) there. In raster space that is l * scale (focus) * (1 - focus / z).
            Some(lens) => {
                self.raster_scale(lens.focal_distance) * (lens.radius * (1.0 - lens.focal_distance / z))
            }
            None => Vec2::ZERO,
        }
    }

    /// Returns the same camera with the origin of "common" space at `origin` of the world. It expects a camera whose
    /// "common" space is the world.
    pub fn nearby(self, origin: Vec3) -> Self {
        if origin == Vec3::ZERO {
            return self;
        }
        let world_to_camera = seen_from(&self.world_to_camera, origin);
        Self { world_to_camera, common_origin: origin, ..self }
    }

    /// Returns the transform from world to "common" space; `None` where they are the same.
    pub fn world_to_common(&self) -> Option<Transform> {
        (self.common_origin != Vec3::ZERO).then(|| Transform::translate(-self.common_origin))
    }

    /// Returns the world space position of a point of "common" space.
    pub fn place_in_world(&self, p: Vec3) -> Vec3 {
        // Where the spaces are the same, not even the sign of a zero changes.
        if self.common_origin == Vec3::ZERO { p } else { p + self.common_origin }
    }

    /// Returns the same camera with "common" space equal to world space.
    fn in_world(&self) -> Self {
        let world_to_camera = seen_from(&self.world_to_camera, -self.common_origin);
        Self { world_to_camera, common_origin: Vec3::ZERO, ..self.clone() }
    }

    /// Returns the matrices that are written to the files of this camera, and the pixel aspect where it is not 1.
    pub fn metadata(&self) -> Params {
        if self.common_origin != Vec3::ZERO {
            return self.in_world().metadata();
        }
        let matrix = |name: &str, m: Transform| Param {
            name: name.into(),
            ty: granita_base::ParamType::of(granita_base::BaseType::Matrix),
            data: m.to_rows()[..].into(),
        };
        let mut params = Params(vec![
            matrix("worldtocamera", self.world_to_camera.at(self.shading_time())),
            matrix("worldtoscreen", self.world_to_clip()),
        ]);
        if self.pixelaspect != 1.0 {
            let ty = granita_base::ParamType::of(granita_base::BaseType::Float);
            params.set(Param { name: "pixelaspect".into(), ty, data: self.pixelaspect.into() });
        }
        params
    }
}

/// Returns the transform from "common" to camera space, from the transform from world to camera space.
pub fn seen_from(world_to_camera: &MotionTransform, origin: Vec3) -> MotionTransform {
    MotionTransform::from(Transform::translate(origin)).then_rounded_once(world_to_camera)
}

/// True when anything moves relative to this camera.
pub fn is_moving(scene: &Scene, camera: &CameraView) -> bool {
    camera.world_to_camera.is_moving()
        || scene.primitives.iter().any(|p| p.keys.len() > 1 || p.attributes.to_world.is_moving())
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Reporter;

    fn view(list: &[(&str, &[f32])]) -> (CameraView, usize) {
        let (reporter, kept) = Reporter::collecting();
        let params = Params(list.iter().map(|(d, v)| Param::declared(d, *v).unwrap()).collect());
        let camera = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
        let view = CameraView::new(&camera, &reporter);
        let said = kept.lock().len();
        (view, said)
    }

    #[test]
    fn the_default_camera_has_the_values_of_the_reference() {
        let (camera, said) = view(&[]);
        assert_eq!((camera.resolution, said), ([640, 480], 0));
        assert_eq!(camera.crop, PixelRect { x0: 0, y0: 0, x1: 640, y1: 480 });
        // The field of view is 90 degrees, so that y = z is the upper edge.
        let top = camera.project(Vec3::new(0.0, 3.0, 3.0));
        assert!((top - Vec3::new(320.0, 0.0, 3.0)).length() < 1e-4, "{top}");
        let right = camera.project(Vec3::new(4.0, 0.0, 3.0));
        assert!((right.x - 640.0).abs() < 1e-3, "{right}");
        assert!(!camera.has_motion_blur() && camera.lens.is_none());
    }

    #[test]
    fn named_spaces_agree_with_the_projection() {
        for list in [
            &[("float fov", &[35.0][..]), ("int[2] resolution", &[200.0, 100.0])][..],
            &[("float[4] screen", &[-0.5, 2.0, -1.0, 3.0]), ("float near", &[0.5]), ("float far", &[50.0])],
        ] {
            let (camera, _) = view(list);
            let p = Vec3::new(0.3, -0.7, 4.0);
            let raster = camera.world_to("raster", 0.0).unwrap().point(p);
            let direct = camera.project(p);
            assert!((raster.truncate() - direct.truncate()).length() < 1e-3, "{raster} {direct}");
            let ndc = camera.world_to("NDC", 0.0).unwrap().point(p);
            let [w, h] = camera.resolution;
            assert!((ndc.x * w as f32 - raster.x).abs() < 1e-3 && (ndc.y * h as f32 - raster.y).abs() < 1e-3);
            let depth = |z: f32| camera.world_to("screen", 0.0).unwrap().point(Vec3::Z * z).z;
            assert!(depth(camera.near).abs() < 1e-5 && (depth(camera.far) - 1.0).abs() < 1e-5);
            let clip = camera.world_to_clip().point(p);
            assert!(
                (clip.x - (2.0 * ndc.x - 1.0)).abs() < 1e-5 && (clip.y - (1.0 - 2.0 * ndc.y)).abs() < 1e-5
            );
            assert!(camera.world_to("nowhere", 0.0).is_none());
        }
    }

    #[test]
    fn the_resolution_alone_determines_the_screen_window() {
        let (square, _) = view(&[("int[2] resolution", &[300.0, 200.0])]);
        let (wide, _) = view(&[("int[2] resolution", &[300.0, 200.0]), ("float pixelaspect", &[2.0])]);
        assert_eq!((square.screen, wide.screen), ([-1.5, 1.5, -1.0, 1.0], [-1.5, 1.5, -1.0, 1.0]));
        assert_eq!(square.metadata().float("pixelaspect"), None);
        assert_eq!(wide.metadata().float("pixelaspect"), Some(2.0));
    }

    #[test]
    fn the_widest_angle_is_that_of_the_image_corners() {
        let (camera, _) = view(&[("int[2] resolution", &[300.0, 400.0]), ("float fov", &[90.0])]);
        assert!((camera.widest_tangent().unwrap() - 1.25).abs() < 1e-6);
        let parallel = Params(vec![Param::declared("string projection", "orthographic").unwrap()]);
        let camera =
            Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params: parallel };
        assert_eq!(CameraView::new(&camera, &Reporter::silent()).widest_tangent(), None);
    }

    #[test]
    fn neighbouring_crops_share_their_border() {
        let resolution = [640, 481];
        let crop = |c: [f32; 4]| CameraView::crop_pixels(c, resolution);
        for edge in [0.1, 0.25, 1.0 / 3.0, 0.5, 0.7, 0.999] {
            let (left, right) = (crop([0.0, edge, 0.0, 1.0]), crop([edge, 1.0, 0.0, 1.0]));
            assert_eq!((left.x0, left.x1, right.x1), (0, right.x0, 640));
            let (upper, lower) = (crop([0.0, 1.0, 0.0, edge]), crop([0.0, 1.0, edge, 1.0]));
            assert_eq!((upper.y0, upper.y1, lower.y1), (0, lower.y0, 481));
        }
        // ceil (xres * xmin) to ceil (xres * xmax - 1), inclusive.
        assert_eq!(crop([0.1, 0.9, 0.0, 1.0]).x0, 64);
        assert_eq!(crop([0.0, 1.0, 0.5, 1.0]).y0, 241);
        assert!(crop([0.6, 0.4, 0.0, 1.0]).is_empty());
        assert_eq!(crop([-1.0, 2.0, -1.0, 2.0]), PixelRect { x0: 0, y0: 0, x1: 640, y1: 481 });
    }

    #[test]
    fn invalid_camera_values_are_reported_and_replaced() {
        let (camera, said) = view(&[
            ("float fov", &[200.0]),
            ("int[2] resolution", &[0.0, 10.0]),
            ("float near", &[-1.0]),
            ("float[4] screen", &[1.0, 1.0, 0.0, 1.0]),
            ("float[2] shutter", &[1.0, 0.0]),
            ("float pixelaspect", &[0.0]),
        ]);
        assert_eq!(said, 6);
        assert_eq!((camera.resolution, camera.near, camera.shutter), ([1, 10], 0.1, [0.0, 1.0]));
    }

    #[test]
    fn circles_of_confusion_vanish_in_focus() {
        let lens =
            [("float fstop", &[2.0][..]), ("float focallength", &[1.0]), ("float focaldistance", &[4.0])];
        let (camera, _) = view(&lens);
        assert_eq!(camera.confusion(4.0), Vec2::ZERO);
        // The radius is 0.25. At infinity the circle on the plane of focus has a radius of 0.25 / 4 * 240 pixels.
        assert!((camera.confusion(1e9).x - 15.0).abs() < 1e-3);
        assert!(camera.confusion(2.0).x < 0.0);
    }

    #[test]
    fn preview_mode_replaces_qualities() {
        let (camera, _) = view(&[("float preview", &[0.2]), ("int[2] spatialquality", &[8.0, 8.0])]);
        assert_eq!(
            (camera.spatialquality, camera.temporalquality, camera.bucketsize),
            ([1, 1], 1, [2048, 2048])
        );
    }
}
