//! Checks the width of comments. rustfmt checks that of code.

use crate::rules::Rules;
use crate::source::Source;
use std::path::Path;

/// Returns all breaches, one line each.
pub(crate) fn check(sources: &[Source], rules: &Rules) -> Vec<String> {
    let mut faults = Vec::new();
    for source in sources {
        for (line, width) in wide(&source.text, rules.comment_width) {
            let most = rules.comment_width;
            faults
                .push(format!("{}:{line}: a comment of {width} characters, more than {most}", file(source)));
        }
    }
    faults
}

fn file(source: &Source) -> std::path::Display<'_> {
    Path::new(&source.file).display()
}

/// Returns the lines of comments, counted from 1, that are wider than `most`, and their widths. Tables, code in
/// comments and addresses cannot be wrapped.
fn wide(text: &str, most: usize) -> Vec<(usize, usize)> {
    let mut is_code = false;
    let mut found = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let Some(comment) = line.trim_start().strip_prefix("//") else {
            is_code = false;
            continue;
        };
        let comment = comment.trim_start_matches(['/', '!']).trim_start();
        if comment.starts_with("```") {
            is_code = !is_code;
        }
        let width = line.chars().count();
        if width > most && !is_code && !comment.starts_with('|') && !comment.contains("://") {
            found.push((number, width));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_beyond_the_width_are_found() {
        let long = "word ".repeat(9);
        let text = format!(
            "//! {long}\n//! short\n//! | {long} |\n//! ```\n//! {long}\n//! ```\n    // {long}\nlet x = \"{long}\";\n\
             /// <https://example.com> {long}\n/// {}\n// ```\nlet y = 1;\n// {long}",
            "ä".repeat(36)
        );
        assert_eq!(wide(&text, 40), [(1, 49), (7, 52), (13, 48)]);
    }
}
