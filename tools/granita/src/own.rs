//! The options of `granita` itself.

use crate::{TOOLS, share};
use clap::{ArgMatches, Command, CommandFactory, FromArgMatches};
use granita_base::{Reporter, suggestion};
use granita_cli::{Bar, Status, console_reporter, help, parse, print};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Runs the tools of the suite.
///
/// "granita TOOL ..." runs a tool, also where another package has a program of the tool's name. A link to granita with
/// the name of a tool runs that tool.
#[derive(clap::Parser, Debug)]
#[command(name = "granita", subcommand_value_name = "TOOL", subcommand_help_heading = "Tools")]
struct Options {
    /// Print the folder of this installation, for $GELATOHOME. Its folder bin has all tools under their plain names
    #[arg(long, group = "own")]
    home: bool,

    /// Write the man pages, and the completions of bash, zsh and fish, into the folders of a folder such as
    /// ~/.local/share
    #[arg(long, value_name = "FOLDER", group = "own")]
    share: Option<PathBuf>,
}

/// The options together with the tools.
struct Own(Options);

impl CommandFactory for Own {
    fn command() -> Command {
        let command = Options::command().subcommands(TOOLS.iter().map(|tool| {
            // The man page of the tool has the plain name.
            (tool.options)().display_name(tool.name)
        }));
        command.disable_help_subcommand(true)
    }

    fn command_for_update() -> Command {
        Self::command()
    }
}

impl FromArgMatches for Own {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Options::from_arg_matches(matches).map(Self)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        self.0.update_from_arg_matches(matches)
    }
}

/// Returns the table of the options of `granita`, with the tools.
pub(crate) fn command() -> Command {
    granita_cli::command::<Own>()
}

/// Returns the folder of the installation of a program in its folder `bin`.
fn home(program: &Path) -> Option<&Path> {
    let bin = program.parent().filter(|folder| folder.ends_with("bin"))?;
    bin.parent().filter(|home| home.join("shaders").is_dir())
}

/// Runs `granita` without a tool.
pub(crate) fn run(words: Vec<OsString>) -> Status {
    let reporter = console_reporter("granita", &Bar::new(false));
    if let Some(error) = unknown(&words) {
        reporter.error(error);
        return Status::Failed;
    }
    let Own(options) = parse(words);
    if let Some(folder) = &options.share {
        return match share::write(folder, &command()) {
            Ok(()) => Status::Done,
            Err(error) => {
                reporter.error(format!("-share: {error}"));
                Status::Failed
            }
        };
    }
    if options.home {
        return print_home(&reporter);
    }
    print(&format!("{}\n", help(&command())));
    Status::Failed
}

/// Returns the error about a command line that names a tool which does not exist.
fn unknown(words: &[OsString]) -> Option<String> {
    let names = || TOOLS.iter().map(|tool| tool.name);
    let all = || names().collect::<Vec<_>>().join(", ");
    let first = words.get(1)?.to_string_lossy();
    if matches!(&*first, "-as" | "--as") {
        return Some(format!("-as needs the name of a tool: {}", all()));
    }
    if first.starts_with('-') {
        return None;
    }
    Some(match suggestion(&first, names()) {
        Some(near) => format!("there is no tool {first}; did you mean {near}?"),
        None => format!("there is no tool {first}: the tools are {}", all()),
    })
}

fn print_home(reporter: &Reporter) -> Status {
    let program = std::env::current_exe().and_then(std::fs::canonicalize);
    let error = match &program {
        Ok(program) => match home(program) {
            Some(home) => {
                print(&format!("{}\n", home.display()));
                return Status::Done;
            }
            None => format!("{} is not in the folder bin of an installation", program.display()),
        },
        Err(error) => format!("the path of this program is not known: {error}"),
    };
    reporter.error(format!("-home: {error}"));
    Status::Failed
}
