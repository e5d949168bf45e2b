//! Tests `libgranita_texture` from C and from Python.

use crate::support::*;
use granita_tests::repository;
use std::process::{Command, Stdio};

/// Makes the texture of the examples in a folder.
fn bricks(folder: &std::path::Path) {
    let image = repository().join("examples/first/brick.png").display().to_string();
    let (status, _, err) = tool("maketx", folder, &["-mode", "periodic", &image, "-o", "brick.tx"]);
    assert_eq!((status, err.as_str()), (0, ""));
}

#[test]
fn the_example_in_c_looks_up_a_texture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bricks(at);
    let source = at.join("lookup.c");
    std::fs::copy(repository().join("examples/texture-c/lookup.c"), &source).unwrap();
    for compiler in compilers() {
        let made = program(if compiler == "g++" { "gcc" } else { "clang" }, &source, "granita_texture");
        let ran = run(&made, at, &["brick.tx"]);
        let text = String::from_utf8_lossy(&ran.stdout).into_owned();
        assert!(ran.status.success() && ran.stderr.is_empty(), "{}", String::from_utf8_lossy(&ran.stderr));
        let rows: Vec<&str> = text.lines().collect();
        assert_eq!(rows[0], "512 x 512, 1 channels of uint8, 10 levels");
        assert!(rows.len() == 25 && rows[1..].iter().all(|row| row.len() == 64), "{text}");
        let kinds: std::collections::BTreeSet<char> = rows[1..].join("").chars().collect();
        assert!(kinds.len() > 2, "{text}");
        let ran = run(&made, at, &["none.tx"]);
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert!(ran.status.code() == Some(1) && said.contains("texture \"none.tx\" not found"), "{said}");
    }
}

/// A program in C calls every function, also with arguments that are not valid, and from many threads.
#[test]
fn every_function_of_the_texture_library_works_from_c() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    bricks(at);
    let source = own(at, "texture.c");
    for compiler in compilers() {
        let made = program(if compiler == "g++" { "gcc" } else { "clang" }, &source, "granita_texture");
        let ran = run(&made, at, &[]);
        assert!(ran.status.success(), "{compiler}: {}", String::from_utf8_lossy(&ran.stderr));
        if compiler == "g++" {
            valgrind(&made, at);
        }
    }
}

#[test]
fn the_python_module_of_textures_passes_its_tests() {
    if !granita_needs::has("python3") {
        return;
    }
    let name = format!("{}granita_texture{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let ran = Command::new("python3")
        .args(["-m", "unittest", "discover", "-p", "test_texture*.py", "-s"])
        .arg(repository().join("bindings/python/tests"))
        .current_dir(repository())
        .env("GELATO", BUILT.program("gelato"))
        .env("GRANITA_TEXTURE_LIB", BUILT.folder().join(name))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let numpy = Command::new("python3").args(["-c", "import numpy"]).stderr(Stdio::null()).status().unwrap();
    if !numpy.success() {
        granita_needs::skip("numpy (arrays of numpy in the Python module of textures)");
    }
}
