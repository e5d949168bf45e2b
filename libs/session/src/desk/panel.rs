//! The content of the panel, as JSON.
//!
//! The panel consists of parts, of which those that changed are sent: "desk" (what does not change), "state" (status,
//! undo, messages, the order of the lights), "objects" (the names of objects, and how many each light illuminates), and
//! "light/ID" for each light. Positions in the image are pixels of its data window.
//!
//! In "state", "image" describes the last complete image: "edit" is the number of the last edit that it shows (null
//! without numbers), and "coarse" is true for an image of a drag. The pixels of the image are sent before this part.

use super::Desk;
use super::geometry::angles_deg;
use super::interface::Emission;
use super::rig::Lamp;
use crate::Session;
use granita_base::{Vec3, suggestion};
use granita_scene::LightId;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The largest number of names of objects in a panel.
const NAMES: usize = 2000;
/// The largest number of lights in a panel.
const LIGHTS: usize = 1000;

impl Desk {
    /// Shows what changed in the panel.
    pub(super) fn show_panel(&mut self, session: &Session) {
        if self.next_frame().is_none() {
            // The image shows edits that change nothing without another frame.
            self.complete.number = self.number;
        }
        let constant = json!({
            "version": 1,
            "window": self.window().map(|w| [w.x0, w.y0, w.width() as i32, w.height() as i32]),
            "scene": session.options().scene_files,
            "file": self.file,
            "shaders": self.light_shaders(),
        });
        self.screen.show_panel("desk", constant.to_string());
        let lamps = self.rig.lamps.clone();
        let mut parts: BTreeSet<String> = ["desk", "state", "objects"].map(str::to_owned).into();
        for lamp in lamps.iter().take(LIGHTS) {
            let part = format!("light/{}", lamp.id);
            let text = self.light(lamp).to_string();
            self.screen.show_panel(&part, text);
            parts.insert(part);
        }
        for part in self.screen.parts().into_iter().filter(|part| !parts.contains(part)) {
            self.screen.show_panel(&part, String::new());
        }
        let ids: Vec<&str> = lamps.iter().take(LIGHTS).map(|lamp| &*lamp.id).collect();
        let state = json!({
            "status": self.status.word(),
            "image": {"edit": self.complete.number, "coarse": self.complete.coarse},
            "message": self.message.as_ref().map(|(text, is_error)| json!({"text": text, "error": is_error})),
            "undo": self.history.undo_label(),
            "redo": self.history.redo_label(),
            "changed": self.rig != self.base,
            "saved": self.saved.as_ref().is_some_and(|(rig, _)| *rig == self.rig),
            "patch": self.saved.as_ref().map(|(_, file)| file),
            "before": self.has_before.then(|| self.screen.before_name()),
            "lights": ids,
            "solo": self.rig.has_solo(),
        });
        self.screen.show_panel("state", state.to_string());
    }

    /// Shows the names of objects and the number of objects of each light, from the state of the last frame.
    pub(super) fn show_objects(&self, session: &Session) {
        let state = session.state_ref();
        let mut names = BTreeSet::new();
        let mut counts: BTreeMap<LightId, usize> = BTreeMap::new();
        // Objects that follow each other often share their attributes.
        let runs = state.primitives().chunk_by(|a, b| Arc::ptr_eq(&a.attributes, &b.attributes));
        for run in runs {
            let attributes = &run[0].attributes;
            names.insert(attributes.name());
            attributes.lights.iter().for_each(|light| *counts.entry(light).or_default() += run.len());
        }
        let of_light: BTreeMap<&str, usize> = (0..)
            .zip(state.lights())
            .map(|(k, light)| (&*light.name, counts.get(&LightId(k)).copied().unwrap_or(0)))
            .collect();
        let objects = json!({
            "names": names.iter().filter(|name| !name.is_empty()).take(NAMES).map(|name| &**name).collect::<Vec<_>>(),
            "count": state.primitives().len(),
            "lit": of_light,
        });
        self.screen.show_panel("objects", objects.to_string());
    }

    /// Returns the names of the light shaders that a user may choose.
    fn light_shaders(&mut self) -> Vec<&'static str> {
        if self.shaders.is_empty() {
            let names = granita_bundled::shader_names();
            self.shaders = names.filter(|name| self.interfaces.get(name).is_ok()).collect();
        }
        self.shaders.clone()
    }

    /// Returns one light as JSON.
    pub(super) fn light(&mut self, lamp: &Lamp) -> Value {
        let mut layers = Vec::new();
        for layer in &lamp.layers {
            let mut described = json!({"shader": &*layer.shader, "layer": layer.layer.as_deref()});
            match self.interfaces.get(&layer.shader) {
                Ok(interface) => {
                    described["params"] = Value::Array(interface.controls(layer));
                    let help = interface.args.metadata().iter().find(|m| &*m.name == "description");
                    described["help"] = json!(help.and_then(|m| match &m.value {
                        granita_gsl::ir::ConstValue::Strings(v) => v.first().map(|v| v.to_string()),
                        granita_gsl::ir::ConstValue::Floats(_) => None,
                    }));
                }
                Err(what) => described["error"] = json!(what),
            }
            layers.push(described);
        }
        let base = self.base.lamp(&lamp.id);
        let mut light = json!({
            "id": &*lamp.id,
            "on": !lamp.off,
            "solo": lamp.solo,
            "lit": self.rig.is_lit(lamp),
            "added": base.is_none(),
            "changed": base.is_some_and(|base| **base != *lamp),
            "layers": layers,
            "rules": lamp.rules.iter().map(|rule| json!({"pattern": &*rule.pattern, "on": rule.on})).collect::<Vec<_>>(),
        });
        let Some((emission, position, axis)) = self.frame(lamp) else { return light };
        light["emission"] = json!(emission.word());
        let list = |v: Vec3| [v.x, v.y, v.z];
        light["position"] = json!(list(position));
        if emission.turns() {
            light["direction"] = json!(angles_deg(axis));
        }
        let Some(corner) = self.window().map(|w| [w.x0 as f32, w.y0 as f32]) else { return light };
        let Some(eye) = &self.eye else { return light };
        let pixels = |p: Vec3| eye.project(p).map(|[x, y, depth]| [x - corner[0], y - corner[1], depth]);
        let at = pixels(position);
        light["at"] = json!(at);
        // The end of a short line along the axis shows where the light shines.
        if let (Some([.., depth]), Some(axis), Emission::Position { turns: true }) =
            (at, axis.try_normalize(), emission)
        {
            light["toward"] = json!(pixels(position + axis * (0.15 * depth)));
        }
        light
    }

    /// Returns the message for a light that does not exist.
    pub(super) fn no_light(&self, id: &str) -> String {
        let ids = self.rig.lamps.iter().map(|lamp| &*lamp.id);
        let hint = suggestion(id, ids).map(|hint| format!("; did you mean \"{hint}\"?")).unwrap_or_default();
        format!("there is no light \"{id}\"{hint}")
    }
}
