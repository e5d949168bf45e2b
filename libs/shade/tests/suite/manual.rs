//! Compiles and runs the examples of the reference of the functions and of the page about the language.
//!
//! An example is the body of a surface shader, or a whole shader. A line `NAME = ...; // 1 2 3` or `// "text"` states
//! the value that the variable then has.

use crate::fixture::*;
use granita_base::Params;
use granita_gsl::ir::ShaderKind;
use granita_gsl::{CompileOptions, compile, help};
use granita_shade::{Executor, Group, LayerSource};

/// A value that an example states.
#[derive(Debug)]
struct Stated {
    line: usize,
    value: String,
}

/// Returns an example as a shader that prints the stated values, and these values.
fn instrumented(example: &str) -> (String, Vec<Stated>) {
    let kinds = ["surface ", "displacement ", "volume ", "light "];
    let is_whole = example.lines().any(|line| kinds.iter().any(|kind| line.starts_with(kind)));
    let mut out = String::new();
    let mut stated = Vec::new();
    for (line, text) in example.lines().enumerate() {
        out += text;
        if let Some((code, comment)) = text.split_once(" // ")
            && comment.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '"')
        {
            let name = code.split('=').next().and_then(|left| left.split_whitespace().last());
            let conversion = if comment.starts_with('"') { "%s" } else { "%.9g" };
            out += &format!("\nprintf (\"@{line} {conversion}\\n\", {});", name.unwrap_or_default());
            stated.push(Stated { line, value: comment.trim().trim_matches('"').to_owned() });
        }
        out += "\n";
    }
    if !is_whole {
        out = format!("surface example ()\n{{\n{out}}}\n");
    }
    (out, stated)
}

/// True when a printed value is the stated one, within the digits that are stated.
fn is_stated(printed: &str, stated: &str) -> bool {
    let numbers = |text: &str| text.split(' ').map(str::parse).collect::<Result<Vec<f32>, _>>().ok();
    match (numbers(printed), numbers(stated)) {
        (Some(a), Some(b)) if a.len() == b.len() => {
            a.iter().zip(&b).all(|(a, b)| (a - b).abs() <= if *b == 0.0 { 1e-6 } else { 1e-5 * b.abs() })
        }
        _ => printed == stated,
    }
}

/// Compiles an example and runs it, except lights.
fn check(of: &str, example: &str) {
    let (source, stated) = instrumented(example);
    let compiled = compile(&source, of, &CompileOptions::default());
    let compiled = compiled.unwrap_or_else(|list| panic!("{of}: {source}\n{list:#?}"));
    assert!(compiled.warnings.is_empty(), "{of}: {source}\n{:#?}", compiled.warnings);
    let kind = compiled.module.kind;
    let layer = LayerSource { module: compiled.module, params: &Params::new(), name: None };
    let group = Group::link(&[layer], &[], &mut |_, text| panic!("{of}: {text}")).expect("a group");
    if kind == ShaderKind::Light {
        assert!(stated.is_empty(), "{of}: values of lights are not compared");
        return;
    }
    let mut grid = square(5, 4);
    let mut services = Double { grid: Some(grid.clone()), ..Double::default() };
    Executor::new().run(&group, &mut grid, &mut services, &[("C", granita_gsl::ir::ValueType::Color)]);
    assert_eq!(services.errors(), Vec::<&str>::new(), "{of}: {source}");
    let printed = services.printed().concat();
    for Stated { line, value } in &stated {
        let mark = format!("@{line} ");
        let found: Vec<&str> = printed.lines().filter_map(|text| text.strip_prefix(&mark)).collect();
        assert!(!found.is_empty(), "{of}, line {line}: not reached\n{source}");
        for found in found {
            assert!(is_stated(found, value), "{of}, line {line}: {found}, not {value}\n{source}");
        }
    }
}

#[test]
fn examples_of_functions_have_their_values() {
    let (mut stated, mut wrong) = (0, Vec::new());
    for entry in help::sections().iter().flat_map(|section| &section.entries) {
        if std::panic::catch_unwind(|| check(entry.names[0], entry.example)).is_err() {
            wrong.push(entry.names[0]);
        }
        stated += instrumented(entry.example).1.len();
    }
    assert!(wrong.is_empty(), "{wrong:?}");
    assert!(stated > 100, "{stated} values");
}

#[test]
fn examples_of_the_language_have_their_values() {
    let page = include_str!("../../../../docs/language.md");
    let code = |block: &'static str| Some(block.split_once('\n')?.1.split_once("```")?.0);
    let examples: Vec<&str> = page.split("```gsl").skip(1).filter_map(code).collect();
    assert!(examples.len() >= 4);
    for (k, example) in examples.iter().enumerate() {
        check(&format!("language.md, example {}", k + 1), example);
    }
}

#[test]
fn wrong_values_are_noticed() {
    for (printed, stated, same) in [
        ("0.333333343", "0.333333", true),
        ("0.333333343 1 0", "0.333333 1 0", true),
        ("0.334", "0.333333", false),
        ("1 2", "1 2 3", false),
        ("1.53745e-12", "1.53746e-12", true),
        ("1.53e-12", "1.53746e-12", false),
        ("wood", "wood", true),
        ("wood", "woods", false),
    ] {
        assert_eq!(is_stated(printed, stated), same, "{printed} {stated}");
    }
}
