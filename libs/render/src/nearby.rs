//! Moves scenes that are seen far away from the world origin, so that their "common" space begins near the camera.
//!
//! Shading uses single precision, whose steps are visible far from the origin. Such a frame therefore takes the
//! scene in a "common" space that is world space moved by a fixed offset, as pbrt-v4 does in its "rendering space"
//! (Pharr, Jakob, Humphreys: Physically Based Rendering, 4th edition, 6.1). Grids, rays, lights and maps of all its
//! cameras agree with each other there. In all other frames "common" space is world space, to the bit.

use crate::{CameraView, ShaderLibrary};
use granita_base::{BaseType, DVec3, MotionTransform, Param, ParamData, Params, Transform, Vec3};
use granita_dicing::camera::{Projection, seen_from};
use granita_dicing::longest_axis;
use granita_gsl::Func;
use granita_gsl::ir::{Block, EmitForm, OpCode, Stmt};
use granita_scene::{AttributeSet, Camera, Light, Primitive, Scene, ShaderGroup, ShaderInstance, ShapeKey};
use std::collections::HashMap;
use std::sync::Arc;

/// The smallest coordinate in world units of a camera that is far away. Below it, single precision stores a point
/// near the camera to less than a thousandth of a unit.
const FAR: f64 = 32768.0;

/// The offsets are multiples of this. They are exact, sums with them often are, and a camera that moves slightly
/// gets the same offset.
const STEP: f64 = 64.0;

/// The largest number of raster pixels per unit at depth 1. A camera with more looks at distant geometry, perhaps
/// near the origin. Up to this number the effect of the offset on such geometry is a hundredth of a pixel.
const MOST_PIXELS: f64 = 131_072.0;

/// The largest distance in world units by which points may move when their coordinates are made smaller.
const MOST_ERROR: f64 = 1.0 / 16384.0;

/// Returns the origin of "common" space in world space for frames with this first camera. It is the world origin unless
/// the camera is far from it.
pub(crate) fn common_origin(camera: &CameraView) -> Vec3 {
    let time = camera.shading_time();
    let to_camera = camera.world_to_camera.precise_at(time);
    if !camera.world_to_camera.at(time).is_affine() || to_camera.determinant() == 0.0 {
        return Vec3::ZERO;
    }
    let to_world = to_camera.inverse();
    let mut eye = to_world.w_axis.truncate();
    match camera.projection {
        Projection::Perspective { .. } => {
            let pixels = camera.raster_scale(1.0).abs().max_element();
            if f64::from(pixels) > MOST_PIXELS {
                return Vec3::ZERO;
            }
        }
        // The distance of an orthographic camera does not matter. A light may look at the origin from any distance.
        Projection::Orthographic => {
            let axis = to_world.z_axis.truncate().normalize_or_zero();
            eye -= axis * axis.dot(eye);
        }
    }
    if eye.abs().max_element() >= FAR && eye.is_finite() {
        ((eye / STEP).round() * STEP).as_vec3()
    } else {
        Vec3::ZERO
    }
}

/// Returns a scene whose transformations lead to "common" space, which begins at `origin` of world space. Returns
/// the scene itself where that is world space.
pub(crate) fn moved(scene: &Arc<Scene>, origin: Vec3, library: &dyn ShaderLibrary) -> Arc<Scene> {
    let mut mover = Mover { origin: origin.as_dvec3(), ..Mover::default() };
    if origin == Vec3::ZERO && !scene.primitives.iter().any(|p| mover.is_far(&p.attributes.to_world)) {
        return scene.clone();
    }
    let mut near = Scene::clone(scene);
    for camera in near.cameras.iter_mut().filter(|_| origin != Vec3::ZERO) {
        *camera = Camera { world_to_camera: seen_from(&camera.world_to_camera, origin), ..camera.clone() };
    }
    for primitive in &mut near.primitives {
        *primitive = mover.primitive(primitive);
    }
    for light in &mut near.lights {
        let (group, attributes) =
            (mover.light(&light.group, library), mover.attributes(&light.attributes, Vec3::ZERO));
        *light = Arc::new(Light { group, attributes, ..Light::clone(light) });
    }
    for space in near.coordinate_systems.values_mut() {
        *space = mover.place(space);
    }
    Arc::new(near)
}

/// Moves data that many parts of a scene share once, so that it stays shared.
#[derive(Default)]
struct Mover {
    /// The origin of "common" space in world space.
    origin: DVec3,
    /// The moved attributes. The key is the address of the original, which the scene keeps alive, and the bits of the
    /// offset of its points.
    attributes: HashMap<(usize, [u32; 3]), Arc<AttributeSet>>,
    groups: HashMap<usize, Arc<ShaderGroup>>,
    shaders: HashMap<usize, Arc<ShaderInstance>>,
}

impl Mover {
    fn place(&self, to_world: &MotionTransform) -> MotionTransform {
        if self.origin == DVec3::ZERO {
            return to_world.clone();
        }
        to_world.then_rounded_once(&Transform::translate(-self.origin.as_vec3()).into())
    }

    /// True when geometry near the origin of "common" space has large coordinates in a space.
    fn is_far(&self, to_world: &MotionTransform) -> bool {
        let from = to_world.first().as_dmat4().w_axis.truncate() - self.origin;
        from.abs().max_element() >= FAR && to_world.first().is_affine()
    }

    fn primitive(&mut self, primitive: &Arc<Primitive>) -> Arc<Primitive> {
        let set = &primitive.attributes;
        let keys = self.off(set).and_then(|off| Some((off, keys_without(primitive, off, set)?)));
        let (off, keys) = match keys {
            Some((off, keys)) => (off, keys),
            None if self.origin == DVec3::ZERO => return primitive.clone(),
            None => (Vec3::ZERO, primitive.keys.clone()),
        };
        let attributes = self.attributes(set, off);
        Arc::new(Primitive { keys, attributes, ..Primitive::clone(primitive) })
    }

    /// Returns the offset to subtract from the points of objects with large coordinates in their own space. It is
    /// approximately the origin of "common" space there.
    fn off(&self, set: &AttributeSet) -> Option<Vec3> {
        let to_world = set.to_world.first().as_dmat4();
        if !self.is_far(&set.to_world) || to_world.determinant() == 0.0 {
            return None;
        }
        let off = to_world.inverse().transform_point3(self.origin);
        Some(((off / STEP).round() * STEP).as_vec3()).filter(|off| off.is_finite() && *off != Vec3::ZERO)
    }

    /// Returns attributes of objects whose points have `off` subtracted.
    fn attributes(&mut self, set: &Arc<AttributeSet>, off: Vec3) -> Arc<AttributeSet> {
        let address = (Arc::as_ptr(set) as usize, off.to_array().map(f32::to_bits));
        if let Some(known) = self.attributes.get(&address) {
            return known.clone();
        }
        let to_world = match off == Vec3::ZERO {
            true => self.place(&set.to_world),
            // The order matters: `then_rounded_once` keeps the rounding error of the first product.
            false => {
                self.place(&MotionTransform::from(Transform::translate(off)).then_rounded_once(&set.to_world))
            }
        };
        let mut near = AttributeSet { to_world, taken_off: off, ..AttributeSet::clone(set) };
        for group in [&mut near.surface, &mut near.displacement, &mut near.volume].into_iter().flatten() {
            let address = Arc::as_ptr(group) as usize;
            let known = self.groups.get(&address).cloned();
            *group = known.unwrap_or_else(|| {
                let moved = Arc::new(self.group(group));
                self.groups.insert(address, moved.clone());
                moved
            });
        }
        let near = Arc::new(near);
        self.attributes.insert(address, near.clone());
        near
    }

    /// Moves the distant spaces of directional lights to the origin of "common" space. Two points near the origin
    /// of a space give the direction between them exactly.
    fn light(&mut self, group: &ShaderGroup, library: &dyn ShaderLibrary) -> ShaderGroup {
        let mut moved = self.group(group);
        let knows_directions = |layer: &Arc<ShaderInstance>| {
            library.load(&layer.shader).is_ok_and(|module| directions_alone(&module.body))
        };
        if group.layers.iter().all(knows_directions) {
            for (new, old) in moved.layers.iter_mut().zip(&group.layers) {
                if self.origin != DVec3::ZERO && self.is_far(&old.to_world) && !old.to_world.is_moving() {
                    let mut rows = old.to_world.first().to_rows();
                    rows[12..15].fill(0.0);
                    let to_world = Transform::from_rows(&rows).into();
                    *new = Arc::new(ShaderInstance { to_world, ..ShaderInstance::clone(old) });
                }
            }
        }
        moved
    }

    fn group(&mut self, group: &ShaderGroup) -> ShaderGroup {
        let layers = group.layers.iter().map(|layer| self.shader(layer)).collect();
        ShaderGroup { layers, connections: group.connections.clone() }
    }

    fn shader(&mut self, layer: &Arc<ShaderInstance>) -> Arc<ShaderInstance> {
        let to_world = self.place(&layer.to_world);
        let moved = || Arc::new(ShaderInstance { to_world, ..ShaderInstance::clone(layer) });
        self.shaders.entry(Arc::as_ptr(layer) as usize).or_insert_with(moved).clone()
    }
}

/// True when a light shader sends light only along directions and transforms no points.
fn directions_alone(block: &Block) -> bool {
    block.iter().all(|statement| match statement {
        Stmt::Op(op) => op.code != OpCode::Call(Func::Transform),
        Stmt::Emit { form, body, .. } => {
            matches!(form, EmitForm::Distant { .. } | EmitForm::Reflection) && directions_alone(body)
        }
        Stmt::If { then, otherwise, .. } => directions_alone(then) && directions_alone(otherwise),
        Stmt::Loop { test, body, step, .. } => [test, body, step].into_iter().all(directions_alone),
        Stmt::Scope { body, .. } | Stmt::Lights { body, .. } | Stmt::Trace { body, .. } => {
            directions_alone(body)
        }
        Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => true,
    })
}

/// Returns the keys of a primitive with `off` subtracted from their points; `None` when that moves no part of it
/// near, or moves a point by a visible distance.
fn keys_without(primitive: &Primitive, off: Vec3, set: &AttributeSet) -> Option<Vec<ShapeKey>> {
    let to_world = set.to_world.first();
    let stretch = f64::from(longest_axis(|v| to_world.vector(v)));
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut keys = Vec::with_capacity(primitive.keys.len());
    for key in &primitive.keys {
        // A shape without points lies at the origin of its space.
        key.params.iter().find(|param| matches!(&*param.name, "P" | "Pw"))?;
        let mut params = Vec::new();
        for param in key.params.iter() {
            let shapes = matches!(&*param.name, "P" | "Pw");
            let taken = match param.ty.base {
                BaseType::Point => without(param, 3, off)?,
                BaseType::HPoint => without(param, 4, off)?,
                _ => {
                    params.push(param.clone());
                    continue;
                }
            };
            if shapes {
                if taken.error * stretch > MOST_ERROR {
                    return None;
                }
                (low, high) = (low.min(taken.low), high.max(taken.high));
            }
            params.push(taken.param);
        }
        keys.push(ShapeKey { time: key.time, params: Params(params) });
    }
    // The distance from the new origin to the box of the moved points.
    let nearest = DVec3::ZERO.clamp(low, high).length();
    (nearest < 0.5 * off.as_dvec3().length()).then_some(keys)
}

/// Points with an offset subtracted.
struct Taken {
    param: Param,
    /// The largest distance that rounding moved a point.
    error: f64,
    /// Their box.
    low: DVec3,
    high: DVec3,
}

/// Returns a parameter of points of `width` numbers with `off` subtracted; `None` for another parameter.
fn without(param: &Param, width: usize, off: Vec3) -> Option<Taken> {
    let mut values = param.data.to_floats()?.to_vec();
    let (mut error, mut low, mut high) = (0.0_f64, DVec3::INFINITY, DVec3::NEG_INFINITY);
    for point in values.chunks_exact_mut(width) {
        let weight = point.get(3).map_or(1.0, |w| f64::from(*w));
        let mut left = DVec3::ZERO;
        for c in 0..3 {
            let exact = f64::from(point[c]) - f64::from(off[c]) * weight;
            point[c] = exact as f32;
            error = error.max((f64::from(point[c]) - exact).abs() / weight.abs().max(f64::MIN_POSITIVE));
            left[c] = exact / weight;
        }
        (low, high) = (low.min(left), high.max(left));
    }
    let param = Param { data: ParamData::from(&values[..]), ..param.clone() };
    (low.is_finite() && high.is_finite()).then_some(Taken { param, error, low, high })
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{Reporter, ShapeDesc};
    use granita_fixture::{Fixture, param};

    fn camera(place: Vec3, params: Params) -> CameraView {
        let world_to_camera = Transform::translate(-place).into();
        CameraView::new(&Camera { name: "main".into(), world_to_camera, params }, &Reporter::silent())
    }

    #[test]
    fn the_common_space_has_its_origin_near_far_cameras() {
        let of = |x: f32, y: f32, z: f32| common_origin(&camera(Vec3::new(x, y, z), Params::new()));
        assert_eq!(of(3e4, -3e4, 3e4), Vec3::ZERO);
        assert_eq!(of(1e7, -33.0, 31.0), Vec3::new(1e7, -64.0, 0.0));
        // A light looks from far away at geometry near the origin.
        let parallel = Params(vec![param("string projection", "orthographic")]);
        assert_eq!(common_origin(&camera(Vec3::Z * -1e6, parallel.clone())), Vec3::ZERO);
        assert_eq!(common_origin(&camera(Vec3::new(1e6, 0.0, -1e6), parallel)), Vec3::X * 1e6);
        let narrow = Params(vec![param("float fov", 0.01_f32)]);
        assert_eq!(common_origin(&camera(Vec3::Z * -1e6, narrow)), Vec3::ZERO);
    }

    #[test]
    fn far_points_of_object_space_are_moved_near_the_origin() {
        let mut f = Fixture::new(&[]);
        let points = |x: f32| Params(vec![param("vertex point P", &[x, 2.0, 3.0][..])]);
        let at = |x: f32| AttributeSet {
            to_world: Transform::translate(Vec3::X * x).into(),
            ..AttributeSet::default()
        };
        let shape = ShapeDesc::Points { n: 1 };
        f.add(shape.clone(), points(1e7), at(0.0));
        f.add(shape.clone(), points(0.5), at(1e7));
        // It is far away, whatever the origin of its numbers is.
        f.add(shape, points(0.5), at(0.0));
        let (scene, _, environment) = crate::tests::finish(&f);
        let near = moved(&scene, Vec3::X * 1e7, &*environment.shaders);
        let found: Vec<(f32, f32, f32)> = near
            .primitives
            .iter()
            .map(|p| {
                let x = p.keys[0].params.floats("P").unwrap()[0];
                let set = &p.attributes;
                (x, set.to_world.first().point(Vec3::X * x).x, set.object_to_world(0.0).point(Vec3::ZERO).x)
            })
            .collect();
        assert_eq!(found, [(0.0, 0.0, -1e7), (0.5, 0.5, 0.0), (0.5, 0.5 - 1e7, -1e7)]);
        // In world space only geometry that is moved back to its origin from far away changes.
        assert!(Arc::ptr_eq(
            &moved(&scene, Vec3::ZERO, &*environment.shaders).primitives[0],
            &scene.primitives[0]
        ));
    }
}
