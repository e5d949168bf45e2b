//! The pages of the functions and of the language, which are made from the tables of the compiler.

use crate::kept;
use granita_gsl::help::{self, Conversion, Entry, Section};
use granita_gsl::ir::{Global, ShaderKind};
use granita_tests::repository;
use std::fmt::Write;

/// Replaces the lines between `<!-- NAME -->` and `<!-- end -->` of a page.
fn replace_part(page: &mut String, name: &str, text: &str) {
    let mark = format!("<!-- {name} -->\n");
    let from = page.find(&mark).unwrap_or_else(|| panic!("no {mark}")) + mark.len();
    let end = from + page[from..].find("<!-- end -->").unwrap_or_else(|| panic!("no end of {mark}"));
    page.replace_range(from..end, &format!("\n{}\n\n", text.trim()));
}

/// Returns the name of a heading in links, as GitHub and mdbook make it.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// Returns an entry as a section of a page.
fn function(entry: &Entry) -> String {
    let mut out = format!("### {}\n\n```gsl,entry\n", entry.names.join(", "));
    let longest = entry.forms.iter().map(|f| f.declaration.len()).max().unwrap_or(0);
    for form in &entry.forms {
        let line = match &*form.note {
            "" => form.declaration.clone(),
            note => format!("{:<longest$}    // {note}", form.declaration),
        };
        let _ = writeln!(out, "{line}");
    }
    out += "```\n\n";
    if let Some(note) = entry.type_note() {
        let _ = writeln!(out, "{note}\n");
    }
    let _ = writeln!(out, "{}\n", entry.text);
    if !entry.options.is_empty() {
        out += "| option | type | default | effect |\n|---|---|---|---|\n";
        for option in &entry.options {
            let default =
                if option.default.is_empty() { String::new() } else { format!("`{}`", option.default) };
            let ty = option.declaration();
            let _ = writeln!(out, "| \"{}\" | `{ty}` | {default} | {} |", option.name, cell(option.help));
        }
        out.push('\n');
    }
    let _ = writeln!(out, "```gsl,entry\n{}\n```\n", entry.example);
    out
}

/// Returns the list of all functions of a page by section.
fn contents(sections: &[Section], page: &str) -> String {
    let mut out = String::from("| section | functions |\n|---|---|\n");
    for section in sections {
        let file = if section.page == page { String::new() } else { format!("{}.md", section.page) };
        let links: Vec<String> = section
            .entries
            .iter()
            .flat_map(|e| e.names.iter().map(|n| format!("[{n}]({file}#{})", anchor(&e.names.join(", ")))))
            .collect();
        let _ =
            writeln!(out, "| [{}]({file}#{}) | {} |", section.title, anchor(section.title), links.join(" "));
    }
    out
}

#[test]
fn the_manual_describes_every_function() {
    let all = help::sections();
    for (name, title, head) in [
        (
            "functions",
            "Functions",
            "```sh\ngslc -functions smoothstep\n```\n\nprints the entry of a function, and `gslc -functions` the list of all. \
             This page has the functions of numbers, colours, patterns, grids and strings, and \
             [Functions of the scene](functions-scene.md) those of textures, light, rays, displacement, databases and messages. \
             [Types, operators, variables and statements](language.md) has the rest of the language.\n\n\
             Declarations are made from the table of the compiler. `any` is a value or an array of any type, `output` is a \
             variable that the function writes, and `...` after other arguments are its options or further values. An \
             argument is converted as in an assignment. Each example is the body of a surface shader, unless it is a whole \
             shader. A number or string after `//` is the value that the variable of its line has; tests compare it.\n\n\
             Unless an entry says otherwise, a function costs the same at every point. A call whose arguments are the same \
             for all points of a grid runs once for the grid.\n",
        ),
        (
            "functions-scene",
            "Functions of the scene",
            "```sh\ngslc -functions environment\n```\n\nprints the entry of a function. This page has the functions of textures, light, \
             rays, displacement, databases and messages. [Functions](functions.md) has the others, and the list of all.\n",
        ),
    ] {
        let own: Vec<Section> = all.iter().filter(|s| s.page == name).cloned().collect();
        let listed = if name == "functions" { &all } else { &own };
        let mut text = format!("# {title}\n\n{head}\n{}\n", contents(listed, name));
        for section in &own {
            let _ = writeln!(text, "## {}\n", section.title);
            if !section.intro.is_empty() {
                let _ = writeln!(text, "{}\n", section.intro);
            }
            text.extend(section.entries.iter().map(function));
        }
        let text = format!("{}\n", text.trim_end());
        assert!(text.lines().count() < 1700, "{name}.md is long");
        kept(&format!("docs/{name}.md"), &text);
    }
}

#[test]
fn the_manual_lists_the_tables_of_the_language() {
    let path = repository().join("docs/language.md");
    let mut text = std::fs::read_to_string(path).unwrap();
    let table = |first: &str, cell: &dyn Fn(usize, usize) -> String| {
        let words: Vec<String> = help::TYPES.iter().map(|ty| format!("`{}`", ty.word())).collect();
        let mut out = format!("| {first} | {} |\n|{}\n", words.join(" | "), "---|".repeat(words.len() + 1));
        for (a, word) in words.iter().enumerate() {
            let cells: Vec<String> = (0..words.len()).map(|b| cell(a, b)).collect();
            if cells.iter().any(|cell| !cell.is_empty()) {
                let _ = writeln!(out, "| {word} | {} |", cells.join(" | "));
            }
        }
        out
    };
    let conversions = table("from, to", &|a, b| match help::conversion_of(help::TYPES[a], help::TYPES[b]) {
        Conversion::Implicit if a == b => String::new(),
        Conversion::Implicit => "yes".to_owned(),
        Conversion::Cast => "cast".to_owned(),
        Conversion::Impossible => String::new(),
    });
    replace_part(&mut text, "conversions", &conversions);
    for operator in ['+', '-', '*'] {
        let results = table(&format!("a, b of `{operator}`"), &|a, b| {
            let found = help::result_of(operator, help::TYPES[a], help::TYPES[b]);
            if operator == '*' {
                assert_eq!(found, help::result_of('/', help::TYPES[a], help::TYPES[b]));
            }
            found.map_or_else(String::new, |ty| ty.word().to_owned())
        });
        replace_part(&mut text, &format!("operator {operator}"), &results);
    }
    let mut constants = String::from("| constant | value |\n|---|---|\n");
    help::constants().for_each(|(name, value)| _ = writeln!(constants, "| `{name}` | {value} |"));
    replace_part(&mut text, "constants", &constants);
    let kinds = [ShaderKind::Surface, ShaderKind::Displacement, ShaderKind::Volume, ShaderKind::Light];
    let words: Vec<&str> = kinds.iter().map(|kind| kind.word()).collect();
    let mut globals = format!("| variable | {} | meaning |\n|---|---|---|---|---|---|\n", words.join(" | "));
    for global in Global::ALL {
        let cells: Vec<&str> = kinds.iter().map(|kind| help::access_of(*kind, global)).collect();
        let (ty, word) = (global.value_type().word(), global.word());
        let _ = writeln!(globals, "| `{ty} {word}` | {} | {} |", cells.join(" | "), help::meaning_of(global));
    }
    replace_part(&mut text, "globals", &globals);
    kept("docs/language.md", &text);
}
