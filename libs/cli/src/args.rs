//! Options with one dash or two.

use clap::{ArgAction, Command, CommandFactory, FromArgMatches};
use std::ffi::OsString;

/// Parses a command line that begins with the tool's name, as [`std::env::args_os`] gives it; on a mistake,
/// or `-help` or `-version`, prints and exits (2, 0, 0).
///
/// Every tool begins with it, so it also does what all of them need first: it raises the limit of open files.
pub fn parse<T: CommandFactory + FromArgMatches>(words: Vec<OsString>) -> T {
    crate::files::raise_limit();
    let command = prepared(T::command());
    let args = with_two_dashes(&command, words.into_iter());
    let matches = command.get_matches_from(args);
    T::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// The version, and the day of the build.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("GRANITA_BUILD_DATE"), ")");

/// Adds what all tools share.
fn prepared(command: Command) -> Command {
    command.version(VERSION).disable_help_subcommand(true).max_term_width(100)
}

/// Rewrites `-name` to `--name` where a long option is meant; leaves values alone.
fn with_two_dashes(command: &Command, args: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let long = |name: &str| {
        command.get_arguments().find(|a| {
            a.get_long() == Some(name) || a.get_all_aliases().is_some_and(|all| all.contains(&name))
        })
    };
    let is_long = |name: &str| long(name).is_some() || matches!(name, "help" | "version");
    let short = |c: char| command.get_arguments().find(|a| a.get_short() == Some(c));
    let values = |arg: &clap::Arg| match arg.get_action() {
        ArgAction::Set | ArgAction::Append => arg.get_num_args().map_or(1, |n| n.min_values()),
        _ => 0,
    };
    let mut out = Vec::new();
    let mut skip = 1; // the program's name
    let mut literal = false;
    for arg in args {
        let Some(text) = arg.to_str().filter(|_| skip == 0 && !literal) else {
            skip = usize::saturating_sub(skip, 1);
            out.push(arg);
            continue;
        };
        literal = text == "--";
        let body = text.trim_start_matches('-');
        let dashes = text.len() - body.len();
        let (name, has_value) = match body.split_once('=') {
            Some((name, _)) => (name, true),
            None => (body, false),
        };
        let first = body.chars().next();
        let number = first.is_some_and(|c| c.is_ascii_digit() || c == '.');
        if dashes == 0 || body.is_empty() || number {
            out.push(arg);
            continue;
        }
        let as_long = dashes > 1 || is_long(name) || first.is_some_and(|c| short(c).is_none());
        if as_long {
            skip = if has_value { 0 } else { long(name).map_or(0, values) };
            out.push(format!("--{body}").into());
        } else {
            // A lone short option takes its values from the next words.
            let alone = body.chars().count() == 1;
            skip = if alone { first.and_then(short).map_or(0, values) } else { 0 };
            out.push(arg);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser, Debug)]
    struct Tool {
        #[arg(long)]
        envcube: bool,
        #[arg(short = 'o', allow_hyphen_values = true)]
        output: Option<String>,
        #[arg(long, num_args = 2)]
        tile: Vec<u32>,
        #[arg(long, allow_hyphen_values = true)]
        filter: Option<String>,
        #[arg(long, allow_negative_numbers = true)]
        bias: Option<f32>,
        #[arg(short, action = ArgAction::Count)]
        v: u8,
        files: Vec<String>,
    }

    fn tool(line: &str) -> Result<Tool, clap::Error> {
        let command = prepared(Tool::command());
        let args = with_two_dashes(&command, line.split(' ').map(OsString::from));
        command.try_get_matches_from(args).and_then(|m| Tool::from_arg_matches(&m))
    }

    #[test]
    fn one_dash_or_two() {
        let t = tool("x -envcube -o out.tx -tile 32 64 -bias -0.5 -vv a.tif").unwrap();
        assert!(t.envcube && t.v == 2 && t.tile == [32, 64] && t.bias == Some(-0.5));
        assert_eq!((t.output.as_deref(), t.files), (Some("out.tx"), vec!["a.tif".to_owned()]));
        let t = tool("x --filter=box -filter -gaussian -o -out.tx -- -envcube");
        assert!(t.is_err(), "an option twice is a mistake");
        let t = tool("x -filter -gaussian -o -out.tx -- -envcube").unwrap();
        assert_eq!(t.filter.as_deref(), Some("-gaussian"));
        assert_eq!((t.output.as_deref(), t.files), (Some("-out.tx"), vec!["-envcube".to_owned()]));
    }

    #[test]
    fn misspelling_gets_a_suggestion() {
        assert!(tool("x -envcub").unwrap_err().to_string().contains("--envcube"));
    }
}
