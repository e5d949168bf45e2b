//! Patches: Pyg files that change the lights of a scene that was read before.
//!
//! A patch begins with a line that marks it. A session that is going to read a patch reads the scene before it in
//! re-rendering mode, and leaves out the last `Render` of that scene, because the patch has its own.

use granita_base::Files;
use granita_scene::Scene;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

/// The first line of a patch, without the end of the line.
pub(crate) const MARK: &str = "# Patch of the lights of a scene";

/// True when a file is a patch.
pub(crate) fn is_patch(files: &Files, path: &Path) -> bool {
    let mut begin = [0; MARK.len()];
    path.is_file()
        && files.open(path).is_ok_and(|mut file| file.read_exact(&mut begin).is_ok())
        && begin == *MARK.as_bytes()
}

/// The frames of a scene that a patch follows: the last one is left out.
#[derive(Debug, Default)]
pub(crate) struct Deferral {
    /// The number of patches that follow. While it is not 0, a frame is not rendered before the following frame or
    /// command.
    pub(crate) patches: usize,
    /// The deferred frame and the camera of its `Render`.
    frame: Option<(Arc<Scene>, Option<String>)>,
}

impl Deferral {
    /// Takes a frame. Returns the frames that must be rendered now.
    pub(crate) fn take(
        &mut self,
        scene: Arc<Scene>,
        camera: Option<&str>,
    ) -> Option<(Arc<Scene>, Option<String>)> {
        let frame = (scene, camera.map(str::to_owned));
        if self.patches > 0 { self.frame.replace(frame) } else { Some(frame) }
    }

    /// Returns the deferred frame, which must be rendered before anything else happens.
    pub(crate) fn release(&mut self) -> Option<(Arc<Scene>, Option<String>)> {
        self.frame.take()
    }

    /// Begins a patch, which replaces the deferred frame.
    pub(crate) fn begin_patch(&mut self) {
        self.patches = self.patches.saturating_sub(1);
        self.frame = None;
    }
}
