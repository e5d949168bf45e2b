//! The manual as a book: its pages as HTML, and the checks of its links, of its examples and against the tables.

mod html;

use crate::workspace::Workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// The list of the pages.
const SUMMARY: &str = "SUMMARY.md";

/// The arguments of `book`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The folder; target/book without it.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Check the links of the pages and of the book, run the examples, and compare the pages with the tables.
    #[arg(long)]
    check: bool,
}

/// Writes the book, or checks it.
pub(crate) fn run(options: &Options) -> Result<(), String> {
    if !options.check {
        return build(options.out.as_deref());
    }
    check_links(options.out.as_deref())?;
    // These tests compare the pages with the tables of calls, functions, attributes and options, and run the examples.
    let mut tests = Command::new(crate::workspace::cargo());
    tests.current_dir(Workspace::load()?.root).args(["test", "-p", "granita-tests", "--test", "manual"]);
    let status = tests.status().map_err(|e| format!("cargo: {e}"))?;
    if status.success() { Ok(()) } else { Err("the manual and its tables or examples differ".to_owned()) }
}

/// Checks the links of the pages, and where `mdbook` is installed, those of the HTML that it makes. The tests of the
/// manual check the rest.
pub(crate) fn check_links(out: Option<&Path>) -> Result<(), String> {
    let workspace = Workspace::load()?;
    if !has_program() {
        let faults = check(&workspace)?;
        faults.iter().for_each(|fault| eprintln!("book: {fault}"));
        println!("book: its HTML is not checked, because mdbook is not installed (cargo install mdbook)");
        return if faults.is_empty() {
            Ok(())
        } else {
            Err(format!("the manual has {} faults", faults.len()))
        };
    }
    build(out)?;
    let folder = out.map_or_else(|| workspace.root.join("target/book"), Path::to_owned);
    let (faults, pages) = html::check(&folder)?;
    faults.iter().for_each(|fault| eprintln!("book: {fault}"));
    println!("book: {pages} pages, {} links without a target", faults.len());
    if faults.is_empty() { Ok(()) } else { Err(format!("the book has {} faults", faults.len())) }
}

/// Writes the manual as HTML with a search, by `mdbook`.
pub(crate) fn build(out: Option<&Path>) -> Result<(), String> {
    let workspace = Workspace::load()?;
    let faults = check(&workspace)?;
    if !faults.is_empty() {
        faults.iter().for_each(|fault| eprintln!("book: {fault}"));
        return Err(format!("the manual has {} faults", faults.len()));
    }
    let out = out.map_or_else(|| workspace.root.join("target/book"), Path::to_owned);
    let out = std::path::absolute(&out).map_err(|e| format!("{}: {e}", out.display()))?;
    let built =
        Command::new("mdbook").arg("build").arg(workspace.root.join("docs")).arg("-d").arg(&out).status();
    match built {
        Ok(status) if status.success() => {
            println!("book: {}", out.join("index.html").display());
            Ok(())
        }
        Ok(status) => Err(format!("mdbook: {status}")),
        Err(error) => Err(format!("mdbook: {error} (cargo install mdbook)")),
    }
}

/// True when `mdbook` can be run.
pub(crate) fn has_program() -> bool {
    Command::new("mdbook").arg("--version").output().is_ok_and(|ran| ran.status.success())
}

/// One page.
struct Page {
    /// The anchors of its headings.
    anchors: BTreeSet<String>,
    /// The targets of its links and images, with their lines.
    links: Vec<(usize, String)>,
}

/// Returns the faults of the manual: pages that the summary does not list, links without a target, and images that no
/// page shows.
pub(crate) fn check(workspace: &Workspace) -> Result<Vec<String>, String> {
    let docs = workspace.root.join("docs");
    let mut pages = BTreeMap::new();
    let mut images = BTreeSet::new();
    for file in files(&docs)? {
        if file.extension().is_some_and(|e| e == "md") {
            let text =
                std::fs::read_to_string(docs.join(&file)).map_err(|e| format!("{}: {e}", file.display()))?;
            pages.insert(file, Page::read(&text));
        } else if file.extension().is_some_and(|e| e == "png" || e == "svg") {
            images.insert(file);
        }
    }
    let mut faults = Vec::new();
    let mut used = BTreeSet::new();
    for (file, page) in &pages {
        for (line, link) in &page.links {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { file.clone() } else { joined(file, path) };
            let place = || format!("docs/{}:{line}: link to {link}", file.display());
            if target.starts_with("..") {
                faults.push(format!("{}: it leaves the manual, which is also a book of its own", place()));
            }
            match pages.get(&target) {
                Some(found) if !anchor.is_empty() && !found.anchors.contains(anchor) => {
                    faults.push(format!("{}: the page has no such heading", place()));
                }
                Some(_) => (),
                None if !docs.join(&target).exists() => {
                    faults.push(format!("{}: there is no such file", place()))
                }
                None => (),
            }
            used.insert(target);
        }
    }
    let listed = |file: &&PathBuf| {
        let summary = pages.get(Path::new(SUMMARY));
        summary.is_some_and(|summary| summary.links.iter().any(|(_, link)| Path::new(link) == **file))
    };
    let unlisted = pages.keys().filter(|file| *file != Path::new(SUMMARY)).filter(|file| !listed(file));
    faults.extend(unlisted.map(|file| format!("docs/{}: {SUMMARY} does not list it", file.display())));
    // The drawing of the crates belongs to ARCHITECTURE.md.
    let drawing = Path::new(crate::crates::DRAWING).file_name().map(PathBuf::from);
    let unused = images.iter().filter(|image| !used.contains(*image) && Some(*image) != drawing.as_ref());
    faults.extend(unused.map(|image| format!("docs/{}: no page shows it", image.display())));
    Ok(faults)
}

/// Returns all files beneath a folder, relative to it.
fn files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inner) = folders.pop() {
        let io = |e: std::io::Error| format!("{}: {e}", folder.join(&inner).display());
        for entry in std::fs::read_dir(folder.join(&inner)).map_err(io)? {
            let entry = entry.map_err(io)?;
            let path = inner.join(entry.file_name());
            if entry.file_type().map_err(io)?.is_dir() { folders.push(path) } else { found.push(path) }
        }
    }
    Ok(found)
}

/// Returns the target of a link, relative to the folder of the manual.
fn joined(page: &Path, link: &str) -> PathBuf {
    let mut target = PathBuf::new();
    for part in page.parent().unwrap_or(Path::new("")).join(link).components() {
        match part {
            Component::ParentDir if target.file_name().is_some_and(|name| name != "..") => _ = target.pop(),
            Component::CurDir => (),
            other => target.push(other),
        }
    }
    target
}

impl Page {
    fn read(text: &str) -> Self {
        let (mut anchors, mut links) = (BTreeSet::new(), Vec::new());
        let mut is_code = false;
        for (number, line) in text.lines().enumerate() {
            if line.trim_start().starts_with("```") {
                is_code = !is_code;
            }
            if is_code {
                continue;
            }
            if let Some(heading) = line.strip_prefix('#') {
                let name = anchor(heading.trim_start_matches('#').trim());
                // A heading that occurs again gets a number.
                let names = std::iter::once(name.clone()).chain((1..).map(|n| format!("{name}-{n}")));
                anchors.extend(names.into_iter().find(|name| !anchors.contains(name)));
            }
            let line = without_code(line);
            for (at, _) in line.match_indices("](") {
                let link = &line[at + 2..];
                if let Some(end) = link.find(')') {
                    links.push((number + 1, link[..end].to_owned()));
                }
            }
        }
        Self { anchors, links }
    }
}

/// Returns a line without its spans of code.
fn without_code(line: &str) -> String {
    line.split('`').step_by(2).collect()
}

/// Returns the anchor of a heading.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_and_links_are_found_outside_of_code() {
        let page = Page::read(
            "# The `-o` option, twice\n[a](b.md#c) `[x](y)` ![p](q/r.png)\n```\n# no\n[s](t)\n```\n",
        );
        assert_eq!(page.anchors.into_iter().collect::<Vec<_>>(), ["the--o-option-twice"]);
        assert_eq!(page.links, [(2, "b.md#c".to_owned()), (2, "q/r.png".to_owned())]);
    }

    #[test]
    fn links_are_relative_to_their_page() {
        assert_eq!(joined(Path::new("a/b.md"), "../c.md"), Path::new("c.md"));
        assert_eq!(joined(Path::new("a/b.md"), "./d/e.png"), Path::new("a/d/e.png"));
        assert_eq!(joined(Path::new("b.md"), "../README.md"), Path::new("../README.md"));
    }
}
