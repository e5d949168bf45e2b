//! Checks that the files of a crate import each other in one direction, without circles.
//!
//! A file *names* another one when a path of its code, outside of tests, leads to an item that the other one defines,
//! through any `use` lines on the way. A module and its own descendants may name each other. A circle is a set of files
//! in which each file reaches all the others through such names.

mod tree;

use crate::workspace::Workspace;
use petgraph::algo::tarjan_scc;
use petgraph::graph::{DiGraph, NodeIndex};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use tree::{Reader, Target, Tree};

/// A set of files that name each other, sorted by path.
struct Circle {
    files: BTreeSet<PathBuf>,
    /// The names that form the circle, by the two files.
    names: BTreeMap<(PathBuf, PathBuf), Vec<Line>>,
}

/// A line that names an item of another file.
struct Line {
    number: usize,
    path: String,
}

/// Returns all breaches, one message each.
///
/// # Errors
/// Returns the path of a file that is missing or is not Rust, with the reason.
pub(crate) fn check(workspace: &Workspace) -> Result<Vec<String>, String> {
    let reader = |path: &Path| workspace.text(path);
    let mut found: Vec<Circle> = Vec::new();
    for root in workspace.crates.iter().flat_map(|member| &member.roots) {
        for circle in circles(root, &reader)? {
            if !found.iter().any(|other| other.files == circle.files) {
                found.push(circle);
            }
        }
    }
    Ok(found.iter().map(describe).collect())
}

fn describe(circle: &Circle) -> String {
    let mut text = format!("{} files name each other in a circle:", circle.files.len());
    for file in &circle.files {
        text.push_str(&format!("\n  {}", file.display()));
        for ((_, to), lines) in circle.names.iter().filter(|((from, _), _)| from == file) {
            text.push_str(&format!("\n    -> {}", to.display()));
            for line in lines {
                text.push_str(&format!("\n         {}:{}: {}", file.display(), line.number, line.path));
            }
        }
    }
    text
}

/// Returns the circles of the crate with this root file, in order of their first files.
fn circles(root: &Path, reader: Reader) -> Result<Vec<Circle>, String> {
    let tree = Tree::read(root, reader)?;
    let names = names(&tree);
    let mut graph: DiGraph<&PathBuf, ()> = DiGraph::new();
    let mut nodes: BTreeMap<&PathBuf, NodeIndex> = BTreeMap::new();
    for (from, to) in names.keys() {
        let [from, to] = [from, to].map(|file| *nodes.entry(file).or_insert_with(|| graph.add_node(file)));
        graph.add_edge(from, to, ());
    }
    let sets: Vec<BTreeSet<PathBuf>> = tarjan_scc(&graph)
        .iter()
        .filter(|files| files.len() > 1)
        .map(|files| files.iter().map(|node| graph[*node].clone()).collect())
        .collect();
    let mut circles: Vec<Circle> =
        sets.into_iter().map(|files| Circle { files, names: BTreeMap::new() }).collect();
    for ((from, to), lines) in names {
        if let Some(circle) = circles.iter_mut().find(|c| c.files.contains(&from) && c.files.contains(&to)) {
            circle.names.insert((from, to), lines);
        }
    }
    circles.sort_by(|a, b| a.files.cmp(&b.files));
    Ok(circles)
}

/// Returns the pairs of files that name each other, with the lines. Modules and their own descendants are left out.
fn names(tree: &Tree) -> BTreeMap<(PathBuf, PathBuf), Vec<Line>> {
    let mut names: BTreeMap<(PathBuf, PathBuf), Vec<Line>> = BTreeMap::new();
    for (id, module) in tree.modules.iter().enumerate() {
        for mention in module.mentions.iter().filter(|m| !tree.is_imported(m, id)) {
            // A `use` of a module does not count. The paths that start with the module do.
            let Some(Target::Item(definer)) = tree.resolve(&mention.path, id) else { continue };
            let [from, to] = [id, definer].map(|m| tree.file_module(m));
            if tree.contains(from, to) || tree.contains(to, from) {
                continue;
            }
            let files = (module.file.clone(), tree.modules[to].file.clone());
            let lines = names.entry(files).or_default();
            lines.push(Line { number: mention.line, path: mention.path.join("::") });
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the circles of a crate with these files, each as its list of files.
    fn of(files: &[(&str, &str)]) -> Vec<Vec<String>> {
        let reader = |path: &Path| {
            files.iter().find(|(name, _)| Path::new(name) == path).map(|(_, text)| (*text).to_owned())
        };
        let found = circles(Path::new(files[0].0), &reader).unwrap();
        found.iter().map(|c| c.files.iter().map(|f| f.display().to_string()).collect()).collect()
    }

    #[test]
    fn files_that_use_each_other_are_a_cycle() {
        let root = ("src/lib.rs", "mod a; mod b;");
        let a = ("src/a.rs", "use crate::b::B; pub struct A(B);");
        let b = ("src/b.rs", "pub struct B;");
        assert_eq!(of(&[root, a, b]), Vec::<Vec<String>>::new());
        let b = ("src/b.rs", "pub struct B; fn f(_: &super::a::A) {}");
        assert_eq!(of(&[root, a, b]), [["src/a.rs", "src/b.rs"]]);
    }

    #[test]
    fn a_cycle_of_three_files_excludes_their_users() {
        let files = [
            ("src/main.rs", "mod a; mod b; mod c; mod d; fn main() { d::run() }"),
            ("src/a.rs", "pub fn a() { crate::b::b() }"),
            ("src/b.rs", "pub fn b() { println!(\"{}\", crate::c::C) }"),
            ("src/c.rs", "use super::a; pub const C: u8 = 1; fn c() { a::a() }"),
            ("src/d.rs", "use crate::a::a; pub fn run() { a() }"),
        ];
        assert_eq!(of(&files), [["src/a.rs", "src/b.rs", "src/c.rs"]]);
    }

    #[test]
    fn siblings_make_cycles_but_parents_and_children_do_not() {
        let root = ("src/lib.rs", "mod a;");
        let child = ("src/a/x.rs", "use super::A; pub struct X(A);");
        let other = ("src/a/y.rs", "pub struct Y;");
        assert!(
            of(&[root, ("src/a.rs", "mod x; mod y; pub struct A; fn f(_: x::X) {}"), child, other])
                .is_empty()
        );
        // The items are reached through the imports of the parent.
        let parent = ("src/a/mod.rs", "mod x; mod y; use x::X; pub(crate) use y::Y;");
        let child = ("src/a/x.rs", "use super::Y; pub struct X(Y);");
        let other = ("src/a/y.rs", "pub struct Y; fn f(_: super::X) {}");
        assert_eq!(of(&[root, parent, child, other]), [["src/a/x.rs", "src/a/y.rs"]]);
    }

    #[test]
    fn names_are_resolved_through_root_globs_and_renames() {
        let files = [
            ("src/lib.rs", "mod a; mod b; mod c; pub use a::*; pub use b::B as Better;"),
            ("src/a.rs", "pub struct A; fn f(_: crate::Better) {}"),
            ("src/b.rs", "use super::*; pub struct B; fn f(_: C) {}"),
            ("src/c.rs", "use crate::A; pub struct C(A);"),
        ];
        assert!(of(&files).is_empty(), "the root does not export C");
        let files = [
            ("src/lib.rs", "mod a; mod b; mod c; pub use a::*; pub use b::B as Better; use c::C;"),
            files[1],
            files[2],
            files[3],
        ];
        assert_eq!(of(&files), [["src/a.rs", "src/b.rs", "src/c.rs"]]);
    }

    #[test]
    fn tests_are_ignored_and_inner_modules_count_as_their_file() {
        let root = ("src/lib.rs", "mod a; mod b;");
        let a = ("src/a.rs", "pub struct A; #[cfg(test)] mod tests { use crate::b::B; }");
        let b = ("src/b.rs", "pub struct B(crate::a::A);");
        assert!(of(&[root, a, b]).is_empty());
        let a = ("src/a.rs", "pub struct A; mod inner { fn f(_: crate::b::B) {} }");
        assert_eq!(of(&[root, a, b]), [["src/a.rs", "src/b.rs"]]);
    }

    #[test]
    fn macros_are_read_and_path_attributes_followed() {
        let files = [
            ("x/main.rs", "#[path = \"../y/a.rs\"] mod a; mod b;"),
            ("y/a.rs", "pub fn a() { assert!(crate::b::Kind::Small == crate::b::Kind::Big) }"),
            ("x/b/mod.rs", "pub enum Kind { Small, Big } fn b() { crate::a::a() }"),
        ];
        assert_eq!(of(&files), [["x/b/mod.rs", "y/a.rs"]]);
    }

    #[test]
    fn items_of_a_macro_belong_to_its_file() {
        let files = [
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "use crate::b; fn a() { b::made() } pub const A: u8 = 1;"),
            (
                "b.rs",
                "macro_rules! make { ($name:ident) => { pub fn $name() -> u8 { crate::a::A } } } make!(made);",
            ),
        ];
        assert_eq!(of(&files), [["a.rs", "b.rs"]]);
    }

    #[test]
    fn cycles_are_reported_with_their_lines() {
        let files = [
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "pub struct A(crate::b::B);"),
            ("b.rs", "pub struct B; fn f(_: crate::a::A) {}"),
        ];
        let reader = |path: &Path| {
            files.iter().find(|(name, _)| Path::new(name) == path).map(|(_, text)| (*text).to_owned())
        };
        let found = circles(Path::new("lib.rs"), &reader).unwrap();
        let told: Vec<String> = found.iter().map(describe).collect();
        assert!(told.len() == 1 && told[0].contains("a.rs:1: crate::b::B"), "{told:?}");
    }
}
