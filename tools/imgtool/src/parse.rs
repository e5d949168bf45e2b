//! The command line as steps, from left to right.

use crate::table::{GROUPS, Row, find};
use clap::builder::StyledStr;
use clap::{Arg, ArgAction, ArgMatches, Command, CommandFactory, FromArgMatches};
use std::collections::BTreeMap;
use std::ffi::OsString;

/// One step.
#[derive(Clone, Debug)]
pub(crate) enum Step {
    /// An image to read.
    Image(String),
    /// An option.
    Option(Given),
}

/// An option with its values.
#[derive(Clone)]
pub(crate) struct Given {
    pub(crate) row: &'static Row,
    /// The option as it was typed, for messages.
    pub(crate) typed: String,
    pub(crate) values: Vec<String>,
    pub(crate) modifiers: BTreeMap<String, String>,
}

impl std::fmt::Debug for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:?} {:?}", self.typed, self.values, self.modifiers)
    }
}

impl Given {
    /// Returns a modifier as a text.
    pub(crate) fn text(&self, name: &str) -> Option<&str> {
        self.modifiers.get(name).map(|value| &**value)
    }

    /// Returns a modifier as a number.
    ///
    /// # Errors
    /// A message when it is not one.
    pub(crate) fn number<T: std::str::FromStr>(&self, name: &str) -> Result<Option<T>, String> {
        let Some(text) = self.text(name) else { return Ok(None) };
        text.parse().map(Some).map_err(|_| format!("{name}={text} is not a number that fits"))
    }

    /// True when a modifier is on: `1`, or the name alone.
    ///
    /// # Errors
    /// A message when it is neither 0 nor 1.
    pub(crate) fn flag(&self, name: &str, default: bool) -> Result<bool, String> {
        match self.text(name) {
            None => Ok(default),
            Some("1" | "" | "true" | "yes" | "on") => Ok(true),
            Some("0" | "false" | "no" | "off") => Ok(false),
            Some(other) => Err(format!("{name}={other}, 0 and 1 are possible")),
        }
    }

    /// Returns value `i` as a number.
    ///
    /// # Errors
    /// A message when it is not one.
    pub(crate) fn value<T: std::str::FromStr>(&self, i: usize) -> Result<T, String> {
        self.values[i].trim().parse().map_err(|_| format!("\"{}\" is not a number that fits", self.values[i]))
    }
}

/// The options as a table of clap, for the help, the man page and the completions.
pub(crate) struct Table;

impl CommandFactory for Table {
    fn command() -> Command {
        let mut command = Command::new("imgtool")
            .about("Converts, resizes, combines and compares images")
            .long_about(
                "Converts, resizes, combines and compares images.\n\nThe words are processed from left to right. A name \
                 reads an image onto a stack, and an option works on the last images of the stack, which its result \
                 replaces. Modifiers of an option follow its name: -resize:filter=box 50%.",
            )
            .override_usage("imgtool [FILE | -option[:modifier=value...] [value ...]] ...")
            .arg(Arg::new("words").value_name("FILE").num_args(0..).help("Images to read"));
        for (heading, rows) in GROUPS {
            for row in *rows {
                command = command.arg(argument(row).help_heading(*heading));
            }
        }
        command
    }

    fn command_for_update() -> Command {
        Self::command()
    }
}

/// Returns an option as an argument of clap.
fn argument(row: &'static Row) -> Arg {
    let mut arg = Arg::new(row.name);
    let mut letters = row.name.chars();
    arg = match (letters.next(), letters.next()) {
        (Some(letter), None) => arg.short(letter),
        _ => arg.long(row.name),
    };
    arg = arg.visible_aliases(row.aliases.iter().copied());
    if row.about.is_empty() {
        arg = arg.hide(true);
    }
    let mut about = row.about.to_owned();
    if !row.modifiers.is_empty() {
        about.push_str(&format!(" [modifiers: {}]", row.modifiers.join(", ")));
    }
    arg = arg.help(StyledStr::from(about));
    match row.values.len() {
        0 => arg.action(ArgAction::SetTrue),
        n => arg.action(ArgAction::Append).num_args(n).value_names(row.values.iter().copied()),
    }
}

impl FromArgMatches for Table {
    fn from_arg_matches(_: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self)
    }

    fn update_from_arg_matches(&mut self, _: &ArgMatches) -> Result<(), clap::Error> {
        Ok(())
    }
}

/// The reason why a command line was not parsed.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// A message about an option.
    Wrong(String),
    /// A word that is for the parser of all tools: an unknown option, or a request for help.
    Word(OsString),
}

/// Returns the steps of a command line, whose first word is the name of the program.
///
/// # Errors
/// A message for the first word that is wrong.
pub(crate) fn steps(words: &[OsString]) -> Result<Vec<Step>, Refusal> {
    let mut steps = Vec::new();
    let mut rest = words.iter().skip(1);
    while let Some(word) = rest.next() {
        let Some(text) = word.to_str() else {
            let what = format!("{}: a name that is not Unicode", word.display());
            return Err(Refusal::Wrong(what));
        };
        let body = text.strip_prefix("--").or_else(|| text.strip_prefix('-'));
        let Some(body) = body.filter(|body| !body.is_empty()) else {
            steps.push(Step::Image(text.to_owned()));
            continue;
        };
        let (name, modifiers) = body.split_once(':').unwrap_or((body, ""));
        // One value may follow after "=".
        let (name, value) = match find(name) {
            Some(_) => (name, None),
            None => match body.split_once('=') {
                Some((name, value)) if find(name).is_some_and(|row| row.values.len() == 1) => {
                    (name, Some(value))
                }
                _ => (name, None),
            },
        };
        let modifiers = if value.is_some() { "" } else { modifiers };
        let Some(row) = find(name) else { return Err(Refusal::Word(word.clone())) };
        let typed = text[..text.len() - body.len() + name.len()].to_owned();
        let wrong = |what: String| Refusal::Wrong(format!("{typed}: {what}"));
        let mut found = BTreeMap::new();
        for modifier in modifiers.split(':').filter(|m| !m.is_empty()) {
            let (name, value) = modifier.split_once('=').unwrap_or((modifier, ""));
            if !row.modifiers.contains(&name) {
                return Err(wrong(match row.modifiers {
                    [] => format!("there are no modifiers, and \"{modifier}\" is one"),
                    all => format!("there is no modifier \"{name}\"; there are {}", all.join(", ")),
                }));
            }
            found.insert(name.to_owned(), value.to_owned());
        }
        let mut values: Vec<String> = value.map(str::to_owned).into_iter().collect();
        while values.len() < row.values.len() {
            let Some(word) = rest.next() else {
                return Err(wrong(format!("needs {}", row.values.join(" "))));
            };
            let Some(text) = word.to_str() else {
                return Err(wrong(format!("{}: a value that is not Unicode", word.display())));
            };
            values.push(text.to_owned());
        }
        // The modifiers of a pattern follow its name.
        if row.action == crate::table::Action::Pattern
            && let Some((name, rest)) = values[0].clone().split_once(':')
        {
            for modifier in rest.split(':').filter(|m| !m.is_empty()) {
                let (name, value) = modifier.split_once('=').unwrap_or((modifier, ""));
                if !row.modifiers.contains(&name) {
                    return Err(wrong(format!("there is no modifier \"{name}\"")));
                }
                found.insert(name.to_owned(), value.to_owned());
            }
            values[0] = name.to_owned();
        }
        steps.push(Step::Option(Given { row, typed, values, modifiers: found }));
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Action;
    use crate::table::rows;

    fn parsed(line: &str) -> Result<Vec<Step>, Refusal> {
        steps(&line.split(' ').map(OsString::from).collect::<Vec<_>>())
    }

    #[test]
    fn words_become_steps_in_their_order() {
        let steps =
            parsed("imgtool a.exr --resize:filter=box 50% -o b.png -addc=-0.5 -tile 64 32 -subc -1").unwrap();
        let text: Vec<String> = steps.iter().map(|s| format!("{s:?}")).collect();
        assert_eq!(
            text.join("; "),
            "Image(\"a.exr\"); Option(--resize [\"50%\"] {\"filter\": \"box\"}); Option(-o [\"b.png\"] {}); \
             Option(-addc [\"-0.5\"] {}); Option(-tile [\"64\", \"32\"] {}); Option(-subc [\"-1\"] {})"
        );
    }

    #[test]
    fn wrong_words_are_named() {
        for (line, expected) in [
            ("imgtool -resize", "-resize: needs SIZE"),
            ("imgtool --tile 3", "--tile: needs WIDTH HEIGHT"),
            ("imgtool -resize:filtr=box 3", "-resize: there is no modifier \"filtr\"; there are filter"),
            ("imgtool -flip:x=1", "-flip: there are no modifiers, and \"x=1\" is one"),
        ] {
            assert_eq!(parsed(line).unwrap_err(), Refusal::Wrong(expected.to_owned()));
        }
        for word in ["-rezise", "--help", "-version", "-x=3"] {
            assert_eq!(parsed(&format!("imgtool {word}")).unwrap_err(), Refusal::Word(word.into()));
        }
    }

    #[test]
    fn the_table_is_consistent() {
        let mut names: Vec<&str> =
            rows().flat_map(|row| [row.name].into_iter().chain(row.aliases.iter().copied())).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count, "a name twice");
        Table::command().debug_assert();
        assert_eq!(find("keywords").map(|row| row.action), Some(Action::Keyword));
        for row in rows().filter(|row| !row.modifiers.is_empty()) {
            let mut sorted = row.modifiers.to_vec();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), row.modifiers.len(), "{}", row.name);
        }
    }

    #[test]
    fn modifiers_are_read_as_numbers_and_flags() {
        let steps = parsed("imgtool -mosaic:pad=10:fit=x 2x2 -fit:pad 3x3 -fit:pad=7 3x3").unwrap();
        let option = |i: usize| if let Step::Option(given) = &steps[i] { given } else { panic!() };
        assert_eq!((option(0).number::<u32>("pad"), option(0).text("fit")), (Ok(Some(10)), Some("x")));
        assert!(option(0).number::<u32>("fit").is_err());
        assert_eq!((option(1).flag("pad", false), option(0).flag("none", true)), (Ok(true), Ok(true)));
        assert!(option(2).flag("pad", false).is_err());
    }
}
