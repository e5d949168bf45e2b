//! Tests that the manual page of the bundled shaders agrees with their sources.
//!
//! `GRANITA_BLESS=shaders cargo test -p gsoinfo --test manual` writes the list again.

use granita_gsl::ir::{ConstValue, Metadatum};
use granita_gsl::{CompileOptions, GsoArgs, compile};
use std::path::Path;

const HEADING: &str = "## Bundled shaders\n\n";

/// Returns the description among metadata.
fn description(metadata: &[Metadatum]) -> Option<String> {
    metadata.iter().find(|m| &*m.name == "description").and_then(|m| match &m.value {
        ConstValue::Strings(list) => list.first().map(|s| s.to_string()),
        ConstValue::Floats(_) => None,
    })
}

/// Returns the list of all bundled shaders with their parameters, in the form of the manual.
fn list() -> String {
    let mut out = String::from("Every shader with its parameters, their defaults and a line of help.\n");
    for name in granita_bundled::shader_names() {
        let source = granita_bundled::shader(name).expect("a bundled shader");
        let module = compile(source, name, &CompileOptions::default()).expect("no mistakes").module;
        let args = GsoArgs::from_module(&module);
        let help = description(args.metadata()).unwrap_or_else(|| panic!("{name} has no description"));
        out += &format!("\n### {name}\n\n{help} ({}).\n", args.shadertype());
        if args.args().is_empty() {
            continue;
        }
        out += "\n| parameter | default | |\n|---|---|---|\n";
        // The lines of `gsoinfo`: [output] type name value.
        let text = args.describe(false);
        for (arg, line) in args.args().iter().zip(text.lines().skip(1)) {
            let (before, value) = line.split_once(&format!(" {}", arg.name)).unwrap_or((line, ""));
            let help = description(&arg.metadata)
                .unwrap_or_else(|| panic!("{name}: {} has no description", arg.name));
            let value = match value.trim() {
                "nodefault" => "computed".to_owned(),
                value => format!("`{value}`"),
            };
            out += &format!("| `{before} {}` | {value} | {help} |\n", arg.name);
        }
    }
    out
}

#[test]
fn the_manual_lists_every_bundled_shader() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/shaders.md");
    let text = std::fs::read_to_string(&file).expect("the manual");
    let (front, kept) = text.split_once(HEADING).expect("the heading of the list");
    let list = list();
    if std::env::var("GRANITA_BLESS").is_ok_and(|b| b == "shaders") {
        std::fs::write(&file, format!("{front}{HEADING}{list}")).expect("a file");
        return;
    }
    for (line, (kept, list)) in (1..).zip(kept.lines().zip(list.lines())) {
        assert_eq!(kept, list, "line {line} of the list; GRANITA_BLESS=shaders writes it again");
    }
    assert_eq!(kept.len(), list.len(), "one ends before the other; GRANITA_BLESS=shaders writes it again");
}
