//! Every call of the scene interface (reference chapter 2) as one value.
//!
//! Readers, generators and bindings produce calls. The renderer, the Pyg writer and recorders receive them. There is
//! no other description of a scene.

use granita_base::{Location, Param, Params, ShapeDesc, TrimDesc};
use std::sync::Arc;

/// Sixteen numbers, row by row.
pub type Matrix = [f32; 16];

/// The target of `SetTransform`.
#[derive(Clone, Debug, PartialEq)]
pub enum TransformTarget {
    /// A matrix relative to camera space (before `World`) or world space.
    Matrix(Box<Matrix>),
    /// A named coordinate system.
    Named(Arc<str>),
}

/// One call. Parameters that a call takes from the pending list are part of it.
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
    /// A shader. `name` is `None` to clear the usage.
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
    /// A light. `shader` is `None` (or "null") to remove the light.
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
    /// Trim curves. `None` turns trimming off.
    TrimCurve(Option<Box<TrimDesc>>),
    /// A scene file, generator or program. With a bound it may be read later or never.
    Input {
        command: Arc<str>,
        bound: Option<[f32; 6]>,
    },
}

impl Call {
    /// Returns the name of the call in the scene interface.
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

/// A receiver of a stream of calls: the live state, the Pyg writer, or a recorder.
pub trait SceneSink {
    /// Receives one call that was made at `at`. The sink itself reports errors of the scene and returns `Ok` for
    /// them.
    ///
    /// # Errors
    /// [`Stop`] when no further call has an effect (a closed pipe, an aborted frame).
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop>;

    /// True when `World` was called. Geometry is accepted from then on, and cameras are not. Receivers that do not
    /// follow the state return `true`.
    fn in_world(&self) -> bool {
        true
    }

    /// Begins another frame after `Render` and keeps only the scene-wide attributes. Returns `false` when only one
    /// frame is accepted, or none was rendered.
    fn new_frame(&mut self) -> bool {
        false
    }

    /// Returns the value of an attribute in the current state, for `GetAttribute`; `None` when there is none.
    fn attribute(&self, declaration: &str) -> Option<Param> {
        let _ = declaration;
        None
    }
}

/// The reason why a stream of calls ended early.
#[derive(Debug, thiserror::Error)]
pub enum Stop {
    /// The command `Command ("exit")`.
    #[error("stopped by the scene's own request")]
    Exit,
    /// Output could not be written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// Any other reason, which was already reported.
    #[error("{0}")]
    Failed(String),
}
