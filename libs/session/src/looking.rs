//! How a look is rendered: the options, the positions of a turntable, and the reading of mesh files.

mod framing;

pub use framing::Up;
pub(crate) use framing::{Framing, Lens, Space};
use granita_base::{Location, Param, Params};
use granita_scene::{Call, Scene, SceneSink, State, Stop, attr};
use std::path::Path;
use std::sync::Arc;

/// The attribute "name" of everything that the studio adds.
pub(crate) const STUDIO: &str = "studio";
/// The vertical field of view in degrees, when the files set none.
pub(crate) const FOV_DEG: f32 = 30.0;
/// The gamma of images for screens.
pub(crate) const GAMMA: f32 = 2.2;
/// The formats of linear light.
const LINEAR: [&str; 3] = ["exr", "hdr", "pfm"];
/// The angle in degrees up to which neighbouring faces of meshes without normals are smooth.
const SMOOTH_DEG: f32 = 40.0;

/// The requests of the user for [`crate::Session::look`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LookOptions {
    /// The number of images of a whole turn; 0 for one image.
    pub turntable: u32,
    /// The axis that points up.
    pub up: Up,
}

/// How the next frame is rendered: once, or in the positions of a turntable.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Looking {
    pub(crate) framing: Framing,
    /// The number of positions; 0 for a single image, which has no number.
    pub(crate) turns: u32,
}

impl Looking {
    /// The number of frames.
    pub(crate) fn frames(&self) -> u32 {
        self.turns.max(1)
    }

    /// Returns the scene of a frame. Its cameras and the studio are turned.
    pub(crate) fn scene(&self, scene: &Arc<Scene>, frame: u32) -> Arc<Scene> {
        if self.turns == 0 {
            return scene.clone();
        }
        let mut scene = (**scene).clone();
        scene.turn_around(STUDIO, &self.framing.turn(frame as f32 / self.turns as f32));
        Arc::new(scene)
    }

    /// Returns the name of an image of a frame: `spin.png` becomes `spin-001.png`. A name without a file, as a viewer
    /// has it, becomes `spin.glb 001`.
    pub(crate) fn name(&self, name: &str, is_file: bool, frame: u32) -> String {
        if self.turns == 0 {
            return name.to_owned();
        }
        let digits = self.turns.to_string().len().max(3);
        let number = frame + 1;
        let path = Path::new(name);
        match (path.extension(), is_file) {
            (_, false) => format!("{name} {number:0digits$}"),
            (Some(extension), true) => {
                let stem = path.with_extension("");
                format!("{}-{number:0digits$}.{}", stem.display(), extension.to_string_lossy())
            }
            (None, true) => format!("{name}-{number:0digits$}"),
        }
    }

    /// Returns the parameters of an image that the user names, in a format.
    pub(crate) fn params(format: &str) -> Params {
        match LINEAR.contains(&format) || format == "iv" {
            true => Params::new(),
            false => Params(vec![attr::GAMMA.param(GAMMA)]),
        }
    }
}

/// Receives the calls of a mesh file that is to be looked at.
pub(crate) struct MeshSink<'a> {
    pub(crate) state: &'a mut State,
    /// True when the cameras of the file are known already.
    pub(crate) is_second_reading: bool,
}

impl SceneSink for MeshSink<'_> {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        self.state.call(call, at)
    }

    fn in_world(&self) -> bool {
        self.is_second_reading || self.state.in_world()
    }

    fn new_frame(&mut self) -> bool {
        self.state.new_frame()
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        let found = self.state.attribute(declaration);
        if found.is_none() && declaration == "user:smooth" && !self.state.in_world() {
            return Param::declared("float user:smooth", SMOOTH_DEG).ok();
        }
        found
    }
}
