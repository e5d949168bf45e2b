//! Signatures of calls in Pyg, Python and C++.

use granita_scene::interface::{Arg, CallRow, Form, Kind};
use granita_tests::repository;
use std::collections::BTreeMap;

/// The methods of the C++ class that are not calls.
const NO_CALLS: [&str; 3] = ["GelatoAPI", "Err", "GetError"];

/// Returns the signatures of a form in Pyg, without its name.
pub(crate) fn pyg(form: &Form) -> String {
    let shown = |arg: &Arg| match arg.kind {
        Kind::Row(3) | Kind::Rest => arg.shape.to_owned(),
        _ if arg.default.is_empty() || !is_last(form, arg) => arg.name.to_owned(),
        _ => format!("[{}]", arg.name),
    };
    let mut all: Vec<String> = form.args.iter().map(shown).collect();
    if form.params {
        all.push("\"type name\", value, ...".into());
    }
    all.join(", ")
}

/// True when no argument that is needed follows.
fn is_last(form: &Form, arg: &Arg) -> bool {
    form.args.iter().skip_while(|other| other.name != arg.name).all(|other| !other.default.is_empty())
}

/// Returns the parameters of a form in Python, and the result.
pub(crate) fn python(row: &CallRow, form: &Form) -> String {
    let mut all: Vec<String> = form.args.iter().filter_map(|arg| python_arg(form, arg)).collect();
    if form.params {
        all.push("*params: Value".into());
    }
    format!("({}) -> {}", all.join(", "), if row.is_query() { "Value" } else { "None" })
}

fn python_arg(form: &Form, arg: &Arg) -> Option<String> {
    let name = arg.name;
    let optional = if is_last(form, arg) { " = None" } else { "" };
    Some(match arg.kind {
        Kind::Text | Kind::Declaration => format!("{name}: str"),
        Kind::OptionalText => format!("{name}: str | None{optional}"),
        Kind::Number => format!("{name}: float"),
        Kind::Switch => format!("{name}: float"),
        Kind::Count => format!("{name}: int"),
        Kind::Numbers | Kind::Integers => format!("{name}: Numbers"),
        Kind::Row(_) | Kind::Rest => format!("*{name}: Numbers"),
        Kind::OptionalRow(_) => format!("*{name}: Numbers | None"),
        Kind::Value => format!("*{name}: Value"),
        // It is one of the values that follow.
        Kind::Layer => return None,
    })
}

/// Returns the type of an argument in words.
pub(crate) fn type_of(arg: &Arg) -> String {
    let with = |text: String| if arg.shape.is_empty() { text } else { format!("{text}: {}", arg.shape) };
    match arg.kind {
        Kind::Text | Kind::OptionalText | Kind::Declaration | Kind::Layer => "string".into(),
        Kind::Number => "float".into(),
        Kind::Switch | Kind::Count => "int".into(),
        Kind::Numbers => format!("float[{}]", arg.shape),
        Kind::Integers => format!("int[{}]", arg.shape),
        Kind::Row(n) | Kind::OptionalRow(n) => with(format!("{n} floats")),
        Kind::Rest => with("floats".into()),
        Kind::Value => "as declared".into(),
    }
}

/// Returns the unit, the range and the words of an argument.
pub(crate) fn range_of(arg: &Arg) -> String {
    let words = arg.words.iter().map(|word| format!("`\"{word}\"`")).collect::<Vec<_>>().join(", ");
    match (arg.range, &*words) {
        (range, "") => range.to_owned(),
        ("", words) => words.to_owned(),
        (range, words) => format!("{words}; {range}"),
    }
}

/// Returns the declarations of each call in the header for C++, in its order.
pub(crate) fn cpp() -> BTreeMap<String, Vec<String>> {
    let header = std::fs::read_to_string(repository().join("bindings/cpp/include/gelatoapi.h")).unwrap();
    let class = header.split_once("class GELATO_PUBLIC GelatoAPI {").unwrap().1;
    let (before, nested) = class.split_once("class GELATO_PUBLIC Generator {").unwrap();
    let after = nested.split_once("};").unwrap().1;
    let code: Vec<&str> =
        before.lines().chain(after.lines()).map(|line| line.split("//").next().unwrap_or("")).collect();
    let words: Vec<String> = code.join(" ").split_whitespace().map(str::to_owned).collect();
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for declaration in words.join(" ").split("virtual ").skip(1) {
        let (head, rest) = declaration.split_once(" (").unwrap();
        let name = head.split([' ', '~', '&']).next_back().unwrap();
        if !NO_CALLS.contains(&name) {
            let args = rest.split_once(')').unwrap().0;
            let args = if args == "void" { "" } else { args };
            found.entry(name.to_owned()).or_default().push(format!("{head} ({args})"));
        }
    }
    found
}

/// Returns a text of the table without the marks of a page.
pub(crate) fn plain(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, link)) = rest.split_once('[') {
        out.push_str(before);
        match link.split_once("](").and_then(|(shown, to)| Some((shown, to.split_once(')')?.1))) {
            Some((shown, behind)) => {
                out.push_str(shown);
                rest = behind;
            }
            None => {
                out.push('[');
                rest = link;
            }
        }
    }
    out.push_str(rest);
    out.replace('`', "")
}

#[test]
fn marks_are_removed() {
    assert_eq!(plain("see [Input and x](../a.md#b), `nu`, int[2] [a"), "see Input and x, nu, int[2] [a");
}
