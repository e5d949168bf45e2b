//! Tests of the program with all tools.

#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::path::Path;
use std::process::{Command, Output};

fn ran(program: &Path, words: &[&str]) -> Output {
    Command::new(program).args(words).output().unwrap()
}

fn granita(words: &[&str]) -> Output {
    ran(Path::new(env!("CARGO_BIN_EXE_granita")), words)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim().to_owned()
}

#[test]
fn every_tool_runs_by_its_name() {
    for tool in ["gelato", "gslc", "gsoinfo", "imgtool", "iv", "maketx", "topyg"] {
        for words in [vec![tool, "-version"], vec!["-as", tool, "-version"]] {
            let out = granita(&words);
            assert!(out.status.success() && text(&out.stdout).starts_with(&format!("{tool} ")), "{words:?}");
        }
    }
}

#[cfg(unix)]
#[test]
fn a_link_runs_the_tool_of_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("maketx");
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_granita"), &link).unwrap();
    assert!(text(&ran(&link, &["-version"]).stdout).starts_with("maketx "));
    // An input of that name is not a tool.
    let out = ran(&link, &["gelato"]);
    assert_eq!((out.status.code(), text(&out.stderr).contains("gelato")), (Some(2), true));
}

#[test]
fn scenes_and_workers_use_the_same_program() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "Attribute (\"int[2] resolution\", (16, 16))\nOutput (\"a.tif\", \"tiff\", \"rgb\", \"camera\")\n\
                 Attribute (\"string net:workers\", \"local\")\nWorld ()\nCommand (\"system gsoinfo plastic > p.txt\")\n\
                 Sphere (1, -1, 1, 360)\nRender ()\n";
    std::fs::write(folder.path().join("a.pyg"), scene).unwrap();
    let out = Command::new(env!("CARGO_BIN_EXE_granita"))
        .args(["gelato", "a.pyg"])
        .current_dir(folder.path())
        .env("PATH", "")
        .output()
        .unwrap();
    assert!(out.status.success() && text(&out.stderr).is_empty(), "{}", text(&out.stderr));
    assert!(folder.path().join("a.tif").is_file());
    assert!(std::fs::read_to_string(folder.path().join("p.txt")).unwrap().contains("plastic"));
}

#[test]
fn unknown_tools_and_folders_are_errors() {
    for (words, expected) in [
        (&["maketex"][..], "granita: error: there is no tool maketex; did you mean maketx?"),
        (
            &["-as", "nosuch"],
            "granita: error: -as needs the name of a tool: gelato, gslc, gsoinfo, imgtool, iv, maketx, oiio-maketx, topyg",
        ),
        (&["render"], "granita: error: there is no tool render: the tools are gelato, gslc"),
        (&["-hom"], "granita: error: there is no option -hom; did you mean -home?"),
        (&["-home"], "is not in the folder bin of an installation"),
    ] {
        let out = granita(words);
        assert_eq!(out.status.code(), Some(2), "{words:?}");
        assert!(text(&out.stderr).contains(expected), "{words:?}: {}", text(&out.stderr));
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let out = granita(&["-share", file.to_str().unwrap()]);
    assert_eq!(out.status.code(), Some(2));
    assert!(
        text(&out.stderr).contains("-share: ") && text(&out.stderr).contains("file"),
        "{}",
        text(&out.stderr)
    );
}

#[test]
fn an_installation_prints_its_folder_and_pages() {
    let folder = tempfile::tempdir().unwrap();
    let home = folder.path().canonicalize().unwrap();
    let (bin, program) = (home.join("bin"), home.join("bin/granita"));
    std::fs::create_dir_all(&bin).unwrap();
    std::fs::create_dir(home.join("shaders")).unwrap();
    granita_needs::copy_program(Path::new(env!("CARGO_BIN_EXE_granita")), &program);
    let out = ran(&program, &["-home"]);
    assert_eq!(text(&out.stdout), home.display().to_string(), "{}", text(&out.stderr));
    let share = home.join("share");
    assert!(ran(&program, &["-share", share.to_str().unwrap()]).status.success());
    for file in [
        "man/man1/granita.1",
        "man/man1/granita-iv.1",
        "bash-completion/completions/maketx",
        "zsh/site-functions/_gelato",
        "fish/vendor_completions.d/granita.fish",
    ] {
        assert!(share.join(file).is_file(), "{file}");
    }
    let plain = std::fs::read_to_string(share.join("man/man1/iv.1")).unwrap();
    assert_eq!(plain, ".so man1/granita-iv.1\n");
}
