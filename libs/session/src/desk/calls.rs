//! The calls that lead from the lights of a scene to edited ones (reference 11.2).
//!
//! They follow a `Render` in re-rendering mode. The same calls are made for an image of the desk and written to a
//! patch, so that both have the same pixels.

use super::rig::{Lamp, Layer, Rig};
use granita_base::{MotionTransform, Param};
use granita_scene::attribute::attribute_default;
use granita_scene::{Call, TransformTarget, Values, attr};
use std::sync::Arc;

/// Returns the calls that turn the lights `base` into `rig`, from `World` to before `Render`. `world` holds the
/// attributes right after the first `World`.
pub(crate) fn calls(base: &Rig, rig: &Rig, world: &Values) -> Vec<Call> {
    let mut calls = vec![Call::World];
    for old in base.lamps.iter().filter(|old| rig.lamp(&old.id).is_none()) {
        calls.push(Call::Light { id: old.id.clone(), shader: None, layer: None, params: Default::default() });
    }
    for lamp in &rig.lamps {
        let old = base.lamp(&lamp.id);
        if old.is_none_or(|old| !old.is_declared_like(lamp)) {
            declare(lamp, world, &mut calls);
        }
        if old.is_none() {
            switch(&lamp.id, "", true, &mut calls);
        }
        lamp.rules.iter().for_each(|rule| switch(&lamp.id, &rule.pattern, rule.on, &mut calls));
        if !rig.is_lit(lamp) {
            switch(&lamp.id, "", false, &mut calls);
        }
    }
    calls
}

/// Appends the calls that switch a light for the objects whose names match a pattern.
fn switch(id: &Arc<str>, pattern: &str, on: bool, calls: &mut Vec<Call>) {
    calls.push(Call::PushAttributes);
    calls.push(Call::Modify { pattern: pattern.into() });
    calls.push(Call::LightSwitch { id: id.clone(), on });
    calls.push(Call::PopAttributes);
}

/// Appends the calls that declare a light with all its attributes, shaders and parameters.
fn declare(lamp: &Lamp, world: &Values, calls: &mut Vec<Call>) {
    calls.push(Call::PushAttributes);
    for (name, value) in lamp.values.iter().filter(|(name, value)| world.get(name) != Some(value)) {
        if !attr::NAME.is_named(name) {
            calls.push(Call::Attribute(value.clone()));
        }
    }
    // Attributes that are not in the list have their defaults.
    let missing = world.iter().filter(|(name, _)| lamp.values.get(name).is_none());
    let defaults = missing.filter_map(|(name, _)| attribute_default(name));
    calls.extend(defaults.filter(|p| !attr::NAME.is_named(&p.name)).map(Call::Attribute));
    let mut name = world.get(attr::NAME.name()).and_then(|p| attr::NAME.given(p)).unwrap_or_default();
    let grouped = lamp.layers.len() > 1 || !lamp.connections.is_empty();
    if grouped {
        calls.push(Call::ShaderGroupBegin);
    }
    for layer in &lamp.layers {
        rename(&mut name, &layer.state, calls);
        place(&layer.to_world, calls);
        let Layer { shader, layer, params, .. } = layer.clone();
        calls.push(Call::Light { id: lamp.id.clone(), shader: Some(shader), layer, params });
    }
    for c in lamp.connections.iter().cloned() {
        calls.push(Call::ConnectShaders {
            source_layer: c.source_layer,
            source: c.source,
            target_layer: c.target_layer,
            target: c.target,
        });
    }
    if grouped {
        rename(&mut name, &lamp.state, calls);
        calls.push(Call::ShaderGroupEnd);
    }
    calls.push(Call::PopAttributes);
}

/// Appends a change of the attribute "name".
fn rename(name: &mut Arc<str>, to: &Arc<str>, calls: &mut Vec<Call>) {
    if name != to {
        calls.push(Call::Attribute(Param { ..attr::NAME.param(to.clone()) }));
        name.clone_from(to);
    }
}

/// Appends the calls that set the current transformation.
fn place(to_world: &MotionTransform, calls: &mut Vec<Call>) {
    if to_world.is_moving() {
        calls.push(Call::Motion(to_world.keys().iter().map(|(time, _)| *time).collect()));
    }
    for (_, matrix) in to_world.keys() {
        calls.push(Call::SetTransform(TransformTarget::Matrix(Box::new(matrix.to_rows()))));
    }
}
