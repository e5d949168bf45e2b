//! Checkpoints of a scene that is rendered several times: a program may try changes and take them back.

use super::current::Current;
use super::save::Saved;
use super::{Phase, Push, State, World};
use crate::{Camera, Light, LightId, Output, Primitive, Values};
use granita_base::{Param, Params};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The graphics state after a `Render` in re-rendering mode, to which [`State::return_to`] leads back. It shares the
/// objects with the state.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    current: Current,
    stack: Vec<Push>,
    world: Option<World>,
    globals: BTreeMap<Arc<str>, Param>,
    camera_values: BTreeMap<Arc<str>, Param>,
    cameras: Vec<Camera>,
    outputs: Vec<Output>,
    primitives: Vec<Arc<Primitive>>,
    lights: Vec<Arc<Light>>,
    light_ids: Arc<BTreeMap<Arc<str>, LightId>>,
    saved: Arc<BTreeMap<Arc<str>, Saved>>,
}

impl Checkpoint {
    /// Returns the attributes right after `World`, with which each further frame begins.
    pub fn world_values(&self) -> &Values {
        match &self.world {
            Some(World { current, .. }) => &current.set.values,
            None => &self.current.set.values,
        }
    }
}

impl State {
    /// Returns a checkpoint; `None` unless the last call was a `Render` in re-rendering mode. All inputs are read then.
    pub fn checkpoint(&self) -> Option<Checkpoint> {
        (self.phase == Phase::Rerender).then(|| Checkpoint {
            current: self.current.clone(),
            stack: self.stack.clone(),
            world: self.world.clone(),
            globals: self.globals.clone(),
            camera_values: self.camera_values.clone(),
            cameras: self.cameras.clone(),
            outputs: self.outputs.clone(),
            primitives: self.primitives.clone(),
            lights: self.lights.clone(),
            light_ids: self.light_ids.clone(),
            saved: self.saved.clone(),
        })
    }

    /// Undoes all calls since a checkpoint of this frame.
    pub fn return_to(&mut self, checkpoint: &Checkpoint) {
        let from = checkpoint.clone();
        self.current = from.current;
        self.stack = from.stack;
        self.world = from.world;
        self.globals = from.globals;
        self.camera_values = from.camera_values;
        self.cameras = from.cameras;
        self.outputs = from.outputs;
        self.primitives = from.primitives;
        self.lights = from.lights;
        self.light_ids = from.light_ids;
        self.saved = from.saved;
        self.pending = Params::new();
        (self.motion, self.group, self.modify) = (None, None, None);
        self.phase = Phase::Rerender;
    }

    /// Returns the lights, in the order of declaration. A removed light has no layers.
    pub fn lights(&self) -> &[Arc<Light>] {
        &self.lights
    }

    /// Returns the primitives that are read, in the order of declaration.
    pub fn primitives(&self) -> &[Arc<Primitive>] {
        &self.primitives
    }

    /// Returns the first camera, which is that of the shading; `None` before one is declared.
    pub fn first_camera(&self) -> Option<&Camera> {
        self.cameras.first()
    }
}
