//! The documentation and the types of the Python package, which are made from the table of calls.

use crate::kept;
use crate::signature::{plain, python, range_of, type_of};
use granita_scene::interface::{CallRow, TABLE};
use std::fmt::Write;

/// Returns the rows, sorted by name.
fn sorted() -> Vec<&'static CallRow> {
    let mut rows = TABLE.to_vec();
    rows.sort_by_key(|row| row.name);
    rows
}

/// Returns a text as lines of at most `width` characters, the later ones after `indent`.
fn wrapped(text: &str, width: usize, indent: &str) -> String {
    let (mut lines, mut line) = (String::new(), String::new());
    for word in text.split_whitespace() {
        if !line.trim().is_empty() && line.len() + 1 + word.len() > width {
            lines += &format!("{}\n", std::mem::replace(&mut line, indent.to_owned()));
        } else if !line.trim().is_empty() {
            line.push(' ');
        }
        line += word;
    }
    lines + &line + "\n"
}

/// Returns the description of a call.
fn description(row: &CallRow) -> String {
    let mut text = String::new();
    for form in row.forms {
        let _ = writeln!(text, "{}{}", row.name, python(row, form));
    }
    text += &format!("\n{}", wrapped(&plain(row.help), 100, ""));
    for form in row.forms.iter().filter(|form| !form.args.is_empty()) {
        text.push('\n');
        for arg in form.args {
            let default = if arg.default.is_empty() {
                String::new()
            } else {
                format!(" Default: {}.", plain(arg.default))
            };
            let line = format!(
                "{}: {}; {}. {}{default}",
                arg.name,
                type_of(arg),
                plain(&range_of(arg)),
                plain(arg.help)
            );
            text += &wrapped(&line, 100, "    ");
        }
    }
    if row.is_query() {
        let _ = write!(text, "\nReturns {}.\n", row.returns.replace("nothing", "None"));
    }
    text
}

#[test]
fn calls_describe_themselves() {
    let mut text = String::from(
        "\"\"\"The calls of the scene interface and their descriptions. ``cargo xtask bless manual`` makes this file.\"\"\"\n\n\
         CALLS = {\n",
    );
    for row in sorted() {
        let description = description(row);
        assert!(!description.contains("\"\"\"") && !description.contains('\\'), "{}", row.name);
        let quoted = description
            .trim_end()
            .strip_suffix('"')
            .map_or(description.trim_end().to_owned(), |rest| format!("{rest}\\\""));
        let _ = writeln!(text, "    \"{}\": \"\"\"{quoted}\"\"\",", row.name);
    }
    kept("bindings/python/gelato/_calls.py", &(text + "}\n"));
}

#[test]
fn calls_have_types() {
    let mut text = String::from(
        "# cargo xtask bless manual makes this file.\nfrom typing import Any, Iterable, Union, overload\n\nNumbers = \
         Union[float, Iterable[Any]]\nValue = Union[float, str, None, Iterable[Any]]\n\n__version__: str\n\nclass \
         GelatoError(RuntimeError): ...\n\nclass GelatoAPI:\n    def __init__(self, *options: Any) -> None: ...\n    def \
         __enter__(self) -> GelatoAPI: ...\n    def __exit__(self, *_: Any) -> None: ...\n    @property\n    def errors(self) \
         -> int: ...\n    def finish(self) -> int: ...\n    @staticmethod\n    def CreateRenderer(*options: Any) -> \
         GelatoAPI: ...\n",
    );
    let functions = |text: &mut String, indent: &str, first: &str| {
        for row in sorted() {
            for form in row.forms {
                let overload =
                    if row.forms.len() > 1 { format!("{indent}@overload\n") } else { String::new() };
                let arguments = python(row, form);
                let (open, rest) = arguments.split_at(1);
                let first = if rest.starts_with(')') { first.trim_end_matches(", ") } else { first };
                let _ = writeln!(text, "{overload}{indent}def {}{open}{first}{rest}: ...", row.name);
            }
        }
    };
    functions(&mut text, "    ", "self, ");
    text += "\nGelatoRenderer: GelatoAPI\n\ndef CreateRenderer(*options: Any) -> GelatoAPI: ...\ndef finish() -> int: ...\n";
    functions(&mut text, "", "");
    kept("bindings/python/gelato/__init__.pyi", &text);
}
