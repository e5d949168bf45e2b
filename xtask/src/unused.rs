//! Finds unused dependencies, which are those whose name does not occur in the code that they are for.

use crate::source::{Kind, Source, is_test};
use crate::workspace::{Crate, Purpose, Workspace};
use std::collections::BTreeSet;
use std::path::Path;

/// The dependencies that are used without being named, each with the reason.
const UNNAMED: [(&str, &str, &str); 1] =
    [("iv", "wgpu", "its features choose the backends that eframe draws with")];

/// Returns all breaches, one line each.
pub(crate) fn check(workspace: &Workspace, sources: &[Source]) -> Vec<String> {
    let mut faults = Vec::new();
    for member in &workspace.crates {
        let own = |source: &&Source| {
            let inner = workspace
                .crates
                .iter()
                .filter(|c| c.folder != member.folder && c.folder.starts_with(&member.folder));
            source.file.starts_with(&member.folder)
                && !inner.into_iter().any(|c| source.file.starts_with(&c.folder))
        };
        let files: Vec<&Source> = sources.iter().filter(own).collect();
        faults.extend(unused(member, &files));
    }
    faults
}

/// Returns the dependencies of a crate that its files do not name.
fn unused(member: &Crate, files: &[&Source]) -> Vec<String> {
    let is_build = |source: &Source| source.file == member.folder.join("build.rs");
    // The code of a crate of tests is in their folder.
    let has_code = |source: &Source| {
        let inside = source.file.strip_prefix(&member.folder).unwrap_or(&source.file);
        member.roots.contains(&source.file) || !is_test(inside)
    };
    let mut faults = Vec::new();
    for dependency in &member.dependencies {
        let name = dependency.name_in_code.as_str();
        let is_named = files.iter().any(|source| match dependency.purpose {
            Purpose::Build => is_build(source) && words(source, true).contains(name),
            Purpose::Tests => !is_build(source) && words(source, true).contains(name),
            Purpose::Code => {
                !is_build(source) && has_code(source) && words(source, source.is_test).contains(name)
            }
        });
        let excepted = UNNAMED.iter().any(|(of, other, _)| *of == member.name && *other == dependency.name);
        if !is_named && !excepted {
            let what = match dependency.purpose {
                Purpose::Build => "its build script names it nowhere",
                Purpose::Tests => "nothing names it",
                Purpose::Code => "nothing names it, or tests alone do",
            };
            faults.push(format!(
                "{}: depends on {}: {what}",
                Path::new(&member.folder).join("Cargo.toml").display(),
                dependency.name
            ));
        }
    }
    faults
}

fn words(source: &Source, with_tests: bool) -> BTreeSet<&str> {
    let tokens = if with_tests { &source.all } else { &source.code };
    let word = |kind: &'_ Kind| matches!(kind, Kind::Word(_));
    let words = tokens.iter().filter(|token| word(&token.kind));
    words
        .map(|token| match &token.kind {
            Kind::Word(word) => word.as_str(),
            _ => "",
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::Dependency;

    #[test]
    fn unused_dependencies_are_reported_in_their_section() {
        let source = |file: &str, text: &str| Source::new(file.into(), text.to_owned()).unwrap();
        let files = [
            source(
                "libs/x/src/lib.rs",
                "use a_b::C; #[cfg(test)] mod tests { use only_tests::D; } // not_there",
            ),
            source("libs/x/tests/t.rs", "fn f() { of_tests::g(); }"),
            source("libs/x/build.rs", "fn main() { of_build::g(); }"),
        ];
        let dependency = |name: &str, purpose| Dependency {
            name: name.to_owned(),
            name_in_code: name.replace('-', "_"),
            purpose,
        };
        let member = |dependencies| Crate {
            name: "x".to_owned(),
            folder: "libs/x".into(),
            dependencies,
            roots: vec!["libs/x/src/lib.rs".into(), "libs/x/tests/t.rs".into()],
        };
        let good = member(vec![
            dependency("a-b", Purpose::Code),
            dependency("only-tests", Purpose::Tests),
            dependency("of-tests", Purpose::Tests),
            dependency("of-build", Purpose::Build),
        ]);
        let files: Vec<&Source> = files.iter().collect();
        assert_eq!(unused(&good, &files), Vec::<String>::new());
        let bad = member(vec![
            dependency("not-there", Purpose::Code),
            dependency("only-tests", Purpose::Code),
            dependency("of-build", Purpose::Tests),
            dependency("a-b", Purpose::Build),
        ]);
        assert_eq!(unused(&bad, &files).len(), 4);
    }
}
