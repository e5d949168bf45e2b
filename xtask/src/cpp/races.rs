//! Runs `races`: renderers, handlers and images of a program in several threads, under ThreadSanitizer.

use crate::files::{made, repository, run};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The status of the program after a report of the sanitizer.
const REPORTED: i32 = 66;

/// Returns the library of the sanitizer, which comes with the compiler.
///
/// # Errors
/// Returns the part that is missing for this check.
fn runtime(sysroot: &Path, host: &str) -> Result<PathBuf, String> {
    if !sysroot.join("lib/rustlib/src/rust/library/std").is_dir() {
        return Err("the sources of Rust's standard library (rustup component add rust-src)".to_owned());
    }
    let folder = sysroot.join("lib/rustlib").join(host).join("lib");
    let files = std::fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut all = files.filter_map(|file| Some(file.ok()?.path()));
    let found = all.find(|path| path.to_string_lossy().ends_with("_rt.tsan.a"));
    found.ok_or_else(|| format!("ThreadSanitizer for {host}"))
}

/// Returns the output of a program.
fn answer(program: &str, words: &[&str]) -> Result<String, String> {
    let output = Command::new(program).current_dir(repository()).args(words).output();
    let output = output.map_err(|e| format!("{program}: {e}"))?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Compiles C++ for the sanitizer. Linking is a separate step, because only the program links the library of the
/// sanitizer.
struct Compiler {
    name: String,
    headers: PathBuf,
    out: PathBuf,
}

impl Compiler {
    fn object(&self, source: &Path, words: &[&str]) -> Result<(), String> {
        let mut command = Command::new(&self.name);
        command.args(["-w", "-g", "-O1", "-std=c++11", "-fsanitize=thread", "-fPIC", "-c", "-I"]);
        run(command.arg(&self.headers).args(words).current_dir(&self.out).arg(source))
    }

    fn link(&self, arguments: &[String]) -> Result<(), String> {
        run(Command::new(&self.name).current_dir(&self.out).args(arguments))
    }

    /// Compiles a shadeop that counts. With `lies` it declares that it may run in several threads, although it may not.
    fn shadeop(&self, lies: bool) -> Result<(), String> {
        let words: &[&str] = if lies { &["-DLIES"] } else { &[] };
        self.object(&repository().join("tests/cpp/count.cpp"), words)?;
        self.link(&["-shared", "-o", "count.so", "count.o"].map(str::to_owned))
    }

    /// Runs the program and returns its status. With `aloud` its output is printed.
    fn run_program(&self, aloud: bool) -> Result<Option<i32>, String> {
        let mut command = Command::new(self.out.join("threads"));
        command.current_dir(&self.out).env("GELATOHOME", &self.out);
        command.env("TSAN_OPTIONS", format!("exitcode={REPORTED}"));
        // The variable may name folders of Cargo with a library without the sanitizer.
        command.env_remove("LD_LIBRARY_PATH");
        let output = command.output().map_err(|e| e.to_string())?;
        if aloud {
            print!("{}", String::from_utf8_lossy(&output.stdout));
            eprint!("{}", String::from_utf8_lossy(&output.stderr));
        }
        Ok(output.status.code())
    }
}

/// Builds `libgelato` and the standard library below it for ThreadSanitizer, and runs `tests/cpp/threads.cpp` on it.
pub(crate) fn races() -> Result<(), String> {
    let root = repository();
    let variable = |name: &str, else_: &str| std::env::var(name).unwrap_or_else(|_| else_.to_owned());
    let rustc = variable("RUSTC", "rustc");
    let sysroot = PathBuf::from(answer(&rustc, &["--print", "sysroot"])?);
    let host = answer(&rustc, &["--print", "host-tuple"])?;
    let runtime = match runtime(&sysroot, &host) {
        Ok(runtime) => runtime,
        Err(what) => {
            println!("races: skipped: {what} is not installed");
            return Ok(());
        }
    };
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
    let target = target.join("races");
    let out = made(target.join("program"))?;
    let flags = |name: &str| format!("{name}_{}", host.replace('-', "_"));
    let mut build = Command::new(variable("CARGO", "cargo"));
    build.current_dir(&root).args(["build", "--package", "libgelato", "-Zbuild-std", "--target", &host]);
    build.arg("--target-dir").arg(&target);
    // The sanitizer comes with the stable compiler but is not part of its stable options.
    build.env("RUSTC_BOOTSTRAP", "1").env("RUSTFLAGS", "-Zsanitizer=thread");
    build.env(flags("CXXFLAGS"), "-fsanitize=thread").env(flags("CFLAGS"), "-fsanitize=thread");
    run(&mut build)?;
    let compiler = Compiler {
        name: variable("CXX", "c++"),
        headers: root.join("bindings/cpp/include"),
        out: out.clone(),
    };
    let tests = root.join("tests/cpp");
    std::fs::copy(tests.join("talks.gsl"), out.join("talks.gsl")).map_err(|e| format!("talks.gsl: {e}"))?;
    compiler.object(&tests.join("threads.cpp"), &[])?;
    let library = target.join(&host).join("debug");
    let mut words =
        vec!["threads.o".to_owned(), "-o".to_owned(), "threads".to_owned(), "-rdynamic".to_owned()];
    words.extend(["-pthread", "-Wl,--whole-archive"].map(str::to_owned));
    words.push(runtime.display().to_string());
    words
        .extend(["-Wl,--no-whole-archive", "-ldl", "-lrt", "-lm", "-lresolv", "-lgelato"].map(str::to_owned));
    words.extend([format!("-L{}", library.display()), format!("-Wl,-rpath,{}", library.display())]);
    compiler.link(&words)?;
    // This checks the sanitizer itself. It must report a plugin that wrongly declares that it may run in several
    // threads.
    compiler.shadeop(true)?;
    if compiler.run_program(false)? != Some(REPORTED) {
        return Err("races: a race that was made on purpose is not reported".to_owned());
    }
    compiler.shadeop(false)?;
    match compiler.run_program(true)? {
        Some(0) => {
            println!("races: ThreadSanitizer has nothing to say");
            Ok(())
        }
        status => Err(format!("races: ended with {status:?}")),
    }
}
