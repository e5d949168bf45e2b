//! Reads the data of `cargo metadata` and git about the workspace.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A dependency of a crate.
pub(crate) struct Dependency {
    /// The name of the package.
    pub(crate) name: String,
    /// The name of the package in code.
    pub(crate) name_in_code: String,
    pub(crate) purpose: Purpose,
}

/// The purpose of a dependency.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// A dependency of the code that is built for users.
    Code,
    /// A dependency of tests, benches and examples only.
    Tests,
    /// A dependency of the build script.
    Build,
}

/// A crate of the workspace.
pub(crate) struct Crate {
    /// The name of the package.
    pub(crate) name: String,
    /// The folder, relative to the root, such as `libs/base`.
    pub(crate) folder: PathBuf,
    /// The dependencies that its manifest names.
    pub(crate) dependencies: Vec<Dependency>,
    /// The root files of its library, programs, tests, examples and benches, relative to the root of the workspace,
    /// sorted.
    pub(crate) roots: Vec<PathBuf>,
}

/// The workspace.
pub(crate) struct Workspace {
    /// The root folder.
    pub(crate) root: PathBuf,
    /// The crates, sorted by folder.
    pub(crate) crates: Vec<Crate>,
}

impl Workspace {
    /// Reads the workspace from `cargo metadata`.
    pub(crate) fn load() -> Result<Self, String> {
        let answer = Command::new(cargo())
            .args(["metadata", "--format-version=1", "--no-deps"])
            .output()
            .map_err(|e| format!("cargo metadata: {e}"))?;
        if !answer.status.success() {
            return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&answer.stderr)));
        }
        let metadata: Value =
            serde_json::from_slice(&answer.stdout).map_err(|e| format!("cargo metadata: {e}"))?;
        let root = PathBuf::from(text(&metadata["workspace_root"]));
        let mut crates: Vec<Crate> = list(&metadata["packages"])
            .iter()
            .map(|package| {
                let manifest = PathBuf::from(text(&package["manifest_path"]));
                let folder = manifest.parent().unwrap_or(&root);
                let mut roots: Vec<PathBuf> = list(&package["targets"])
                    .iter()
                    .map(|target| PathBuf::from(text(&target["src_path"])))
                    .map(|path| path.strip_prefix(&root).map(Path::to_owned).unwrap_or(path))
                    .collect();
                roots.sort();
                Crate {
                    name: text(&package["name"]).to_owned(),
                    folder: folder.strip_prefix(&root).unwrap_or(folder).to_owned(),
                    dependencies: list(&package["dependencies"])
                        .iter()
                        .map(|d| Dependency {
                            name: text(&d["name"]).to_owned(),
                            name_in_code: d["rename"].as_str().unwrap_or(text(&d["name"])).replace('-', "_"),
                            purpose: match text(&d["kind"]) {
                                "dev" => Purpose::Tests,
                                "build" => Purpose::Build,
                                _ => Purpose::Code,
                            },
                        })
                        .collect(),
                    roots,
                }
            })
            .collect();
        crates.sort_by(|a, b| a.folder.cmp(&b.folder));
        Ok(Self { root, crates })
    }

    /// Returns every file that git tracks or would track, relative to the root, sorted.
    pub(crate) fn files(&self) -> Result<Vec<PathBuf>, String> {
        let answer = Command::new("git")
            .current_dir(&self.root)
            .args(["ls-files", "--cached", "--others", "--exclude-standard", "-z"])
            .output()
            .map_err(|e| format!("git ls-files: {e}"))?;
        if !answer.status.success() {
            return Err(format!("git ls-files: {}", String::from_utf8_lossy(&answer.stderr)));
        }
        let mut files: Vec<PathBuf> = answer
            .stdout
            .split(|b| *b == 0)
            .filter(|name| !name.is_empty())
            .map(|name| PathBuf::from(String::from_utf8_lossy(name).into_owned()))
            .filter(|name| self.root.join(name).is_file())
            .collect();
        files.sort();
        files.dedup();
        Ok(files)
    }

    /// Returns the text of a file; `None` when it is not text.
    pub(crate) fn text(&self, file: &Path) -> Option<String> {
        String::from_utf8(std::fs::read(self.root.join(file)).ok()?).ok()
    }
}

/// Returns the path of the cargo that runs this task.
pub(crate) fn cargo() -> String {
    std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned())
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}
