//! The other blocks of code of the manual: shaders are compiled, and commands name tools, options and files that exist.

use crate::pages::{Block, PageText, pages};
use granita_gsl::{CompileOptions, compile};
use granita_tests::repository;

/// The words after the fences, and what is checked. "gsl,part" is a function. "gsl,entry" belongs to an entry of a
/// function, whose examples the tests of `shade` run. "pyg,file" and "gsl,file" are files, which commands of the same
/// page use.
const KINDS: [&str; 15] = [
    "pyg",
    "pyg,calls",
    "pyg,file",
    "pyg,rerender",
    "gsl",
    "gsl,part",
    "gsl,entry",
    "gsl,file",
    "sh",
    "text",
    "python",
    "cpp",
    "rust",
    "cmake",
    "toml",
];

/// The tools, each with the page that lists its options.
const TOOLS: [(&str, &str); 7] = [
    ("gelato", "docs/gelato.md"),
    ("maketx", "docs/maketx.md"),
    ("imgtool", "docs/imgtool.md"),
    ("iv", "docs/iv.md"),
    ("topyg", "docs/scenes.md"),
    ("gslc", "docs/shaders.md"),
    ("gsoinfo", "docs/shaders.md"),
];

fn each_block(mut check: impl FnMut(&PageText, &Block) -> Result<(), String>) -> String {
    let mut faults = String::new();
    for page in pages() {
        for block in page.blocks() {
            if let Err(what) = check(&page, &block) {
                faults += &format!("{}:{}: {what}\n", page.name, block.line);
            }
        }
    }
    faults
}

#[test]
fn blocks_have_a_language() {
    let faults = each_block(|_, block| match KINDS.contains(&&*block.info) {
        true => Ok(()),
        false => Err(format!("a block of \"{}\"", block.info)),
    });
    assert!(faults.is_empty(), "{faults}");
}

#[test]
fn shaders_compile() {
    let mut n = 0;
    let faults = each_block(|page, block| {
        let text = match &*block.info {
            "gsl" | "gsl,file" => block.text.clone(),
            "gsl,part" => format!("{}\nsurface part () {{ }}\n", block.text),
            _ => return Ok(()),
        };
        n += 1;
        compile(&text, &page.name, &CompileOptions::default()).map_err(|all| format!("{all:?}"))?;
        Ok(())
    });
    assert!(faults.is_empty() && n > 1, "{n} shaders\n{faults}");
}

#[test]
fn commands_name_options_and_files_that_exist() {
    let all = pages();
    let mut n = 0;
    let faults = each_block(|_, block| {
        if block.info != "sh" {
            return Ok(());
        }
        for command in block.text.split(['\n', '|', ';', '&']) {
            let words: Vec<&str> = command.split_whitespace().collect();
            let Some((_, page)) = TOOLS.iter().find(|(tool, _)| words.first() == Some(tool)) else {
                continue;
            };
            n += 1;
            let page = all.iter().find(|other| other.name == *page).unwrap();
            for word in &words[1..] {
                // Modifiers of options of imgtool follow a colon.
                let word = &word.split(':').next().unwrap_or(word);
                let listed =
                    || page.text.contains(&format!("`{word}`")) || page.text.contains(&format!("`{word} "));
                let is_option =
                    word.strip_prefix('-').is_some_and(|name| name.starts_with(char::is_alphabetic));
                if is_option && !listed() {
                    return Err(format!("{} does not list {word}", page.name));
                }
                if word.starts_with("examples/") && !repository().join(word).exists() {
                    return Err(format!("there is no {word}"));
                }
            }
        }
        Ok(())
    });
    assert!(faults.is_empty() && n > 20, "{n} commands\n{faults}");
}
