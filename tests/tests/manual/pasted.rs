//! The pages of tasks and the tutorials. Their blocks are pasted into a folder that looks like the root of a checkout:
//! blocks of files become files, and each command must end without an error or a warning.

use crate::pages::{Block, PageText, pages};
use granita_tests::{Tools, repository};
use std::path::Path;
use std::process::Command;

/// The beginnings of commands that are not run, each with the reason.
const NOT_RUN: [(&str, &str); 3] = [
    ("cargo ", "it builds the suite"),
    ("gelato -manual", "it opens a browser; the tests of gelato run it"),
    ("gelato examples/", "examples take minutes in this profile; the gallery renders them"),
];

/// A file between the examples that takes seconds.
const RUN: &str = "gelato examples/data/";

/// Runs `gelato` for a few pixels in the middle of an image, unless the command says which part it renders.
const GELATO: &str = "case \" $* \" in
*' -crop '*|*' -as '*) exec \"$GELATO_OF_TEST\" \"$@\" ;;
*) exec \"$GELATO_OF_TEST\" -crop 0.46 0.54 0.46 0.54 \"$@\" ;;
esac
";

/// True for the pages whose blocks are pasted.
fn is_pasted(page: &PageText) -> bool {
    page.name == "docs/howto.md" || page.name.starts_with("docs/tutorials/")
}

/// Returns the name of the file that a block is.
pub(crate) fn file_name(block: &Block) -> Option<&str> {
    let comment = block.text.lines().next().filter(|_| block.info.ends_with(",file"))?;
    comment.trim_start_matches(['#', '/']).split_whitespace().next()
}

#[test]
fn files_of_blocks_have_names() {
    for page in pages() {
        for block in page.blocks().iter().filter(|block| block.info.ends_with(",file")) {
            assert!(is_pasted(&page), "{}:{}: its commands are not run", page.name, block.line);
            let extension = block.info.split(',').next().unwrap_or_default();
            let name = file_name(block).unwrap_or_default();
            assert!(name.ends_with(&format!(".{extension}")), "{}:{}: \"{name}\"", page.name, block.line);
        }
    }
}

#[test]
fn every_question_has_a_section_and_an_answer() {
    let all = pages();
    let page = all.iter().find(|page| page.name == "docs/howto.md").unwrap();
    let blocks = page.blocks();
    let questions: Vec<&str> = page.headings().into_iter().filter(|h| h.0 == 3).map(|h| h.1).collect();
    for question in &questions {
        assert!(question.ends_with('?'), "{question}");
        let section = page.text.split_once(&format!("### {question}\n")).unwrap().1;
        let section = section.split("\n#").next().unwrap();
        assert!(section.contains("](") && section.contains(".md"), "{question}: no link");
        assert!(blocks.iter().any(|block| block.heading == *question), "{question}: no block");
    }
    assert!(questions.len() >= 40, "{} questions", questions.len());
}

#[cfg(unix)]
#[test]
fn pasted_commands_work() {
    let tools = Tools::build_with(&["iv"]).unwrap();
    let (mut faults, mut n) = (String::new(), 0);
    for page in pages().iter().filter(|page| is_pasted(page)) {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path();
        std::fs::create_dir(place.join("bin")).unwrap();
        granita_needs::write_script(&place.join("bin/gelato"), GELATO);
        copy(&repository().join("examples"), &place.join("examples"));
        for block in page.blocks() {
            if let Some(name) = file_name(&block) {
                std::fs::write(place.join(name), &block.text).unwrap();
            }
            for line in block.text.lines().filter(|_| block.info == "sh") {
                if NOT_RUN.iter().any(|(start, _)| line.starts_with(start)) && !line.starts_with(RUN) {
                    continue;
                }
                n += 1;
                if let Err(what) = paste(&tools, place, line) {
                    faults += &format!("{}:{}: {line}\n{what}\n", page.name, block.line);
                }
            }
        }
    }
    assert!(faults.is_empty() && n > 40, "{n} commands\n{faults}");
}

/// Runs a line of the shell. Returns its messages when it fails or warns.
#[cfg(unix)]
fn paste(tools: &Tools, place: &Path, line: &str) -> Result<(), String> {
    let path = format!(
        "{}:{}:{}",
        place.join("bin").display(),
        tools.folder().display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let mut command = Command::new("sh");
    command.current_dir(place).args(["-c", line]).env("PATH", path).env("HOME", place);
    command.env("GELATO_OF_TEST", tools.program("gelato")).env_remove("GELATOHOME").env_remove("DISPLAY");
    let ran = command.output().map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    let is_quiet = !said.contains("warning: ") && !said.contains("error: ");
    if ran.status.success() && is_quiet { Ok(()) } else { Err(format!("{}\n{said}", ran.status)) }
}

/// Copies a folder without the results in it.
#[cfg(unix)]
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name())).unwrap();
        match path.is_dir() {
            true if name == "out" => (),
            true => copy(&path, &to.join(name)),
            false => _ = std::fs::copy(&path, to.join(name)).unwrap(),
        }
    }
}
