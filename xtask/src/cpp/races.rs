//! `races`: renderers, handlers and images of a program in several threads, watched by ThreadSanitizer.

use super::{made, repository, run};
use std::path::{Path, PathBuf};
use std::process::Command;

/// What this check needs and cannot do without, if that is missing.
fn missing(sysroot: &Path, compiler: &str, out: &Path) -> Option<String> {
    if !sysroot.join("lib/rustlib/src/rust/library/std").is_dir() {
        return Some("the sources of Rust's standard library (rustup component add rust-src)".to_owned());
    }
    let source = out.join("empty.cpp");
    std::fs::write(&source, "int main () { return 0; }\n").ok()?;
    let mut command = Command::new(compiler);
    let made = command.args(["-fsanitize=thread", "-o"]).arg(out.join("empty")).arg(&source).output();
    match made {
        Ok(made) if made.status.success() => None,
        _ => Some(format!("{compiler}'s own library of ThreadSanitizer (-fsanitize=thread)")),
    }
}

/// What a program answers.
fn answer(program: &str, words: &[&str]) -> Result<String, String> {
    let output = Command::new(program)
        .current_dir(repository())
        .args(words)
        .output()
        .map_err(|e| format!("{program}: {e}"))?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Builds `libgelato` and the standard library below it for ThreadSanitizer, and runs `tests/cpp/threads.cpp` on it.
pub(crate) fn races() -> Result<(), String> {
    let root = repository();
    let variable = |name: &str, else_: &str| std::env::var(name).unwrap_or_else(|_| else_.to_owned());
    let (compiler, rustc) = (variable("CXX", "c++"), variable("RUSTC", "rustc"));
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from).join("races");
    let out = made(target.join("program"))?;
    let sysroot = PathBuf::from(answer(&rustc, &["--print", "sysroot"])?);
    if let Some(what) = missing(&sysroot, &compiler, &out) {
        println!("races: skipped: {what} is not installed");
        return Ok(());
    }
    let host = answer(&rustc, &["--print", "host-tuple"])?;
    let flags = |name: &str| format!("{name}_{}", host.replace('-', "_"));
    let mut build = Command::new(variable("CARGO", "cargo"));
    build.current_dir(&root).args(["build", "--package", "libgelato", "-Zbuild-std", "--target", &host]);
    build.arg("--target-dir").arg(&target);
    // The sanitizer is no part of a stable compiler's promises; it is a part of the compiler.
    build.env("RUSTC_BOOTSTRAP", "1").env("RUSTFLAGS", "-Zsanitizer=thread");
    build.env(flags("CXXFLAGS"), "-fsanitize=thread").env(flags("CFLAGS"), "-fsanitize=thread");
    run(&mut build)?;
    let library = target.join(&host).join("debug");
    let program = out.join("threads");
    let mut compile = Command::new(&compiler);
    compile.args(["-w", "-g", "-O1", "-std=c++11", "-fsanitize=thread", "-pthread", "-I"]);
    compile.arg(root.join("bindings/cpp/include")).arg(root.join("tests/cpp/threads.cpp"));
    compile.arg("-o").arg(&program).arg(format!("-L{}", library.display())).arg("-lgelato");
    run(compile.arg(format!("-Wl,-rpath,{}", library.display())))?;
    for file in ["talks.gsl", "count.cpp"] {
        let from = root.join("tests/cpp").join(file);
        std::fs::copy(&from, out.join(file)).map_err(|e| format!("{}: {e}", from.display()))?;
    }
    let mut plugin = Command::new(&compiler);
    plugin.args(["-w", "-g", "-O1", "-fsanitize=thread", "-shared", "-fPIC", "-I"]);
    plugin.arg(root.join("bindings/cpp/include")).current_dir(&out).args(["-o", "count.so", "count.cpp"]);
    run(&mut plugin)?;
    let suppressions = root.join("tests/cpp/races.supp");
    let options = format!("exitcode=66 second_deadlock_stack=1 suppressions={}", suppressions.display());
    let status = Command::new(&program)
        .current_dir(&out)
        .env("TSAN_OPTIONS", options)
        .env("GELATOHOME", &out)
        .status();
    match status.map_err(|e| e.to_string())? {
        status if status.success() => {
            println!("races: ThreadSanitizer has nothing to say");
            Ok(())
        }
        status => Err(format!("races: {status}")),
    }
}
