//! The lights of a scene as data that can be edited, compared and kept for undo.

use granita_base::{MotionTransform, Params};
use granita_scene::{Connection, Light, ShaderGroup, ShaderInstance, State, Values};
use std::sync::Arc;

/// A shader of a light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layer {
    /// The name of the shader.
    pub(crate) shader: Arc<str>,
    /// The name of the layer, when given.
    pub(crate) layer: Option<Arc<str>>,
    /// The parameters of the call. Spatial values are in "shader" space.
    pub(crate) params: Params,
    /// The transformation from "shader" space to world.
    pub(crate) to_world: MotionTransform,
    /// The attribute "name" of the state in which it is declared.
    pub(crate) state: Arc<str>,
}

/// A rule that switches a light for the objects whose names match a pattern.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Rule {
    /// The pattern of `Modify`.
    pub(crate) pattern: Arc<str>,
    /// True when the light illuminates these objects.
    pub(crate) on: bool,
}

/// A light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lamp {
    /// The `lightid` of the call.
    pub(crate) id: Arc<str>,
    /// The shaders, in the order of their execution. The list is never empty.
    pub(crate) layers: Vec<Layer>,
    /// The connections between the shaders.
    pub(crate) connections: Vec<Connection>,
    /// The attributes of the state in which it is declared.
    pub(crate) values: Arc<Values>,
    /// The attribute "name" of that state.
    pub(crate) state: Arc<str>,
    /// The changes to the lists of lights of objects, in the order of their application.
    pub(crate) rules: Vec<Rule>,
    /// True when it illuminates nothing.
    pub(crate) off: bool,
    /// True when all lights without this mark illuminate nothing.
    pub(crate) solo: bool,
}

impl Lamp {
    /// Returns a light of a scene.
    fn of(light: &Light) -> Self {
        let layer = |instance: &Arc<ShaderInstance>| Layer {
            shader: instance.shader.clone(),
            layer: instance.layer.clone(),
            params: instance.params.clone(),
            to_world: instance.to_world.clone(),
            state: instance.state.clone(),
        };
        let ShaderGroup { layers, connections } = &light.group;
        Self {
            id: light.name.clone(),
            layers: layers.iter().map(layer).collect(),
            connections: connections.clone(),
            values: light.attributes.values.clone(),
            state: light.attributes.name(),
            rules: Vec::new(),
            off: false,
            solo: false,
        }
    }

    /// True when the calls that declare both are the same.
    pub(crate) fn is_declared_like(&self, other: &Self) -> bool {
        self.layers == other.layers
            && self.connections == other.connections
            && self.values == other.values
            && self.state == other.state
    }

    /// Applies a transformation of world space.
    pub(crate) fn transform(&mut self, by: &MotionTransform) {
        self.layers.iter_mut().for_each(|layer| layer.to_world = layer.to_world.then(by));
    }
}

/// All lights. Copies share those that do not differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Rig {
    /// Those of the scene, in the order of their declaration, then those that were added.
    pub(crate) lamps: Vec<Arc<Lamp>>,
}

impl Rig {
    /// Returns the lights of a scene.
    pub(crate) fn of(state: &State) -> Self {
        let present = state.lights().iter().filter(|light| !light.group.layers.is_empty());
        Self { lamps: present.map(|light| Arc::new(Lamp::of(light))).collect() }
    }

    /// Returns a light.
    pub(crate) fn lamp(&self, id: &str) -> Option<&Arc<Lamp>> {
        self.lamps.iter().find(|lamp| &*lamp.id == id)
    }

    /// Returns a light for a change.
    pub(crate) fn lamp_mut(&mut self, id: &str) -> Option<&mut Lamp> {
        self.lamps.iter_mut().find(|lamp| &*lamp.id == id).map(Arc::make_mut)
    }

    /// True when some lights are the only ones.
    pub(crate) fn has_solo(&self) -> bool {
        self.lamps.iter().any(|lamp| lamp.solo)
    }

    /// True when a light may illuminate objects: it is on, and no others are the only ones.
    pub(crate) fn is_lit(&self, lamp: &Lamp) -> bool {
        !lamp.off && (lamp.solo || !self.has_solo())
    }

    /// Returns an id that no light has, which begins with `wanted`.
    pub(crate) fn free_id(&self, wanted: &str, base: &Self) -> Arc<str> {
        let is_taken = |id: &str| self.lamp(id).is_some() || base.lamp(id).is_some();
        let ids = std::iter::once(wanted.to_owned()).chain((2..).map(|k| format!("{wanted}{k}")));
        ids.into_iter().find(|id| !is_taken(id)).unwrap_or_default().into()
    }
}
