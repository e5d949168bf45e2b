//! Checks that attributes are not read or set by text. Programs name attributes by the keys of `granita_scene::attr`,
//! so that a misspelled name or a different type does not compile.

use crate::source::{Kind, Source};
use std::path::Path;

/// The file that defines the attributes.
const TABLE: &str = "libs/scene/src/attribute/table.rs";

/// The mark on the line, or in comments above it, that justifies a text.
const MARK: &str = "tidy: attribute: ";

/// The functions whose first text argument names a value.
const CALLS: [&str; 10] = [
    "get",
    "float",
    "floats",
    "int",
    "string",
    "attribute",
    "declared",
    "lookup",
    "attribute_row",
    "attribute_default",
];

/// The names of attributes that are also names of primitive variables and of parameters of commands.
const ALSO_VARIABLES: [&str; 3] = ["C", "opacity", "name"];

/// The crates for images, below scenes. They read attributes of images only.
const BELOW: [&str; 5] = ["libs/base", "libs/image", "formats/exr", "formats/tiff", "formats/raster"];

/// Returns all breaches, one line each.
///
/// # Errors
/// Returns an error when there is no table of attributes.
pub(crate) fn check(sources: &[Source]) -> Result<Vec<String>, String> {
    let table = sources.iter().find(|source| source.file == Path::new(TABLE));
    let names = names(&table.ok_or_else(|| format!("no {TABLE}"))?.text);
    if names.is_empty() {
        return Err(format!("{TABLE} has no names of attributes"));
    }
    let mut faults = Vec::new();
    for source in sources {
        let is_inside =
            ["libs", "formats", "tools", "bindings"].iter().any(|folder| source.file.starts_with(folder));
        let exempt =
            BELOW.iter().any(|folder| source.file.starts_with(folder)) || source.file == Path::new(TABLE);
        if !is_inside || exempt {
            continue;
        }
        // In the crate that defines the names, only calls are checked.
        let is_home = source.file.starts_with("libs/scene");
        for (line, name) in by_text(source, &names, !is_home) {
            let file = source.file.display();
            faults.push(format!(
                "{file}:{line}: \"{name}\" by a text; attr has a key for it (or `// {MARK}REASON`)"
            ));
        }
    }
    Ok(faults)
}

/// Returns the names in the table: the second text of each `"section", "name", `.
fn names(table: &str) -> Vec<&str> {
    let rows = table.lines().filter_map(|line| line.split_once(" = \"")?.1.split_once("\", \""));
    let names = rows.filter_map(|(_, rest)| Some(rest.split_once('"')?.0));
    names.filter(|name| !ALSO_VARIABLES.contains(name)).collect()
}

/// Returns the lines, counted from 1, that name an attribute by text, and the names. With `anywhere`, a name with a
/// colon counts in any place, with or without a type. A name without a colon, which may be an ordinary word, counts
/// only in calls that take names.
fn by_text<'a>(source: &Source, names: &[&'a str], anywhere: bool) -> Vec<(usize, &'a str)> {
    let mut found = Vec::new();
    for (at, token) in source.code.iter().enumerate() {
        let Kind::Text(text) = &token.kind else { continue };
        // The text has the form "int twosided" or "twosided".
        let word = match text.split(' ').collect::<Vec<_>>().as_slice() {
            [.., last] if text.split(' ').count() <= 2 => *last,
            _ => continue,
        };
        let Some(name) = names.iter().find(|name| **name == word) else { continue };
        let before: Vec<&Kind> = source.code[..at]
            .iter()
            .rev()
            .map(|t| &t.kind)
            .skip_while(|k| **k == Kind::Sign('&'))
            .take(2)
            .collect();
        let is_argument = matches!(before.as_slice(), [Kind::Sign('('), Kind::Word(call)] if CALLS.contains(&call.as_str()));
        if (anywhere && name.contains(':') || is_argument) && !source.is_marked(token.line, MARK) {
            found.push((token.line, *name));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attribute_names_in_strings_are_found() {
        let table = "    FOV: Camera, f32 = \"4.1\", \"fov\", Floats(&[90.0]),\n        \"help\";\n    COLOR: Object, Color = \"4.4.4\", \"C\", X, \"y\";\n    \
                     CURVATURE: Object, f32 = \"4\", \"dice:curvature\", X, \"y\";\n";
        let names = names(table);
        assert_eq!(names, ["fov", "dice:curvature"]);
        let text = "fn f() { camera.get(\"fov\"); // read\n// get(\"fov\")\nset(declared(&\"float fov\", 1.0)); other(\"fov\");\n\
                    get(\"C\");\nlet read = |name: &str| get(name); read(\"dice:curvature\");\nsay(\"no dice:curvature here\");\n\
                    // tidy: attribute: a message of the other side\nread(\"dice:curvature\"); }\n\
                    #[cfg(test)]\nfn t() { get(\"fov\") }\n\
                    const A: [&str; 1] = [\"float dice:curvature\"];";
        let source = Source::new("libs/x/src/a.rs".into(), text.to_owned()).unwrap();
        let expected = [(1, "fov"), (3, "fov"), (5, "dice:curvature"), (11, "dice:curvature")];
        assert_eq!(by_text(&source, &names, true), expected);
        assert_eq!(by_text(&source, &names, false), expected[..2]);
    }
}
