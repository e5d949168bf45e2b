//! Simplifies a scene's objects in preview mode (reference 4.1, 6.5), to a few of many curves and points, and to
//! boxes.

use granita_base::{
    Bound, Interp, Param, ParamData, ParamType, Params, Reporter, Severity, ShapeDesc, Vec3, hash,
};
use granita_dicing::camera::{CameraView, PreviewLimits, Projection};
use granita_dicing::{Placement, trimming};
use granita_hider::{NOWHERE, Projector};
use granita_scene::{AttributeSet, LightSet, Primitive, Scene, ShapeKey, attr};
use std::sync::Arc;

/// The largest number of curves or points of a call that is drawn whole.
const LARGE: usize = 100;

/// Returns the scene as preview mode shows it to `view`; the scene itself where that is the same.
///
/// The remaining curves and points depend only on their index in their primitive. They are widened so that together
/// they cover the area of all. Boxes have the colour and opacity of their object and the default surface, or the
/// surface that "shadertype" sets for all.
pub(crate) fn simplified(scene: &Arc<Scene>, view: &CameraView, reporter: &Reporter) -> Arc<Scene> {
    let Some(limits) = view.preview_limits else { return scene.clone() };
    let draws_boxes = limits.limitpixelsize > 0.0 || limits.limitdistance < 1.0e38;
    let shadertype = scene.cameras.first().map(|c| c.get(attr::SHADERTYPE));
    let boxes = Boxes {
        view,
        limits,
        projector: Projector::new(view, false),
        keeps_surface: shadertype.is_some_and(|name| &*name != "gsl"),
        reporter,
    };
    let change = |primitive: &Arc<Primitive>| {
        let boxed = if draws_boxes { boxes.instead_of(primitive) } else { None };
        boxed.or_else(|| thinned(primitive, &limits))
    };
    let changed: Vec<Option<Primitive>> = scene.primitives.iter().map(change).collect();
    if changed.iter().all(Option::is_none) {
        return scene.clone();
    }
    let mut simple = Scene::clone(scene);
    for (primitive, changed) in simple.primitives.iter_mut().zip(changed) {
        if let Some(changed) = changed {
            *primitive = Arc::new(changed);
        }
    }
    Arc::new(simple)
}

/// The number of values that a primitive of many parts has for each of them.
#[derive(Clone, Copy)]
struct PerPart {
    vertex: usize,
    linear: usize,
}

/// Returns a few of the curves or points of a large primitive; `None` when all are drawn.
fn thinned(primitive: &Primitive, limits: &PreviewLimits) -> Option<Primitive> {
    let (count, n, per_part) = match &primitive.shape {
        ShapeDesc::Curves { ncurves, nverts, .. } => {
            (*ncurves, limits.thincurves, PerPart { vertex: *nverts, linear: 2 })
        }
        ShapeDesc::NurbsCurves { ncurves, span } => {
            (*ncurves, limits.thincurves, PerPart { vertex: span.n, linear: 2 })
        }
        ShapeDesc::Points { n } => (*n, limits.thinpoints, PerPart { vertex: 1, linear: 1 }),
        _ => return None,
    };
    let n = n as usize;
    if n < 2 || count < LARGE {
        return None;
    }
    // One of every n is picked, at a hashed position, so that parts laid out in rows keep their appearance.
    let pick = |group: usize| group * n + hash::words(&[group as u32, 0x7468_696e]) as usize % n;
    let chosen: Vec<usize> = (0..count.div_ceil(n)).map(pick).filter(|i| *i < count).collect();
    let factor = count as f32 / chosen.len() as f32;
    let mut shape = primitive.shape.clone();
    // Curves cover an area in proportion to their width, disks to its square.
    let widen = match &mut shape {
        ShapeDesc::Curves { ncurves, .. } | ShapeDesc::NurbsCurves { ncurves, .. } => {
            *ncurves = chosen.len();
            factor
        }
        ShapeDesc::Points { n } => {
            *n = chosen.len();
            factor.sqrt()
        }
        _ => return None,
    };
    let keys: Option<Vec<ShapeKey>> = primitive
        .keys
        .iter()
        .map(|key| {
            let params: Option<Vec<Param>> =
                key.params.iter().map(|p| picked(p, count, &chosen, per_part)).collect();
            Some(ShapeKey { time: key.time, params: widened(Params(params?), widen) })
        })
        .collect();
    Some(Primitive { shape, keys: keys?, ..primitive.clone() })
}

/// Returns the values of some parts; `None` when their number is wrong, which is reported when the primitive is
/// built.
fn picked(param: &Param, count: usize, chosen: &[usize], per_part: PerPart) -> Option<Param> {
    let items = match param.ty.interp {
        Interp::Constant => return Some(param.clone()),
        Interp::PerPiece => 1,
        Interp::Linear => per_part.linear,
        Interp::Vertex => per_part.vertex,
    };
    let stride = items.checked_mul(param.ty.width())?;
    if param.data.len() != count.checked_mul(stride)? {
        return None;
    }
    fn take<T: Clone>(list: &[T], chosen: &[usize], stride: usize) -> Arc<[T]> {
        chosen.iter().flat_map(|i| list[i * stride..(i + 1) * stride].iter().cloned()).collect()
    }
    let data = match &param.data {
        ParamData::Float(v) => ParamData::Float(take(v, chosen, stride)),
        ParamData::Int(v) => ParamData::Int(take(v, chosen, stride)),
        ParamData::String(v) => ParamData::String(take(v, chosen, stride)),
    };
    Some(Param { data, ..param.clone() })
}

/// Multiplies all widths. The default width is 1.
fn widened(mut params: Params, factor: f32) -> Params {
    let mut found = false;
    for param in params.0.iter_mut().filter(|p| matches!(&*p.name, "width" | "rasterwidth")) {
        if let Some(widths) = param.data.to_floats() {
            param.data = ParamData::Float(widths.iter().map(|w| w * factor).collect());
            found = true;
        }
    }
    if !found {
        let ty = ParamType::of(granita_base::BaseType::Float);
        params.set(Param { name: "width".into(), ty, data: factor.into() });
    }
    params
}

/// Decides which objects are drawn as boxes.
struct Boxes<'a> {
    view: &'a CameraView,
    limits: PreviewLimits,
    projector: Projector,
    /// True when all objects already have one simple surface.
    keeps_surface: bool,
    reporter: &'a Reporter,
}

impl Boxes<'_> {
    /// Returns the box of a primitive that is too small or too far away to be drawn itself.
    fn instead_of(&self, primitive: &Primitive) -> Option<Primitive> {
        let bounds = self.bounds(primitive)?;
        let attributes = &primitive.attributes;
        let time = self.view.shading_time();
        let to_camera = attributes.to_world.at(time).then(&self.view.world_to_camera.at(time));
        let hull = bounds.first()?.transformed(&to_camera);
        let far = self.distance(&hull) > self.limits.limitdistance;
        if !far && self.pixels(&hull) >= self.limits.limitpixelsize {
            return None;
        }
        let keys = primitive.keys.iter().zip(&bounds);
        let keys = keys.map(|(key, bound)| ShapeKey { time: key.time, params: corners(bound) }).collect();
        let mut values = (*attributes.values).clone();
        for name in [attr::TWOSIDED.name(), attr::DISPLACE_MAXRADIUS.name()] {
            values.remove(name);
        }
        let plain = AttributeSet {
            values: Arc::new(values),
            surface: attributes.surface.clone().filter(|_| self.keeps_surface),
            displacement: None,
            volume: None,
            lights: LightSet::default(),
            trim: None,
            ..(**attributes).clone()
        };
        Some(Primitive { shape: box_shape(), keys, attributes: Arc::new(plain), ..primitive.clone() })
    }

    /// Returns the object space box at each key; `None` for a primitive without one.
    fn bounds(&self, primitive: &Primitive) -> Option<Vec<Bound>> {
        let keys: Vec<granita_geom::ShapeKey<'_>> = primitive
            .keys
            .iter()
            .map(|k| granita_geom::ShapeKey { time: k.time, params: &k.params })
            .collect();
        let trim = trimming(&primitive.attributes, 1.0);
        // Errors are reported when it is built to be drawn.
        let mut report = |_: Severity, _: String| ();
        let pieces = granita_geom::build(&primitive.shape, &keys, trim, &mut report).ok()?;
        let whole = |key: &granita_geom::ShapeKey<'_>| {
            let boxes = pieces.iter().map(|p| Placement::object_bound(&**p, key.time));
            boxes.fold(Bound::EMPTY, Bound::union)
        };
        let bounds: Vec<Bound> = keys.iter().map(whole).collect();
        let usable = bounds.iter().all(|b| !b.is_empty() && b.is_finite());
        if !usable && !pieces.is_empty() {
            let text = "an object without a finite bound is not drawn as a box";
            self.reporter.once(text, Severity::Warning, &primitive.at, text);
        }
        usable.then_some(bounds)
    }

    /// Returns the distance in camera units from the camera to the nearest point of a camera space box.
    fn distance(&self, hull: &Bound) -> f32 {
        match self.view.projection {
            Projection::Perspective { .. } => Vec3::ZERO.clamp(hull.min, hull.max).length(),
            Projection::Orthographic => hull.min.z,
        }
    }

    /// Returns the approximate number of pixels that a camera space box covers; infinite for one that crosses the
    /// near plane.
    fn pixels(&self, hull: &Bound) -> f32 {
        let perspective = matches!(self.view.projection, Projection::Perspective { .. });
        if perspective && hull.min.z < self.view.near {
            return f32::INFINITY;
        }
        match self.projector.raster_box(hull) {
            NOWHERE => f32::INFINITY,
            [x0, y0, x1, y1] => (x1 - x0) * (y1 - y0),
        }
    }
}

/// Returns six faces over the corners of [`corners`], seen from outside.
fn box_shape() -> ShapeDesc {
    const FACES: [i32; 24] = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5];
    ShapeDesc::Mesh { subdivide: false, nverts: [4; 6].into(), verts: FACES.into() }
}

/// Returns the corners of a box as the vertices of a mesh, x fastest.
fn corners(bound: &Bound) -> Params {
    let points: Vec<f32> = bound.corners().iter().flat_map(|p| p.to_array()).collect();
    let ty = ParamType::of(granita_base::BaseType::Point).with_interp(Interp::Vertex);
    Params(vec![Param { name: "P".into(), ty, data: ParamData::Float(points.into()) }])
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{CurveBasis, Location, MotionTransform, Transform};
    use granita_scene::Camera;

    fn param(declaration: &str, values: &[f32]) -> Param {
        Param::declared(declaration, values).unwrap()
    }

    fn primitive(shape: ShapeDesc, params: Vec<Param>, z: f32) -> Arc<Primitive> {
        let to_world = MotionTransform::from(Transform::translate(Vec3::Z * z));
        let attributes = Arc::new(AttributeSet { to_world, ..AttributeSet::default() });
        let keys = vec![ShapeKey { time: 0.0, params: Params(params) }];
        Arc::new(Primitive { id: 7, shape, keys, attributes, at: Location::default() })
    }

    fn simple(primitives: Vec<Arc<Primitive>>, camera: &[(&str, f32)]) -> Arc<Scene> {
        let mut params = Params(camera.iter().map(|(d, v)| Param::declared(d, *v).unwrap()).collect());
        params.set(param("int[2] resolution", &[100.0, 100.0]));
        let camera = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
        let view = CameraView::new(&camera, &Reporter::silent());
        let scene = Arc::new(Scene { cameras: vec![camera], primitives, ..Scene::default() });
        simplified(&scene, &view, &Reporter::silent())
    }

    /// Returns `n` straight curves of two vertices with an index in every variable.
    fn curves(n: usize) -> Arc<Primitive> {
        let p: Vec<f32> = (0..n).flat_map(|i| [i as f32, 0.0, 0.0, i as f32, 1.0, 0.0]).collect();
        let ids: Vec<f32> = (0..n).map(|i| i as f32).collect();
        let ends: Vec<f32> = (0..2 * n).map(|i| i as f32).collect();
        let params = vec![
            param("vertex point P", &p),
            param("perpiece float id", &ids),
            param("linear float width", &ends),
            param("color C", &[1.0, 0.5, 0.2]),
        ];
        primitive(ShapeDesc::Curves { basis: CurveBasis::Linear, ncurves: n, nverts: 2 }, params, 5.0)
    }

    const PREVIEW: (&str, f32) = ("float preview", 0.5);

    #[test]
    fn one_of_ten_curves_is_drawn_ten_times_as_wide() {
        let scene = simple(vec![curves(1003)], &[PREVIEW]);
        let ShapeDesc::Curves { ncurves, .. } = scene.primitives[0].shape else { panic!() };
        assert!((100..=101).contains(&ncurves), "{ncurves}");
        let params = &scene.primitives[0].keys[0].params;
        let [p, ids, widths] = ["P", "id", "width"].map(|name| params.floats(name).unwrap());
        assert_eq!((p.len(), ids.len(), widths.len()), (6 * ncurves, ncurves, 2 * ncurves));
        let factor = 1003.0 / ncurves as f32;
        let mut places = std::collections::BTreeSet::new();
        for (k, id) in ids.iter().enumerate() {
            assert_eq!((*id as usize / 10, p[6 * k], p[6 * k + 3]), (k, *id, *id));
            assert_eq!(widths[2 * k..2 * k + 2], [2.0 * id * factor, (2.0 * id + 1.0) * factor]);
            places.insert(*id as usize % 10);
        }
        assert_eq!(places.len(), 10, "not always the same one of ten");
        let three = simple(vec![curves(300)], &[PREVIEW, ("int preview:thincurves", 3.0)]);
        assert!(matches!(three.primitives[0].shape, ShapeDesc::Curves { ncurves: 100, .. }));
    }

    #[test]
    fn points_keep_the_area_that_they_cover() {
        let n = 500;
        let p: Vec<f32> = (0..3 * n).map(|i| i as f32).collect();
        let points = primitive(ShapeDesc::Points { n }, vec![param("vertex point P", &p)], 0.0);
        let scene = simple(vec![points], &[PREVIEW]);
        let ShapeDesc::Points { n: left } = scene.primitives[0].shape else { panic!() };
        let width = scene.primitives[0].keys[0].params.float("width").unwrap();
        assert_eq!(left, 50);
        assert!((left as f32 * width * width - n as f32).abs() < 1e-2, "{width}");
    }

    #[test]
    fn few_or_invalid_primitives_are_not_simplified() {
        let same = |p: Arc<Primitive>, camera: &[(&str, f32)]| {
            Arc::ptr_eq(&simple(vec![p.clone()], camera).primitives[0], &p)
        };
        assert!(same(curves(99), &[PREVIEW]));
        assert!(same(curves(1000), &[]));
        assert!(same(curves(1000), &[PREVIEW, ("int preview:thincurves", 1.0)]));
        assert!(same(curves(1000), &[("float preview:limitdistance", 0.0)]));
        let mut short = (*curves(1000)).clone();
        short.shape = ShapeDesc::Curves { basis: CurveBasis::Linear, ncurves: 1001, nverts: 2 };
        assert!(same(Arc::new(short), &[PREVIEW]));
    }

    fn sphere(z: f32) -> Arc<Primitive> {
        let shape = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
        primitive(shape, Vec::new(), z)
    }

    #[test]
    fn boxes_replace_small_or_far_objects() {
        // 100 pixels over 90 degrees: at depth z the box covers (2 * 50 / (z - 1))^2.
        let objects = || vec![sphere(5.0), sphere(50.0), sphere(0.0)];
        let boxed = |limit: (&str, f32)| -> Vec<bool> {
            let scene = simple(objects(), &[PREVIEW, limit]);
            scene.primitives.iter().map(|p| matches!(p.shape, ShapeDesc::Mesh { .. })).collect()
        };
        assert_eq!(boxed(("float preview:limitpixelsize", 4.0)), [false, false, false]);
        assert_eq!(boxed(("float preview:limitpixelsize", 4.2)), [false, true, false]);
        assert_eq!(boxed(("float preview:limitpixelsize", 600.0)), [false, true, false]);
        assert_eq!(boxed(("float preview:limitpixelsize", 630.0)), [true, true, false]);
        assert_eq!(boxed(("float preview:limitdistance", 48.9)), [false, true, false]);
        assert_eq!(boxed(("float preview:limitdistance", 49.1)), [false, false, false]);
        assert_eq!(boxed(("float preview:limitdistance", -1.0)), [true, true, true]);
        let scene = simple(objects(), &[PREVIEW, ("float preview:limitdistance", 10.0)]);
        let p = scene.primitives[1].keys[0].params.floats("P").unwrap();
        let bound = Bound::around(p.chunks(3).map(Vec3::from_slice));
        assert!((bound.max - Vec3::ONE).length() < 1e-3 && (bound.min + Vec3::ONE).length() < 1e-3);
        assert!(scene.primitives[1].attributes.surface.is_none());
    }
}
