//! Shaders, layers and lights (reference 2.6).

use super::State;
use super::attributes::typed;
use super::transforms::hint;
use crate::interface::SHADER;
use crate::{Connection, Light, LightId, ShaderGroup, ShaderInstance, ShaderUsage};
use granita_base::{Location, ParamData, Params, Severity, suggestion};
use std::sync::Arc;

/// The shaders between `ShaderGroupBegin` and `ShaderGroupEnd`.
#[derive(Debug)]
pub(super) struct GroupBlock {
    pub(super) at: Location,
    layers: Vec<(ShaderUsage, Arc<ShaderInstance>)>,
    connections: Vec<Connection>,
    light: Option<Arc<str>>,
}

impl State {
    /// Handles `Shader`.
    pub(super) fn shader(
        &mut self,
        usage: &str,
        name: Option<Arc<str>>,
        layer: Option<Arc<str>>,
        params: Params,
        at: &Location,
    ) {
        let params = self.take_params(params);
        let kind = match usage {
            "surface" => ShaderUsage::Surface,
            "displacement" => ShaderUsage::Displacement,
            // Older scenes use "atmosphere".
            "volume" | "atmosphere" => ShaderUsage::Volume,
            _ => {
                let hint = hint(suggestion(usage, SHADER.words("usage").iter().copied()));
                let text = format!("Shader: unknown usage \"{usage}\"{hint}");
                return self.report(Severity::Warning, at, "usage", text);
            }
        };
        let Some(name) = name else {
            return self.assign(kind, None);
        };
        let instance = self.instance(name, layer, &params, "Shader", at);
        match &mut self.group {
            Some(group) => group.layers.push((kind, instance)),
            None => {
                let group = ShaderGroup { layers: vec![instance], connections: Vec::new() };
                self.assign(kind, Some(Arc::new(group)));
            }
        }
    }

    fn assign(&mut self, usage: ShaderUsage, group: Option<Arc<ShaderGroup>>) {
        self.edit_sets(|set| {
            let slot = match usage {
                ShaderUsage::Surface => &mut set.surface,
                ShaderUsage::Displacement => &mut set.displacement,
                ShaderUsage::Volume => &mut set.volume,
                ShaderUsage::Light => return,
            };
            slot.clone_from(&group);
        });
    }

    fn instance(
        &mut self,
        shader: Arc<str>,
        layer: Option<Arc<str>>,
        params: &Params,
        call: &str,
        at: &Location,
    ) -> Arc<ShaderInstance> {
        let mut good = Params::new();
        for param in params {
            match typed(param) {
                Ok(param) => {
                    if let ParamData::Float(values) = &param.data
                        && values.iter().any(|v| v.is_nan())
                    {
                        let text = format!("{call} \"{shader}\": \"{}\" is not a number (NaN)", param.name);
                        self.report_object(Severity::Warning, at, "shader parameter", text);
                    }
                    good.0.push(param);
                }
                Err(text) => {
                    let text = format!("{call} \"{shader}\": {text}");
                    self.report_object(Severity::Error, at, "shader parameter", text);
                }
            }
        }
        let to_world = self.current.set.to_world.clone();
        let state = self.current.set.name();
        let instance =
            Arc::new(ShaderInstance { shader, layer, params: good, to_world, state, at: at.clone() });
        self.modify_shader_also(&instance);
        instance
    }

    /// Handles `ShaderGroupBegin`.
    pub(super) fn begin_group(&mut self, at: &Location) {
        if self.group.is_some() {
            self.out_of_place(at, "ShaderGroupBegin", "inside another shader group");
            return;
        }
        self.group =
            Some(GroupBlock { at: at.clone(), layers: Vec::new(), connections: Vec::new(), light: None });
    }

    /// Handles `ShaderGroupEnd` and assigns the layers of each usage.
    pub(super) fn end_group(&mut self, at: &Location) {
        let Some(block) = self.group.take() else {
            return self.out_of_place(at, "ShaderGroupEnd", "without ShaderGroupBegin");
        };
        if block.layers.is_empty() {
            self.report(Severity::Warning, at, "group", "shader group without shaders");
        }
        let usages =
            [ShaderUsage::Surface, ShaderUsage::Displacement, ShaderUsage::Volume, ShaderUsage::Light];
        for usage in usages {
            let layers: Vec<_> =
                block.layers.iter().filter(|(u, _)| *u == usage).map(|(_, l)| l.clone()).collect();
            if layers.is_empty() {
                continue;
            }
            let has = |name: &str| layers.iter().any(|l| l.layer.as_deref() == Some(name));
            let connections = block.connections.iter().filter(|c| has(&c.target_layer)).cloned().collect();
            let group = ShaderGroup { layers, connections };
            match (usage, &block.light) {
                (ShaderUsage::Light, Some(id)) => self.set_light(id.clone(), group, at),
                _ => self.assign(usage, Some(Arc::new(group))),
            }
        }
    }

    /// Handles `ConnectShaders`.
    pub(super) fn connect(&mut self, connection: Connection, at: &Location) {
        let Some(group) = &self.group else {
            return self.out_of_place(at, "ConnectShaders", "outside of a shader group");
        };
        let position = |name: &str| group.layers.iter().position(|(_, l)| l.layer.as_deref() == Some(name));
        let (source, target) = (position(&connection.source_layer), position(&connection.target_layer));
        for (found, layer) in [(source, &connection.source_layer), (target, &connection.target_layer)] {
            if found.is_none() {
                let layers = group.layers.iter().filter_map(|(_, l)| l.layer.as_deref());
                let text = format!(
                    "ConnectShaders: no layer \"{layer}\" in the group{}",
                    hint(suggestion(layer, layers))
                );
                return self.report(Severity::Error, at, "layer", text);
            }
        }
        let (Some(source), Some(target)) = (source, target) else { return };
        if group.layers[source].0 != group.layers[target].0 {
            let text = format!(
                "ConnectShaders: layers \"{}\" and \"{}\" have different usages",
                connection.source_layer, connection.target_layer
            );
            return self.report(Severity::Error, at, "layer", text);
        }
        if source >= target {
            let text = format!(
                "ConnectShaders: layer \"{}\" does not run before \"{}\"",
                connection.source_layer, connection.target_layer
            );
            return self.report(Severity::Error, at, "layer", text);
        }
        if let Some(group) = &mut self.group {
            group.connections.push(connection);
        }
    }

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
        let Some(shader) = shader.filter(|s| &**s != "null") else {
            return self.remove_light(&id, at);
        };
        let instance = self.instance(shader, layer, &params, "Light", at);
        match &mut self.group {
            None => self.set_light(id, ShaderGroup { layers: vec![instance], connections: Vec::new() }, at),
            Some(group) => match &group.light {
                Some(first) if *first != id => {
                    let text = format!("Light \"{id}\" in a group that began with light \"{first}\"");
                    self.report(Severity::Error, at, "light group", text);
                }
                _ => {
                    group.light = Some(id);
                    group.layers.push((ShaderUsage::Light, instance));
                }
            },
        }
    }

    /// Declares or replaces a light and switches it on.
    fn set_light(&mut self, name: Arc<str>, group: ShaderGroup, at: &Location) {
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
                let is_edit = self.rendered && self.is_rerender();
                let old = &mut self.lights[id.0 as usize];
                if !old.group.layers.is_empty() && !is_edit {
                    let text = format!("light \"{name}\" is declared again; the last declaration counts");
                    self.reporter.once(&format!("scene light {name}"), Severity::Warning, at, text);
                }
                *old = light;
                id
            }
            None => {
                let id = LightId(self.lights.len() as u32);
                self.lights.push(light);
                Arc::make_mut(&mut self.light_ids).insert(name, id);
                id
            }
        };
        self.switch(id, true);
    }

    /// Handles `Light (id, "null")`. The light keeps its index, but has no layers and illuminates nothing.
    fn remove_light(&mut self, name: &str, at: &Location) {
        let Some(&id) = self.light_ids.get(name) else {
            let hint = hint(suggestion(name, self.light_ids.keys().map(|k| &**k)));
            let text = format!("Light: cannot remove \"{name}\", there is no such light{hint}");
            return self.report(Severity::Warning, at, "light", text);
        };
        if !self.inputs.is_outside(id) {
            Arc::make_mut(&mut self.lights[id.0 as usize]).group = ShaderGroup::default();
        }
        self.switch(id, false);
    }

    /// Handles `LightSwitch`.
    pub(super) fn light_switch(&mut self, name: &str, on: bool, at: &Location) {
        match self.light_ids.get(name) {
            Some(&id) => self.switch(id, on),
            None => {
                let hint = hint(suggestion(name, self.light_ids.keys().map(|k| &**k)));
                let text = format!("LightSwitch: no light \"{name}\"{hint}");
                self.report(Severity::Error, at, "light", text);
            }
        }
    }

    fn switch(&mut self, id: LightId, on: bool) {
        self.edit_sets(|set| {
            if set.lights.contains(id) != on {
                set.lights.switch(id, on);
            }
        });
    }
}
