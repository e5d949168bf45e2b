//! Reads the scenes of images: their commands, and their frames without them.

use super::table::Image;
use std::path::Path;

/// The beginning of a call that runs a tool.
const SYSTEM: &str = "Command (\"system ";

/// What a scene makes before its frame.
pub(super) struct Recipe {
    /// The scene.
    pub(super) scene: String,
    /// The folder of its results.
    pub(super) out: String,
    /// The words of the command lines that it runs.
    pub(super) commands: Vec<Vec<String>>,
}

impl Recipe {
    /// Reads the commands of a scene. Each call must be one line.
    pub(super) fn read(root: &Path, scene: &str) -> Result<Self, String> {
        let text = read(root, scene)?;
        let commands = text
            .lines()
            .filter_map(|line| line.strip_prefix(SYSTEM)?.strip_suffix("\")"))
            .map(|line| line.split_whitespace().map(str::to_owned).collect::<Vec<String>>())
            .filter(|words| !words.is_empty())
            .collect();
        let folder = scene.rsplit_once('/').map_or("", |(folder, _)| folder);
        Ok(Self { scene: scene.to_owned(), out: format!("{folder}/out"), commands })
    }
}

/// Returns the settings and the frame of an image, as Pyg. The frame writes `file`.
pub(super) fn frame(root: &Path, image: &Image, file: &str) -> Result<(String, String), String> {
    let text = read(root, image.frame)?;
    let mut frame: String =
        text.lines().filter(|line| !line.starts_with("Command (")).map(|line| format!("{line}\n")).collect();
    for (from, to) in image.changes {
        if !frame.contains(from) {
            return Err(format!("{} no longer contains {from}", image.frame));
        }
        frame = frame.replace(from, to);
    }
    let format = match file.rsplit('.').next() {
        Some("jpg") => "\"jpeg\", \"rgb\", \"camera\", \"int quality\", 90",
        _ => "\"png\", \"rgb\", \"camera\"",
    };
    // Noise in the last bit would double the size of the file.
    let output = format!("Output (\"{}\", {format}, \"float gamma\", 2.2, \"float dither\", 0)\n", file);
    let settings = image.settings.iter().map(|call| format!("{call}\n")).collect::<String>() + &output;
    Ok((settings, frame))
}

fn read(root: &Path, name: &str) -> Result<String, String> {
    std::fs::read_to_string(root.join(name)).map_err(|e| format!("{name}: {e}"))
}
