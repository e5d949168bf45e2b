//! The command `gelato`, and under `--as NAME` any other tool of the suite.
//!
//! One binary contains all tools, so that a scene's `Command ("system maketx ...")` runs the tool of the same build in
//! any folder. The names are passed to the session, which starts this program again.

#![forbid(unsafe_code)]

use granita_cli::Status;
use std::ffi::OsString;
use std::process::ExitCode;

/// The allocator. Grids are allocated and freed by the million, in sizes that repeat. `docs/performance.md` lists the
/// gain.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// An entry point. The words begin with the name of the tool.
type Tool = fn(Vec<OsString>) -> Status;

/// The tools that this binary contains.
const TOOLS: [(&str, Tool); 5] = [
    ("gelato", |words| gelato::main(words, &TOOLS.map(|(name, _)| name))),
    ("maketx", maketx::main),
    ("gslc", gslc::main),
    ("gsoinfo", gsoinfo::main),
    ("topyg", topyg::main),
];

fn main() -> ExitCode {
    let mut words: Vec<OsString> = std::env::args_os().collect();
    let named = words.get(1).is_some_and(|word| word == "-as" || word == "--as");
    let name = if named { words.get(2).cloned() } else { Some("gelato".into()) };
    match TOOLS.iter().find(|(tool, _)| name.as_deref().is_some_and(|n| n == *tool)) {
        Some((_, tool)) => {
            if named {
                // The first word becomes the tool's own name, as if the tool had been called by it.
                words.drain(..2);
            }
            tool(words).into()
        }
        None => {
            granita_cli::console_reporter("gelato", &granita_cli::Bar::new(false))
                .error("-as needs the name of a tool: gelato, maketx, gslc, gsoinfo or topyg");
            Status::Failed.into()
        }
    }
}
