//! Command line options with one dash or two.

use crate::help::{for_output, with_one_dash};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Command, CommandFactory, FromArgMatches};
use granita_base::suggestion;
use std::borrow::Cow;
use std::ffi::{OsStr, OsString};
use std::io::Write;

/// Parses a command line that begins with the tool's name, as in [`std::env::args_os`]. After an error, `-help` or
/// `-version` it prints and exits (with status 2, 0, 0).
///
/// Every tool calls it first, so that it also raises the limit of open files, which all tools need.
pub fn parse<T: CommandFactory + FromArgMatches>(words: Vec<OsString>) -> T {
    parse_with_given(words).0
}

/// Does the same as [`parse`], and also returns the options of the command line, for a tool that passes them on to
/// another process.
pub fn parse_with_given<T: CommandFactory + FromArgMatches>(words: Vec<OsString>) -> (T, Vec<Given>) {
    crate::files::raise_limit();
    try_parse(words).unwrap_or_else(|refusal| refusal.exit(crate::Status::Failed))
}

/// Does the same as [`parse`], with another status after an error, for a tool that takes the place of another program.
pub fn parse_or<T: CommandFactory + FromArgMatches>(words: Vec<OsString>, failed: crate::Status) -> T {
    crate::files::raise_limit();
    try_parse(words).unwrap_or_else(|refusal| refusal.exit(failed)).0
}

/// The reason why a command line was not parsed.
#[derive(Debug)]
pub struct Refusal {
    error: clap::Error,
    /// The message about a usage error; empty for `-help` and `-version`.
    text: String,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.text.is_empty() {
            true => f.write_str(&with_one_dash(&self.error.to_string())),
            false => f.write_str(&self.text),
        }
    }
}

impl std::error::Error for Refusal {}

impl Refusal {
    fn new(command: &Command, error: clap::Error, words: &[Word]) -> Self {
        let text = if error.use_stderr() { usage_error(command, &error, words) } else { String::new() };
        Self { error, text }
    }

    fn exit(&self, failed: crate::Status) -> ! {
        if self.text.is_empty() {
            crate::print(&for_output(&self.error.render()));
            std::process::exit(crate::Status::Done.code().into())
        }
        // Without a standard error the status still counts.
        let _ = writeln!(std::io::stderr().lock(), "{}", self.text);
        std::process::exit(failed.code().into())
    }
}

/// A word of the command line, as it was typed and as clap reads it.
struct Word {
    typed: OsString,
    read: OsString,
}

/// Returns the message about a usage error. It begins with the name of the tool, and shows options as they were typed.
fn usage_error(command: &Command, error: &clap::Error, words: &[Word]) -> String {
    let typed = |option: &str| -> String {
        let is_it = |word: &&Word| word.read.to_str().is_some_and(|read| name_of(read) == option);
        let typed = words.iter().find(is_it).map(|word| name_of(&word.typed.to_string_lossy()).to_owned());
        typed.unwrap_or_else(|| {
            option.strip_prefix('-').filter(|o| o.starts_with('-')).unwrap_or(option).to_owned()
        })
    };
    let unknown = match (error.kind(), error.get(ContextKind::InvalidArg)) {
        (ErrorKind::UnknownArgument, Some(ContextValue::String(option))) => Some(option),
        _ => None,
    };
    let what = match unknown {
        Some(option) => {
            let shown = typed(option);
            let dashes = shown.len() - shown.trim_start_matches('-').len();
            let longs = || command.get_arguments().filter_map(|arg| arg.get_long());
            let near = suggestion(shown.trim_start_matches('-'), longs().chain(["help", "version"]));
            let near =
                near.map_or(String::new(), |near| format!("; did you mean {}{near}?", "-".repeat(dashes)));
            format!("there is no option {shown}{near}")
        }
        None => {
            let text = error.to_string();
            let text = text.split("\n\n").next().unwrap_or_default();
            let mut text = Cow::from(text.strip_prefix("error: ").unwrap_or(text));
            for long in command.get_arguments().filter_map(|arg| arg.get_long()) {
                let read = format!("--{long}");
                let shown = typed(&read);
                for end in ["'", " ", "="] {
                    if text.contains(&format!("{read}{end}")) {
                        text = text.replace(&format!("{read}{end}"), &format!("{shown}{end}")).into();
                    }
                }
            }
            text.into_owned()
        }
    };
    let name = command.get_name();
    let usage = command.clone().render_usage();
    format!("{name}: error: {what}\n{usage}\nAll options: {name} -help")
}

/// Returns an option without its value.
fn name_of(word: &str) -> &str {
    word.split_once('=').map_or(word, |(name, _)| name)
}

/// Parses a command line like [`parse_with_given`], without printing and without an effect on the process.
///
/// # Errors
/// Returns a [`Refusal`] when the command line is invalid, and for `-help` and `-version`.
pub fn try_parse<T: CommandFactory + FromArgMatches>(
    words: Vec<OsString>,
) -> Result<(T, Vec<Given>), Refusal> {
    let command = command::<T>();
    let words = with_two_dashes(&command, words.into_iter());
    let refused = |error: clap::Error| Refusal::new(&command, error, &words);
    let read = words.iter().map(|word| &word.read);
    let matches = command.clone().try_get_matches_from(read).map_err(refused)?;
    let given = given(&command, &matches);
    Ok((T::from_arg_matches(&matches).map_err(refused)?, given))
}

/// An option of a command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Given {
    /// The id of the option, which is the name of its field.
    pub id: String,
    /// Its words with all values. They have the same meaning on another command line of the tool.
    pub words: Vec<OsString>,
}

/// Returns the options of the command line, in the order of their declaration, without positional arguments.
fn given(command: &Command, matches: &ArgMatches) -> Vec<Given> {
    let mut all = Vec::new();
    for arg in command.get_arguments().filter(|arg| !arg.is_positional()) {
        let id = arg.get_id().as_str();
        if matches.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        let occurrences: Vec<Vec<&OsStr>> = match arg.get_action() {
            ArgAction::Count => vec![Vec::new(); matches.get_count(id).into()],
            action if !action.takes_values() => vec![Vec::new()],
            _ => matches.get_raw_occurrences(id).into_iter().flatten().map(Iterator::collect).collect(),
        };
        for values in occurrences {
            let mut words: Vec<OsString> = Vec::new();
            match (arg.get_long(), arg.get_short(), values.as_slice()) {
                // The option is one word, because the value may begin with a dash.
                (Some(long), _, [value]) => {
                    let mut word = OsString::from(format!("-{long}="));
                    word.push(value);
                    words.push(word);
                }
                (Some(long), _, _) => words.push(format!("-{long}").into()),
                (None, short, _) => words.extend(short.map(|short| format!("-{short}").into())),
            }
            if !(arg.get_long().is_some() && values.len() == 1) {
                words.extend(values.iter().map(|&value| value.to_owned()));
            }
            all.push(Given { id: id.to_owned(), words });
        }
    }
    all
}

/// The version, and the date of the build.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("GRANITA_BUILD_DATE"), ")");

/// The version of the suite.
pub const SUITE_VERSION: &str = env!("CARGO_PKG_VERSION");

/// The day of the build, as `2026-01-31`.
pub const BUILD_DATE: &str = env!("GRANITA_BUILD_DATE");

/// Returns the table of a tool's options, from which its help, its man page and its completions are made.
pub fn command<T: CommandFactory>() -> Command {
    prepared(T::command())
}

/// Adds the settings that all tools share.
fn prepared(command: Command) -> Command {
    command.version(VERSION).disable_help_subcommand(true).max_term_width(100)
}

/// Reads `-name` as `--name` where it is a long option. Values are not changed.
fn with_two_dashes(command: &Command, args: impl Iterator<Item = OsString>) -> Vec<Word> {
    let long = |name: &str| {
        command.get_arguments().find(|a| {
            a.get_long() == Some(name) || a.get_all_aliases().is_some_and(|all| all.contains(&name))
        })
    };
    let is_long = |name: &str| long(name).is_some() || matches!(name, "help" | "version");
    let same = |arg: OsString| Word { typed: arg.clone(), read: arg };
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
            out.push(same(arg));
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
        let is_help = dashes == 1 && matches!(body, "h" | "V");
        if dashes == 0 || body.is_empty() || number || is_help {
            out.push(same(arg));
            continue;
        }
        let as_long = dashes > 1 || is_long(name) || first.is_some_and(|c| short(c).is_none());
        if as_long {
            skip = if has_value { 0 } else { long(name).map_or(0, values) };
            let read = format!("--{body}").into();
            out.push(Word { typed: arg, read });
        } else {
            // A lone short option takes its values from the next words.
            let alone = body.chars().count() == 1;
            skip = if alone { first.and_then(short).map_or(0, values) } else { 0 };
            out.push(same(arg));
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

    fn tool(line: &str) -> Result<Tool, Refusal> {
        try_parse(line.split(' ').map(OsString::from).collect()).map(|(tool, _)| tool)
    }

    #[test]
    fn given_options_parse_to_the_same_values_again() {
        let line = "x a.tif --tile 32 64 -envcube -o out.tx --filter=-box -vv -tile 1 2";
        let words = |given: &[Given]| given.iter().flat_map(|g| g.words.clone()).collect::<Vec<_>>();
        let (tool, given) = try_parse::<Tool>(line.split(' ').map(OsString::from).collect()).unwrap();
        let ids: Vec<&str> = given.iter().map(|g| &*g.id).collect();
        assert_eq!(ids, ["envcube", "output", "tile", "tile", "filter", "v", "v"]);
        let again = [vec!["x".into()], words(&given), vec!["a.tif".into()]].concat();
        let (second, same) = try_parse::<Tool>(again).unwrap();
        assert_eq!((format!("{tool:?}"), given), (format!("{second:?}"), same));
    }

    #[test]
    fn options_take_one_dash_or_two() {
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
    fn a_misspelled_option_gets_a_suggestion() {
        let said = |line: &str| tool(line).unwrap_err().to_string();
        let first = |line: &str| said(line).lines().next().unwrap_or_default().to_owned();
        let tool = Tool::command().get_name().to_owned();
        for (line, expected) in [
            ("x -envcub", "there is no option -envcub; did you mean -envcube?"),
            ("x --flter=box", "there is no option --flter; did you mean --filter?"),
            ("x -nothing", "there is no option -nothing"),
            ("x -tile 3", "2 values required for '-tile <TILE> <TILE>' but 1 was provided"),
            ("x --bias y", "invalid value 'y' for '--bias <BIAS>': invalid float literal"),
        ] {
            assert_eq!(first(line), format!("{tool}: error: {expected}"));
        }
        assert!(said("x -nothing").ends_with(&format!("All options: {tool} -help")));
        for (line, expected) in [("x -h", "Usage:"), ("x -help", "Usage:"), ("x -V", VERSION)] {
            assert!(said(line).contains(expected) && !said(line).contains("error"), "{line}");
        }
        assert!(said("x -help").contains("\n  -envcube") && !said("x -help").contains("--"), "one dash");
    }
}
