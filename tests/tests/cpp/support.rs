//! Compilers, libraries and listings for the tests of the C++ interface.

use granita_tests::{Tools, has_program, repository};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

/// The tools and libraries of this build.
pub(crate) static BUILT: LazyLock<Tools> =
    LazyLock::new(|| Tools::build_also(&["libgelato", "libgsoargs", "libgranita-texture"]).unwrap());

/// Returns the C++ compilers that are installed.
pub(crate) fn compilers() -> Vec<&'static str> {
    let found: Vec<&str> = ["g++", "clang++"].into_iter().filter(|c| has_program(c)).collect();
    assert!(!found.is_empty(), "the build needs a C++ compiler");
    found
}

/// Returns the folder of the headers.
pub(crate) fn headers() -> PathBuf {
    repository().join("bindings/cpp/include")
}

fn checked(mut command: Command) {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
}

/// Returns the folder of the tests' own programs and headers.
pub(crate) fn own_folder() -> PathBuf {
    repository().join("tests/cpp")
}

/// Compiles a program against a library of the suite.
pub(crate) fn program(compiler: &str, source: &Path, library: &str) -> PathBuf {
    let program = source.with_extension(compiler);
    let folder = BUILT.folder().to_str().unwrap().to_owned();
    let mut command = Command::new(compiler);
    command.arg("-w").arg(source).arg("-o").arg(&program);
    command.arg("-I").arg(headers()).arg("-I").arg(own_folder()).args([
        &format!("-L{folder}"),
        &format!("-l{library}"),
        &format!("-Wl,-rpath,{folder}"),
        "-pthread",
        "-lm",
    ]);
    checked(command);
    program
}

/// Compiles a plugin into a file of this name beside its source.
pub(crate) fn plugin(compiler: &str, source: &Path, name: &str, arguments: &[&str]) -> PathBuf {
    let plugin = source.with_file_name(name);
    let mut command = Command::new(compiler);
    command.args(["-w", "-shared", "-fPIC", "-o"]).arg(&plugin).arg("-I").arg(headers());
    command.arg(source).args(arguments);
    checked(command);
    plugin
}

/// Runs a program in a folder.
pub(crate) fn run(program: &Path, folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(program);
    command.current_dir(folder).args(arguments).env("GELATOHOME", folder);
    command.output().unwrap()
}

/// Runs a tool in a folder whose plugins it may use. Returns its status, standard output and standard error.
pub(crate) fn tool(name: &str, folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    match name {
        "gsoinfo" => plain_tool(name, folder, arguments),
        _ => plain_tool(name, folder, &[&["-plugins", "."], arguments].concat()),
    }
}

/// Runs a tool without options for plugins. Returns its status, standard output and standard error.
pub(crate) fn plain_tool(name: &str, folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let ran = run(&BUILT.program(name), folder, arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (ran.status.code().unwrap_or(-1), text(&ran.stdout), text(&ran.stderr))
}

/// Copies a source of the tests into a folder, and returns its path.
pub(crate) fn own(folder: &Path, name: &str) -> PathBuf {
    let to = folder.join(name);
    std::fs::copy(own_folder().join(name), &to).unwrap();
    to
}

/// Returns a chapter of the reference. Without the reference beside the checkout, the test is reported as skipped, and
/// the result is `None`.
pub(crate) fn chapter(file: &str) -> Option<String> {
    let places = ["../shared/spec", "../../shared/spec"];
    let found = places.iter().map(|p| repository().join(p).join(file)).find(|p| p.is_file());
    if found.is_none() {
        granita_needs::skip("shared/spec (the reference, whose programs are tested)");
    }
    Some(std::fs::read_to_string(found?).unwrap())
}

/// Returns the listing of a chapter from its line `from` to the line `to`, or to the end. The pages between ``` are
/// joined, without the braces that the scan put at the end of pages.
pub(crate) fn listing(chapter: &str, after: &str, from: &str, to: Option<&str>) -> String {
    let text = &chapter[chapter.find(after).unwrap()..];
    let text = &text[text.find(from).unwrap()..];
    let text = to.map_or(text, |to| &text[..text.find(to).unwrap()]);
    let pages: Vec<&str> = text.split("```").step_by(2).collect();
    let suspects: Vec<usize> =
        (0..pages.len() - 1).filter(|&i| pages[i].trim_end().ends_with("\n}")).collect();
    let joined = |drop: u32| {
        let mut all = String::new();
        for (i, page) in pages.iter().enumerate() {
            let noise = suspects.iter().position(|s| *s == i).is_some_and(|k| drop >> k & 1 == 1);
            let page = page.trim_end();
            all += if noise { page.strip_suffix('}').unwrap() } else { page };
            all += "\n";
        }
        all
    };
    let mut ways: Vec<u32> = (0..1 << suspects.len()).collect();
    ways.sort_by_key(|way| way.count_ones());
    ways.into_iter().map(joined).find(|text| balanced(text)).expect("some way is balanced")
}

fn balanced(text: &str) -> bool {
    let mut depth = 0;
    for c in text.chars() {
        depth += match c {
            '{' => 1,
            '}' => -1,
            _ => 0,
        };
        if depth < 0 {
            return false;
        }
    }
    depth == 0
}

/// Runs a program under valgrind, if that is installed. The program must succeed without memory errors.
pub(crate) fn valgrind(program: &Path, folder: &Path) {
    if !granita_needs::has("valgrind") {
        return;
    }
    let output = Command::new("valgrind")
        .current_dir(folder)
        .args(["--error-exitcode=99", "--leak-check=full", "--errors-for-leak-kinds=definite", "--quiet"])
        .arg(program)
        .env("GELATOHOME", folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
