//! The layout of `$GELATOHOME`: one program with all tools, links with their names, libraries, headers, shaders and
//! inputs.

use crate::book;
use crate::files::{copy, copy_all, link, made, read, repository, run, write};
use std::env::consts::{DLL_PREFIX, DLL_SUFFIX, EXE_SUFFIX};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The program with all tools.
pub(crate) const PROGRAM: &str = "granita";
/// The tools, which are links to it.
pub(crate) const TOOLS: [&str; 7] = ["gelato", "maketx", "imgtool", "gslc", "gsoinfo", "topyg", "iv"];
/// Further names of tools, which are links to it.
const NAMES: [&str; 1] = ["oiio-maketx"];
const LIBRARIES: [&str; 3] = ["gelato", "gsoargs", "granita_texture"];

/// Writes the layout below `home`, from the programs and libraries in `built`.
pub(crate) fn lay_out(home: &Path, built: &Path) -> Result<(), String> {
    let root = repository();
    let folder = |name: &str| made(home.join(name));
    let (bin, lib) = (folder("bin")?, folder("lib")?);
    let program = format!("{PROGRAM}{EXE_SUFFIX}");
    copy(&built.join(&program), &bin)?;
    for tool in TOOLS.into_iter().chain(NAMES) {
        link(&program, &bin.join(format!("{tool}{EXE_SUFFIX}")))?;
    }
    for library in LIBRARIES {
        copy(&built.join(format!("{DLL_PREFIX}{library}{DLL_SUFFIX}")), &lib)?;
    }
    copy_all(&root.join("bindings/cpp/include"), &folder("include")?, ".h")?;
    let shaders = folder("shaders")?;
    copy_all(&root.join("shaders"), &shaders, ".gsl")?;
    let program = std::path::absolute(bin.join(&program)).map_err(|e| e.to_string())?;
    compile_shaders(&program, &shaders)?;
    copy_all(&root.join("inputs"), &folder("inputs")?, ".pyg")?;
    folder("textures")?;
    run(Command::new(&program).arg("-share").arg(folder("share")?))?;
    documents(&folder("doc")?)?;
    let mut places =
        ["gelato.pc", "gsoargs.pc", "granita_texture.pc"].map(|file| (file, "pkgconfig")).to_vec();
    places.push(("GelatoConfig.cmake", "cmake/Gelato"));
    places.push(("GranitaTextureConfig.cmake", "cmake/GranitaTexture"));
    for (file, place) in places {
        let text = read(&root.join(format!("bindings/cpp/package/{file}.in")))?;
        write(&lib.join(place).join(file), &text.replace("@VERSION@", env!("CARGO_PKG_VERSION")))?;
    }
    Ok(())
}

/// Copies the manual, the licences and the list of changes. Where `mdbook` is installed, the manual is there as HTML,
/// too.
fn documents(doc: &Path) -> Result<(), String> {
    let root = repository();
    copy_all(&root.join("docs"), doc, ".md")?;
    for folder in ["calls", "tutorials"] {
        copy_all(&root.join("docs").join(folder), &made(doc.join(folder))?, ".md")?;
    }
    copy_all(&root.join("docs/pictures"), &made(doc.join("pictures"))?, "")?;
    for file in ["LICENSE-MIT", "LICENSE-APACHE", "CREDITS.md", "CHANGELOG.md"] {
        copy(&root.join(file), doc)?;
    }
    if book::has_program() {
        book::build(Some(&doc.join("book")))?;
    } else {
        println!("no mdbook (cargo install mdbook): the manual is copied as text only");
    }
    Ok(())
}

/// Compiles the shaders, for programs that search `.gso` files in `$GELATOHOME/shaders`.
fn compile_shaders(program: &Path, shaders: &Path) -> Result<(), String> {
    let entries = std::fs::read_dir(shaders).map_err(|e| format!("{}: {e}", shaders.display()))?;
    let paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    for path in paths.iter().filter(|path| path.extension().is_some_and(|e| e == "gsl")) {
        let name = path.file_name().unwrap_or_default();
        let words = ["gslc", "-verbosity", "0"];
        run(Command::new(program).current_dir(shaders).args(words).arg(name))?;
    }
    Ok(())
}
