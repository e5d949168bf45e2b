//! The wheel of Python: the packages `gelato` and `granita`, with the folder `gelato/suite`, the layout of
//! `$GELATOHOME` without documents and libraries, except that of textures.
//!
//! A wheel is an archive with two lists. `packaging/wheel.py` writes it, with Python's own modules: tools that build
//! wheels want to build the program as well, and need the network.

use super::Release;
use crate::files::{copy, emptied, made, repository, run};
use crate::home::PROGRAM;
use std::path::PathBuf;

/// The folders of `examples` that the first example reads. The wheel has no others.
const EXAMPLES: [&str; 2] = ["data", "first"];

/// The library that `granita.texture` loads.
const TEXTURES: &str = "libgranita_texture.so";

/// Makes the wheel, and returns its path.
pub(super) fn make(release: &Release) -> Result<PathBuf, String> {
    let root = repository();
    let home = emptied(release.work.join("wheel"))?;
    // Archives of this kind have no links: the names of the tools are scripts, which `wheel.py` writes.
    copy(&release.home.join("bin").join(PROGRAM), &made(home.join("bin"))?)?;
    copy(&release.home.join("lib").join(TEXTURES), &made(home.join("lib"))?)?;
    for folder in ["shaders", "inputs"] {
        run(release.command("cp").arg("-R").arg(release.home.join(folder)).arg(&home))?;
    }
    let examples = made(home.join("examples"))?;
    for folder in EXAMPLES {
        run(release.command("cp").arg("-R").arg(release.home.join("examples").join(folder)).arg(&examples))?;
    }
    super::modes(&home)?;
    let (major, minor) = release.needs.promised();
    let tag = format!("py3-none-manylinux_{major}_{minor}_{}", std::env::consts::ARCH);
    let mut pack = release.command("python3");
    pack.arg(root.join("packaging/wheel.py")).arg(root.join("bindings/python")).arg(&home);
    pack.arg(release.home.join("doc")).arg(&release.out).arg(&tag);
    run(&mut pack)?;
    let path = release.out.join(format!("gelato_renderer-{}-{tag}.whl", release.version));
    if path.is_file() {
        Ok(path)
    } else {
        Err(format!("packaging/wheel.py did not write {}", path.display()))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
mod tests {
    use super::*;

    #[test]
    fn the_wheel_has_the_folders_that_the_first_example_reads() {
        let mut named = std::collections::BTreeSet::new();
        for entry in std::fs::read_dir(repository().join("examples/first")).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "pyg") {
                let text = std::fs::read_to_string(path).unwrap();
                let folder =
                    |rest: &str| rest.split(|c: char| !c.is_alphanumeric()).next().unwrap().to_owned();
                named.extend(text.split("examples/").skip(1).map(folder));
            }
        }
        assert!(named.iter().eq(EXAMPLES), "{named:?}");
    }
}
