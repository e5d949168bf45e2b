//! The tarball, a folder that works in any place.

use super::Release;
use crate::files::run;
use std::path::PathBuf;

/// Makes the tarball, and returns its path.
pub(super) fn make(release: &Release) -> Result<PathBuf, String> {
    let name = name(release);
    let path = release.out.join(format!("{name}.tar.xz"));
    let mut tar = release.command("tar");
    tar.args(["--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--format=gnu"]);
    // One thread: the blocks of several would depend on their number.
    tar.arg(format!("--mtime=@{}", release.epoch)).args(["--use-compress-program", "xz -6 -T1"]);
    tar.arg("--create").arg("--file").arg(&path).arg("--directory").arg(&release.home);
    // The folder gets the name of the release. The targets of links stay.
    tar.arg(format!("--transform=flags=r;s,^\\.,{name},")).arg(".");
    run(&mut tar)?;
    Ok(path)
}

/// Returns the name of the folder in the tarball.
pub(super) fn name(release: &Release) -> String {
    format!("granita-{}-{}-linux", release.version, std::env::consts::ARCH)
}
