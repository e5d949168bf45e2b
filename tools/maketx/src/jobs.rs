//! Assigns inputs to textures.

use granita_texture::make::{Mode, Neighbour};
use granita_texture::{Square, UdimName};
use std::collections::BTreeMap;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// The inputs and the output of one texture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) inputs: Vec<PathBuf>,
    pub(crate) output: PathBuf,
    /// The images of the set around the input.
    pub(crate) neighbours: Vec<Neighbour>,
}

impl Job {
    fn new(inputs: Vec<PathBuf>, output: PathBuf) -> Self {
        Self { inputs, output, neighbours: Vec::new() }
    }
}

/// True when `-o` means a folder, which is an existing folder or a name that ends with a separator.
pub(crate) fn is_folder(path: &Path) -> bool {
    let text = path.to_string_lossy();
    text.ends_with(['/', MAIN_SEPARATOR]) || path.is_dir()
}

/// An input file, and its place when it was named as a part of a set.
struct Input {
    path: PathBuf,
    square: Option<Square>,
    neighbours: Vec<Neighbour>,
}

/// Returns the images of a set around a square.
fn neighbours(set: &BTreeMap<Square, PathBuf>, square: Square) -> Vec<Neighbour> {
    let sides = (-1..=1).flat_map(|down: i8| (-1..=1).map(move |across: i8| (across, down)));
    sides
        .filter(|side| *side != (0, 0))
        .filter_map(|(across, down)| {
            // Rows are counted upward.
            let row = square.row.checked_add_signed(-i32::from(down))?;
            let column = square.column.checked_add_signed(across.into())?;
            let path = set.get(&Square { row, column })?.clone();
            Some(Neighbour { across, down, path })
        })
        .collect()
}

/// Returns the name of a set that is the name of no file.
pub(crate) fn set_of(path: &Path) -> Option<UdimName> {
    if path.is_file() { None } else { UdimName::parse(&path.to_string_lossy()) }
}

/// Returns the files of all inputs, with sets replaced by their files.
fn files(inputs: Vec<PathBuf>) -> Result<Vec<Input>, String> {
    let mut all = Vec::new();
    for path in inputs {
        let Some(set) = set_of(&path) else {
            all.push(Input { path, square: None, neighbours: Vec::new() });
            continue;
        };
        let files = set.files();
        if files.is_empty() {
            return Err(format!("{}: no file of this set exists", path.display()));
        }
        all.extend(files.iter().map(|(square, path)| Input {
            path: path.clone(),
            square: Some(*square),
            neighbours: neighbours(&files, *square),
        }));
    }
    Ok(all)
}

/// Returns the textures of a set, one for each input.
fn set_jobs(inputs: Vec<Input>, output: &Path, set: &UdimName) -> Result<Vec<Job>, String> {
    let mut jobs: Vec<Job> = Vec::new();
    for Input { path, square, neighbours } in inputs {
        let of = path.display();
        let Some(square) = square else {
            return Err(format!("{of}: -o {} names a set, and this input is not one", output.display()));
        };
        let name = set.of(square).ok_or_else(|| {
            let Square { row, column } = square;
            format!("{of}: -o {} has no number for column {column}, row {row}", output.display())
        })?;
        if let Some(other) = jobs.iter().find(|job| job.output == Path::new(&name)) {
            return Err(format!("{} and {of} would both become {name}", other.inputs[0].display()));
        }
        jobs.push(Job { neighbours, ..Job::new(vec![path], name.into()) });
    }
    Ok(jobs)
}

/// Returns the textures to make. An input `wall.<UDIM>.exr` stands for all files of that set ([`UdimName`]). With the
/// name of a file, all inputs make one texture, as many as the mode needs.
/// Without a name, or with that of a folder, each input makes a texture with its own name and the extension `tx`,
/// beside the input or in the folder.
///
/// # Errors
/// Returns an error when a mode needs several inputs for one texture, when an output that is not named would replace
/// its input, when two outputs would have one name, or when only one of input and output is a set.
pub(crate) fn jobs(inputs: Vec<PathBuf>, output: Option<&Path>, mode: Mode) -> Result<Vec<Job>, String> {
    let inputs = files(inputs)?;
    let is_set = inputs.iter().any(|input| input.square.is_some());
    if is_set && !mode.takes_one() {
        return Err("six inputs make one texture: a set cannot be used here".to_owned());
    }
    let folder = match output {
        Some(path) if !is_folder(path) => {
            if let Some(set) = UdimName::parse(&path.to_string_lossy()) {
                return set_jobs(inputs, path, &set);
            }
            if is_set {
                return Err(format!(
                    "-o {}: a set makes a texture for each of its images, so that the name needs <UDIM>",
                    path.display()
                ));
            }
            let inputs = inputs.into_iter().map(|input| input.path).collect();
            return Ok(vec![Job::new(inputs, path.to_owned())]);
        }
        folder => folder,
    };
    if !mode.takes_one() {
        return Err("six inputs make one texture: -o names its file".to_owned());
    }
    let mut jobs: Vec<Job> = Vec::new();
    for Input { path: input, neighbours, .. } in inputs {
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
        jobs.push(Job { neighbours, ..Job::new(vec![input], output) });
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
    fn sets_make_a_texture_for_each_image() {
        let folder = tempfile::tempdir().unwrap();
        let here = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
        for name in ["w.1001.png", "w.1012.png", "v.u11_v1.png", "one.png"] {
            std::fs::write(here(name), "").unwrap();
        }
        let of = |inputs: &[&str], output: Option<&str>, mode: Mode| {
            let (inputs, output): (Vec<String>, _) =
                (inputs.iter().map(|name| here(name)).collect(), output.map(here));
            let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
            let jobs = of(&inputs, output.as_deref(), mode);
            jobs.map(|jobs| jobs.join(", ").replace(&here(""), ""))
        };
        let both = "x.1001.tx <- 1, x.1012.tx <- 1";
        assert_eq!(of(&["w.<UDIM>.png"], Some("x.<UDIM>.tx"), Mode::Plain).unwrap(), both);
        // 1012 lies above and to the right of 1001.
        let set = super::jobs(vec![here("w.<UDIM>.png").into()], None, Mode::Plain).unwrap();
        let sides: Vec<_> =
            set.iter().flat_map(|job| job.neighbours.iter().map(|n| (n.across, n.down))).collect();
        assert_eq!(sides, [(1, -1), (-1, 1)]);
        assert_eq!(
            of(&["w.<UDIM>.png"], None, Mode::Plain).unwrap(),
            both.replace('x', "w").replace("tw", "tx")
        );
        assert_eq!(
            of(&["w.<UDIM>.png"], Some("x_<UVTILE>.tx"), Mode::Plain).unwrap(),
            "x_u1_v1.tx <- 1, x_u2_v2.tx <- 1"
        );
        for (inputs, output, mode, expected) in [
            (&["w.<UDIM>.png"][..], Some("x.tx"), Mode::Plain, "the name needs <UDIM>"),
            (&["u.<UDIM>.png"], Some("x.<UDIM>.tx"), Mode::Plain, "no file of this set"),
            (&["one.png"], Some("x.<UDIM>.tx"), Mode::Plain, "this input is not one"),
            (&["v.<UVTILE>.png"], Some("x.<UDIM>.tx"), Mode::Plain, "no number for column 10, row 0"),
            (&["w.<UDIM>.png", "w.<UDIM>.png"], Some("x.<UDIM>.tx"), Mode::Plain, "both become"),
            (&["w.<UDIM>.png"], Some("x.<UDIM>.tx"), Mode::ShadCube, "a set cannot be used"),
        ] {
            let what = of(inputs, output, mode).unwrap_err();
            assert!(what.contains(expected), "{what}");
        }
    }

    #[test]
    fn conflicting_outputs_are_refused() {
        assert!(of(&["a"; 6], None, Mode::ShadCube).unwrap_err().contains("-o"));
        assert!(of(&["a.png", "a.tif"], None, Mode::Plain).unwrap_err().contains("both become a.tx"));
        assert!(of(&["a.tx"], None, Mode::Plain).unwrap_err().contains("own input"));
        assert!(of(&["a.tx"], Some("a.tx"), Mode::Plain).is_ok(), "who says so means it");
    }
}
