//! No attribute is read or set by a text: programs name attributes by the keys of `granita_scene::attr`, so that a wrong name
//! or type does not compile.

use crate::workspace::Workspace;
use std::path::Path;

/// Where the names of attributes stand.
const TABLE: &str = "libs/scene/src/attribute/table.rs";

/// What stands before a text that names a value.
const CALLS: [&str; 10] = [
    "get(",
    "float(",
    "floats(",
    "int(",
    "string(",
    "attribute(",
    "declared(",
    "lookup(",
    "attribute_row(",
    "attribute_default(",
];

/// Names of attributes that are names of primitive variables and of parameters of commands as well.
const ALSO_VARIABLES: [&str; 3] = ["C", "opacity", "name"];

/// What knows images and no scenes: attributes of images are all that they read.
const BELOW: [&str; 5] = ["libs/base", "libs/image", "formats/exr", "formats/tiff", "formats/raster"];

/// All breaches, one line each.
pub(crate) fn check(workspace: &Workspace) -> Result<Vec<String>, String> {
    let table = workspace.text(Path::new(TABLE)).ok_or_else(|| format!("no {TABLE}"))?;
    let names = names(&table);
    if names.is_empty() {
        return Err(format!("{TABLE} has no names of attributes"));
    }
    let mut faults = Vec::new();
    for file in workspace.files()? {
        let is_source = file.extension().is_some_and(|e| e == "rs");
        let is_test = file.components().any(|c| c.as_os_str() == "tests") || file.ends_with("tests.rs");
        let elsewhere = ["libs", "formats", "tools", "bindings"].iter().all(|f| !file.starts_with(f));
        let exempt = BELOW.iter().any(|f| file.starts_with(f));
        if !is_source || is_test || elsewhere || exempt {
            continue;
        }
        let Some(text) = workspace.text(&file) else { continue };
        for (line, name) in by_text(&text, &names) {
            faults.push(format!("{}:{line}: \"{name}\" by a text; attr has a key for it", file.display()));
        }
    }
    Ok(faults)
}

/// The names in the table: the second text of each `"section", "name", `.
fn names(table: &str) -> Vec<&str> {
    let rows = table.lines().filter_map(|line| line.split_once(" = \"")?.1.split_once("\", \""));
    let names = rows.filter_map(|(_, rest)| Some(rest.split_once('"')?.0));
    names.filter(|name| !ALSO_VARIABLES.contains(name)).collect()
}

/// Lines, from 1, with calls that name an attribute by a text, and the name. Tests, at the end of a file, may.
fn by_text<'a>(text: &'a str, names: &[&str]) -> Vec<(usize, &'a str)> {
    let code = text.split("#[cfg(test)]").next().unwrap_or(text);
    let mut found = Vec::new();
    for (number, line) in (1..).zip(code.lines()) {
        if line.trim_start().starts_with("//") {
            continue;
        }
        for call in CALLS {
            for part in line.split(call).skip(1) {
                let part = part.trim_start_matches('&');
                let Some((word, _)) = part.strip_prefix('"').and_then(|rest| rest.split_once('"')) else {
                    continue;
                };
                // "int twosided" or "twosided".
                let name = word.rsplit(' ').next().unwrap_or(word);
                if names.contains(&name) {
                    found.push((number, name));
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_found() {
        let table = "    FOV: Camera, f32 = \"4.1\", \"fov\", Floats(&[90.0]),\n        \"help\";\n    COLOR: Object, Color = \"4.4.4\", \"C\", X, \"y\";\n";
        let names = names(table);
        assert_eq!(names, ["fov"]);
        let text = "camera.get(\"fov\"); // read\n// get(\"fov\")\nset(declared(\"float fov\", 1.0)); other(\"fov\")\n\
                    get(\"C\");\n#[cfg(test)]\nget(\"fov\")\n";
        assert_eq!(by_text(text, &names), [(1, "fov"), (3, "fov")]);
    }
}
