//! Compares the table, the tree and the drawing of the architecture page with the existing crates.

mod drawing;

use crate::laws;
use crate::rules::rows;
use crate::workspace::Workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The architecture page.
const PAGE: &str = "ARCHITECTURE.md";

/// The drawing of crates and floors.
pub(crate) const DRAWING: &str = "docs/crates.svg";

/// Returns all breaches, one line each.
///
/// # Errors
/// Returns an error when the page is missing.
pub(crate) fn check(workspace: &Workspace) -> Result<Vec<String>, String> {
    let page = workspace.text(Path::new(PAGE)).ok_or_else(|| format!("no {PAGE}"))?;
    let folders: BTreeSet<PathBuf> = workspace.crates.iter().map(|member| member.folder.clone()).collect();
    let mut faults = check_table(&page, &folders);
    faults.extend(check_tree(&page, &folders));
    if workspace.text(Path::new(DRAWING)).as_deref() != Some(&drawing::draw(workspace)) {
        faults.push(format!("{DRAWING}: not what the crates are now; run `cargo xtask crates`"));
    }
    if !page.contains(&format!("({DRAWING})")) {
        faults.push(format!("{PAGE}: no link to {DRAWING}"));
    }
    Ok(faults)
}

/// Writes the drawing.
///
/// # Errors
/// Returns an error when the file cannot be written.
pub(crate) fn draw() -> Result<(), String> {
    let workspace = Workspace::load()?;
    let path = workspace.root.join(DRAWING);
    std::fs::write(&path, drawing::draw(&workspace)).map_err(|e| format!("{}: {e}", path.display()))?;
    println!("{DRAWING}");
    Ok(())
}

/// Checks that each crate has a row, named by its folder (in `libs/` by the name alone), and that each row is a crate.
fn check_table(page: &str, folders: &BTreeSet<PathBuf>) -> Vec<String> {
    let mut faults = Vec::new();
    let mut seen = BTreeSet::new();
    for row in rows(page, "crate") {
        // External crates are in another table.
        if row[0].starts_with('`') {
            continue;
        }
        let folder = [Path::new("libs").join(row[0]), PathBuf::from(row[0])]
            .into_iter()
            .find(|folder| folders.contains(folder));
        match folder {
            None => faults.push(format!("{PAGE}: the table of crates has {}, and there is none", row[0])),
            Some(folder) => {
                if row.len() != 3 || row[1].is_empty() {
                    faults.push(format!("{PAGE}: the row of {} does not say what it is for", row[0]));
                }
                if !seen.insert(folder) {
                    faults.push(format!("{PAGE}: the table of crates has {} twice", row[0]));
                }
            }
        }
    }
    let lacking = folders.difference(&seen);
    faults.extend(
        lacking.map(|folder| format!("{PAGE}: the table of crates has no row for {}", folder.display())),
    );
    faults
}

/// Checks that the tree names each crate on its floor.
fn check_tree(page: &str, folders: &BTreeSet<PathBuf>) -> Vec<String> {
    let tree = page.split_once("## Tree").and_then(|(_, rest)| rest.split("```").nth(1)).unwrap_or_default();
    let named = floors_of(tree);
    let mut faults = Vec::new();
    for folder in folders {
        let Some(floor) = laws::floor(folder) else { continue };
        match named.get(folder) {
            Some(other) if *other == floor => {}
            Some(other) => {
                let name = folder.display();
                faults
                    .push(format!("{PAGE}: the tree has {name} on floor {other}, the laws on floor {floor}"));
            }
            // One word stands for crates without floors, and for the crates in `bindings/`.
            None => {
                let top =
                    folder.components().next().map(|part| part.as_os_str().to_string_lossy().into_owned());
                let top = format!("{}/", top.unwrap_or_default());
                let has_floors = named.keys().any(|other| other.starts_with(&top) && top != "bindings/");
                if has_floors || !tree.split_whitespace().any(|word| word == top) {
                    faults.push(format!("{PAGE}: the tree does not have {}", folder.display()));
                }
            }
        }
    }
    for folder in named.keys().filter(|folder| !folder.starts_with("bindings") && !folders.contains(*folder))
    {
        faults.push(format!("{PAGE}: the tree has {}, and there is no such crate", folder.display()));
    }
    faults
}

/// Returns the folders of the tree and their floors. A line has the form `libs/ base cli floor 0`. Lines below it may
/// continue the folder.
fn floors_of(tree: &str) -> BTreeMap<PathBuf, u8> {
    let mut floors = BTreeMap::new();
    let mut top = "";
    for line in tree.lines() {
        if !line.starts_with(' ') {
            top = line.split_whitespace().next().unwrap_or_default();
        }
        let Some((names, rest)) = line.split_once(" floor ") else { continue };
        let floor = rest.split_whitespace().next().and_then(|word| word.parse().ok());
        let Some(floor) = floor else { continue };
        let names = names.strip_prefix(top).unwrap_or(names).split(['(', ',']).next().unwrap_or_default();
        for name in names.split_whitespace() {
            floors.insert(Path::new(top).join(name), floor);
        }
    }
    floors
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folders(names: &[&str]) -> BTreeSet<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    #[test]
    fn missing_and_extra_rows_of_crates_are_reported() {
        let page = "| crate | purpose | types |\n|---|---|---|\n| base | words | `A` |\n| formats/tiff | images | `B` |\n\n\
                    | crate | for | rather than |\n|---|---|---|\n| `rustix` | files | libc |\n";
        assert!(check_table(page, &folders(&["libs/base", "formats/tiff"])).is_empty());
        let faults = check_table(page, &folders(&["libs/base", "formats/exr"]));
        assert!(faults.len() == 2 && faults[0].contains("formats/tiff") && faults[1].contains("formats/exr"));
        let twice = page.replace("formats/tiff", "base");
        assert_eq!(check_table(&twice, &folders(&["libs/base"])).len(), 1);
        let empty = page.replace("words", "");
        assert_eq!(check_table(&empty, &folders(&["libs/base", "formats/tiff"])).len(), 1);
    }

    #[test]
    fn crates_missing_from_the_tree_are_reported() {
        let page = "## Tree\n```\ntools/    gelato iv   floor 8  what runs\nlibs/     base cli    floor 0\n          scene       floor 1\n\
                    bindings/ cpp (headers), python   floor 8\ntests/   crate\n```\n";
        let all = [
            "libs/base",
            "libs/cli",
            "libs/scene",
            "tools/gelato",
            "tools/iv",
            "bindings/cpp/gelato",
            "tests/needs",
        ];
        assert_eq!(check_tree(page, &folders(&all)), Vec::<String>::new());
        assert_eq!(check_tree(page, &folders(&all[1..])).len(), 1, "base is in the tree only");
        assert_eq!(check_tree(page, &folders(&[&all[..], &["libs/geom"]].concat())).len(), 1);
        assert_eq!(check_tree(page, &folders(&[&all[..], &["benches"]].concat())).len(), 1);
        let moved = page.replace("floor 1", "floor 2");
        assert!(check_tree(&moved, &folders(&all))[0].contains("floor 2"));
    }
}
