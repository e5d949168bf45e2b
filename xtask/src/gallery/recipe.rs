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
    /// The files that a page contains, with their texts.
    pub(super) files: Vec<(String, String)>,
}

impl Recipe {
    /// Reads the commands of a scene. Each call must be one line.
    pub(super) fn read(root: &Path, scene: &str) -> Result<Self, String> {
        let text = read(root, scene)?;
        let is_page = scene.ends_with(".md");
        let blocks = if is_page { blocks(&text) } else { Vec::new() };
        let lines: Vec<&str> = match is_page {
            true => {
                blocks.iter().filter(|(kind, _)| *kind == "sh").flat_map(|(_, text)| text.lines()).collect()
            }
            false => text.lines().filter_map(|line| line.strip_prefix(SYSTEM)?.strip_suffix("\")")).collect(),
        };
        let commands = lines
            .into_iter()
            .map(|line| line.split_whitespace().map(str::to_owned).collect::<Vec<String>>())
            .filter(|words| !words.is_empty())
            .collect();
        let folder = scene.rsplit_once('/').map_or("", |(folder, _)| folder);
        let file = |(_, text): &(&str, String)| Some((file_name(text)?.to_owned(), text.clone()));
        let files = blocks.iter().filter(|(kind, _)| kind.ends_with(",file")).filter_map(file).collect();
        Ok(Self { scene: scene.to_owned(), out: format!("{folder}/out"), commands, files })
    }
}

/// Returns the settings and the frame of an image, as Pyg. The frame writes `file`.
pub(super) fn frame(root: &Path, image: &Image, file: &str) -> Result<(String, String), String> {
    let text = match image.frame.split_once('#') {
        Some((page, file)) => {
            let found = Recipe::read(root, page)?.files.into_iter().find(|(name, _)| name == file);
            found.ok_or_else(|| format!("{page} has no file {file}"))?.1
        }
        None => read(root, image.frame)?,
    };
    let mut frame: String =
        text.lines().filter(|line| !line.starts_with("Command (")).map(|line| format!("{line}\n")).collect();
    for (from, to) in image.changes {
        if !frame.contains(from) {
            return Err(format!("{} no longer contains {from}", image.frame));
        }
        frame = frame.replace(from, to);
    }
    let (format, quality) = match file.ends_with(".jpg") {
        true => ("jpeg", ", \"int quality\", 90"),
        false => ("png", ""),
    };
    let output = format!("Output (\"{file}\", \"{format}\", {}{quality})\n", image.data);
    let settings = image.settings.iter().map(|call| format!("{call}\n")).collect::<String>() + &output;
    Ok((settings, frame))
}

/// Returns the blocks of code of a page, with the words after their fences.
fn blocks(page: &str) -> Vec<(&str, String)> {
    let (mut found, mut open) = (Vec::new(), None::<(&str, String)>);
    for line in page.lines() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(_), Some(_)) => found.extend(open.take()),
            (Some(kind), None) => open = Some((kind, String::new())),
            (None, Some((_, text))) => {
                text.push_str(line);
                text.push('\n');
            }
            (None, None) => (),
        }
    }
    found
}

/// Returns the name of a file in its first line, a comment.
fn file_name(text: &str) -> Option<&str> {
    text.lines().next()?.trim_start_matches(['#', '/']).split_whitespace().next()
}

fn read(root: &Path, name: &str) -> Result<String, String> {
    std::fs::read_to_string(root.join(name)).map_err(|e| format!("{name}: {e}"))
}
