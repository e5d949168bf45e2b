//! Every call of the scene interface (reference chapter 2) as one value.
//!
//! Readers, generators and bindings produce calls. The renderer, the Pyg writer and recorders receive them. There is
//! no other description of a scene.

use crate::interface::{self, CallRow};
use granita_base::{Location, Param, ParamData, Params, ShapeDesc, TrimDesc};
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
    /// Returns the row of the call in the table of calls.
    pub fn row(&self) -> &'static CallRow {
        match self {
            Self::Parameter(_) => interface::PARAMETER,
            Self::Attribute(_) => interface::ATTRIBUTE,
            Self::PushAttributes => interface::PUSH_ATTRIBUTES,
            Self::PopAttributes => interface::POP_ATTRIBUTES,
            Self::SaveAttributes { .. } => interface::SAVE_ATTRIBUTES,
            Self::RestoreAttributes { .. } => interface::RESTORE_ATTRIBUTES,
            Self::Modify { .. } => interface::MODIFY,
            Self::PushTransform => interface::PUSH_TRANSFORM,
            Self::PopTransform => interface::POP_TRANSFORM,
            Self::SetTransform(_) => interface::SET_TRANSFORM,
            Self::AppendTransform(_) => interface::APPEND_TRANSFORM,
            Self::Translate(_) => interface::TRANSLATE,
            Self::Rotate { .. } => interface::ROTATE,
            Self::Scale(_) => interface::SCALE,
            Self::Motion(_) => interface::MOTION,
            Self::Camera { .. } => interface::CAMERA,
            Self::Output { .. } => interface::OUTPUT,
            Self::World => interface::WORLD,
            Self::Render { .. } => interface::RENDER,
            Self::Command { .. } => interface::COMMAND,
            Self::Comment(_) => interface::COMMENT,
            Self::Shader { .. } => interface::SHADER,
            Self::ShaderGroupBegin => interface::SHADER_GROUP_BEGIN,
            Self::ShaderGroupEnd => interface::SHADER_GROUP_END,
            Self::ConnectShaders { .. } => interface::CONNECT_SHADERS,
            Self::Light { .. } => interface::LIGHT,
            Self::LightSwitch { .. } => interface::LIGHT_SWITCH,
            Self::Shape { shape, .. } => match **shape {
                ShapeDesc::Patch { .. } | ShapeDesc::Nurbs { .. } => interface::PATCH,
                ShapeDesc::Mesh { .. } => interface::MESH,
                ShapeDesc::Points { .. } => interface::POINTS,
                ShapeDesc::Curves { .. } | ShapeDesc::NurbsCurves { .. } => interface::CURVES,
                ShapeDesc::Sphere { .. } => interface::SPHERE,
            },
            Self::TrimCurve(_) => interface::TRIM_CURVE,
            Self::Input { .. } => interface::INPUT,
        }
    }

    /// Replaces its texts, except for comments, by what `map` returns for them. A text for which that is `None` stays.
    pub fn map_texts(&mut self, map: &dyn Fn(&str) -> Option<String>) {
        let text = |text: &mut Arc<str>| {
            if let Some(new) = map(text) {
                *text = new.into();
            }
        };
        let param = |param: &mut Param| {
            if let ParamData::String(texts) = &mut param.data
                && texts.iter().any(|text| map(text).is_some())
            {
                *texts =
                    texts.iter().map(|old| map(old).map_or_else(|| old.clone(), |new| new.into())).collect();
            }
        };
        let all = |params: &mut Params| params.0.iter_mut().for_each(param);
        let option = |name: &mut Option<Arc<str>>| name.iter_mut().for_each(text);
        match self {
            Self::Parameter(one) | Self::Attribute(one) => param(one),
            Self::SaveAttributes { name, attributes } | Self::RestoreAttributes { name, attributes } => {
                text(name);
                option(attributes);
            }
            Self::Modify { pattern } => text(pattern),
            Self::Camera { name, params } | Self::Command { name, params } => {
                text(name);
                all(params);
            }
            Self::Output { name, format, data, camera, params } => {
                [name, format, data, camera].into_iter().for_each(text);
                all(params);
            }
            Self::Render { camera } => option(camera),
            Self::Shader { usage, name, layer, params } => {
                text(usage);
                option(name);
                option(layer);
                all(params);
            }
            Self::ConnectShaders { source_layer, source, target_layer, target } => {
                [source_layer, source, target_layer, target].into_iter().for_each(text);
            }
            Self::Light { id, shader, layer, params } => {
                text(id);
                option(shader);
                option(layer);
                all(params);
            }
            Self::LightSwitch { id, .. } => text(id),
            Self::Shape { params, .. } => all(params),
            Self::Input { command, .. } => text(command),
            Self::SetTransform(TransformTarget::Named(name)) => text(name),
            Self::PushAttributes
            | Self::PopAttributes
            | Self::PushTransform
            | Self::PopTransform
            | Self::SetTransform(_)
            | Self::AppendTransform(_)
            | Self::Translate(_)
            | Self::Rotate { .. }
            | Self::Scale(_)
            | Self::Motion(_)
            | Self::World
            | Self::Comment(_)
            | Self::ShaderGroupBegin
            | Self::ShaderGroupEnd
            | Self::TrimCurve(_) => (),
        }
    }

    /// Returns the name of the call in the scene interface.
    pub fn name(&self) -> &'static str {
        self.row().name
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
