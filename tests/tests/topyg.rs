//! Tests that the output of `topyg` renders to the same bits as its input, for every scene of the suite and the
//! examples.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Tools, repository};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Adds all folders under `top` with scenes that render, and the names of those scenes.
fn scenes(top: &Path, found: &mut Vec<(PathBuf, Vec<String>)>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(top).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    let renders = |path: &PathBuf| {
        path.extension().is_some_and(|e| e == "pyg")
            && std::fs::read(path).is_ok_and(|bytes| String::from_utf8_lossy(&bytes).contains("Render"))
    };
    let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
    // The scenes run in reverse order, so that a pass for shadows comes before the scene that needs it.
    let mine: Vec<String> = entries.iter().rev().filter(|p| renders(p)).map(name).collect();
    if !mine.is_empty() {
        found.push((top.to_owned(), mine));
    }
    entries.iter().filter(|p| p.is_dir()).for_each(|folder| scenes(folder, found));
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            std::fs::copy(&path, &target).unwrap();
        }
    }
}

/// Returns the contents of all files except scenes, by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let files = entries.filter(|p| p.is_file() && p.extension().is_none_or(|e| e != "pyg"));
    files
        .map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(p).unwrap()))
        .collect()
}

#[test]
fn scenes_converted_by_topyg_render_to_the_same_bits() {
    let mut all = Vec::new();
    scenes(&repository().join("tests/suite"), &mut all);
    assert!(all.len() > 10, "{}", all.len());
    check(&all);
}

#[test]
fn examples_converted_by_topyg_render_to_the_same_bits() {
    check_examples(&["caustics", "indirect"]);
}

#[test]
#[ignore = "the examples take ten minutes"]
fn all_examples_converted_by_topyg_render_to_the_same_bits() {
    check_examples(&[
        "caustics",
        "envlight",
        "first",
        "indirect",
        "occlusion",
        "relight",
        "shadows",
        "subsurface",
    ]);
}

/// Renders examples as they are and converted. They run in the root of a checkout, and their images are in `out`.
fn check_examples(names: &[&str]) {
    let tools = Tools::build().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    for name in names {
        let mut first: Option<BTreeMap<String, Vec<u8>>> = None;
        for convert in [false, true] {
            let place = scratch.path().join(format!("{name}-{convert}"));
            copy(&repository().join("examples"), &place.join("examples"));
            let folder = place.join("examples").join(name);
            let _ = std::fs::remove_dir_all(folder.join("out"));
            if convert {
                let mut found = Vec::new();
                scenes(&folder, &mut found);
                let passes: Vec<String> = found.into_iter().flat_map(|(_, passes)| passes).collect();
                for scene in passes {
                    let scene = format!("examples/{name}/{scene}");
                    let ran = tools.run(&place, "topyg", &[&scene, "-o", "made.pyg"]).unwrap();
                    assert_eq!(ran.status, 0, "{scene}");
                    std::fs::rename(place.join("made.pyg"), place.join(&scene)).unwrap();
                }
            }
            // The scene with the name of its folder runs all passes.
            let scene = format!("examples/{name}/{name}.pyg");
            let words = ["-threads", "2", "-crop", "0.4", "0.6", "0.45", "0.6", &scene];
            let ran = tools.run(&place, "gelato", &words).unwrap();
            assert_eq!(ran.status, 0, "{scene}");
            let made = files(&folder.join("out"));
            assert!(!made.is_empty(), "{name}");
            let wanted = first.get_or_insert_with(|| made.clone());
            assert!(made.keys().eq(wanted.keys()), "{name}: {:?}", made.keys());
            for (file, bytes) in &made {
                assert!(*bytes == wanted[file], "{name}: {file} differs");
            }
        }
    }
}

/// Tests external scenes in the folder that the variable names.
#[test]
fn external_scenes_converted_by_topyg_render_to_the_same_bits() {
    let Some(top) = std::env::var_os("GRANITA_SCENES") else {
        return granita_needs::skip("GRANITA_SCENES (a folder of scenes besides those of the tree)");
    };
    let mut all = Vec::new();
    scenes(Path::new(&top), &mut all);
    assert!(!all.is_empty(), "no scene in {}", Path::new(&top).display());
    check(&all);
}

fn check(all: &[(PathBuf, Vec<String>)]) {
    let tools = Tools::build().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    for (n, (folder, names)) in all.iter().enumerate() {
        let mut first: Option<(BTreeMap<String, Vec<u8>>, String)> = None;
        let ways: [Option<&[&str]>; 4] = [None, Some(&[]), Some(&["-binary"]), Some(&["-separateparams"])];
        for (way, options) in ways.iter().enumerate() {
            let place = scratch.path().join(format!("{n}-{way}"));
            copy(folder, &place);
            let mut said = String::new();
            for name in names {
                if let Some(options) = options {
                    // The scene keeps its name, because messages and automatic outputs contain it.
                    let words = [*options, &[name, "-o", "made.pyg"]].concat();
                    let ran = tools.run(&place, "topyg", &words).unwrap();
                    // Scenes that cannot be read completely test something else, and are not changed.
                    if ran.status != 2 {
                        std::fs::rename(place.join("made.pyg"), place.join(name)).unwrap();
                    }
                }
                // The middle of the image is enough, because the objects are there.
                let words = ["-threads", "2", "-crop", "0.4", "0.6", "0.45", "0.6", name];
                let ran = tools.run(&place, "gelato", &words).unwrap();
                said += &format!("{name}: {}\n", ran.status);
            }
            let made = (files(&place), said);
            match &first {
                None => first = Some(made),
                Some((wanted, said)) => {
                    let shown = format!("{} {options:?}", folder.display());
                    // A call that was left out when the scene was read is missing in the copy, and causes no error
                    // there.
                    let good = |said: &str| said.replace(": 1", ": 0");
                    assert_eq!(good(&made.1), good(said), "{shown}");
                    assert!(made.0.keys().eq(wanted.keys()), "{shown}: {:?}", made.0.keys());
                    for (name, bytes) in &made.0 {
                        assert!(*bytes == wanted[name], "{shown}: {name} differs");
                    }
                }
            }
        }
    }
}
