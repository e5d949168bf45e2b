//! Patches: Pyg files that change the lights of a scene that was read before.
//!
//! A patch begins with a line that marks it. A session that is going to read a patch renders the scene before it in
//! re-rendering mode, and leaves out the last `Render` of that scene, because the patch has its own.

use super::calls::calls;
use super::rig::Rig;
use crate::SessionError;
use granita_base::{Files, Location};
use granita_pyg::Writer;
use granita_scene::{Call, Scene, SceneSink, Values};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;

/// The first line of a patch, without the end of the line.
const MARK: &str = "# Patch of the lights of a scene";

/// True when a file is a patch.
pub(crate) fn is_patch(files: &Files, path: &Path) -> bool {
    let mut begin = [0; MARK.len()];
    path.is_file()
        && files.open(path).is_ok_and(|mut file| file.read_exact(&mut begin).is_ok())
        && begin == *MARK.as_bytes()
}

/// Returns the text of the patch that turns the lights `base` into `rig`. `scenes` are the names of the scene files.
///
/// # Errors
/// Returns [`SessionError::Failed`] when a call cannot be written.
pub(crate) fn text(
    base: &Rig,
    rig: &Rig,
    world: &Values,
    scenes: &[String],
) -> Result<Vec<u8>, SessionError> {
    let scenes: Vec<String> = scenes.iter().map(|name| name.replace(char::is_control, "?")).collect();
    let mut out = format!("{MARK}\n# gelato {} THIS\n", scenes.join(" ")).into_bytes();
    let mut writer = Writer::new(Vec::new());
    let all = calls(base, rig, world).into_iter().chain([Call::Render { camera: None }]);
    for call in all {
        writer.call(call, &Location::default()).map_err(crate::session::stopped)?;
    }
    out.extend(writer.into_inner().map_err(|error| SessionError::Failed(error.to_string()))?);
    Ok(out)
}

/// Writes a patch. It replaces only an earlier patch.
///
/// # Errors
/// Returns a message when the file cannot be written.
pub(crate) fn write(files: &Files, path: &Path, text: &[u8]) -> Result<(), String> {
    if path.exists() && !is_patch(files, path) {
        return Err(format!("{} is another file, which is not replaced", path.display()));
    }
    let mut file = files.create(path).map_err(|error| error.to_string())?;
    file.write_all(text).map_err(|error| format!("{}: {error}", path.display()))?;
    file.commit().map_err(|error| error.to_string())
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
