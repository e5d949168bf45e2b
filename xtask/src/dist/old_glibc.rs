//! Linking for systems with an older C library (glibc 2.28, of Debian 10 and RHEL 8).
//!
//! A program that is linked here needs the versions of the functions of this machine's glibc. Zig can make the stubs of
//! any glibc: libraries with names and versions and without code, and the start files. The compiler and the linker of
//! this machine link with these stubs, through `-B`.
//!
//! `cargo zigbuild` is not used. It links libc++ and LLVM's unwinder into the program. An exception of a plugin, which
//! was compiled by g++ and uses libgcc's unwinder, then reaches the shim of `granita-plugin` with data of the other
//! unwinder, and the process crashes.

use crate::files::{answer, emptied, link, run, write};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The version of glibc, that of manylinux_2_28.
pub(super) const VERSION: (u32, u32) = (2, 28);

/// The object file with [`NEWER`], which all programs and libraries link.
pub(super) const COMPLETION: &str = "newer.o";

/// The one function of libstdc++ that code of a newer g++ calls and that GCC 8, of the same age as glibc 2.28, does not
/// have. It throws, where the program has libstdc++ at all.
const NEWER: &str = "\
#include <stdlib.h>
extern void *_Znwm (size_t) __attribute__ ((weak));
__attribute__ ((noreturn, visibility (\"hidden\"))) void _ZSt28__throw_bad_array_new_lengthv (void)
{
    if (_Znwm)
        _Znwm (~(size_t) 0);
    abort ();
}
";

/// The names by which libraries are linked, and their files.
const LIBRARIES: [(&str, &str); 6] = [
    ("libdl.so", "libdl.so.2"),
    ("libm.so", "libm.so.6"),
    ("libpthread.so", "libpthread.so.0"),
    ("libresolv.so", "libresolv.so.2"),
    ("librt.so", "librt.so.1"),
    ("libutil.so", "libutil.so.1"),
];

/// Makes the folder with the parts of glibc that a link needs. Returns `None` where zig is not installed.
pub(super) fn parts(work: &Path, triple: &str) -> Result<Option<PathBuf>, String> {
    let installed = [&["zig"][..], &["python3", "-m", "ziglang"]];
    let works = |words: &&&[&str]| answer(Command::new(words[0]).args(&words[1..]).arg("version")).is_ok();
    let Some(zig) = installed.iter().find(works) else { return Ok(None) };
    let Some(machine) = triple.strip_suffix("-unknown-linux-gnu") else { return Ok(None) };
    let (cache, folder) = (emptied(work.join("zig"))?, emptied(work.join("glibc"))?);
    let source = cache.join("main.c");
    write(&source, "int main (void) { return 0; }\n")?;
    let (major, minor) = VERSION;
    let mut compile = Command::new(zig[0]);
    compile.args(&zig[1..]).args(["cc", "-target", &format!("{machine}-linux-gnu.{major}.{minor}")]);
    compile.args(["-fPIE", "-pie", "-o", "main", "main.c"]).current_dir(&cache);
    compile.env("ZIG_GLOBAL_CACHE_DIR", &cache).env("ZIG_LOCAL_CACHE_DIR", &cache);
    run(&mut compile)?;
    gather(&cache, &folder)?;
    for (name, file) in LIBRARIES {
        link(file, &folder.join(name))?;
    }
    for file in ["Scrt1.o", "libc.so.6", "libc_nonshared.a"] {
        if !folder.join(file).is_file() {
            return Err(format!("zig made no {file} of glibc {major}.{minor}"));
        }
    }
    write(&folder.join("libc.so"), "INPUT ( libc.so.6 libc_nonshared.a AS_NEEDED ( libld.so.2 ) )\n")?;
    let source = folder.join("newer.c");
    write(&source, NEWER)?;
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let mut compile = Command::new(compiler);
    compile.args(["-c", "-O2", "-fPIC", "-fexceptions", "-w", "-o", COMPLETION, "newer.c"]);
    run(compile.current_dir(&folder))?;
    Ok(Some(folder))
}

/// Copies the libraries and start files from the cache of zig.
fn gather(from: &Path, folder: &Path) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", from.display());
    for entry in std::fs::read_dir(from).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            gather(&path, folder)?;
        } else if name.contains(".so.") || matches!(&*name, "Scrt1.o" | "libc_nonshared.a") {
            crate::files::copy(&path, folder)?;
        }
    }
    Ok(())
}
