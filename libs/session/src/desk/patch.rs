//! The writing of patches, which change the lights of a scene that was read before.

use super::calls::calls;
use super::rig::Rig;
use crate::SessionError;
use crate::patches::{MARK, is_patch};
use granita_base::{Files, Location};
use granita_pyg::Writer;
use granita_scene::{Call, SceneSink, Values};
use std::io::Write;
use std::path::Path;

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
        writer.call(call, &Location::default()).map_err(|stop| SessionError::Failed(stop.to_string()))?;
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
