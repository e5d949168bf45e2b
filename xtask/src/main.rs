//! Tasks of the workspace, run as `cargo xtask NAME`.
//!
//! - `tidy` checks the laws of `ARCHITECTURE.md`, the house rules that a machine can check, that files import each
//!   other in one direction, and the tests of the ledger;
//! - `crates` draws `docs/crates.svg`, the crates on their floors;
//! - `ci` runs all checks that a change must pass: the README's test command, format, lints, docs, `tidy`;
//! - `book` writes the manual as HTML, or checks its links, its examples and that it is complete;
//! - `bless [NAME]` accepts the current results of the suite's cases as their references;
//! - `trade SCENE` measures the time and the error of each parameter of a scene's indirect light and occlusion;
//! - `rerender` compares random sequences of re-rendered frames with frames rendered anew;
//! - `gallery` renders the images that pages show, or checks that they are those of today;
//! - `farm` renders jobs and frames with several processes and with Slurm, and kills some of them (Linux);
//! - `attack` tests that tools do not run for ever, hang, fill the machine or crash (Linux);
//! - `install --prefix P` builds everything and installs it as `$GELATOHOME`;
//! - `dist` makes the tarball, the Python wheel and the package of Debian that users install (Linux);
//! - `examples-cpp` compiles `examples/cpp`;
//! - `crossing` measures the cost of calls from C++;
//! - `races` runs a C++ program of several threads under ThreadSanitizer;
//! - `report` writes an HTML page with the reference, result and difference of every image case.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a tool for a terminal")]

#[cfg(target_os = "linux")]
mod attack;
mod attributes;
mod book;
mod ci;
mod circles;
mod comments;
mod cpp;
mod crates;
mod dist;
mod errors;
#[cfg(target_os = "linux")]
mod farm;
mod files;
mod gallery;
mod home;
mod laws;
mod ledger;
mod mathematics;
mod process;
mod rules;
mod source;
mod suite;
mod texts;
mod unused;
mod workspace;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Chores of the Granita workspace")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Check the laws and the house rules.
    Tidy,
    /// Run all checks that a change must pass.
    Ci,
    /// Draw docs/crates.svg again: the crates, their floors and their imports.
    Crates,
    /// Accept the current results of suite cases as their references.
    Bless {
        /// `AREA/CASE`, or the beginning of it; all cases without a name.
        name: Option<String>,
    },
    /// Write the manual as HTML, by mdbook, or check it.
    Book(book::Options),
    /// Write target/suite-report/index.html.
    Report,
    /// Render the images of examples/ and docs/pictures, or check that they are those of today.
    Gallery(gallery::Options),
    /// Build tools and libraries, and lay them out as $GELATOHOME: bin, lib, include, shaders, inputs, textures, share,
    /// doc.
    Install {
        /// The folder.
        #[arg(long, value_name = "FOLDER")]
        prefix: std::path::PathBuf,
        /// Use the dev profile, for trying.
        #[arg(long)]
        debug: bool,
    },
    /// Make the tarball, the Python wheel and the package of Debian in target/dist.
    Dist(dist::Options),
    /// Test the tools with bombs, failing peers, kills and changed files.
    #[cfg(target_os = "linux")]
    Attack(attack::Options),
    /// Test jobs and frames of several processes and of the nodes of a Slurm cluster, some of which are killed.
    #[cfg(target_os = "linux")]
    Farm(farm::Options),
    /// Measure the cost of calls from C++.
    Crossing {
        /// Use the dev profile.
        #[arg(long)]
        debug: bool,
    },
    /// Compare the frames of random sequences of edits with frames rendered anew, to the bit.
    Rerender {
        /// The number of sequences.
        #[arg(long, default_value_t = 500)]
        sequences: u32,
        /// The seed of the first sequence. The others have the seeds after it.
        #[arg(long, default_value_t = 1)]
        seed: u32,
    },
    /// Run a C++ program with several renderers and threads under ThreadSanitizer; skipped where that is not installed.
    Races,
    /// Compile the programs and plugins of examples/cpp into target/examples-cpp.
    ExamplesCpp {
        /// Use the libraries of the dev profile.
        #[arg(long)]
        debug: bool,
    },
    /// Measure time and error for every parameter of a scene's indirect light and occlusion, as a table and a plot.
    Trade {
        /// SCENE.pyg [--threads N] [--reference SAMPLES] [--svg FILE]
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true)]
        words: Vec<String>,
    },
}

fn main() -> ExitCode {
    let done = match Arguments::parse().chore {
        Chore::Tidy => tidy(),
        Chore::Ci => ci::run(),
        Chore::Crates => crates::draw(),
        Chore::Bless { name } => suite::bless(name.as_deref()),
        Chore::Book(options) => book::run(&options),
        Chore::Report => suite::report(),
        Chore::Rerender { sequences, seed } => suite::rerender(sequences, seed),
        Chore::Gallery(options) => gallery::run(&options),
        Chore::Install { prefix, debug } => cpp::install(&prefix, debug),
        Chore::Dist(options) => dist::run_with(&options),
        Chore::ExamplesCpp { debug } => cpp::examples(debug),
        #[cfg(target_os = "linux")]
        Chore::Attack(options) => attack::run(&options),
        #[cfg(target_os = "linux")]
        Chore::Farm(options) => farm::run(&options),
        Chore::Crossing { debug } => cpp::crossing(debug),
        Chore::Races => cpp::races(),
        Chore::Trade { words } => suite::trade(&words),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(what) => {
            eprintln!("xtask: {what}");
            ExitCode::FAILURE
        }
    }
}

/// Runs all checks and lists all errors, not only the first one.
fn tidy() -> Result<(), String> {
    let workspace = workspace::Workspace::load()?;
    let sources = source::load(&workspace)?;
    let page =
        workspace.text(std::path::Path::new(rules::PAGE)).ok_or_else(|| format!("no {}", rules::PAGE))?;
    let rules = rules::Rules::read(&page)?;
    let mut faults = laws::check(&workspace);
    faults.extend(crates::check(&workspace)?);
    faults.extend(unused::check(&workspace, &sources));
    faults.extend(texts::check(&workspace, &sources, &rules)?);
    faults.extend(comments::check(&sources, &rules));
    faults.extend(errors::check(&sources)?);
    faults.extend(process::check(&sources));
    faults.extend(mathematics::check(&sources));
    faults.extend(attributes::check(&sources)?);
    faults.extend(circles::check(&workspace)?);
    faults.extend(book::check(&workspace)?);
    let ledger = ledger::check(&workspace)?;
    faults.extend(ledger.faults);
    for fault in &faults {
        eprintln!("tidy: {fault}");
    }
    match faults.len() {
        0 => {
            println!(
                "tidy: {} crates, {} files (half of them up to {} lines) and {} rows of the ledger, nothing to say; {} rows \
                 are planned:",
                workspace.crates.len(),
                sources.len(),
                texts::median(&sources),
                ledger.rows,
                ledger.planned.len()
            );
            ledger.planned.iter().for_each(|row| println!("  {row}"));
            Ok(())
        }
        n => Err(format!("tidy found {n} faults")),
    }
}
