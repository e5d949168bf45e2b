//! The attribute table says of each attribute whether anything comes of setting it. Here that is held against the
//! sources: what has an effect is named somewhere, what is said to have none is named nowhere.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_scene::attribute::{Effect, Scope, TABLE};
use granita_tests::repository;
use std::path::Path;

/// All sources of these folders but tests.
fn sources(folder: &Path, text: &mut String) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "tests" {
            sources(&path, text);
        } else if name.ends_with(".rs")
            && !["tests.rs", "fixture.rs", "attribute.rs"].contains(&name.as_str())
        {
            let source = std::fs::read_to_string(&path).unwrap();
            // Unit tests stand last in a file; comments name attributes freely.
            let code = source.split("#[cfg(test)]").next().unwrap();
            let code = code.lines().filter(|l| !l.trim_start().starts_with("//"));
            code.for_each(|line| {
                text.push_str(line);
                text.push('\n');
            });
        }
    }
}

/// Attributes whose effect does not show by name: asked for by shaders, or named in pieces.
const ELSEWHERE: [&str; 6] =
    ["pass", "hider", "preview:spatialquality", "preview:temporalquality", "preview:dofquality", "dynamic"];

#[test]
fn the_table_knows_what_has_an_effect() {
    let mut text = String::new();
    for folder in [
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
        let named = text.contains(&format!("\"{}\"", row.name));
        match row.effect {
            Effect::Full if !named => wrong.push(format!("{} has no effect", row.name)),
            Effect::Hint if named => wrong.push(format!("{} has an effect", row.name)),
            _ => (),
        }
    }
    assert!(wrong.is_empty(), "libs/scene/src/attribute.rs is not what the sources say: {wrong:#?}");
}
