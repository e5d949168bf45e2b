//! Builds the programs and libraries of a release.

use super::old_glibc;
use crate::files::{answer, repository, run, target};
use crate::workspace::cargo;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The packages that are built. `gelato` alone is built for the table of sizes.
const PACKAGES: [&str; 5] = ["granita", "gelato", "libgelato", "libgsoargs", "libgranita-texture"];

/// The profile. It has another name than the folder of the results, which is `target/dist`.
pub(super) const PROFILE: &str = "packed";

/// The result of a build.
pub(super) struct Built {
    pub(super) folder: PathBuf,
    /// The name of the platform, as `rustc` calls it.
    pub(super) triple: String,
}

/// Builds with the dev profile, as everything else does.
pub(super) fn dev(epoch: u64) -> Result<Built, String> {
    let mut command = Command::new(cargo());
    command.current_dir(repository()).args(["build", "--bins", "--lib"]).args(packages());
    command.env("SOURCE_DATE_EPOCH", epoch.to_string());
    run(&mut command)?;
    Ok(Built { folder: target().join("debug"), triple: triple()? })
}

/// Builds with the profile [`PROFILE`]. `work` keeps the parts of an older C library, where a tool for them is
/// installed.
pub(super) fn release(epoch: u64, work: &Path) -> Result<Built, String> {
    let triple = triple()?;
    let root = repository();
    let home = std::env::var("CARGO_HOME").unwrap_or_else(|_| {
        let home = std::env::var("HOME").unwrap_or_default();
        format!("{home}/.cargo")
    });
    // Paths of this machine are not part of the files.
    let renamed = [(home.as_str(), "/cargo"), (&*root.to_string_lossy(), "/granita")];
    let mut flags: Vec<String> =
        renamed.iter().map(|(from, to)| format!("--remap-path-prefix={from}={to}")).collect();
    let in_c: Vec<String> =
        renamed.iter().map(|(from, to)| format!("-ffile-prefix-map={from}={to}")).collect();
    match old_glibc::parts(work, &triple)? {
        Some(folder) => {
            let folder = folder.strip_prefix(&root).unwrap_or(&folder).display().to_string();
            flags.push(format!("-Clink-arg=-B{folder}"));
            flags.push(format!("-Clink-arg={folder}/{}", old_glibc::COMPLETION));
            // The libraries of the compiler on this machine need its own C library, and programs need neither.
            flags.push("-Clink-arg=-Wl,--allow-shlib-undefined".to_owned());
        }
        None => println!(
            "dist: neither zig nor Python's ziglang is installed: the files need this machine's glibc"
        ),
    }
    let mut command = Command::new(cargo());
    command.current_dir(&root).args(["build", "--locked", "--profile", PROFILE, "--bins", "--lib"]);
    // With the name of the platform, flags do not apply to programs that run while building.
    command.args(["--target", &triple]).args(packages());
    command.env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"));
    command.env("CFLAGS", in_c.join(" ")).env("CXXFLAGS", in_c.join(" "));
    command.env("SOURCE_DATE_EPOCH", epoch.to_string());
    run(&mut command)?;
    Ok(Built { folder: target().join(&triple).join(PROFILE), triple })
}

fn packages() -> impl Iterator<Item = &'static str> {
    PACKAGES.iter().flat_map(|package| ["--package", package])
}

/// Returns the name of this platform.
fn triple() -> Result<String, String> {
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let said = answer(Command::new(rustc).current_dir(repository()).arg("-vV"))?;
    let host = said.lines().find_map(|line| line.strip_prefix("host: "));
    Ok(host.ok_or("rustc -vV names no host")?.to_owned())
}
