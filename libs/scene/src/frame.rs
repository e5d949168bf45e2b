//! What the state machine asks of the renderer behind it.

use crate::{AttributeSet, Scene, SceneSink, Stop};
use granita_base::{Location, Param, Params};
use std::sync::Arc;

/// Reads a scene file, a generator's calls or a program's output into a sink. It is a value of its own so that an
/// `Input` with a bound can be read later, and so that one `Input` may contain others.
pub type InputReader = Box<dyn FnOnce(&mut dyn SceneSink) -> Result<(), Stop> + Send>;

/// What the name of an `Input` turned out to be; made by [`FrameRenderer::input`].
pub struct FoundInput {
    /// Tells it from others: what names the same thing again while it is being read would never end.
    pub identity: Arc<str>,
    /// The bound that the generator itself knows: xmin, xmax, ymin, ymax, zmin, zmax in the space of the call.
    pub bound: Option<[f32; 6]>,
    /// Opens and reads it. Nothing is opened, and no program is started, before.
    pub reader: InputReader,
}

impl std::fmt::Debug for FoundInput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FoundInput").field("identity", &self.identity).finish_non_exhaustive()
    }
}

/// Where inputs are looked for, as the scene set it: `&` resolved, variables not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputPaths<'a> {
    /// "path:input".
    pub input: &'a str,
    /// "path:generator".
    pub generator: &'a str,
}

/// An `Input` with a bound that was not read yet.
#[derive(Clone, Debug)]
pub struct UnreadInput {
    /// xmin, xmax, ymin, ymax, zmin, zmax in the space of the call.
    pub bound: [f32; 6],
    /// The state at the call.
    pub attributes: Arc<AttributeSet>,
}

/// The other side of [`crate::State`]: makes pictures, executes commands, finds inputs.
pub trait FrameRenderer: Send {
    /// Renders a finished scene and returns when the images are written. `camera` is the name given to
    /// `Render`, always one of `scene.cameras`; `None` renders every camera that has outputs.
    ///
    /// Failures are reported by the renderer itself; `Err` ends the stream of calls.
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop>;

    /// Executes a command (reference 4.5) other than "exit". `name` is the whole argument of `Command`,
    /// with what follows the first word (`"system maketx a.tif a.tx"`). Returns whether the command is known.
    fn command(&mut self, name: &str, params: &Params, at: &Location) -> Result<bool, Stop>;

    /// Finds what an `Input` names: a file, a generator with its argument, `"pyg << text"`, `"pyg < program"`. `None`
    /// when there is no such thing, which the implementation has reported.
    fn input(
        &mut self,
        command: &str,
        paths: InputPaths<'_>,
        at: &Location,
    ) -> Result<Option<FoundInput>, Stop>;

    /// Which of the inputs that were put off may be seen, or met by a ray, when `scene` is rendered as it is so far: one
    /// answer each, `true` when in doubt. Asked again after those are read.
    fn needed(&mut self, scene: &Arc<Scene>, unread: &[UnreadInput]) -> Vec<bool> {
        let _ = scene;
        vec![true; unread.len()]
    }

    /// Told of every scene-wide attribute as it is set (checked and converted), for those that work at
    /// once, as "verbosity".
    fn attribute(&mut self, param: &Param) {
        let _ = param;
    }

    /// Values that only the renderer knows, as "render:progress".
    fn query(&self, name: &str) -> Option<Param> {
        let _ = name;
        None
    }
}
