//! Shaders and layers (reference 2.6).

use super::State;
use super::attributes::typed;
use super::current::Edit;
use super::transforms::hint;
use crate::interface::SHADER;
use crate::{Connection, ShaderGroup, ShaderInstance, ShaderUsage};
use granita_base::{Location, ParamData, Params, Severity, suggestion};
use std::sync::Arc;

/// The shaders between `ShaderGroupBegin` and `ShaderGroupEnd`.
#[derive(Debug)]
pub(super) struct GroupBlock {
    pub(super) at: Location,
    pub(super) layers: Vec<(ShaderUsage, Arc<ShaderInstance>)>,
    connections: Vec<Connection>,
    pub(super) light: Option<Arc<str>>,
    /// True when a layer of the light is in error, so that a re-render keeps the light as it was.
    pub(super) keeps_light: bool,
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
        if self.refuses("Shader", "the shaders of objects cannot change", at) && self.group.is_none() {
            return;
        }
        let Some(name) = name else {
            return self.assign(kind, None, at);
        };
        let (instance, _) = self.instance(name, layer, &params, "Shader", at);
        match &mut self.group {
            Some(group) => group.layers.push((kind, instance)),
            None => {
                let group = ShaderGroup { layers: vec![instance], connections: Vec::new() };
                self.assign(kind, Some(Arc::new(group)), at);
            }
        }
    }

    fn assign(&mut self, usage: ShaderUsage, group: Option<Arc<ShaderGroup>>, at: &Location) {
        if self.in_rerender() {
            // The error is reported with its shaders.
            return;
        }
        self.edit_sets(Edit::Call("Shader", at), |set| {
            let slot = match usage {
                ShaderUsage::Surface => &mut set.surface,
                ShaderUsage::Displacement => &mut set.displacement,
                ShaderUsage::Volume => &mut set.volume,
                ShaderUsage::Light => return,
            };
            slot.clone_from(&group);
        });
    }

    /// Returns a shader with its parameters, and whether all of them are usable. The others are reported and left out.
    pub(super) fn instance(
        &mut self,
        shader: Arc<str>,
        layer: Option<Arc<str>>,
        params: &Params,
        call: &str,
        at: &Location,
    ) -> (Arc<ShaderInstance>, bool) {
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
        let is_whole = instance.params.0.len() == params.0.len();
        (instance, is_whole)
    }

    /// Handles `ShaderGroupBegin`.
    pub(super) fn begin_group(&mut self, at: &Location) {
        if self.group.is_some() {
            self.out_of_place(at, "ShaderGroupBegin", "inside another shader group");
            return;
        }
        self.group = Some(GroupBlock {
            at: at.clone(),
            layers: Vec::new(),
            connections: Vec::new(),
            light: None,
            keeps_light: false,
        });
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
                (ShaderUsage::Light, Some(id)) if block.keeps_light => self.keep_light(id.clone()),
                (ShaderUsage::Light, Some(id)) => self.set_light(id.clone(), group, at),
                _ => self.assign(usage, Some(Arc::new(group)), at),
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
}
