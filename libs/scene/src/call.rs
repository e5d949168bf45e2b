//! Every call of the scene interface (reference chapter 2) as one value.
//!
//! Readers, generators and bindings produce calls; the renderer, the Pyg writer and recorders
//! consume them. Nothing else describes a scene.

use granita_base::{Location, Param, Params, ShapeDesc, TrimDesc};
use std::sync::Arc;

/// Sixteen numbers, row by row.
pub type Matrix = [f32; 16];

/// What `SetTransform` sets the current transformation to.
#[derive(Clone, Debug, PartialEq)]
pub enum TransformTarget {
    /// A matrix relative to camera space (before `World`) or world space.
    Matrix(Box<Matrix>),
    /// A named coordinate system.
    Named(Arc<str>),
}

/// One call. Parameters that a call takes from the pending list travel in it.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub enum Call {
    /// A pending parameter, for the next call that takes parameters.
    Parameter(Param),
    Attribute(Param),
    PushAttributes,
    PopAttributes,
    SaveAttributes {
        name: Arc<str>,
        attributes: Option<Arc<str>>,
    },
    RestoreAttributes {
        name: Arc<str>,
        attributes: Option<Arc<str>>,
    },
    Modify {
        pattern: Arc<str>,
    },
    PushTransform,
    PopTransform,
    SetTransform(TransformTarget),
    AppendTransform(Box<Matrix>),
    Translate([f32; 3]),
    Rotate {
        angle_deg: f32,
        axis: [f32; 3],
    },
    Scale([f32; 3]),
    Motion(Arc<[f32]>),
    Camera {
        name: Arc<str>,
        params: Params,
    },
    Output {
        name: Arc<str>,
        format: Arc<str>,
        data: Arc<str>,
        camera: Arc<str>,
        params: Params,
    },
    World,
    Render {
        camera: Option<Arc<str>>,
    },
    Command {
        name: Arc<str>,
        params: Params,
    },
    Comment(Arc<str>),
    /// `name` is `None` to clear the usage.
    Shader {
        usage: Arc<str>,
        name: Option<Arc<str>>,
        layer: Option<Arc<str>>,
        params: Params,
    },
    ShaderGroupBegin,
    ShaderGroupEnd,
    ConnectShaders {
        source_layer: Arc<str>,
        source: Arc<str>,
        target_layer: Arc<str>,
        target: Arc<str>,
    },
    /// `shader` is `None` (or "null") to remove the light.
    Light {
        id: Arc<str>,
        shader: Option<Arc<str>>,
        layer: Option<Arc<str>>,
        params: Params,
    },
    LightSwitch {
        id: Arc<str>,
        on: bool,
    },
    Shape {
        shape: Box<ShapeDesc>,
        params: Params,
    },
    /// `None` turns trimming off.
    TrimCurve(Option<Box<TrimDesc>>),
    /// A scene file, generator or program; with a bound it may be read later or never.
    Input {
        command: Arc<str>,
        bound: Option<[f32; 6]>,
    },
}

impl Call {
    /// The name of the call in the scene interface.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Parameter(_) => "Parameter",
            Self::Attribute(_) => "Attribute",
            Self::PushAttributes => "PushAttributes",
            Self::PopAttributes => "PopAttributes",
            Self::SaveAttributes { .. } => "SaveAttributes",
            Self::RestoreAttributes { .. } => "RestoreAttributes",
            Self::Modify { .. } => "Modify",
            Self::PushTransform => "PushTransform",
            Self::PopTransform => "PopTransform",
            Self::SetTransform(_) => "SetTransform",
            Self::AppendTransform(_) => "AppendTransform",
            Self::Translate(_) => "Translate",
            Self::Rotate { .. } => "Rotate",
            Self::Scale(_) => "Scale",
            Self::Motion(_) => "Motion",
            Self::Camera { .. } => "Camera",
            Self::Output { .. } => "Output",
            Self::World => "World",
            Self::Render { .. } => "Render",
            Self::Command { .. } => "Command",
            Self::Comment(_) => "Comment",
            Self::Shader { .. } => "Shader",
            Self::ShaderGroupBegin => "ShaderGroupBegin",
            Self::ShaderGroupEnd => "ShaderGroupEnd",
            Self::ConnectShaders { .. } => "ConnectShaders",
            Self::Light { .. } => "Light",
            Self::LightSwitch { .. } => "LightSwitch",
            Self::Shape { shape, .. } => shape.call_name(),
            Self::TrimCurve(_) => "TrimCurve",
            Self::Input { .. } => "Input",
        }
    }
}

/// Whatever takes a stream of calls: the live state, the Pyg writer, a recorder.
pub trait SceneSink {
    /// Takes one call made at `at`. Mistakes of the scene are reported by the sink itself and are no
    /// error; an `Err` means that going on is pointless (a closed pipe, an aborted frame).
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop>;

    /// Whether `World` was called: geometry is taken from then on, and cameras no longer. `true` for receivers that do
    /// not follow the state.
    fn in_world(&self) -> bool {
        true
    }

    /// Begins another frame after `Render`, with nothing but the scene-wide attributes kept. `false` where one frame is
    /// all that is taken, or none was rendered.
    fn new_frame(&mut self) -> bool {
        false
    }

    /// The value of an attribute in the current state, for `GetAttribute`; `None` when there is none.
    fn attribute(&self, declaration: &str) -> Option<Param> {
        let _ = declaration;
        None
    }
}

/// Why a stream of calls ended early.
#[derive(Debug, thiserror::Error)]
pub enum Stop {
    /// `Command ("exit")`.
    #[error("stopped by the scene's own request")]
    Exit,
    /// Output that cannot be written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// Anything else, already told to the user.
    #[error("{0}")]
    Failed(String),
}
