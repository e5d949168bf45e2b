//! Checks law 6: crates below the tools do not read the environment, print or exit.

use crate::source::{Kind, Source, paths};

/// The modules of the standard library, and their names that query or change the process.
const NAMES: [(&str, &[&str]); 3] = [
    (
        "env",
        &[
            "args",
            "args_os",
            "current_dir",
            "current_exe",
            "home_dir",
            "remove_var",
            "set_current_dir",
            "set_var",
            "temp_dir",
            "var",
            "var_os",
            "vars",
            "vars_os",
        ],
    ),
    ("process", &["abort", "exit"]),
    ("io", &["stdin", "stdout", "stderr"]),
];

/// The macros that print.
const MACROS: [&str; 5] = ["dbg", "eprint", "eprintln", "print", "println"];

/// The files that may use a name nevertheless, each with the reason.
const EXCEPTIONS: [(&str, &str, &str); 5] = [
    ("libs/base/src/files/mod.rs", "temp_dir", "the system's folder where no option names another"),
    (
        "libs/machine/src/simd.rs",
        "var_os",
        "tests choose the portable code; not in the tools that are shipped",
    ),
    ("libs/inputs/src/programs.rs", "stderr", "given to programs that a scene starts, as an option asks for"),
    ("libs/inputs/src/inputs.rs", "stdin", "what the user names by \"-\""),
    ("libs/plugin/src/errors.rs", "stderr", "an error manager of C++ that has no session prints"),
];

/// Returns all breaches, one line each.
pub(crate) fn check(sources: &[Source]) -> Vec<String> {
    let mut faults = Vec::new();
    let mut used = [false; EXCEPTIONS.len()];
    for source in sources {
        let below = source.file.starts_with("libs") && !source.file.starts_with("libs/cli");
        if !below && !source.file.starts_with("formats") {
            continue;
        }
        for (line, name) in breaches(source) {
            let excepted =
                |(file, other, _): &(&str, &str, &str)| source.file.ends_with(file) && *other == name;
            match EXCEPTIONS.iter().position(excepted) {
                Some(at) => used[at] = true,
                None => {
                    let file = source.file.display();
                    faults.push(format!(
                        "{file}:{line}: {name}: asks the process or prints below the tools (law 6)"
                    ));
                }
            }
        }
    }
    for ((file, name, _), _) in EXCEPTIONS.iter().zip(used).filter(|(_, used)| !used) {
        faults.push(format!("xtask/src/process.rs: the exception {name} of {file} is not needed"));
    }
    faults
}

/// Returns the lines with calls that a library must not make, and the names.
fn breaches(source: &Source) -> Vec<(usize, String)> {
    let mut found: Vec<(usize, String)> = Vec::new();
    for (line, path) in paths(&source.code) {
        let pair = path.windows(2).find(|pair| {
            NAMES
                .iter()
                .any(|(module, names)| *module == pair[0] && (names.contains(&pair[1]) || pair[1] == "*"))
        });
        found.extend(pair.map(|pair| (line, pair[1].to_owned())));
    }
    for pair in source.code.windows(2) {
        if let (Kind::Word(word), Kind::Sign('!')) = (&pair[0].kind, &pair[1].kind)
            && MACROS.contains(&word.as_str())
        {
            found.push((pair[0].line, format!("{word}!")));
        }
    }
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn every_use_of_the_process_environment_is_found() {
        let text = "use std::env::{self, current_dir};\nfn f() { std::env::temp_dir(); env::args(); }\n\
                    fn g() { println!(\"x\"); std::process::exit(1) }\nfn h() { std::env::consts::OS; io::stdout(); }\n\
                    #[cfg(test)]\nmod tests { fn f() { println!(\"x\") } }";
        let source = Source::new(PathBuf::from("libs/x/src/a.rs"), text.to_owned()).unwrap();
        let found = breaches(&source);
        let names: Vec<(usize, &str)> = found.iter().map(|(line, name)| (*line, name.as_str())).collect();
        let expected =
            [(1, "current_dir"), (2, "args"), (2, "temp_dir"), (3, "exit"), (3, "println!"), (4, "stdout")];
        assert_eq!(names, expected);
        assert!(!check(&[source]).is_empty());
    }
}
