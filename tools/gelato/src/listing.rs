//! The files that scenes need (`-assets`), and frames that need not be rendered (`-u`).

use granita_base::{Files, Reporter};
use granita_cli::Status;
use granita_session::{Assets, Session, SessionError, SessionOptions, SharedProgress, is_up_to_date};
use serde_json::{Value, json};
use sha1::{Digest, Sha1};
use std::io::{Read, Write};
use std::path::Path;

/// Reads scene files, and returns what they need. No command is run and nothing is written. With `all_inputs` the list
/// contains inputs that the frames do not need.
///
/// # Errors
/// Returns the error of a file that cannot be read.
pub(crate) fn assets(
    options: SessionOptions,
    files: &[String],
    all_inputs: bool,
    reporter: &Reporter,
) -> Result<Assets, SessionError> {
    let mut session = Session::new(options, reporter.clone(), SharedProgress::default());
    let list = session.list_assets(all_inputs);
    session.expect_files(files)?;
    for file in files {
        match session.read_file(file) {
            Ok(()) => (),
            Err(SessionError::Exit) => break,
            Err(error) => return Err(error),
        }
    }
    session.finish();
    Ok(std::mem::take(&mut list.lock()))
}

/// Prints the files that scene files need.
pub(crate) fn print(options: SessionOptions, files: &[String], reporter: &Reporter) -> Status {
    let folder = options.current_folder.clone();
    let opener = options.run.environment.files().clone();
    match assets(options, files, true, reporter) {
        Ok(assets) => {
            let text = format!("{:#}\n", document(&assets, &folder, &opener));
            // A reader that is gone needs no list.
            let _ = std::io::stdout().write_all(text.as_bytes());
            if reporter.errors() > 0 { Status::WithErrors } else { Status::Done }
        }
        Err(error) => {
            reporter.error(error.to_string());
            Status::Failed
        }
    }
}

/// True when the images of scene files are newer than all that these need. Errors count as false: the frame that is
/// rendered then reports them.
pub(crate) fn needs_nothing(options: SessionOptions, files: &[String]) -> bool {
    let opener = options.run.environment.files().clone();
    assets(options, files, false, &Reporter::silent()).is_ok_and(|assets| is_up_to_date(&assets, &opener))
}

/// Returns the list as JSON. Files that cannot be read have no hash.
fn document(assets: &Assets, folder: &Path, opener: &Files) -> Value {
    let absolute = |path: &Path| folder.join(opener.place(path)).to_string_lossy().into_owned();
    let files: Vec<Value> = assets
        .read
        .iter()
        .map(|(path, kind)| {
            let size = std::fs::metadata(opener.place(path)).map(|data| data.len()).ok();
            let hash = sha1(&opener.place(path)).ok();
            json!({
                "name": path.to_string_lossy(),
                "path": absolute(path),
                "kind": kind.name(),
                "bytes": size,
                "sha1": hash,
            })
        })
        .collect();
    let outputs: Vec<Value> = assets
        .written
        .iter()
        .map(|path| json!({"name": path.to_string_lossy(), "path": absolute(path)}))
        .collect();
    json!({"files": files, "outputs": outputs, "commands": assets.commands, "missing": assets.missing})
}

/// Returns the SHA-1 hash of a file, in hexadecimal digits.
fn sha1(path: &Path) -> std::io::Result<String> {
    let mut file = std::fs::File::open(path)?;
    let mut hash = Sha1::new();
    let mut room = vec![0; 1 << 16];
    loop {
        match file.read(&mut room)? {
            0 => break,
            n => hash.update(&room[..n]),
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
