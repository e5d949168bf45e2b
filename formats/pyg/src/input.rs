//! What the argument of `Input` (reference 2.9) or of a command line names.

use crate::{PygError, PygSource};
use granita_base::{Environment, SearchPath};
use std::io::{self, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

impl PygSource {
    /// Finds what `command` names: a scene file `"a.pyg"` or `"pyg a.pyg"` on `path`, standard input
    /// (`"pyg -"`), text (`"pyg << Sphere (1, -1, 1, 360)"`), or the output of a shell command
    /// (`"pyg < make_chair -width 40"`) that runs with `variables` added to the environment.
    ///
    /// Whoever reads scenes from strangers has to refuse the last of these: see [`runs_program`].
    pub fn find(command: &str, path: &SearchPath, variables: &Environment) -> Result<Self, PygError> {
        let (generator, rest) = split(command);
        if generator == "pyg" && !rest.is_empty() {
            if let Some(text) = rest.strip_prefix("<<") {
                return Ok(Self::Bytes {
                    name: "<pyg>".into(),
                    bytes: text.trim_start().as_bytes().to_vec(),
                });
            }
            if let Some(shell) = rest.strip_prefix('<') {
                return run(shell.trim(), variables);
            }
            if rest == "-" {
                return Ok(Self::Stream { name: "<stdin>".into(), stream: Box::new(io::stdin()) });
            }
            return match path.find(rest) {
                Some(found) => Ok(Self::Path(found)),
                None => Err(missing(rest, path)),
            };
        }
        // A file of that name, blanks and all, comes before a generator with arguments.
        let extension =
            |name: &str| Path::new(name).extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match (path.find(command), extension(command)) {
            (Some(found), Some(e)) if e == "pyg" => Ok(Self::Path(found)),
            (Some(_), Some(e)) => {
                Err(PygError::Unsupported(format!("no generator reads files of type \"{e}\": {command}")))
            }
            (Some(_), None) => {
                Err(PygError::Unsupported(format!("a scene file without an extension: {command}")))
            }
            (None, Some(e)) if e == "pyg" => Err(missing(command, path)),
            (None, _) => {
                Err(PygError::Unsupported(format!("there is no scene file and no generator \"{generator}\"")))
            }
        }
    }
}

/// Whether an `Input` of this name would run a program.
pub fn runs_program(command: &str) -> bool {
    let (_, rest) = split(command);
    rest.starts_with('<') && !rest.starts_with("<<")
}

fn split(command: &str) -> (&str, &str) {
    let command = command.trim();
    let end = command.find(char::is_whitespace).unwrap_or(command.len());
    (&command[..end], command[end..].trim_start())
}

fn missing(name: &str, path: &SearchPath) -> PygError {
    let folders: Vec<_> = path.folders().iter().map(|f| f.display().to_string()).collect();
    let source =
        io::Error::new(io::ErrorKind::NotFound, format!("not found on the path {}", folders.join(":")));
    PygError::Io { path: name.to_owned(), source }
}

/// The output of a shell command, while it runs.
struct Output {
    child: Child,
    out: ChildStdout,
    command: String,
}

fn run(shell: &str, variables: &Environment) -> Result<PygSource, PygError> {
    let failed = |source| PygError::Io { path: shell.to_owned(), source };
    let mut child = Command::new("sh")
        .arg("-c")
        .arg(shell)
        .envs(variables.iter())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    let out = child.stdout.take().ok_or_else(|| failed(io::Error::other("no pipe")))?;
    let stream = Box::new(Output { child, out, command: shell.to_owned() });
    Ok(PygSource::Stream { name: format!("<{shell}>").into(), stream })
}

impl Read for Output {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let n = self.out.read(buf)?;
        if n == 0 && !buf.is_empty() {
            let status = self.child.wait()?;
            if !status.success() {
                return Err(io::Error::other(format!("the command \"{}\" failed ({status})", self.command)));
            }
        }
        Ok(n)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // Nobody reads any more; it may have ended by itself, then both fail.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(command: &str) -> Result<PygSource, PygError> {
        let env = Environment::empty();
        let path = SearchPath::parse(".:src", &SearchPath::default(), &env);
        PygSource::find(command, &path, &env)
    }

    #[test]
    fn kinds_of_inputs() {
        assert!(
            matches!(find("pyg << World ()"), Ok(PygSource::Bytes { bytes, .. }) if bytes == b"World ()")
        );
        assert!(matches!(find("pyg -"), Ok(PygSource::Stream { .. })));
        assert!(matches!(find("no such file.pyg"), Err(PygError::Io { .. })));
        assert!(matches!(find("pyg nothing"), Err(PygError::Io { .. })));
        assert!(matches!(find("grass 0 0 1"), Err(PygError::Unsupported(_))));
        assert!(matches!(find("Cargo.toml"), Err(PygError::Unsupported(_))));
        assert!(matches!(find("pyg Cargo.toml"), Ok(PygSource::Path(_))));
        assert!(matches!(find(""), Err(PygError::Unsupported(_))));
        assert!(runs_program("pyg < ls") && !runs_program("pyg << ls") && !runs_program("a.pyg"));
    }

    #[test]
    fn output_of_a_program() {
        let Ok(PygSource::Stream { mut stream, .. }) = find("pyg < echo 'World ()'") else { panic!() };
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        assert_eq!(text, "World ()\n");
        let Ok(PygSource::Stream { mut stream, .. }) = find("pyg < exit 3") else { panic!() };
        assert!(stream.read_to_string(&mut text).is_err());
    }
}
