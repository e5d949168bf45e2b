//! The links of the manual: pages, headings, pictures and files.

use crate::pages::{PageText, pages};
use granita_tests::repository;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Returns the targets of the links of a line: `[text](target)` and `![text](target)`.
fn links(line: &str) -> Vec<&str> {
    line.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0)).collect()
}

/// Returns a path without `.` and `..`.
fn tidied(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                out.pop();
            }
            Component::CurDir => {}
            other => out.push(other),
        }
    }
    out
}

#[test]
fn links_lead_somewhere() {
    let pages = pages();
    let anchors: BTreeMap<&str, BTreeSet<String>> =
        pages.iter().map(|page| (&*page.name, page.anchors())).collect();
    let (mut faults, mut n) = (String::new(), 0);
    for page in &pages {
        for (line, text) in page.prose() {
            for link in links(text).into_iter().filter(|link| !link.contains("://")) {
                n += 1;
                if let Err(what) = follow(page, link, &anchors) {
                    faults += &format!("{}:{line}: {link}: {what}\n", page.name);
                }
            }
        }
    }
    assert!(faults.is_empty() && n > 100, "{n} links\n{faults}");
}

fn follow(page: &PageText, link: &str, anchors: &BTreeMap<&str, BTreeSet<String>>) -> Result<(), String> {
    let (file, anchor) = link.split_once('#').map_or((link, None), |(file, anchor)| (file, Some(anchor)));
    let folder = Path::new(&page.name).parent().unwrap_or(Path::new(""));
    let target = if file.is_empty() { PathBuf::from(&page.name) } else { tidied(&folder.join(file)) };
    if !repository().join(&target).exists() {
        return Err(format!("there is no {}", target.display()));
    }
    let Some(anchor) = anchor else { return Ok(()) };
    let name = target.to_string_lossy().replace('\\', "/");
    let known = anchors.get(&*name).ok_or_else(|| format!("{name} is no page"))?;
    known.contains(anchor).then_some(()).ok_or_else(|| format!("{name} has no heading of that name"))
}

#[test]
fn the_summary_lists_every_page_once() {
    let pages = pages();
    let summary = pages.iter().find(|page| page.name == "docs/SUMMARY.md").unwrap();
    let mut listed: Vec<String> = summary
        .prose()
        .into_iter()
        .flat_map(|(_, line)| links(line))
        .map(|link| format!("docs/{link}"))
        .collect();
    listed.push("docs/SUMMARY.md".to_owned());
    listed.sort();
    let mut names: Vec<String> = pages.iter().map(|page| page.name.clone()).collect();
    names.sort();
    assert_eq!(listed, names);
}

#[test]
fn every_picture_is_shown() {
    let pages = pages();
    let readme = std::fs::read_to_string(repository().join("README.md")).unwrap();
    for entry in std::fs::read_dir(repository().join("docs/pictures")).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        let shown = |text: &str| text.contains(&format!("pictures/{name}"));
        assert!(shown(&readme) || pages.iter().any(|page| shown(&page.text)), "no page shows {name}");
    }
}
