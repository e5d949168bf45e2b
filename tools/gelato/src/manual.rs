//! The manual of an installation, which `-manual` opens.

use granita_base::Reporter;
use granita_cli::{Status, environment, print};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The first page of the manual as HTML, in the folder of documents of an installation.
const BOOK: &str = "doc/book/index.html";
/// The list of the pages of the manual as text, in the same place.
const TEXT: &str = "doc/SUMMARY.md";

/// The manual of this program.
#[derive(Debug, PartialEq, Eq)]
enum Manual {
    Book(PathBuf),
    Text(PathBuf),
}

/// Prints where the manual is, and opens it in a browser where there is a screen.
pub(crate) fn show(reporter: &Reporter) -> Status {
    let variables = environment();
    let program = std::env::current_exe().and_then(std::fs::canonicalize).unwrap_or_default();
    match find(&program, variables.get("GELATOHOME").map(Path::new)) {
        Some(Manual::Book(page)) => {
            print(&format!("{}\n", page.display()));
            let is_set = |name: &str| variables.get(name).is_some_and(|value| !value.is_empty());
            let has_screen = !cfg!(target_os = "linux") || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY");
            if has_screen && let Err(error) = open(&page) {
                reporter.warning(format!("-manual: no browser was started: {error}"));
            }
            Status::Done
        }
        Some(Manual::Text(list)) => {
            print(&format!("{}\n", list.display()));
            reporter.info("the manual is here as text; mdbook makes a book of it");
            Status::Done
        }
        None => {
            reporter.error(
                "-manual: this program is not in an installation with a manual, and $GELATOHOME names none; in a \
                 checkout `cargo xtask book` writes it to target/book",
            );
            Status::Failed
        }
    }
}

/// Returns the manual of the installation of a program, of `home`, or of the checkout in whose folder of results the
/// program is, in this order.
fn find(program: &Path, home: Option<&Path>) -> Option<Manual> {
    let folder = program.parent()?;
    let own = folder.parent().filter(|_| folder.ends_with("bin"));
    let home = home.filter(|home| !home.as_os_str().is_empty());
    for home in own.into_iter().chain(home) {
        let (book, text) = (home.join(BOOK), home.join(TEXT));
        if book.is_file() {
            return Some(Manual::Book(book));
        }
        if text.is_file() {
            return Some(Manual::Text(text));
        }
    }
    let built = folder.parent()?.join("book/index.html");
    built.is_file().then_some(Manual::Book(built))
}

/// Opens a page in the browser of the user, which stays open.
fn open(page: &Path) -> std::io::Result<()> {
    let mut command = if cfg!(target_os = "macos") {
        Command::new("open")
    } else if cfg!(windows) {
        Command::new("explorer")
    } else {
        Command::new("xdg-open")
    };
    command.arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manual_of_the_program_comes_first() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        let write = |name: &str| {
            std::fs::create_dir_all(place(name).parent().unwrap()).unwrap();
            std::fs::write(place(name), "").unwrap();
        };
        let home = place("home");
        let [installed, built] = [place("own/bin/gelato"), place("target/release/gelato")];
        assert_eq!(find(&installed, Some(&home)), None);
        write("target/book/index.html");
        assert_eq!(find(&built, Some(&home)), Some(Manual::Book(place("target/book/index.html"))));
        write("home/doc/SUMMARY.md");
        assert_eq!(find(&built, Some(&home)), Some(Manual::Text(place("home/doc/SUMMARY.md"))));
        write("home/doc/book/index.html");
        assert_eq!(find(&installed, Some(&home)), Some(Manual::Book(place("home/doc/book/index.html"))));
        assert_eq!(find(&built, None), Some(Manual::Book(place("target/book/index.html"))));
        write("own/doc/book/index.html");
        assert_eq!(find(&installed, Some(&home)), Some(Manual::Book(place("own/doc/book/index.html"))));
    }
}
