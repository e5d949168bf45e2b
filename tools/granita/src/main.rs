//! The command `granita`: all tools of the suite in one program.
//!
//! `granita maketx ...` runs `maketx`. A link to this program with the name of a tool runs that tool. Packages install
//! one program and links, and the plain names `maketx`, `imgtool` and `iv`, which other packages use as well, are not
//! needed.

#![forbid(unsafe_code)]

mod completions;
mod own;
mod pages;
mod share;

use granita_cli::Status;
use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::ExitCode;

/// The allocator, as in `gelato`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// A tool of the suite.
struct Tool {
    name: &'static str,
    /// Returns the table of its options.
    options: fn() -> clap::Command,
    /// The entry point. The words begin with the name of the tool.
    run: fn(Vec<OsString>) -> Status,
}

/// The tools, sorted by name.
const TOOLS: [Tool; 8] = [
    Tool { name: "gelato", options: gelato::command, run: |words| gelato::main(words, &shell_names()) },
    Tool { name: "gslc", options: gslc::command, run: gslc::main },
    Tool { name: "gsoinfo", options: gsoinfo::command, run: gsoinfo::main },
    Tool { name: "imgtool", options: imgtool::command, run: imgtool::main },
    Tool { name: "iv", options: iv::command, run: iv::main },
    Tool { name: "maketx", options: maketx::command, run: maketx::main },
    Tool { name: "oiio-maketx", options: maketx::oiio_command, run: maketx::main },
    Tool { name: "topyg", options: topyg::command, run: topyg::main },
];

/// Returns the names of tools in commands of scenes, which are functions of the shell there. A name with a dash cannot
/// be one. `maketx -profile` is the same tool.
fn shell_names() -> Vec<&'static str> {
    TOOLS.iter().map(|tool| tool.name).filter(|name| !name.contains('-')).collect()
}

/// The options of `gelato` with which other programs start it. They know one path of a program, which may be that of
/// this one: scripts in `$GELATO`, and coordinators that start workers.
const MODES: [&str; 3] = ["stream", "worker", "remote"];

/// Returns the tool that a command line names, and the number of words that are removed from its beginning. The first
/// word that is left takes the place of the tool's name. `None` when the command line is for `granita` itself.
fn chosen(words: &[OsString]) -> Option<(&'static Tool, usize)> {
    let tool = |name: &OsStr| TOOLS.iter().find(|tool| name == tool.name);
    let first = words.get(1);
    if first.is_some_and(|word| word == "-as" || word == "--as") {
        return tool(words.get(2)?).map(|tool| (tool, 2));
    }
    let called = words.first().map(Path::new).and_then(Path::file_name).unwrap_or_default();
    let suffix = std::env::consts::EXE_SUFFIX;
    let called = called.to_str().and_then(|name| name.strip_suffix(suffix)).unwrap_or_default();
    if let Some(tool) = tool(OsStr::new(called)) {
        return Some((tool, 0));
    }
    let first = first?;
    let is_mode = |mode: &&str| first.to_str().is_some_and(|word| word.trim_start_matches('-') == *mode);
    if first.as_encoded_bytes().starts_with(b"-") && MODES.iter().any(is_mode) {
        return tool(OsStr::new("gelato")).map(|tool| (tool, 0));
    }
    tool(first).map(|tool| (tool, 1))
}

fn main() -> ExitCode {
    let mut words: Vec<OsString> = std::env::args_os().collect();
    match chosen(&words) {
        Some((tool, removed)) => {
            words.drain(..removed);
            (tool.run)(words).into()
        }
        None => own::run(words).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tool_is_named_by_the_link_or_by_a_word() {
        for (line, expected) in [
            ("granita maketx a.png", Some(("maketx", 1))),
            ("/usr/bin/granita gelato maketx", Some(("gelato", 1))),
            ("/usr/bin/gelato maketx", Some(("gelato", 0))),
            ("bin/iv", Some(("iv", 0))),
            ("bin/oiio-maketx a.png", Some(("oiio-maketx", 0))),
            ("granita oiio-maketx a.png", Some(("oiio-maketx", 1))),
            ("granita -as gslc x.gsl", Some(("gslc", 2))),
            ("gelato --as topyg x.pyg", Some(("topyg", 2))),
            ("granita -stream -threads 2", Some(("gelato", 0))),
            ("granita --worker", Some(("gelato", 0))),
            ("granita stream", None),
            ("granita -as nosuch", None),
            ("granita -as", None),
            ("granita", None),
            ("granita -help", None),
        ] {
            let words: Vec<OsString> = line.split(' ').map(OsString::from).collect();
            assert_eq!(chosen(&words).map(|(tool, removed)| (tool.name, removed)), expected, "{line}");
        }
    }
}
