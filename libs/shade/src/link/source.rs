//! What is linked: layers and connections as a scene gives them.

use granita_base::Params;
use granita_gsl::ir::Module;
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

/// One `ConnectShaders` (reference 2.6).
#[derive(Clone, Copy, Debug)]
pub struct ConnectionSource<'a> {
    /// Layer that gives.
    pub source_layer: &'a str,
    /// Its parameter or a global, with an optional index: `"out"`, `"c[1]"`.
    pub source: &'a str,
    /// Layer that takes; comes later in the group.
    pub target_layer: &'a str,
    /// Its parameter or a global, with an optional index.
    pub target: &'a str,
}

/// How to link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkOptions {
    /// Whether the code is made better with what is known of the instance: constants folded, what nobody needs
    /// left out, what is computed twice computed once. The results are the same to the bit.
    pub optimize: bool,
}

impl Default for LinkOptions {
    fn default() -> Self {
        Self { optimize: true }
    }
}
