//! What the state machine asks of the renderer behind it.

use crate::{Scene, SceneSink, Stop};
use granita_base::{Location, Param, Params};
use std::sync::Arc;

/// Reads a scene file, a generator's calls or a program's output into a sink; made by
/// [`FrameRenderer::input`]. It is a value of its own so that an `Input` with a bound can be read later, and
/// so that one `Input` may contain others.
pub type InputReader = Box<dyn FnOnce(&mut dyn SceneSink) -> Result<(), Stop> + Send>;

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

    /// Finds what an `Input` names: a file on `path:input` (handed in as set by the scene, `&` resolved,
    /// variables not), a generator, `"pyg << text"`, `"pyg < program"`. `None` when there is no such thing,
    /// which the implementation has reported.
    fn input(&mut self, command: &str, path: &str, at: &Location) -> Result<Option<InputReader>, Stop>;

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
