//! `gslc -functions`: prints the reference of the functions.

use crate::say;
use granita_cli::{Status, print};
use granita_gsl::help::{self, Entry};
use std::fmt::Write as _;

/// Prints the entry of a function or statement, or the list of all without a name.
pub(crate) fn show(name: &str) -> Status {
    if name.is_empty() {
        print(&list());
        return Status::Done;
    }
    let Some(entry) = help::entry(name) else {
        let near = help::nearest(name).map_or_else(
            || "`gslc -functions` lists all".to_owned(),
            |near| format!("did you mean `{near}`?"),
        );
        say(&format!("gslc: error: there is no function `{name}`\n    {near}"));
        return Status::Failed;
    };
    print(&text_of(&entry));
    Status::Done
}

/// Returns the names of all functions with a sentence each, by section.
fn list() -> String {
    let mut out = String::new();
    for section in help::sections() {
        let _ = writeln!(out, "{}", section.title);
        for entry in &section.entries {
            let _ = writeln!(out, "  {:<28} {}", entry.names.join(", "), plain(&entry.summary()));
        }
        out.push('\n');
    }
    out.push_str("gslc -functions NAME prints all about one.\n");
    out
}

/// Returns an entry as text for a terminal.
fn text_of(entry: &Entry) -> String {
    let mut out = String::new();
    for form in &entry.forms {
        let note = if form.note.is_empty() { String::new() } else { format!("    // {}", form.note) };
        let _ = writeln!(out, "{}{note}", form.declaration);
    }
    if let Some(note) = entry.type_note() {
        let _ = writeln!(out, "\n{note}");
    }
    let _ = writeln!(out, "\n{}", plain(entry.text));
    if !entry.options.is_empty() {
        out.push_str("\nOptions, as names and values after the other arguments:\n");
    }
    for option in &entry.options {
        let default = match option.default {
            "" => String::new(),
            default => format!(", default {default}"),
        };
        let _ = writeln!(
            out,
            "  \"{}\" ({}{default})\n    {}",
            option.name,
            option.declaration(),
            plain(option.help)
        );
    }
    out.push_str("\nExample:\n");
    for line in entry.example.lines() {
        let _ = writeln!(out, "{}", format!("    {line}").trim_end());
    }
    out
}

/// Returns Markdown with the texts of links instead of the links.
fn plain(markdown: &str) -> String {
    let mut out = String::new();
    let mut rest = markdown;
    while let Some(at) = rest.find("](") {
        let link = rest[..at].rfind('[').zip(rest[at..].find(')'));
        let Some((open, close)) = link else { break };
        out.push_str(&rest[..open]);
        out.push_str(&rest[open + 1..at]);
        rest = &rest[at + close + 1..];
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_become_their_texts() {
        assert_eq!(plain("see [Rays](rays.md#width), a[0] (b)"), "see Rays, a[0] (b)");
        assert_eq!(plain("`m[0][1]`](x"), "`m[0][1]`](x");
    }

    #[test]
    fn entries_have_all_parts() {
        let text = text_of(&help::entry("texture").unwrap());
        for part in [
            "type texture (string file, float s, float t, ...)",
            "  \"blur\" (float, default 0)\n",
            "Example:\n    float a;",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(list().contains("\n  sin, cos, tan ") && !list().contains("]("));
    }
}
