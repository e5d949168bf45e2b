//! What `Input` names (reference 2.9): scene files, programs, strings.

use crate::SessionOptions;
use granita_base::{Reporter, SearchPath};
use granita_pyg::{PygError, PygOptions, PygSource};
use granita_scene::{InputReader, SceneSink, Stop};
use std::path::PathBuf;

/// What the argument of `Input` turned out to be.
#[derive(Debug)]
pub(crate) enum Found {
    /// A scene file.
    File(PathBuf),
    /// A bundled scene file.
    Bundled(String, &'static [u8]),
    /// `pyg << text`.
    Text(String),
    /// `pyg < command`.
    Program(String),
    /// Another generator than "pyg".
    Generator(String),
    /// Nothing of the kind.
    Nothing,
}

/// The folders of an input path.
fn folders(options: &SessionOptions, path: &str) -> SearchPath {
    SearchPath::parse(path, &SearchPath::default(), &options.environment)
}

/// Names where is looked, for messages.
pub(crate) fn places(options: &SessionOptions, path: &str) -> String {
    let folders: Vec<String> =
        folders(options, path).folders().iter().map(|f| f.display().to_string()).collect();
    format!("{}, and the bundled inputs", folders.join(", "))
}

/// Whether `Input (command)` would find anything to try.
pub(crate) fn exists(command: &str, options: &SessionOptions, path: &str) -> bool {
    !matches!(find(command, options, path), Found::Nothing)
}

/// Finds what `command` names. A whole file name comes first, so that names may contain blanks.
pub(crate) fn find(command: &str, options: &SessionOptions, path: &str) -> Found {
    let command = command.trim();
    let search = folders(options, path);
    let file = |name: &str| {
        search.find(name).map(Found::File).or_else(|| {
            let bytes = granita_bundled::input(name)?;
            Some(Found::Bundled(name.to_owned(), bytes))
        })
    };
    if let Some(found) = file(command) {
        return found;
    }
    match command.split_once(char::is_whitespace) {
        Some(("pyg", rest)) => {
            let rest = rest.trim_start();
            if let Some(text) = rest.strip_prefix("<<") {
                Found::Text(text.trim_start().to_owned())
            } else if let Some(program) = rest.strip_prefix('<') {
                Found::Program(program.trim().to_owned())
            } else {
                file(rest.trim_end()).unwrap_or(Found::Nothing)
            }
        }
        Some((generator, _)) if !generator.contains(['.', '/']) => Found::Generator(generator.to_owned()),
        _ => Found::Nothing,
    }
}

/// How scene files are read.
pub(crate) fn pyg_options(options: &SessionOptions) -> PygOptions {
    let set = |name: &str| options.environment.get(name).is_some();
    PygOptions {
        always_pyglet: set("PYG_ALWAYS_PYGLET"),
        never_pyglet: set("PYG_NEVER_PYGLET"),
        chunking: match (set("PYG_ALWAYS_CHUNK"), set("PYG_NEVER_CHUNK")) {
            (true, _) => granita_pyg::Chunking::Always,
            (_, true) => granita_pyg::Chunking::Never,
            _ => granita_pyg::Chunking::Auto,
        },
        safe: options.safe,
        ..PygOptions::default()
    }
}

/// A reader of `source`; what keeps it from being read is reported.
pub(crate) fn reader(source: PygSource, options: &SessionOptions, reporter: Reporter) -> InputReader {
    let options = pyg_options(options);
    Box::new(move |sink: &mut dyn SceneSink| -> Result<(), Stop> {
        match granita_pyg::read(source, sink, &options, &reporter) {
            Ok(()) => Ok(()),
            Err(PygError::Stopped(stop)) => Err(stop),
            Err(error) => {
                reporter.error(error.to_string());
                Ok(())
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_of_input() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("two words.pyg"), "").unwrap();
        let path = folder.path().to_str().unwrap();
        let find = |command: &str| find(command, &SessionOptions::default(), path);
        assert!(matches!(find("two words.pyg"), Found::File(_)));
        assert!(matches!(find("pyg two words.pyg"), Found::File(_)));
        assert!(matches!(find("pyg << Sphere (1, -1, 1, 360)"), Found::Text(t) if t.starts_with("Sphere")));
        assert!(
            matches!(find("pyg < make_chair -width 40"), Found::Program(p) if p == "make_chair -width 40")
        );
        assert!(matches!(find("myproc 3.7 moo"), Found::Generator(g) if g == "myproc"));
        assert!(matches!(find("absent.pyg"), Found::Nothing));
        assert!(matches!(find(""), Found::Nothing));
    }
}
