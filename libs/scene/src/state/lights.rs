//! Lights and light switches (reference 2.6), also those of later frames (reference 11.2).

use super::State;
use super::current::Edit;
use super::transforms::hint;
use crate::{Light, LightId, ShaderGroup, ShaderUsage, attr};
use granita_base::{Location, Params, Severity, suggestion};
use std::sync::Arc;

impl State {
    /// Handles `Light`.
    pub(super) fn light(
        &mut self,
        id: Arc<str>,
        shader: Option<Arc<str>>,
        layer: Option<Arc<str>>,
        params: Params,
        at: &Location,
    ) {
        let params = self.take_params(params);
        let Some(shader) = shader.filter(|s| !s.is_empty() && &**s != "null") else {
            return self.remove_light(&id, at);
        };
        self.spend_refused();
        let (instance, is_whole) = self.instance(shader, layer, &params, "Light", at);
        let keeps = self.in_rerender() && !is_whole;
        match &mut self.group {
            None if keeps => self.keep_light(id),
            None => self.set_light(id, ShaderGroup { layers: vec![instance], connections: Vec::new() }, at),
            Some(group) => match &group.light {
                Some(first) if *first != id => {
                    let text = format!("Light \"{id}\" in a group that began with light \"{first}\"");
                    self.report(Severity::Error, at, "light group", text);
                }
                _ => {
                    group.light = Some(id);
                    group.keeps_light |= keeps;
                    group.layers.push((ShaderUsage::Light, instance));
                }
            },
        }
    }

    /// Declares or replaces a light and switches it on.
    pub(super) fn set_light(&mut self, name: Arc<str>, group: ShaderGroup, at: &Location) {
        if self.in_rerender() {
            return self.rerender_light(name, group, at);
        }
        let camera = self.shading_camera();
        let attributes = self.current.freeze(camera.as_ref());
        let light = Arc::new(Light { name: name.clone(), group, attributes });
        let outer = self.light_ids.get(&name).copied().filter(|id| self.inputs.is_outside(*id));
        if let Some(outer) = outer {
            // An input that is read late must not change lights of other objects. It gets a light of its own instead.
            self.switch(outer, false);
        }
        let id = match self.light_ids.get(&name).filter(|_| outer.is_none()) {
            Some(&id) => {
                let old = &mut self.lights[id.0 as usize];
                if !old.group.layers.is_empty() {
                    let text = format!("light \"{name}\" is declared again; the last declaration counts");
                    self.reporter.once(&format!("scene light {name}"), Severity::Warning, at, text);
                }
                *old = light;
                id
            }
            None => self.add_light(light),
        };
        self.switch(id, true);
    }

    fn add_light(&mut self, light: Arc<Light>) -> LightId {
        let id = LightId(self.lights.len() as u32);
        Arc::make_mut(&mut self.light_ids).insert(light.name.clone(), id);
        self.lights.push(light);
        id
    }

    /// Adds or replaces a light after the first frame, if the renderer accepts it. The lists of objects stay: a light
    /// that is replaced shines on the same objects, and one that is added on none before `LightSwitch`.
    fn rerender_light(&mut self, name: Arc<str>, group: ShaderGroup, at: &Location) {
        let path = attr::PATH_SHADER.of(self.globals.get(attr::PATH_SHADER.name()));
        if !self.renderer.check_light(&name, &group, &path, at) {
            return self.keep_light(name);
        }
        self.rerender.refused_lights.remove(&name);
        let camera = self.shading_camera();
        let attributes = self.current.freeze(camera.as_ref());
        let light = Arc::new(Light { name: name.clone(), group, attributes });
        let id = match self.light_ids.get(&name) {
            Some(&id) => {
                self.lights[id.0 as usize] = light;
                id
            }
            None => self.add_light(light),
        };
        self.current.edit().lights.switch(id, true);
    }

    /// Leaves a light as it was, because its new declaration is in error.
    pub(super) fn keep_light(&mut self, name: Arc<str>) {
        if self.shining(&name).is_none() {
            self.rerender.refused_lights.insert(name);
        }
    }

    /// Returns the light of this name, unless it was removed.
    fn shining(&self, name: &str) -> Option<LightId> {
        self.light_ids.get(name).copied().filter(|id| !self.lights[id.0 as usize].group.layers.is_empty())
    }

    /// Handles `Light (id, "null")`. The light keeps its index, but has no layers and illuminates nothing.
    fn remove_light(&mut self, name: &str, at: &Location) {
        let known = if self.in_rerender() { self.shining(name) } else { self.light_ids.get(name).copied() };
        let Some(id) = known else {
            let text = format!(
                "Light: cannot remove \"{name}\", there is no such light{}",
                self.similar_light(name)
            );
            return self.report(Severity::Warning, at, "light", text);
        };
        if !self.inputs.is_outside(id) {
            Arc::make_mut(&mut self.lights[id.0 as usize]).group = ShaderGroup::default();
        }
        if self.in_rerender() { self.drop_light(id) } else { self.switch(id, false) }
    }

    /// Handles `LightSwitch`.
    pub(super) fn light_switch(&mut self, name: &str, on: bool, at: &Location) {
        let known = self.light_ids.get(name).copied();
        match if self.in_rerender() { self.shining(name) } else { known } {
            Some(id) => self.switch(id, on),
            None if self.rerender.refused_lights.contains(name) || (known.is_some() && !on) => {}
            None => {
                let text = format!("LightSwitch: no light \"{name}\"{}", self.similar_light(name));
                self.report(Severity::Error, at, "light", text);
            }
        }
    }

    fn similar_light(&self, name: &str) -> String {
        let names = self.light_ids.keys().map(|known| &**known);
        hint(suggestion(name, names.filter(|known| self.shining(known).is_some())))
    }

    fn switch(&mut self, id: LightId, on: bool) {
        self.edit_sets(Edit::Allowed, |set| {
            if set.lights.contains(id) != on {
                set.lights.switch(id, on);
            }
        });
    }
}
