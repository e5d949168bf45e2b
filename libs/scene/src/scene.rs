//! The finished scene: immutable and ready to be rendered.
//!
//! All transformations lead **to world space**. "common" space is world space, unless the renderer moves the scene.

use crate::attribute::{AttributeValue, Key, attr, scope};
use crate::{LightSet, Values};
use granita_base::{Location, MotionTransform, Param, Params, ShapeDesc, Transform, TrimDesc, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The usage for which a shader is attached (reference 8.1.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the words are the reference's")]
pub enum ShaderUsage {
    Surface,
    Displacement,
    Volume,
    Light,
}

/// One shader with the parameters of its `Shader` or `Light` call.
#[derive(Clone, Debug, PartialEq)]
pub struct ShaderInstance {
    /// The name of the compiled shader, without extension.
    pub shader: Arc<str>,
    /// The layer name, when given.
    pub layer: Option<Arc<str>>,
    /// The parameters of this instance. Spatial values are in the space of `to_world`.
    pub params: Params,
    /// The transform from "shader" space to world.
    pub to_world: MotionTransform,
    /// The "name" of the attribute state in which it was declared. `Modify` finds the state by this name.
    pub state: Arc<str>,
    /// The location of its declaration.
    pub at: Location,
}

/// A connection of `ConnectShaders`: a source parameter (or global) is the input of a parameter (or global) of a
/// later layer.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct Connection {
    pub source_layer: Arc<str>,
    /// The source parameter. It may have an index: `"colorvar[1]"`.
    pub source: Arc<str>,
    pub target_layer: Arc<str>,
    pub target: Arc<str>,
}

/// The shaders of one usage, run in sequence. A single shader is a group of one layer.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ShaderGroup {
    /// The layers in order of execution; never empty in a scene.
    pub layers: Vec<Arc<ShaderInstance>>,
    /// The connections between the layers.
    pub connections: Vec<Connection>,
}

impl ShaderGroup {
    /// Returns the group with a transformation of world space applied to its "shader" spaces.
    pub fn rebased(&self, by: &MotionTransform) -> Self {
        let mut new = self.clone();
        for layer in &mut new.layers {
            let layer = Arc::make_mut(layer);
            layer.to_world = layer.to_world.then(by);
        }
        new
    }
}

/// A light source.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The `lightid` of the call.
    pub name: Arc<str>,
    /// The shader layers.
    pub group: ShaderGroup,
    /// The attribute state at the time of the `Light` call (bias, samples, ...).
    pub attributes: Arc<AttributeSet>,
}

/// The per-object state that is frozen when a primitive is declared. Many primitives share one.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct AttributeSet {
    /// The per-object attributes that differ from their default, and the `user:` attributes, by name. They are
    /// shared, so that objects that differ only in their transformation need little memory.
    pub values: Arc<Values>,
    /// The surface shaders. For each usage `None` selects the documented default.
    pub surface: Option<Arc<ShaderGroup>>,
    /// The displacement shaders.
    pub displacement: Option<Arc<ShaderGroup>>,
    /// The volume shaders.
    pub volume: Option<Arc<ShaderGroup>>,
    /// The lights that illuminate the object, in order of declaration.
    pub lights: LightSet,
    /// The transform from object space to world, for points from which [`AttributeSet::taken_off`] was subtracted.
    pub to_world: MotionTransform,
    /// The offset that was subtracted from the points of primitives, in object space. It moves points far from the
    /// origin near another origin. The state machine always sets it to zero.
    pub taken_off: Vec3,
    /// True when the orientation is reversed relative to the handedness of world space. By the rules of
    /// "orientation", `cross (dPdu, dPdv)` of the object's own space then points to the outside only after negation
    /// (reference 4.4.4).
    pub flip_normals: bool,
    /// The trim curves for patches.
    pub trim: Option<Arc<TrimDesc>>,
    /// The names of the geometry sets that contain the object, sorted.
    pub geometry_sets: Arc<[Arc<str>]>,
}

/// The effect of a surface on what is behind it: the attribute "holdout" (reference 4.4.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Holdout {
    /// The surface shows what is behind it as far as it is not opaque.
    #[default]
    None,
    /// The surface hides what is behind it and is not visible itself. No shader runs.
    Matte,
    /// The surface hides what is behind it and is visible.
    Shaded,
}

impl AttributeSet {
    /// Returns the attribute "holdout".
    pub fn holdout(&self) -> Holdout {
        match self.get(attr::HOLDOUT) {
            0 => Holdout::None,
            2 => Holdout::Shaded,
            _ => Holdout::Matte,
        }
    }

    /// Returns the transform from object space to world at a time, for points from which no offset was subtracted.
    pub fn object_to_world(&self, time: f32) -> Transform {
        let to_world = self.to_world.at(time);
        if self.taken_off == Vec3::ZERO {
            return to_world;
        }
        Transform::translate(-self.taken_off).then_rounded_once(&to_world)
    }

    /// Applies a transformation of world space to the object and to the "shader" spaces of its shaders.
    pub fn rebase(&mut self, by: &MotionTransform) {
        self.to_world = self.to_world.then(by);
        for group in [&mut self.surface, &mut self.displacement, &mut self.volume].into_iter().flatten() {
            *group = Arc::new(group.rebased(by));
        }
    }

    /// Returns the value of a per-object attribute, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Object, T>) -> T {
        key.of(self.values.get(key.name()))
    }

    /// True when a per-object attribute differs from its default.
    pub fn is_set<T>(&self, key: Key<scope::Object, T>) -> bool {
        self.values.get(key.name()).is_some()
    }

    /// Returns the "name" attribute.
    pub fn name(&self) -> Arc<str> {
        self.get(attr::NAME)
    }
}

/// A shape at one time: its parameters (control vertices and primitive variables).
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeKey {
    /// The time of the motion key; 0 for a shape that does not deform.
    pub time: f32,
    /// The control vertices and primitive variables, in object space.
    pub params: Params,
}

/// One geometric primitive.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// A hash of its shape and place, which seeds all its random choices. It does not depend on the rest of the
    /// scene, so that an input that is not visible may stay deferred.
    pub id: u32,
    /// The shape.
    pub shape: ShapeDesc,
    /// One key, or several (times increasing) for deformation blur, all with the same parameters.
    pub keys: Vec<ShapeKey>,
    /// The state when it was declared.
    pub attributes: Arc<AttributeSet>,
    /// The location of its declaration.
    pub at: Location,
}

/// A camera (reference 4.1) with all parameters resolved.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The name of the camera, which is also the name of a geometry set.
    pub name: Arc<str>,
    /// The transform from world to "camera" space: left handed, x right, y up, z forward.
    pub world_to_camera: MotionTransform,
    /// The camera attributes by name, with defaults filled in (`resolution`, `fov`, `screen` only when set, ...).
    pub params: Params,
}

/// An image to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// The file name.
    pub name: Arc<str>,
    /// The image format.
    pub format: Arc<str>,
    /// The data: "rgb", "rgba", "error", "z", "avgz", "volz", or `type name` of a variable; several with commas between
    /// them for an image of several layers.
    pub data: Arc<str>,
    /// The name of the camera that it shows.
    pub camera: Arc<str>,
    /// The output attributes (4.2) and the parameters of the format.
    pub params: Params,
}

/// The complete data of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The scene-wide attributes that differ from their default, by name.
    pub globals: BTreeMap<Arc<str>, Param>,
    /// The cameras in order of declaration. The first one is the shading camera. Never empty after `World`.
    pub cameras: Vec<Camera>,
    /// The outputs in order of declaration. Never empty: without `Output` the first camera gets a default one.
    pub outputs: Vec<Output>,
    /// The primitives in order of declaration.
    pub primitives: Vec<Arc<Primitive>>,
    /// The lights, indexed by [`LightId`](crate::LightId).
    pub lights: Vec<Arc<Light>>,
    /// The spaces named by `SaveAttributes`, as transforms to world.
    pub coordinate_systems: BTreeMap<Arc<str>, MotionTransform>,
    /// The numbers of deferred inputs that were read and not read.
    pub inputs: InputCounts,
}

/// The numbers of inputs with a bound (reference 2.9).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputCounts {
    /// The number that was read because a camera or a ray may see their contents.
    pub read: usize,
    /// The number that was never read.
    pub unread: usize,
}

impl Scene {
    /// Applies a transformation of world space to all cameras, and to the lights and the objects whose attribute "name"
    /// is `name`.
    pub fn turn_around(&mut self, name: &str, by: &Transform) {
        let undone: MotionTransform = by.inverse().into();
        let by: MotionTransform = (*by).into();
        for camera in &mut self.cameras {
            camera.world_to_camera = undone.then(&camera.world_to_camera);
        }
        for light in self.lights.iter_mut().filter(|light| &*light.attributes.name() == name) {
            let light = Arc::make_mut(light);
            light.group = light.group.rebased(&by);
            let mut attributes = (*light.attributes).clone();
            attributes.rebase(&by);
            light.attributes = Arc::new(attributes);
        }
        for primitive in self.primitives.iter_mut().filter(|p| &*p.attributes.name() == name) {
            let primitive = Arc::make_mut(primitive);
            let mut attributes = (*primitive.attributes).clone();
            attributes.rebase(&by);
            primitive.attributes = Arc::new(attributes);
        }
    }

    /// Returns the value of a scene-wide attribute, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Global, T>) -> T {
        key.of(self.globals.get(key.name()))
    }

    /// Returns the value of a scene-wide attribute, if it was set.
    pub fn given<T: AttributeValue>(&self, key: Key<scope::Global, T>) -> Option<T> {
        T::read(&self.globals.get(key.name())?.data)
    }
}

impl Camera {
    /// Returns the value of a camera attribute, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Camera, T>) -> T {
        key.of(self.params.get(key.name()))
    }
}

impl Output {
    /// Returns the data of each layer.
    pub fn layers(&self) -> impl Iterator<Item = &str> {
        self.data.split(',').map(str::trim)
    }

    /// Returns the name of the part of the file that the image becomes; empty for a file of its own.
    pub fn part(&self) -> Arc<str> {
        self.get(crate::attr::PART)
    }

    /// True when a further call with this output replaces this one. The parts of one file are outputs of their own.
    pub fn is_replaced_by(&self, new: &Self) -> bool {
        self.name == new.name && self.part() == new.part()
    }

    /// Returns the value of an attribute of an image, or its default.
    pub fn get<T: AttributeValue>(&self, key: Key<scope::Output, T>) -> T {
        self.given(key).unwrap_or_else(|| key.default())
    }

    /// Returns the value of an attribute of an image, if one was given.
    pub fn given<T: AttributeValue>(&self, key: Key<scope::Output, T>) -> Option<T> {
        T::read(&self.params.get(key.name())?.data)
    }
}
