//! The help of the tools, which shows options with one dash, as the manual does.

use clap::Command;
use clap::builder::StyledStr;
use std::io::IsTerminal;

/// Returns the summary of a tool's options as plain text.
pub fn help(command: &Command) -> String {
    with_one_dash(&command.clone().render_help().to_string())
}

/// Returns a text of clap for standard output: with colours where that is a terminal that shows them.
pub(crate) fn for_output(text: &StyledStr) -> String {
    let set = |variable: &str| std::env::var_os(variable).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    let is_colored = cfg!(unix) && std::io::stdout().is_terminal() && !set("NO_COLOR") && !is_dumb;
    with_one_dash(&if is_colored { text.ansi().to_string() } else { text.to_string() })
}

/// Replaces two dashes before the name of an option by one. Options without a short form begin in the third column, and
/// descriptions in the same line stay in their column.
pub(crate) fn with_one_dash(text: &str) -> String {
    text.split_inclusive('\n').map(line_with_one_dash).collect()
}

fn line_with_one_dash(line: &str) -> String {
    let mut out = String::new();
    let mut removed = 0;
    let mut rest = line;
    while let Some((before, after)) = rest.split_once("--") {
        let is_name = after.starts_with(|c: char| c.is_ascii_alphabetic()) && !before.ends_with('-');
        out.push_str(before);
        out.push_str(if is_name { "-" } else { "--" });
        removed += usize::from(is_name);
        rest = after;
    }
    let at = out.len();
    out.push_str(rest);
    // Clap leaves room for "-x, " before options without a short form.
    let styled = |c: char| c == '\x1b' || c == '-';
    if removed > 0 && line.strip_prefix("      ").is_some_and(|option| option.starts_with(styled)) {
        out.replace_range(..4, "");
        if let Some(gap) = out[at - 4..].find("  ") {
            out.insert_str(at - 4 + gap, &" ".repeat(removed + 4));
        }
    } else if removed > 0
        && line.starts_with("  ")
        && !line.starts_with("   ")
        && let Some(gap) = out[at..].find("  ")
    {
        out.insert_str(at + gap, &" ".repeat(removed));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_have_one_dash_and_descriptions_stay_in_their_column() {
        for (line, expected) in [
            ("      --statistics\n", "  -statistics\n"),
            ("      --tile <T>  Side\n", "  -tile <T>       Side\n"),
            ("  -o, --out <T>   Name\n", "  -o, -out <T>    Name\n"),
            ("  -h, --help\n", "  -h, -help\n"),
            ("          As -- or with --tile here\n", "          As -- or with -tile here\n"),
            ("      \x1b[1m--iv\x1b[0m  Show\n", "  \x1b[1m-iv\x1b[0m       Show\n"),
            ("  -o <FILE>  Name\n", "  -o <FILE>  Name\n"),
        ] {
            assert_eq!(with_one_dash(line), expected);
        }
    }
}
