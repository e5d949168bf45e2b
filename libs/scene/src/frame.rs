//! The interface of the state machine to the renderer.

use crate::{AttributeSet, Scene, SceneSink, ShaderGroup, Stop};
use granita_base::{Location, Param, Params};
use std::sync::Arc;

/// Reads a scene file, a generator's calls or a program's output into a sink. It is a separate value, so that an
/// `Input` with a bound can be read later, and so that one `Input` may contain others.
pub type InputReader = Box<dyn FnOnce(&mut dyn SceneSink) -> Result<(), Stop> + Send>;

/// The result of resolving the name of an `Input`, made by [`FrameRenderer::input`].
pub struct FoundInput {
    /// An identifier of the input. An input that contains itself is detected by it, because reading it would never
    /// end.
    pub identity: Arc<str>,
    /// The bound that the generator provides: xmin, xmax, ymin, ymax, zmin, zmax in the space of the call.
    pub bound: Option<[f32; 6]>,
    /// Opens and reads the input. Nothing is opened, and no program is started, before.
    pub reader: InputReader,
}

impl std::fmt::Debug for FoundInput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FoundInput").field("identity", &self.identity).finish_non_exhaustive()
    }
}

/// The search paths of inputs, as set by the scene: `&` is resolved, variables are not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputPaths<'a> {
    /// The attribute "path:input".
    pub input: &'a str,
    /// The attribute "path:generator".
    pub generator: &'a str,
}

/// An `Input` with a bound that is not read yet.
#[derive(Clone, Debug)]
pub struct DeferredInput {
    /// The bound: xmin, xmax, ymin, ymax, zmin, zmax in the space of the call.
    pub bound: [f32; 6],
    /// The state at the call.
    pub attributes: Arc<AttributeSet>,
}

/// The renderer behind [`crate::State`]. It makes images, executes commands and finds inputs.
pub trait FrameRenderer: Send {
    /// Renders a finished scene and returns when the images are written. `camera` is the name given to `Render`,
    /// always one of `scene.cameras`. `None` renders every camera that has outputs.
    ///
    /// The renderer itself reports failures. `Err` ends the stream of calls.
    ///
    /// # Errors
    /// [`Stop`] when no further call has an effect.
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop>;

    /// Executes a command (reference 4.5) other than "exit". `name` is the whole argument of `Command`, including the
    /// text after the first word (`"system maketx a.tif a.tx"`). Returns whether the command exists.
    ///
    /// # Errors
    /// [`Stop`] when no further call has an effect.
    fn command(&mut self, name: &str, params: &Params, at: &Location) -> Result<bool, Stop>;

    /// Finds the input that an `Input` names: a file, a generator with its argument, `"pyg << text"`, or
    /// `"pyg < program"`. Returns `None` when it does not exist, which the implementation has reported.
    ///
    /// # Errors
    /// [`Stop`] when no further call has an effect.
    fn input(
        &mut self,
        command: &str,
        paths: InputPaths<'_>,
        at: &Location,
    ) -> Result<Option<FoundInput>, Stop>;

    /// Returns for each deferred input whether it may be visible, or hit by a ray, when `scene` is rendered in its
    /// current form; `true` when in doubt. It is called again after these inputs are read.
    fn needed(&mut self, scene: &Arc<Scene>, unread: &[DeferredInput]) -> Vec<bool> {
        let _ = scene;
        vec![true; unread.len()]
    }

    /// Returns whether a light can be used that a re-render adds or replaces: its shaders exist and accept their
    /// parameters. When it cannot, the implementation reports why, and the scene keeps the light as it was.
    /// `shader_path` is the attribute "path:shader" as set by the scene.
    fn check_light(&mut self, name: &str, group: &ShaderGroup, shader_path: &str, at: &Location) -> bool {
        let _ = (name, group, shader_path, at);
        true
    }

    /// Receives every scene-wide attribute when it is set (checked and converted), for attributes that apply at once,
    /// such as "verbosity".
    fn attribute(&mut self, param: &Param) {
        let _ = param;
    }

    /// Returns a value that only the renderer can compute, such as "render:progress".
    fn query(&self, name: &str) -> Option<Param> {
        let _ = name;
        None
    }
}
