//! Installs the suite, and compiles the examples in C++.

mod races;

use crate::files::{copy, made, repository, run, target};
use crate::home;
pub(crate) use races::races;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Builds tools and libraries, and returns their folder.
fn build(tools: &[&'static str], debug: bool) -> Result<PathBuf, String> {
    let mut words = vec!["build", "--bins", "--lib"];
    words.extend(tools.iter().flat_map(|tool| ["--package", tool]));
    words.extend(["--package", "libgelato", "--package", "libgsoargs", "--package", "libgranita-texture"]);
    if !debug {
        words.push("--release");
    }
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    run(Command::new(cargo).current_dir(repository()).args(words))?;
    Ok(target().join(if debug { "debug" } else { "release" }))
}

/// Runs `install --prefix P`: writes the layout of `$GELATOHOME`.
pub(crate) fn install(prefix: &Path, debug: bool) -> Result<(), String> {
    home::lay_out(prefix, &build(&[home::PROGRAM], debug)?)?;
    println!("installed; export GELATOHOME={}", prefix.display());
    Ok(())
}

/// Runs `examples-cpp`: compiles the examples into `target/examples-cpp`.
pub(crate) fn examples(debug: bool) -> Result<(), String> {
    let (root, built) = (repository(), build(&["gelato", "topyg"], debug)?);
    let out = made(built.parent().unwrap_or(&built).join("examples-cpp"))?;
    let source = root.join("examples/cpp");
    let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".to_owned());
    let compile = |file: &str, words: &[&str]| {
        let mut command = Command::new(&compiler);
        command.args(["-O2", "-Wall", "-I"]).arg(root.join("bindings/cpp/include"));
        command.current_dir(&out).arg(source.join(file)).args(words);
        run(&mut command)
    };
    let (folder, path) = (format!("-L{}", built.display()), format!("-Wl,-rpath,{}", built.display()));
    for program in ["scene", "callback"] {
        compile(&format!("{program}.cpp"), &["-o", program, &folder, "-lgelato", &path])?;
    }
    for (file, plugin) in
        [("spiral.cpp", "spiral.generator.so"), ("fmap.cpp", "fmap.imageio.so"), ("fbm.cpp", "fbm.so")]
    {
        compile(file, &["-shared", "-fPIC", "-o", plugin])?;
    }
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let words = ["--edition", "2024", "--crate-type", "cdylib", "-C", "panic=abort", "-A", "warnings"];
    let mut command = Command::new(rustc);
    command.current_dir(&out).args(words).args(["-o", "steps.generator.so"]).arg(source.join("steps.rs"));
    run(&mut command)?;
    for file in ["marble.gsl", "plugins.pyg"] {
        copy(&source.join(file), &out)?;
    }
    println!("compiled into {}", out.display());
    Ok(())
}

/// Runs `crossing`: measures the cost of calls from C++ (`benches/cpp/crossing.cpp`).
pub(crate) fn crossing(debug: bool) -> Result<(), String> {
    let (root, built) = (repository(), build(&["gelato", "topyg"], debug)?);
    let out = made(built.parent().unwrap_or(&built).join("examples-cpp"))?;
    let compiler = std::env::var("CXX").unwrap_or_else(|_| "c++".to_owned());
    let (folder, path) = (format!("-L{}", built.display()), format!("-Wl,-rpath,{}", built.display()));
    let mut command = Command::new(&compiler);
    command.args(["-O2", "-w", "-std=c++11", "-I"]).arg(root.join("bindings/cpp/include"));
    command.current_dir(&out).arg(root.join("benches/cpp/crossing.cpp"));
    run(command.args(["-o", "crossing", &folder, "-lgelato", &path]))?;
    run(Command::new(out.join("crossing")).current_dir(&out))
}
