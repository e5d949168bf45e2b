//! The crates in the programs: a bill of materials (CycloneDX 1.5), and the terms of their licences.

use crate::files::{answer, read, repository, write};
use crate::workspace::cargo;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The packages whose dependencies are listed.
const ROOTS: [&str; 4] = ["granita", "libgelato", "libgsoargs", "libgranita-texture"];

/// The beginnings of the names of files with terms, in lower case.
const TERMS: [&str; 8] = ["license", "licence", "copying", "copyright", "notice", "unlicense", "ofl", "ufl"];

/// A crate in the programs.
pub(super) struct Component {
    name: String,
    version: String,
    licence: String,
    /// SHA-256 of the package in the registry; empty for a crate of this workspace.
    checksum: String,
    folder: PathBuf,
    /// The identifiers of the crates that it depends on.
    dependencies: BTreeSet<String>,
}

impl Component {
    /// Returns the identifier, a package URL.
    fn id(&self) -> String {
        id(&self.name, &self.version)
    }

    /// True for a crate of this workspace.
    fn is_own(&self) -> bool {
        self.checksum.is_empty()
    }
}

fn id(name: &str, version: &str) -> String {
    format!("pkg:cargo/{name}@{version}")
}

/// Reads the crates that the programs for a platform contain, sorted by name and version. Crates that only run while
/// building (build scripts, macros) are left out.
pub(super) fn read_from_cargo(triple: &str) -> Result<Vec<Component>, String> {
    let words = ["metadata", "--format-version=1", "--locked", "--filter-platform", triple];
    let text = answer(Command::new(cargo()).current_dir(repository()).args(words))?;
    let metadata: Value = serde_json::from_str(&text).map_err(|e| format!("cargo metadata: {e}"))?;
    Ok(components(&metadata, &checksums(&read(&repository().join("Cargo.lock"))?)))
}

/// Returns the check sums of the packages in a lock file, by name and version.
fn checksums(lock: &str) -> BTreeMap<(String, String), String> {
    let mut sums = BTreeMap::new();
    let (mut name, mut version) = (String::new(), String::new());
    for line in lock.lines() {
        let Some((key, value)) = line.split_once(" = ") else { continue };
        let value = value.trim_matches('"').to_owned();
        match key {
            "name" => name = value,
            "version" => version = value,
            "checksum" => drop(sums.insert((name.clone(), version.clone()), value)),
            _ => (),
        }
    }
    sums
}

fn components(metadata: &Value, sums: &BTreeMap<(String, String), String>) -> Vec<Component> {
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let packages: BTreeMap<String, Value> =
        list(&metadata["packages"]).into_iter().map(|package| (text(&package["id"]), package)).collect();
    let nodes: BTreeMap<String, Value> =
        list(&metadata["resolve"]["nodes"]).into_iter().map(|node| (text(&node["id"]), node)).collect();
    let is_macro = |package: &Value| {
        list(&package["targets"]).iter().any(|target| list(&target["kind"]).contains(&json!("proc-macro")))
    };
    let of = |package: &Value| id(&text(&package["name"]), &text(&package["version"]));
    let is_root = |package: &Value| ROOTS.contains(&package["name"].as_str().unwrap_or_default());
    let mut waiting: Vec<String> =
        packages.iter().filter(|(_, package)| is_root(package)).map(|(id, _)| id.clone()).collect();
    let mut found = BTreeMap::new();
    while let Some(next) = waiting.pop() {
        let (Some(package), Some(node)) = (packages.get(&next), nodes.get(&next)) else { continue };
        let (name, version) = (text(&package["name"]), text(&package["version"]));
        let key = (name.clone(), version.clone());
        if found.contains_key(&key) {
            continue;
        }
        let normal =
            |dependency: &Value| list(&dependency["dep_kinds"]).iter().any(|kind| kind["kind"].is_null());
        let inside: Vec<String> = list(&node["deps"])
            .iter()
            .filter(|dependency| normal(dependency))
            .map(|dependency| text(&dependency["pkg"]))
            .filter(|id| packages.get(id).is_some_and(|package| !is_macro(package)))
            .collect();
        let component = Component {
            licence: text(&package["license"]),
            checksum: sums.get(&key).cloned().unwrap_or_default(),
            folder: Path::new(&text(&package["manifest_path"])).parent().unwrap_or(Path::new("")).to_owned(),
            dependencies: inside.iter().filter_map(|id| packages.get(id)).map(of).collect(),
            name,
            version,
        };
        waiting.extend(inside);
        found.insert(key, component);
    }
    found.into_values().collect()
}

/// Returns the bill of materials.
fn bill(components: &[Component], epoch: u64) -> Result<Value, String> {
    let time = answer(Command::new("date").args(["--utc", "+%FT%TZ", "--date", &format!("@{epoch}")]))?;
    let entry = |component: &Component| {
        let (id, licence) = (component.id(), &component.licence);
        let mut entry = json!({
            "type": "library", "bom-ref": id, "name": component.name, "version": component.version, "purl": id,
        });
        // The old form of a choice is not an expression.
        let licence = licence.replace('/', " OR ");
        if !licence.is_empty() {
            entry["licenses"] = json!([{ "expression": licence }]);
        }
        if !component.is_own() {
            entry["hashes"] = json!([{ "alg": "SHA-256", "content": component.checksum }]);
        }
        entry
    };
    Ok(json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "timestamp": time,
            "component": { "type": "application", "bom-ref": "granita", "name": "granita",
                           "version": env!("CARGO_PKG_VERSION") },
        },
        "components": components.iter().map(entry).collect::<Vec<_>>(),
        "dependencies": components
            .iter()
            .map(|component| json!({ "ref": component.id(), "dependsOn": component.dependencies }))
            .collect::<Vec<_>>(),
    }))
}

/// Returns the files with terms in the folder of a crate and in the folders in it, sorted.
fn terms(folder: &Path, depth: u32) -> Vec<PathBuf> {
    let entries =
        std::fs::read_dir(folder).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let mut files = Vec::new();
    for path in entries {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let is_code = [".rs", ".toml", ".py"].iter().any(|end| name.ends_with(end));
        if path.is_dir() {
            if depth > 0 {
                files.extend(terms(&path, depth - 1));
            }
        } else if TERMS.iter().any(|start| name.starts_with(start)) && !is_code {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// Returns the terms of all crates of others. A text is printed once, after the crates that it belongs to.
fn notices(components: &[Component]) -> String {
    let mut texts: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut list = String::new();
    for component in components.iter().filter(|component| !component.is_own()) {
        let name = format!("{} {}", component.name, component.version);
        list.push_str(&format!("{name}: {}\n", component.licence));
        for file in terms(&component.folder, 2) {
            let text = String::from_utf8_lossy(&std::fs::read(&file).unwrap_or_default()).replace('\r', "");
            texts.entry(text.trim().to_owned()).or_default().insert(name.clone());
        }
    }
    let mut out = format!("The programs contain these packages of others, under these licences.\n\n{list}");
    for (text, names) in texts {
        let names: Vec<String> = names.into_iter().collect();
        out.push_str(&format!("\n{}\n{}:\n\n{text}\n", "-".repeat(78), names.join(", ")));
    }
    out
}

/// Writes both lists into a folder.
pub(super) fn write_lists(components: &[Component], folder: &Path, epoch: u64) -> Result<(), String> {
    let bill = bill(components, epoch)?;
    write(&folder.join("sbom.cdx.json"), &format!("{bill:#}\n"))?;
    write(&folder.join("LICENSES-OF-OTHERS"), &notices(components))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn package(name: &str, kind: &str) -> Value {
        json!({ "id": name, "name": name, "version": "1.0.0", "license": "MIT/Apache-2.0",
                "manifest_path": format!("/x/{name}/Cargo.toml"), "targets": [{ "kind": [kind] }] })
    }

    #[test]
    fn only_what_is_in_the_programs_is_listed() {
        let dependency = |name: &str, kind: Value| json!({ "pkg": name, "dep_kinds": [{ "kind": kind }] });
        let metadata = json!({
            "packages": [package("granita", "bin"), package("glam", "lib"), package("syn_derive", "proc-macro"),
                         package("cc", "lib"), package("proptest", "lib"), package("unrelated", "lib")],
            "resolve": { "nodes": [
                { "id": "granita", "deps": [dependency("glam", Value::Null), dependency("syn_derive", Value::Null),
                                            dependency("cc", json!("build")), dependency("proptest", json!("dev"))] },
                { "id": "glam", "deps": [] },
            ] },
        });
        let lock = "[[package]]\nname = \"glam\"\nversion = \"1.0.0\"\nchecksum = \"ab12\"\n";
        let found = components(&metadata, &checksums(lock));
        let ids: Vec<String> = found.iter().map(Component::id).collect();
        assert_eq!(ids, ["pkg:cargo/glam@1.0.0", "pkg:cargo/granita@1.0.0"]);
        let bill = bill(&found, 0).unwrap();
        assert_eq!(bill["metadata"]["timestamp"], "1970-01-01T00:00:00Z");
        assert_eq!(bill["components"][0]["hashes"][0]["content"], "ab12");
        assert_eq!(bill["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(bill["dependencies"][1]["dependsOn"], json!(["pkg:cargo/glam@1.0.0"]));
        assert!(
            notices(&found).contains("glam 1.0.0: MIT/Apache-2.0") && !notices(&found).contains("granita 1")
        );
    }
}
