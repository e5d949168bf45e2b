//! Builds the tools, and runs them.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The variable that `cargo xtask ci` sets where the tests of the whole workspace run. The tools are then built as a
/// part of it, which takes seconds. Alone they need other features of their dependencies, which takes minutes.
const WHOLE: &str = "GRANITA_WHOLE_WORKSPACE";

/// The tools of this build.
#[derive(Clone, Debug)]
pub struct Tools {
    folder: PathBuf,
}

/// The result of a run.
#[derive(Clone, Debug)]
pub struct Ran {
    /// The exit status; -1 when a signal ended the run.
    pub status: i32,
    /// The standard output.
    pub stdout: String,
    /// The standard error.
    pub stderr: String,
}

impl Tools {
    /// The names of the tools that a case may run.
    pub const NAMES: [&'static str; 6] = ["gelato", "maketx", "imgtool", "gslc", "gsoinfo", "topyg"];

    /// Builds the tools in the profile of the running test and finds them.
    ///
    /// # Errors
    /// Returns the output of cargo when it cannot build them.
    pub fn build() -> Result<Self, String> {
        Self::build_all(&[], &[])
    }

    /// Builds the tools like [`Tools::build`], and also these programs.
    ///
    /// # Errors
    /// Returns the errors of [`Tools::build`].
    pub fn build_with(programs: &[&str]) -> Result<Self, String> {
        Self::build_all(programs, &[])
    }

    /// Builds the tools like [`Tools::build`], and also the libraries of these packages.
    ///
    /// # Errors
    /// Returns the errors of [`Tools::build`].
    pub fn build_also(libraries: &[&str]) -> Result<Self, String> {
        Self::build_all(&[], libraries)
    }

    fn build_all(programs: &[&str], libraries: &[&str]) -> Result<Self, String> {
        let test = std::env::current_exe().map_err(|e| e.to_string())?;
        // The path of the test is target/PROFILE/deps/suite-0123456789abcdef.
        let folder = test.parent().and_then(Path::parent).ok_or("a test outside a target folder")?.to_owned();
        let target = folder.parent().ok_or("a test outside a target folder")?;
        let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
        let mut command = Command::new(cargo);
        command.current_dir(repository()).args(["build", "--quiet", "--bins", "--target-dir"]).arg(target);
        // Where valgrind tests the libraries for C++, they are built alone, which takes minutes. The workspace has the
        // feature `union` of `smallvec`, which the texts of `exr` are made of. valgrind takes its unused bytes for an
        // error.
        let alone = !libraries.is_empty() && has_program("valgrind");
        if !alone && std::env::var_os(WHOLE).is_some() {
            // The features of dependencies are then those that the tests were built with.
            command.args(["--workspace", "--lib", "--tests"]);
        } else {
            if !libraries.is_empty() {
                command.arg("--lib");
            }
            for name in libraries.iter().chain(programs).chain(&Self::NAMES) {
                command.args(["--package", name]);
            }
        }
        if folder.ends_with("release") {
            command.arg("--release");
        }
        let built = command.output().map_err(|e| format!("cargo build: {e}"))?;
        if built.status.success() {
            Ok(Self { folder })
        } else {
            Err(format!("cargo build: {}", String::from_utf8_lossy(&built.stderr)))
        }
    }

    /// Returns the folder of programs and shared libraries.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the path of the program called `name`.
    pub fn program(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX))
    }

    /// Runs a tool in `folder`, without the variable `GELATOHOME`.
    ///
    /// # Errors
    /// Returns an error when it cannot be started.
    pub fn run(&self, folder: &Path, name: &str, arguments: &[&str]) -> Result<Ran, String> {
        let program = self.program(name);
        let mut command = Command::new(&program);
        command.current_dir(folder).args(arguments).env_remove("GELATOHOME");
        let ran = command.output().map_err(|e| format!("{}: {e}", program.display()))?;
        Ok(Ran {
            status: ran.status.code().unwrap_or(-1),
            stdout: String::from_utf8_lossy(&ran.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&ran.stderr).into_owned(),
        })
    }
}

/// Returns the root of the checkout.
pub fn repository() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_owned()
}

/// True when a program of this name can be run.
pub fn has_program(name: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
}
