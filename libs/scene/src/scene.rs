//! The finished scene: immutable, ready to render.
//!
//! All transformations lead **to world space**. "common" space is world space, unless who renders moves the scene.

use crate::attribute::{AttributeValue, Key, attr, scope};
use crate::{LightSet, Values};
use granita_base::{Location, MotionTransform, Param, Params, ShapeDesc, Transform, TrimDesc, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What a shader is attached as (reference 8.1.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the words are the reference's")]
pub enum ShaderUsage {
    Surface,
    Displacement,
    Volume,
    Light,
}

/// One shader with the parameters that `Shader` or `Light` gave it.
#[derive(Clone, Debug, PartialEq)]
pub struct ShaderInstance {
    /// Name of the compiled shader, without extension.
    pub shader: Arc<str>,
    /// Layer name, when given.
    pub layer: Option<Arc<str>>,
    /// Parameters of this instance. Spatial values are in `to_world`'s space.
    pub params: Params,
    /// "shader" space to world.
    pub to_world: MotionTransform,
    /// The "name" of the attribute state in which it was declared, by which `Modify` finds that state.
    pub state: Arc<str>,
    /// Where it was declared.
    pub at: Location,
}

/// `ConnectShaders`: a source parameter (or global) feeds a parameter (or global) of a later layer.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct Connection {
    pub source_layer: Arc<str>,
    /// May carry an index: `"colorvar[1]"`.
    pub source: Arc<str>,
    pub target_layer: Arc<str>,
    pub target: Arc<str>,
}

/// Shaders of one usage, run in sequence; a single shader is a group of one layer.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ShaderGroup {
    /// In order of execution; never empty in a scene.
    pub layers: Vec<Arc<ShaderInstance>>,
    /// Between them.
    pub connections: Vec<Connection>,
}

/// A light source.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The `lightid` of the call.
    pub name: Arc<str>,
    /// Its shader layers.
    pub group: ShaderGroup,
    /// Attribute state at the time of the `Light` call (bias, samples, ...).
    pub attributes: Arc<AttributeSet>,
}

/// Per-object state frozen when a primitive was declared. Many primitives share one.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct AttributeSet {
    /// Per-object attributes that differ from their default, and `user:` attributes, by name. Shared, so
    /// that objects which differ only in their transformation cost little.
    pub values: Arc<Values>,
    /// Shaders; none of a usage means the documented default.
    pub surface: Option<Arc<ShaderGroup>>,
    /// Displacement shaders.
    pub displacement: Option<Arc<ShaderGroup>>,
    /// Volume shaders.
    pub volume: Option<Arc<ShaderGroup>>,
    /// Lights that shine on it, in order of declaration.
    pub lights: LightSet,
    /// Object space to world, of points from which [`AttributeSet::taken_off`] was taken.
    pub to_world: MotionTransform,
    /// What was taken off the points of primitives, in object space: so points far from its origin are near another one. Zero in
    /// what the state machine makes.
    pub taken_off: Vec3,
    /// Whether the orientation is reversed with respect to the handedness of world space: with the
    /// rules of "orientation" applied, true when `cross (dPdu, dPdv)` of the object's own space points
    /// to the outside only after negation (reference 4.4.4).
    pub flip_normals: bool,
    /// Trim curves for patches.
    pub trim: Option<Arc<TrimDesc>>,
    /// Names of the geometry sets it is in, sorted.
    pub geometry_sets: Arc<[Arc<str>]>,
}

impl AttributeSet {
    /// Object space to world at a time, of points that nothing was taken off.
    pub fn object_to_world(&self, time: f32) -> Transform {
        let to_world = self.to_world.at(time);
        if self.taken_off == Vec3::ZERO {
            return to_world;
        }
        Transform::translate(-self.taken_off).then_rounded_once(&to_world)
    }

    /// The value of a per-object attribute, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Object, T>) -> T {
        key.of(self.values.get(key.name()))
    }

    /// Whether a per-object attribute has another value than its default.
    pub fn is_set<T>(&self, key: Key<scope::Object, T>) -> bool {
        self.values.get(key.name()).is_some()
    }

    /// The "name" attribute.
    pub fn name(&self) -> Arc<str> {
        self.get(attr::NAME)
    }
}

/// A shape at one moment: its parameters (control vertices and primitive variables).
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeKey {
    /// Time of the motion key; 0 for a shape that does not deform.
    pub time: f32,
    /// Control vertices and primitive variables, in object space.
    pub params: Params,
}

/// One geometric primitive.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// A hash of its shape and place, which seeds everything random about it: it does not depend on what else is in the
    /// scene, so that an input which nobody sees may stay unread.
    pub id: u32,
    /// What it is.
    pub shape: ShapeDesc,
    /// One key, or several (times increasing) for deformation blur; all with the same parameters.
    pub keys: Vec<ShapeKey>,
    /// State when it was declared.
    pub attributes: Arc<AttributeSet>,
    /// Where it was declared.
    pub at: Location,
}

/// A camera (reference 4.1), all parameters resolved.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Its name, also the name of a geometry set.
    pub name: Arc<str>,
    /// World to "camera" space: left handed, x right, y up, z forward.
    pub world_to_camera: MotionTransform,
    /// Camera attributes by name, defaults filled in (`resolution`, `fov`, `screen` only when set, ...).
    pub params: Params,
}

/// An image to make.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// File name.
    pub name: Arc<str>,
    /// Image format.
    pub format: Arc<str>,
    /// "rgb", "rgba", "z", "avgz", "volz", or `type name` of a variable.
    pub data: Arc<str>,
    /// Camera that it shows.
    pub camera: Arc<str>,
    /// Output attributes (4.2) and what goes to the format.
    pub params: Params,
}

/// Everything a frame needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Scene-wide attributes that differ from their default, by name.
    pub globals: BTreeMap<Arc<str>, Param>,
    /// In order of declaration; the first one shades. Never empty after `World`.
    pub cameras: Vec<Camera>,
    /// In order of declaration. Never empty: without `Output` the first camera gets a default one.
    pub outputs: Vec<Output>,
    /// In order of declaration.
    pub primitives: Vec<Arc<Primitive>>,
    /// Indexed by [`LightId`](crate::LightId).
    pub lights: Vec<Arc<Light>>,
    /// Named by `SaveAttributes`: that space to world.
    pub coordinate_systems: BTreeMap<Arc<str>, MotionTransform>,
    /// What became of the inputs that were put off.
    pub inputs: InputCounts,
}

/// Inputs with a bound (reference 2.9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputCounts {
    /// Read because a camera or a ray may see their contents.
    pub read: usize,
    /// Never read.
    pub unread: usize,
}

impl Scene {
    /// The value of a scene-wide attribute, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Global, T>) -> T {
        key.of(self.globals.get(key.name()))
    }
}

impl Camera {
    /// The value of a camera attribute, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Camera, T>) -> T {
        key.of(self.params.get(key.name()))
    }
}

impl Output {
    /// The value of an attribute of an image, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Output, T>) -> T {
        self.given(key).unwrap_or_else(|| key.default())
    }

    /// The value of an attribute of an image, where one was given.
    pub fn given<T: AttributeValue>(&self, key: Key<scope::Output, T>) -> Option<T> {
        T::read(&self.params.get(key.name())?.data)
    }
}
