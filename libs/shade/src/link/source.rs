//! The inputs of linking: layers and connections of a scene.

use granita_base::Params;
use granita_gsl::ValidModule;

/// One layer of a scene.
#[derive(Clone, Debug)]
pub struct LayerSource<'a> {
    /// The compiled shader.
    pub module: ValidModule,
    /// The values of the instance. Spatial ones are in the layer's "shader" space.
    pub params: &'a Params,
    /// The name of the layer, for connections and messages.
    pub name: Option<&'a str>,
}

/// One `ConnectShaders` (reference 2.6).
#[derive(Clone, Copy, Debug)]
pub struct ConnectionSource<'a> {
    /// The source layer.
    pub source_layer: &'a str,
    /// Its parameter or a global, with an optional index: `"out"`, `"c[1]"`.
    pub source: &'a str,
    /// The target layer, which comes later in the group.
    pub target_layer: &'a str,
    /// Its parameter or a global, with an optional index.
    pub target: &'a str,
}

/// The options of linking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkOptions {
    /// True when the code is optimised with the values of the instance: constants are folded, unused code is
    /// removed and repeated computations are done once. The results are the same to the bit.
    pub optimize: bool,
}

impl Default for LinkOptions {
    fn default() -> Self {
        Self { optimize: true }
    }
}
