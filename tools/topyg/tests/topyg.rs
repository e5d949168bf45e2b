//! The tool from outside.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use std::path::Path;
use std::process::{Command, Output, Stdio};

fn topyg(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_topyg"))
        .args(args)
        .current_dir(folder)
        .env_remove("PYG_ALWAYS_PYGLET")
        .env_remove("PYG_NEVER_PYGLET")
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    files.iter().for_each(|(name, text)| std::fs::write(dir.path().join(name), text).unwrap());
    dir
}

#[test]
fn expands_inputs_to_the_depth_asked() {
    let dir = folder(&[
        ("a.pyg", "World ()\nInput ('b.pyg')\nInput (\"b.pyg\", (-1, 1, -1, 1, -1, 1))\nRender ()\n"),
        ("b.pyg", "Translate (1, 2, 3)\nInput ('c.pyg')\n"),
        ("c.pyg", "Sphere (1, -1, 1, 360)"),
    ]);
    let text = |args: &[&str]| {
        let out = topyg(dir.path(), args);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    assert_eq!(
        text(&["a.pyg"]),
        "World ()\nInput (\"b.pyg\")\nInput (\"b.pyg\", (-1, 1, -1, 1, -1, 1))\nRender ()\n"
    );
    assert_eq!(
        text(&["-r", "1", "a.pyg"]),
        "World ()\nTranslate (1, 2, 3)\nInput (\"c.pyg\")\nPushAttributes ()\nTranslate (1, 2, 3)\nInput (\"c.pyg\")\nPopAttributes ()\nRender ()\n"
    );
    assert!(!text(&["-r", "2", "a.pyg"]).contains("Input"));
    assert_eq!(text(&["pyg << World ()", "pyg < echo 'Render ()'"]), "World ()\nRender ()\n");
}

#[test]
fn files_appear_whole_or_not_at_all() {
    let dir = folder(&[("good.pyg", "World ()\n"), ("bad.pyg", "x = 1\n")]);
    let out = topyg(dir.path(), &["good.pyg", "-o", "out.pyg"]);
    assert!(out.status.success() && out.stdout.is_empty());
    assert_eq!(std::fs::read_to_string(dir.path().join("out.pyg")).unwrap(), "World ()\n");
    let out = Command::new(env!("CARGO_BIN_EXE_topyg"))
        .args(["good.pyg", "bad.pyg", "-o", "none.pyg"])
        .current_dir(dir.path())
        .env("PYG_ALWAYS_PYGLET", "1")
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(2));
    let mut left: Vec<_> = std::fs::read_dir(dir.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(left, ["bad.pyg", "good.pyg", "out.pyg"]);
}

#[test]
fn mistakes_have_exit_codes() {
    let dir = folder(&[("a.pyg", "Sphere (1)\nWorld ()\n")]);
    let out = topyg(dir.path(), &["a.pyg"]);
    assert_eq!(out.status.code(), Some(1));
    assert_eq!(out.stdout, b"World ()\n");
    let told = String::from_utf8(out.stderr).unwrap();
    assert!(told.starts_with("topyg: a.pyg:1: error: Sphere is called without zmin"), "{told}");
    let out = topyg(dir.path(), &["missing.pyg"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&out.stderr).contains("missing.pyg"));
    assert_eq!(topyg(dir.path(), &[]).status.code(), Some(2));
    let out = topyg(dir.path(), &["grass 0 0 1"]);
    assert_eq!(out.status.code(), Some(2));
}

#[test]
fn a_closed_pipe_is_success() {
    let dir = folder(&[("a.pyg", &"Sphere (1, -1, 1, 360)\n".repeat(200_000))]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_topyg"))
        .arg("a.pyg")
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let out = child.wait_with_output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(out.stderr.is_empty());
}
