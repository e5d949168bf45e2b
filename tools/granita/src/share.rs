//! The files of the folder `share` of an installation: man pages and completions.

use crate::{TOOLS, completions, pages};
use clap::Command;
use clap_complete::Shell;
use granita_base::AtomicFile;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folders of completions, and the name of the file of a command.
const SHELLS: [(Shell, &str, &str, &str); 3] = [
    (Shell::Bash, "bash-completion/completions", "", ""),
    (Shell::Zsh, "zsh/site-functions", "_", ""),
    (Shell::Fish, "fish/vendor_completions.d", "", ".fish"),
];

/// Returns all files with their paths relative to the folder. `own` is the command `granita`. The page of a tool is
/// `granita-TOOL`, and the page with its plain name shows that one, so that a package can leave out plain names.
fn files(own: &Command) -> std::io::Result<Vec<(PathBuf, String)>> {
    let man = |page: &str| PathBuf::from(format!("man/man1/{page}.1"));
    let mut files = vec![(man("granita"), pages::page(own)?)];
    for tool in &TOOLS {
        let page = format!("granita-{}", tool.name);
        files.push((man(&page), pages::page(&(tool.options)())?));
        files.push((man(tool.name), pages::alias(&page)));
    }
    let commands = TOOLS.iter().map(|tool| (tool.options)()).chain([own.clone()]);
    for command in commands {
        for (shell, folder, before, after) in SHELLS {
            let name = format!("{before}{}{after}", command.get_name());
            files.push((Path::new(folder).join(name), completions::script(shell, &command)));
        }
    }
    Ok(files)
}

/// Writes all files below a folder. Each appears complete or not at all.
///
/// # Errors
/// Returns a message that names the file or folder.
pub(crate) fn write(folder: &Path, own: &Command) -> Result<(), String> {
    let failed = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    for (name, text) in files(own).map_err(|error| failed(folder, error))? {
        let path = folder.join(name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(|error| failed(parent, error))?;
        }
        let mut file = AtomicFile::create(&path).map_err(|error| error.to_string())?;
        file.write_all(text.as_bytes()).map_err(|error| failed(&path, error))?;
        file.commit().map_err(|error| error.to_string())?;
    }
    Ok(())
}
