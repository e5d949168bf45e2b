//! Layers of shaders, linked.

use crate::ShadeError;
use granita_base::{Params, Severity};
use granita_gsl::ir::{Global, Module, ShaderKind};
use std::sync::Arc;

/// One layer, as a scene gives it.
#[derive(Clone, Debug)]
pub struct LayerSource<'a> {
    /// The compiled shader.
    pub module: Arc<Module>,
    /// Values given with it; spatial ones are in the layer's "shader" space.
    pub params: &'a Params,
    /// Name of the layer, for connections and messages.
    pub name: Option<&'a str>,
}

/// One `ConnectShaders`.
#[derive(Clone, Copy, Debug)]
pub struct ConnectionSource<'a> {
    /// Layer that gives.
    pub source_layer: &'a str,
    /// Its parameter or a global, with an optional index: `"out"`, `"c[1]"`.
    pub source: &'a str,
    /// Layer that takes.
    pub target_layer: &'a str,
    /// Its parameter or a global, with an optional index.
    pub target: &'a str,
}

/// Shaders that run one after the other.
#[derive(Debug)]
pub struct Group {
    modules: Vec<Arc<Module>>,
}

impl Group {
    /// Links layers.
    pub fn link(
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Self, ShadeError> {
        let _ = (connections, report);
        Ok(Self { modules: layers.iter().map(|l| l.module.clone()).collect() })
    }

    /// Checks that every layer may be used as `usage`, and makes that the group's usage.
    pub fn attach(&mut self, usage: ShaderKind) -> Result<(), ShadeError> {
        let _ = usage;
        Ok(())
    }

    /// Whether some layer looks at neighbouring points.
    pub fn needs_derivatives(&self) -> bool {
        self.modules.iter().any(|m| m.needs_derivatives)
    }

    /// Whether some layer writes a global.
    pub fn writes(&self, global: Global) -> bool {
        self.modules.iter().any(|m| m.writes.contains(&global))
    }

    /// Whether some layer writes `opacity`.
    pub fn sets_opacity(&self) -> bool {
        self.writes(Global::opacity)
    }

    /// Whether some layer has an `emit` statement: not an ambient light.
    pub fn has_emit(&self) -> bool {
        false
    }

    /// Names of the output parameters of all layers.
    pub fn output_names(&self) -> &[Arc<str>] {
        &[]
    }

    /// Value of a string parameter that can be told without running.
    pub fn param_string(&self, name: &str) -> Option<Arc<str>> {
        let _ = name;
        None
    }
}
