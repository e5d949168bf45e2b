//! Runs `dist`: makes the files that users install, in `target/dist`.
//!
//! All of them hold the same folder, the layout of `$GELATOHOME` (`crate::home`): a tarball, a Python wheel and a
//! package of Debian. The same commit gives the same bytes.

mod build;
mod check;
mod deb;
mod elf;
mod inventory;
mod old_glibc;
mod tarball;
mod wheel;

use crate::files::{answer, emptied, made, repository, run, target};
use crate::{files, home};
use elf::Needs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The largest size of the program `gelato`, in bytes.
const RENDERER: u64 = 25_000_000;

/// The options of `dist`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Install each file in a clean place afterwards, and run it there.
    #[arg(long)]
    check: bool,
    /// Use the dev profile and the C library of this machine, for trying.
    #[arg(long)]
    debug: bool,
}

/// What the packages have in common.
struct Release {
    version: &'static str,
    /// The seconds since 1970 that all files get as their time.
    epoch: u64,
    /// The folder of the results.
    out: PathBuf,
    /// The folder of intermediate files.
    work: PathBuf,
    /// The layout of `$GELATOHOME`.
    home: PathBuf,
    /// What the program and the libraries need of the system.
    needs: Needs,
}

impl Release {
    /// Returns a command that sees the time of the release.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SOURCE_DATE_EPOCH", self.epoch.to_string()).env("LC_ALL", "C").env("TZ", "UTC");
        command
    }
}

/// Makes all files, and checks them where the options say so.
pub(crate) fn run_with(options: &Options) -> Result<(), String> {
    if !cfg!(target_os = "linux") {
        return Err("dist makes files for Linux, on Linux; `cargo xtask install` works everywhere".to_owned());
    }
    let epoch = epoch()?;
    let out = made(target().join("dist"))?;
    let out = std::fs::canonicalize(&out).map_err(|e| format!("{}: {e}", out.display()))?;
    let work = made(out.join("work"))?;
    let built = if options.debug { build::dev(epoch)? } else { build::release(epoch, &work)? };
    let home = emptied(work.join("home"))?;
    remove_files(&out)?;
    home::lay_out(&home, &built.folder)?;
    examples(&home)?;
    let inventory = inventory::read_from_cargo(&built.triple)?;
    inventory::write_lists(&inventory, &home.join("doc"), epoch)?;
    let mut needs = elf::needs(&home.join("bin").join(home::PROGRAM))?;
    for library in ["lib/libgelato.so", "lib/libgsoargs.so", "lib/libgranita_texture.so"] {
        needs.merge(elf::needs(&home.join(library))?);
    }
    let release = Release { version: env!("CARGO_PKG_VERSION"), epoch, out, work, home, needs };
    modes(&release.home)?;
    let made = [tarball::make(&release)?, wheel::make(&release)?, deb::make(&release)?];
    sums(&release, &made)?;
    table(&release, &made, &built)?;
    if options.check { check::all(&release, &made) } else { Ok(()) }
}

/// Returns the time of the release, `$SOURCE_DATE_EPOCH` or that of the last commit.
fn epoch() -> Result<u64, String> {
    let text = match std::env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => text,
        Err(_) => answer(Command::new("git").current_dir(repository()).args(["log", "-1", "--format=%ct"]))
            .map_err(|e| format!("the time of the release: set SOURCE_DATE_EPOCH ({e})"))?,
    };
    text.trim().parse().map_err(|_| format!("SOURCE_DATE_EPOCH: {text} is not a number of seconds"))
}

/// Removes the results of earlier runs, whose names may differ.
fn remove_files(folder: &Path) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_file() {
            std::fs::remove_file(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        }
    }
    Ok(())
}

/// Copies the examples of the checkout, without what they made.
fn examples(home: &Path) -> Result<(), String> {
    let root = repository();
    for file in crate::workspace::Workspace::load()?.files()? {
        if let Some(folder) = file.parent().filter(|_| file.starts_with("examples")) {
            files::copy(&root.join(&file), &made(home.join(folder))?)?;
        }
    }
    Ok(())
}

/// Gives all files of a folder the same permissions, whatever those of the checkout are.
fn modes(folder: &Path) -> Result<(), String> {
    run(Command::new("chmod").args(["-R", "u=rwX,go=rX"]).arg(folder))
}

/// Writes the check sums of the results.
fn sums(release: &Release, made: &[PathBuf]) -> Result<(), String> {
    let names = made.iter().filter_map(|path| path.file_name());
    let text = answer(Command::new("sha256sum").current_dir(&release.out).args(names))?;
    files::write(&release.out.join("SHA256SUMS"), &format!("{text}\n"))
}

/// Prints the sizes of the programs and the results, and keeps the table as a file.
fn table(release: &Release, made: &[PathBuf], built: &build::Built) -> Result<(), String> {
    let home = &release.home;
    let programs = [
        home.join("bin").join(home::PROGRAM),
        built.folder.join("gelato"),
        home.join("lib/libgelato.so"),
        home.join("lib/libgsoargs.so"),
        home.join("lib/libgranita_texture.so"),
    ];
    let size = |path: &Path| std::fs::metadata(path).map_or(0, |file| file.len());
    if built.folder.ends_with(build::PROFILE) && size(&programs[1]) > RENDERER {
        return Err(format!("gelato has {} bytes, more than {RENDERER}", size(&programs[1])));
    }
    let mut text = "| file | MB |\n|---|---|\n".to_owned();
    for path in programs.iter().chain(made) {
        let Ok(file) = std::fs::metadata(path) else { continue };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        text.push_str(&format!("| {name} | {:.1} |\n", file.len() as f64 / 1e6));
    }
    println!("{text}\n{}", release.needs);
    files::write(&release.out.join("sizes.md"), &text)
}
