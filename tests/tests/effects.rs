//! Compares the effects in the attribute table with the sources. An attribute with an effect must be read by its key or
//! named in the sources. An attribute without an effect must not occur in them.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_scene::attribute::{Effect, Scope, TABLE};
use granita_tests::repository;
use std::path::Path;

/// Appends all sources of these folders except tests.
fn sources(folder: &Path, text: &mut String) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "tests" {
            sources(&path, text);
        } else if name.ends_with(".rs")
            && !["tests.rs", "fixture.rs", "attribute.rs", "table.rs"].contains(&name.as_str())
        {
            let source = std::fs::read_to_string(&path).unwrap();
            // Unit tests are at the end of a file. Comments may name attributes.
            let code = source.split("#[cfg(test)]").next().unwrap();
            let code = code.lines().filter(|l| !l.trim_start().starts_with("//"));
            code.for_each(|line| {
                text.push_str(line);
                text.push('\n');
            });
        }
    }
}

/// The attributes whose effect is not visible in the sources. They are read by shaders, or have only one possible
/// value.
const ELSEWHERE: [&str; 2] = ["pass", "hider"];

/// Returns the key of an attribute, as programs write it.
fn key(name: &str) -> String {
    let name = if name == "C" { "color" } else { name };
    format!("attr::{}", name.replace(':', "_").to_uppercase())
}

#[test]
fn the_attribute_table_lists_hints_correctly() {
    let mut text = String::new();
    for folder in [
        "libs/dicing/src",
        "libs/hider/src",
        "libs/rays/src",
        "libs/shading/src",
        "libs/render/src",
        "libs/scene/src",
        "libs/session/src",
        "libs/texture/src",
        "formats/pyg/src",
        "tools/topyg/src",
    ] {
        sources(&repository().join(folder), &mut text);
    }
    let mut wrong = Vec::new();
    for row in TABLE.iter().filter(|row| row.scope != Scope::ReadOnly && !ELSEWHERE.contains(&row.name)) {
        let word = |c: char| c.is_alphanumeric() || c == '_';
        let key = key(row.name);
        let asked = text.match_indices(&key).any(|(at, _)| !text[at + key.len()..].starts_with(word));
        let named = asked || text.contains(&format!("\"{}\"", row.name));
        match row.effect {
            Effect::Full if !named => wrong.push(format!("{} has no effect", row.name)),
            Effect::Hint if named => wrong.push(format!("{} has an effect", row.name)),
            _ => (),
        }
    }
    assert!(wrong.is_empty(), "libs/scene/src/attribute.rs is not what the sources say: {wrong:#?}");
}
