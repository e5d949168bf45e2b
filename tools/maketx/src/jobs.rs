//! Assigns inputs to textures.

use granita_texture::make::Mode;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// The inputs and the output of one texture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) inputs: Vec<PathBuf>,
    pub(crate) output: PathBuf,
}

/// True when `-o` means a folder, which is an existing folder or a name that ends with a separator.
pub(crate) fn is_folder(path: &Path) -> bool {
    let text = path.to_string_lossy();
    text.ends_with(['/', MAIN_SEPARATOR]) || path.is_dir()
}

/// Returns the textures to make. With the name of a file, all inputs make one texture, as many as the mode needs.
/// Without a name, or with that of a folder, each input makes a texture with its own name and the extension `tx`,
/// beside the input or in the folder.
///
/// # Errors
/// Returns an error when a mode needs several inputs for one texture, when an output that is not named would replace
/// its input, or when two outputs would have one name.
pub(crate) fn jobs(inputs: Vec<PathBuf>, output: Option<&Path>, mode: Mode) -> Result<Vec<Job>, String> {
    let folder = match output {
        Some(path) if !is_folder(path) => {
            return Ok(vec![Job { inputs, output: path.to_owned() }]);
        }
        folder => folder,
    };
    if !mode.takes_one() {
        return Err("six inputs make one texture: -o names its file".to_owned());
    }
    let mut jobs: Vec<Job> = Vec::new();
    for input in inputs {
        let Some(name) = input.file_name() else {
            return Err(format!("{}: not a file", input.display()));
        };
        let beside = input.parent().unwrap_or(Path::new(""));
        let output = folder.unwrap_or(beside).join(name).with_extension("tx");
        if output == input {
            return Err(format!("{}: the texture would replace its own input", input.display()));
        }
        if let Some(other) = jobs.iter().find(|job| job.output == output) {
            let (a, b) = (other.inputs[0].display(), input.display());
            return Err(format!("{a} and {b} would both become {}", output.display()));
        }
        jobs.push(Job { inputs: vec![input], output });
    }
    Ok(jobs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(inputs: &[&str], output: Option<&str>, mode: Mode) -> Result<Vec<String>, String> {
        let jobs = jobs(inputs.iter().map(PathBuf::from).collect(), output.map(Path::new), mode)?;
        let text = |job: Job| format!("{} <- {}", job.output.display(), job.inputs.len());
        Ok(jobs.into_iter().map(text).collect())
    }

    #[test]
    fn output_names_follow_inputs_and_folders() {
        assert_eq!(of(&["a.png"], Some("b.tx"), Mode::Plain).unwrap(), ["b.tx <- 1"]);
        assert_eq!(of(&["x/a.b.png", "c"], None, Mode::Plain).unwrap(), ["x/a.b.tx <- 1", "c.tx <- 1"]);
        assert_eq!(
            of(&["x/a.png", "c.exr"], Some("y/"), Mode::EnvLatLong).unwrap(),
            ["y/a.tx <- 1", "y/c.tx <- 1"]
        );
        assert_eq!(of(&["a"; 6], Some("b"), Mode::EnvCube).unwrap(), ["b <- 6"]);
        assert_eq!(of(&["a", "b"], Some("c"), Mode::Plain).unwrap(), ["c <- 2"], "the library complains");
    }

    #[test]
    fn conflicting_outputs_are_refused() {
        assert!(of(&["a"; 6], None, Mode::ShadCube).unwrap_err().contains("-o"));
        assert!(of(&["a.png", "a.tif"], None, Mode::Plain).unwrap_err().contains("both become a.tx"));
        assert!(of(&["a.tx"], None, Mode::Plain).unwrap_err().contains("own input"));
        assert!(of(&["a.tx"], Some("a.tx"), Mode::Plain).is_ok(), "who says so means it");
    }
}
