//! Installs the suite, and compiles the examples in C++.

mod races;

pub(crate) use races::races;
use std::path::{Path, PathBuf};
use std::process::Command;

const TOOLS: [&str; 6] = ["gelato", "maketx", "gslc", "gsoinfo", "topyg", "iv"];
const LIBRARIES: [&str; 2] = ["gelato", "gsoargs"];

/// Returns the root of the checkout.
fn repository() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_owned()
}

/// Builds tools and libraries, and returns their folder.
fn build(tools: &[&'static str], debug: bool) -> Result<PathBuf, String> {
    let mut words = vec!["build", "--bins", "--lib"];
    words.extend(tools.iter().flat_map(|tool| ["--package", tool]));
    words.extend(["--package", "libgelato", "--package", "libgsoargs"]);
    if !debug {
        words.push("--release");
    }
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    run(Command::new(cargo).current_dir(repository()).args(words))?;
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| repository().join("target"), PathBuf::from);
    Ok(target.join(if debug { "debug" } else { "release" }))
}

fn run(command: &mut Command) -> Result<(), String> {
    let status = command.status().map_err(|e| format!("{command:?}: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("{command:?}: {status}")) }
}

fn made(folder: PathBuf) -> Result<PathBuf, String> {
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(folder)
}

/// Copies a file. An existing file is replaced and not written into, because it may be running.
fn copy(from: &Path, folder: &Path) -> Result<(), String> {
    let to = folder.join(from.file_name().unwrap_or_default());
    let beside = to.with_extension("new");
    let copied = std::fs::copy(from, &beside).and_then(|_| std::fs::rename(&beside, &to));
    copied.map_err(|e| format!("{} to {}: {e}", from.display(), to.display()))
}

/// Copies the files of a folder whose names end with `ending`.
fn copy_all(from: &Path, folder: &Path, ending: &str) -> Result<(), String> {
    let entries = std::fs::read_dir(from).map_err(|e| format!("{}: {e}", from.display()))?;
    for entry in entries {
        let path = entry.map_err(|e| e.to_string())?.path();
        if path.is_file() && path.to_string_lossy().ends_with(ending) {
            copy(&path, folder)?;
        }
    }
    Ok(())
}

/// Runs `install --prefix P`: writes the layout of `$GELATOHOME`.
pub(crate) fn install(prefix: &Path, debug: bool) -> Result<(), String> {
    let (root, built) = (repository(), build(&TOOLS, debug)?);
    let folder = |name: &str| made(prefix.join(name));
    let (bin, lib) = (folder("bin")?, folder("lib")?);
    for tool in TOOLS {
        copy(&built.join(format!("{tool}{}", std::env::consts::EXE_SUFFIX)), &bin)?;
    }
    let (before, after) = (std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    for library in LIBRARIES {
        copy(&built.join(format!("{before}{library}{after}")), &lib)?;
    }
    copy_all(&root.join("bindings/cpp/include"), &folder("include")?, ".h")?;
    let shaders = folder("shaders")?;
    copy_all(&root.join("shaders"), &shaders, ".gsl")?;
    compile_shaders(&bin, &shaders)?;
    copy_all(&root.join("inputs"), &folder("inputs")?, ".pyg")?;
    folder("textures")?;
    let doc = folder("doc")?;
    copy_all(&root.join("docs"), &doc, ".md")?;
    copy_all(&root.join("docs/calls"), &made(doc.join("calls"))?, ".md")?;
    copy_all(&root.join("docs/pictures"), &made(doc.join("pictures"))?, "")?;
    for (file, place) in
        [("gelato.pc", "pkgconfig"), ("gsoargs.pc", "pkgconfig"), ("GelatoConfig.cmake", "cmake/Gelato")]
    {
        let from = root.join(format!("bindings/cpp/package/{file}.in"));
        let text = std::fs::read_to_string(&from).map_err(|e| format!("{}: {e}", from.display()))?;
        let to = made(lib.join(place))?.join(file);
        std::fs::write(&to, text.replace("@VERSION@", env!("CARGO_PKG_VERSION")))
            .map_err(|e| format!("{}: {e}", to.display()))?;
    }
    println!("installed; export GELATOHOME={}", prefix.display());
    Ok(())
}

/// Compiles the shaders, for programs that search `.gso` files in `$GELATOHOME/shaders`.
fn compile_shaders(bin: &Path, shaders: &Path) -> Result<(), String> {
    let bin = std::path::absolute(bin).map_err(|e| e.to_string())?;
    let entries = std::fs::read_dir(shaders).map_err(|e| format!("{}: {e}", shaders.display()))?;
    for entry in entries {
        let path = entry.map_err(|e| e.to_string())?.path();
        if path.extension().is_some_and(|e| e == "gsl") {
            let name = path.file_name().unwrap_or_default();
            run(Command::new(bin.join("gslc")).current_dir(shaders).args(["-verbosity", "0"]).arg(name))?;
        }
    }
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
