//! `-relight`: a desk for lighting, whose panel and image `iv` shows.

use crate::Options;
use crate::viewer::{self, Pages};
use granita_base::{Environment, Location, Reporter, Severity};
use granita_session::DeskOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A desk that is prepared, with what must live as long as it.
#[derive(Debug)]
pub(crate) struct Relight {
    pub(crate) options: DeskOptions,
    /// The viewer in browsers, unless the user has another one.
    pages: Option<Pages>,
    /// The file through which a browser finds the page.
    door: Option<PathBuf>,
}

impl Drop for Relight {
    fn drop(&mut self) {
        if let Some(door) = &self.door {
            // It may have been deleted by hand.
            let _ = std::fs::remove_file(door);
        }
    }
}

/// Prepares a desk for the scene of `options`. Its viewer is that of `-display`, the window of `-iv`, or a page.
///
/// # Errors
/// Returns a message when no viewer can be started.
pub(crate) fn begin(
    options: &Options,
    variables: &Environment,
    find: &dyn Fn() -> Result<String, String>,
    own: bool,
) -> Result<Relight, String> {
    let failed = |what: String| {
        format!(
            "-relight needs the viewer iv, and {what}; iv is part of every installation of the suite (cargo build -p iv)"
        )
    };
    let (address, pages) = if options.is_shown() {
        (find().map_err(failed)?, None)
    } else {
        let pages = viewer::pages(own).map_err(failed)?;
        (pages.address.clone(), Some(pages))
    };
    let last = options.files.last().map_or("scene", |file| file.trim());
    let name = Path::new(last).file_name().map_or("scene".into(), |name| name.to_string_lossy());
    let stem = Path::new(&*name).file_stem().map_or("scene".into(), |stem| stem.to_string_lossy());
    let is_plain = !stem.contains(char::is_whitespace) && !stem.starts_with(['-', '.']);
    let file = format!("{}.lights.pyg", if is_plain { &*stem } else { "scene" });
    let door = pages.as_ref().and_then(|pages| open(&pages.url, variables));
    let data = options.data.clone();
    Ok(Relight { options: DeskOptions { name: name.into_owned(), address, data, file }, pages, door })
}

impl Relight {
    /// Prints the address of the page.
    pub(crate) fn report(&self, reporter: &Reporter) {
        if let Some(pages) = &self.pages {
            let text = format!("gelato: the desk is at {}\n", pages.url);
            reporter.say(Severity::Message, &Location::default(), text);
        }
    }
}

/// Opens the page in the browser of the user, where there is a screen. Returns the file that leads to the page: other
/// users see the words of commands, and must not see the address.
fn open(url: &str, variables: &Environment) -> Option<PathBuf> {
    let has_screen =
        ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| variables.get(name).is_some_and(|v| !v.is_empty()));
    if !has_screen {
        return None;
    }
    let door = std::env::temp_dir().join(format!("gelato-desk-{}.html", std::process::id()));
    let mut new = std::fs::OpenOptions::new();
    new.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut new, 0o600);
    let text = format!(
        "<!DOCTYPE html><meta http-equiv=\"refresh\" content=\"0; url={url}\"><a href=\"{url}\">The desk</a>\n"
    );
    new.open(&door).and_then(|mut file| file.write_all(text.as_bytes())).ok()?;
    let mut command = Command::new("xdg-open");
    command.arg(&door).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    match command.spawn() {
        Ok(mut child) => _ = std::thread::spawn(move || child.wait()),
        // The address is printed as well.
        Err(_) => _ = std::fs::remove_file(&door),
    }
    Some(door)
}
