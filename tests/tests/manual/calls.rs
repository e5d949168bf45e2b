//! The pages of calls. Signatures, arguments and other tables in them are made from the tables in the code, and no call
//! is without a section or an example.

use crate::kept;
use crate::pages::{PageText, pages};
use crate::signature::{cpp, pyg, python, range_of, type_of};
use granita_base::shape::KnotSpan;
use granita_base::{CurveBasis, Interp, ShapeDesc};
use granita_scene::interface::{COMMANDS, CallRow, Form, Page, TABLE, VARIABLES, call_row};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// The end of a part that is made from a table.
const END: &str = "<!-- end -->\n";

/// Returns the page of calls, relative to `docs`.
fn file(page: Page) -> &'static str {
    match page {
        Page::Frames => "calls/frames.md",
        Page::Attributes => "calls/attributes.md",
        Page::Transformations => "calls/transformations.md",
        Page::Shaders => "calls/shaders.md",
        Page::Shapes => "calls/shapes.md",
    }
}

/// Returns the pages that describe calls.
fn call_pages() -> Vec<PageText> {
    let mut all = pages();
    all.retain(|page| page.name == "docs/calls.md" || page.name.starts_with("docs/calls/"));
    assert_eq!(all.len(), 6);
    all
}

#[test]
fn parts_are_made_from_tables() {
    let header = cpp();
    for page in call_pages() {
        let mut text = String::new();
        let mut rest = &*page.text;
        while let Some((before, behind)) = rest.split_once("<!-- ") {
            let (mark, behind) = behind.split_once(" -->\n").unwrap();
            let (_, behind) =
                behind.split_once(END).unwrap_or_else(|| panic!("{}: {mark} has no end", page.name));
            let _ = write!(text, "{before}<!-- {mark} -->\n{}{END}", part(mark, &header));
            rest = behind;
        }
        text.push_str(rest);
        kept(&page.name, &text);
    }
}

/// Returns the text of a part.
fn part(mark: &str, header: &BTreeMap<String, Vec<String>>) -> String {
    match mark {
        "index" => index(),
        "classes" => classes(),
        "variables" => variables(),
        "commands" => commands(),
        other => {
            let name = other.strip_prefix("call: ").unwrap_or_else(|| panic!("there is no part \"{other}\""));
            section(call_row(name).unwrap_or_else(|| panic!("there is no call \"{name}\"")), &header[name])
        }
    }
}

fn index() -> String {
    let mut text = "\n| call | meaning |\n|---|---|\n".to_owned();
    for row in TABLE {
        let (name, file) = (row.name, file(row.page));
        let _ = writeln!(text, "| [`{name}`]({file}#{}) | {} |", name.to_ascii_lowercase(), row.help);
    }
    text + "\n"
}

/// Returns the description, the signatures and the arguments of a call.
fn section(row: &CallRow, cpp: &[String]) -> String {
    let mut text = format!("\n{}\n\n```text\n", row.help);
    for (k, form) in row.forms.iter().enumerate() {
        let _ = writeln!(text, "{:<7} {} ({})", if k == 0 { "Pyg" } else { "" }, row.name, pyg(form));
    }
    for (k, form) in row.forms.iter().enumerate() {
        let _ = writeln!(
            text,
            "{:<7} gelato.{}{}",
            if k == 0 { "Python" } else { "" },
            row.name,
            python(row, form)
        );
    }
    for (k, declaration) in cpp.iter().enumerate() {
        let _ = writeln!(text, "{:<7} {declaration}", if k == 0 { "C++" } else { "" });
    }
    text += "```\n\n";
    for form in row.forms.iter().filter(|form| form.params || !form.args.is_empty()) {
        arguments(&mut text, row, form);
    }
    if row.is_query() {
        let _ = writeln!(text, "It returns {}.\n", row.returns);
    }
    text
}

fn arguments(text: &mut String, row: &CallRow, form: &Form) {
    *text += "| argument | type | unit and range | default | meaning |\n|---|---|---|---|---|\n";
    for arg in form.args {
        let (range, help) = (range_of(arg).replace('|', "\\|"), arg.help.replace('|', "\\|"));
        let _ = writeln!(text, "| `{}` | {} | {range} | {} | {help} |", arg.name, type_of(arg), arg.default);
    }
    if form.params {
        let parameters = match row.page {
            Page::Shapes => "[Parameters of primitives](#parameters-of-primitives) and primitive variables.",
            _ => "Parameters, see below.",
        };
        let _ = writeln!(text, "| `\"type name\", value` | pairs | | none | {parameters} |");
    }
    *text += "\n";
}

fn variables() -> String {
    let mut text =
        "\n| parameter | of | unit and range | default | meaning |\n|---|---|---|---|---|\n".to_owned();
    for row in VARIABLES {
        let declaration = format!("{} {}", row.ty, row.name).replace("[0]", "[]");
        let _ = writeln!(
            text,
            "| `{declaration}` | {} | {} | {} | {} |",
            row.of, row.range, row.default, row.help
        );
    }
    text + "\n"
}

fn commands() -> String {
    let mut text = "\n| command | meaning | parameters |\n|---|---|---|\n".to_owned();
    for row in COMMANDS {
        let params: Vec<String> = row.params.iter().map(|(name, help)| format!("`{name}`: {help}")).collect();
        let _ = writeln!(text, "| `\"{}\"` | {} | {} |", row.name, row.help, params.join("; "));
    }
    text + "\n"
}

/// A primitive, an example of it, and its numbers of "perpiece", "linear" and "vertex" values in words and numbers.
type ClassRow = (&'static str, ShapeDesc, [(&'static str, usize); 3]);

/// Returns the numbers of values of each class, which are compared with those of an example.
fn classes() -> String {
    let span = |n: usize| KnotSpan { n, order: 2, knots: vec![0.0; n + 2].into(), min: 0.0, max: 1.0 };
    let (linear, mesh) = (CurveBasis::Linear, [0, 1, 2, 0, 2, 6, 5]);
    let rows: [ClassRow; 7] = [
        (
            "`Patch`",
            ShapeDesc::Patch { u: linear, v: linear, nu: 2, nv: 5 },
            [("-", 0), ("4", 4), ("nu * nv", 2 * 5)],
        ),
        (
            "`Patch` (NURBS)",
            ShapeDesc::Nurbs { u: span(3), v: span(5) },
            [("-", 0), ("4", 4), ("nu * nv", 3 * 5)],
        ),
        (
            "`Mesh`",
            ShapeDesc::Mesh { subdivide: false, nverts: [3, 4].into(), verts: mesh.into() },
            [("number of faces", 2), ("sum of nverts", 3 + 4), ("largest index + 1, or more", 6 + 1)],
        ),
        ("`Points`", ShapeDesc::Points { n: 7 }, [("n", 7), ("n", 7), ("n", 7)]),
        (
            "`Curves`",
            ShapeDesc::Curves { basis: linear, ncurves: 3, nverts: 5 },
            [("ncurves", 3), ("2 ncurves", 2 * 3), ("ncurves * nverts", 3 * 5)],
        ),
        (
            "`Curves` (NURBS)",
            ShapeDesc::NurbsCurves { ncurves: 3, span: span(5) },
            [("ncurves", 3), ("2 ncurves", 2 * 3), ("ncurves * nverts", 3 * 5)],
        ),
        (
            "`Sphere`",
            ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 },
            [("-", 0), ("4", 4), ("-", 0)],
        ),
    ];
    let mut text = "\n| | constant | perpiece | linear | vertex |\n|---|---|---|---|---|\n".to_owned();
    for (name, shape, classes) in &rows {
        assert_eq!(shape.items(Interp::Constant), 1);
        let kinds = [Interp::PerPiece, Interp::Linear, Interp::Vertex];
        for (interp, (_, wanted)) in kinds.iter().zip(classes) {
            assert_eq!(shape.items(*interp), *wanted, "{name} {interp:?}");
        }
        let [perpiece, linear, vertex] = classes.map(|(text, _)| text);
        let _ = writeln!(text, "| {name} | 1 | {perpiece} | {linear} | {vertex} |");
    }
    text + "\n"
}

#[test]
fn every_call_has_a_section_with_an_example() {
    let mut described = BTreeMap::new();
    for page in call_pages() {
        let blocks = page.blocks();
        for (level, heading) in page.headings() {
            let Some(row) = call_row(heading) else { continue };
            assert_eq!((level, &*page.name), (2, &*format!("docs/{}", file(row.page))), "{heading}");
            assert!(page.text.contains(&format!("## {heading}\n\n<!-- call: {heading} -->\n")), "{heading}");
            let uses = |text: &str| text.contains(&format!("{heading} ("));
            let examples = blocks.iter().filter(|block| block.heading == heading && block.info == "pyg");
            assert!(examples.into_iter().any(|block| uses(&block.text)), "{heading} has no example");
            assert_eq!(described.insert(heading.to_owned(), ()), None, "{heading} is described twice");
        }
    }
    let described: BTreeSet<&str> = described.keys().map(|name| &**name).collect();
    let table: BTreeSet<&str> = TABLE.iter().map(|row| row.name).collect();
    assert_eq!(described, table);
    assert_eq!(table.len(), TABLE.len(), "a call stands in the table twice");
}

#[test]
fn the_header_for_cpp_has_the_same_calls() {
    let header = cpp();
    let names: BTreeSet<&str> = header.keys().map(|name| &**name).collect();
    assert_eq!(names, TABLE.iter().map(|row| row.name).collect());
}

#[test]
fn forms_can_be_told_apart() {
    for row in TABLE {
        assert!(!row.forms.is_empty() && row.help.ends_with('.'), "{}", row.name);
        let texts = row.forms.iter().filter(|form| !form.args.is_empty());
        let mut kinds: Vec<bool> = texts.map(|form| form.args[0].kind.is_text()).collect();
        kinds.dedup();
        let n = row.forms.iter().filter(|form| !form.args.is_empty()).count();
        assert_eq!(kinds.len(), n, "{}: two forms begin alike", row.name);
    }
}
