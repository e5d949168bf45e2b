//! Tests that run the tool as a process.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test, and says why")]

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
fn inputs_are_expanded_to_the_given_depth() {
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
fn errors_set_the_exit_code() {
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

/// Writes a generator, which is any program along the path. The words after its name are passed to it.
#[cfg(unix)]
fn generator(folder: &Path, place: &str, radius: u32) {
    std::fs::create_dir_all(folder.join(place)).unwrap();
    let file = folder.join(place).join("grow");
    granita_needs::write_script(&file, &format!("echo \"Sphere ({radius}, -$1, $1, 360)\""));
}

#[cfg(unix)]
#[test]
fn generators_are_found_along_the_option_and_the_variable() {
    let dir = folder(&[]);
    generator(dir.path(), "one", 1);
    generator(dir.path(), "two", 2);
    let run = |args: &[&str], variable: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_topyg"));
        command.args(args).current_dir(dir.path()).env_remove("GELATO_GENERATOR_PATH").stdin(Stdio::null());
        command.envs(variable.map(|v| ("GELATO_GENERATOR_PATH", v)));
        let out = command.output().unwrap();
        (out.status.code(), String::from_utf8(out.stdout).unwrap())
    };
    let sphere = |radius: u32| (Some(0), format!("Sphere ({radius}, -7, 7, 360)\n"));
    assert_eq!(run(&["grow 7"], None).0, Some(2), "it is not beside the scene");
    assert_eq!(run(&["-p", "none:one", "grow 7"], None), sphere(1));
    assert_eq!(run(&["-p", "two:one", "grow 7"], None), sphere(2));
    assert_eq!(run(&["grow 7"], Some("one:two")), sphere(1));
    // The option takes precedence.
    assert_eq!(run(&["-p", "two", "grow 7"], Some("one")), sphere(2));
    // The same holds for an Input that is expanded.
    std::fs::write(dir.path().join("a.pyg"), "Input (\"grow 7\")\n").unwrap();
    assert_eq!(run(&["-r", "1", "-p", "one", "a.pyg"], None), sphere(1));
}

#[test]
fn verbose_prints_the_files_that_are_read() {
    let dir = folder(&[("a.pyg", "World ()\nSphere (1, -1, 1, 360)\n")]);
    let told = |args: &[&str]| String::from_utf8(topyg(dir.path(), args).stderr).unwrap();
    assert_eq!(told(&["a.pyg"]), "");
    assert!(told(&["-v", "a.pyg"]).contains("2 calls"), "{}", told(&["-v", "a.pyg"]));
}

/// Tests `PYG_ALWAYS_PYGLET`, `PYG_NEVER_PYGLET` and `PYG_NEVER_CHUNK`. They control whether Python is needed, and how
/// much of a file it gets at once.
#[cfg(unix)]
#[test]
fn environment_variables_choose_the_reader() {
    let dir = folder(&[
        ("flat.pyg", "World ()\n"),
        ("script.pyg", "World ()\nn = 2\nScale (n, n, n)\n"),
        ("wrong.pyg", "World ()\nn = 2\nWorld ()\nn = = 3\n"),
    ]);
    let run = |file: &str, variables: &[(&str, &str)]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_topyg"));
        command.arg(file).current_dir(dir.path()).stdin(Stdio::null());
        for name in ["PYG_ALWAYS_PYGLET", "PYG_NEVER_PYGLET", "PYG_ALWAYS_CHUNK", "PYG_NEVER_CHUNK"] {
            command.env_remove(name);
        }
        let out = command.envs(variables.iter().copied()).output().unwrap();
        (
            out.status.code().unwrap(),
            String::from_utf8(out.stdout).unwrap(),
            String::from_utf8(out.stderr).unwrap(),
        )
    };
    // Without Python, flat files can be read, unless Python is required for them.
    let nowhere = dir.path().join("none");
    let path = ("PATH", nowhere.to_str().unwrap());
    assert_eq!(run("flat.pyg", &[path]).0, 0);
    let (status, _, said) = run("flat.pyg", &[path, ("PYG_NEVER_PYGLET", "1")]);
    assert!(status == 2 && said.contains("python3"), "{said}");
    let (status, _, said) = run("script.pyg", &[path]);
    assert!(status == 2 && said.contains("python3"), "{said}");
    // With Python, scripts are not read when all files must be flat.
    let (status, _, said) = run("script.pyg", &[("PYG_ALWAYS_PYGLET", "1")]);
    assert!(status == 2 && said.contains("only flat scenes are to be read"), "{said}");
    if !granita_needs::has("python3") {
        return;
    }
    let scene = "World ()\nScale (2, 2, 2)\n";
    for variables in
        [&[][..], &[("PYG_NEVER_PYGLET", "1")], &[("PYG_ALWAYS_CHUNK", "1")], &[("PYG_NEVER_CHUNK", "1")]]
    {
        assert_eq!(run("script.pyg", variables).1, scene, "{variables:?}");
    }
    // In chunks, the calls before a syntax error are executed before it is found. With the whole script at once, none
    // of its calls are executed.
    let calls = |variables: &[(&str, &str)]| {
        let out = dir.path().join("out.pyg");
        let _ = std::fs::remove_file(&out);
        run("wrong.pyg", variables).1.matches("World").count()
    };
    assert_eq!(
        (calls(&[]), calls(&[("PYG_ALWAYS_CHUNK", "1")]), calls(&[("PYG_NEVER_CHUNK", "1")])),
        (2, 2, 1)
    );
}

#[test]
fn standard_input_is_read() {
    use std::io::Write;
    let dir = folder(&[("a.pyg", "World ()\n")]);
    for words in [&["a.pyg", "-"][..], &["a.pyg", "pyg -"]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_topyg"))
            .args(words)
            .current_dir(dir.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(b"Render ()\nSphere (1)\n").unwrap();
        let out = child.wait_with_output().unwrap();
        let told = String::from_utf8(out.stderr).unwrap();
        assert_eq!((out.status.code(), &out.stdout[..]), (Some(1), &b"World ()\nRender ()\n"[..]), "{told}");
        assert!(told.starts_with("topyg: <stdin>:2: error: Sphere is called without zmin"), "{told}");
    }
}

#[test]
fn a_missing_folder_for_temporary_files_is_reported() {
    let dir = folder(&[("a.pyg", "World ()\n")]);
    let run = |temporary: &str| {
        let out = Command::new(env!("CARGO_BIN_EXE_topyg"))
            .arg("a.pyg")
            .current_dir(dir.path())
            .env("GELATOTEMP", temporary)
            .output()
            .unwrap();
        assert_eq!(out.stdout, b"World ()\n");
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let (status, told) = run("nosuch");
    assert!(status == Some(0) && told.contains("GELATOTEMP: \"nosuch\" is no folder"), "{told}");
    assert_eq!(run("."), (Some(0), String::new()));
}
