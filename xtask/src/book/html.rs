//! The links of the book as browsers follow them: every local target of its HTML exists, with its anchor.

use super::{files, joined};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The pages without links of their own: all pages in one for printing, and what browsers show for a missing page.
const NOT_CHECKED: [&str; 2] = ["print.html", "404.html"];

/// One page of the book.
#[derive(Debug, Default, PartialEq)]
struct Page {
    anchors: BTreeSet<String>,
    links: Vec<String>,
}

/// Returns the faults of a book in `folder`, and the number of its pages.
///
/// # Errors
/// Returns an error when the folder cannot be read.
pub(super) fn check(folder: &Path) -> Result<(Vec<String>, usize), String> {
    let all: BTreeSet<PathBuf> = files(folder)?.into_iter().collect();
    let mut pages = BTreeMap::new();
    for file in all.iter().filter(|file| file.extension().is_some_and(|e| e == "html")) {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        pages.insert(file.clone(), Page::read(&text));
    }
    let mut faults = Vec::new();
    for (file, page) in &pages {
        if NOT_CHECKED.iter().any(|name| file == Path::new(name)) {
            continue;
        }
        for link in &page.links {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { file.clone() } else { joined(file, path) };
            let place = || format!("{}: link to {link}", file.display());
            match pages.get(&target) {
                Some(found) if !anchor.is_empty() && !found.anchors.contains(anchor) => {
                    faults.push(format!("{}: the page has no such heading", place()));
                }
                None if !all.contains(&target) => faults.push(format!("{}: there is no such file", place())),
                _ => (),
            }
        }
    }
    Ok((faults, pages.len()))
}

impl Page {
    fn read(text: &str) -> Self {
        let mut page = Self::default();
        for tag in text.split('<').skip(1) {
            // Scripts contain texts with tags, which have no links of the page.
            let tag = tag.split('>').next().unwrap_or_default();
            page.anchors.extend(value(tag, "id"));
            let local = |link: &String| !link.contains(':') && !link.starts_with("//") && !link.is_empty();
            page.links.extend(["href", "src"].iter().filter_map(|name| value(tag, name)).filter(local));
        }
        page
    }
}

/// Returns the value of an attribute in a tag.
fn value(tag: &str, name: &str) -> Option<String> {
    let (_, rest) = tag.split_once(&format!(" {name}=\""))?;
    let (value, _) = rest.split_once('"')?;
    Some(value.replace("&amp;", "&").replace("&#39;", "'").replace("&quot;", "\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_without_a_target_are_found() {
        let folder = std::env::temp_dir().join(format!("granita-book-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("sub")).unwrap();
        let page = "<h1 id=\"top\">x</h1><a href=\"sub/b.html#here\">b</a><a href=\"https://a.b/c\">c</a>\
                    <img src=\"none.png\"><a href=\"#top\">t</a><a class=\"x\" href=\"sub/b.html#gone\">d</a>";
        std::fs::write(folder.join("a.html"), page).unwrap();
        std::fs::write(folder.join("sub/b.html"), "<p id=\"here\"><a href=\"../a.html\">up</a>").unwrap();
        let found = check(&folder);
        std::fs::remove_dir_all(&folder).unwrap();
        let expected = [
            "a.html: link to none.png: there is no such file",
            "a.html: link to sub/b.html#gone: the page has no such heading",
        ];
        assert_eq!(found, Ok((expected.map(str::to_owned).to_vec(), 2)));
    }
}
