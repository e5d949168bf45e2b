//! Checks of the package of Debian.

use super::super::Release;
use super::super::deb::SHARED_NAMES;
use super::{EXAMPLE, Place, in_time, same_image};
use crate::files::{answer, run, write};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Unpacks the package and runs it, tries its scripts beside a program of another package, and installs it in a bare
/// system where `mmdebstrap` can make one.
pub(super) fn check(release: &Release, package: &Path, image: &Path) -> Result<(), String> {
    unpacked(release, package, image)?;
    alternatives(release)?;
    bare_system(release, package)
}

fn unpacked(release: &Release, package: &Path, image: &Path) -> Result<(), String> {
    let place = Place::new(release, "deb")?;
    let start = Instant::now();
    run(Command::new("dpkg-deb").arg("-x").arg(package).arg(&place.folder))?;
    let (bin, work) = (place.folder.join("usr/bin"), place.folder.join("work"));
    place.model("deb, unpacked", &bin.join("gelato"), start)?;
    let start = Instant::now();
    let examples = place.folder.join("usr/share/doc/granita/examples/");
    run(Command::new("mkdir").arg(&work))?;
    run(Command::new("cp").arg("-RL").arg(examples).arg(&work))?;
    let made = place.first(&bin.join("gelato"), &work)?;
    in_time("deb, unpacked", "for the example", start, EXAMPLE)?;
    same_image(&bin.join("granita"), &made, image)?;
    for name in SHARED_NAMES {
        if bin.join(name).exists() {
            return Err(format!("deb: it has the file /usr/bin/{name}"));
        }
        answer(place.command(&bin.join("granita")).args([name, "-version"]))?;
    }
    let pages = place.folder.join("usr/share/man/man1");
    if answer(Command::new("man").arg("--version")).is_ok() {
        for page in ["granita", "granita-gelato", "granita-maketx", "granita-iv"] {
            let mut show = Command::new("man");
            show.env("MANWIDTH", "100").arg("--local-file").arg(pages.join(format!("{page}.1.gz")));
            if !answer(&mut show)?.contains("OPTIONS") {
                return Err(format!("deb: the page {page} has no options"));
            }
        }
    }
    let entry = place.folder.join("usr/share/applications/granita-iv.desktop");
    match answer(Command::new("sh").args(["-c", "command -v desktop-file-validate"])) {
        Ok(_) => run(Command::new("desktop-file-validate").arg(entry))?,
        Err(_) => println!("check: deb: desktop-file-validate is not installed, and not asked"),
    }
    Ok(())
}

/// Runs the scripts of the package on a system in a folder, where `maketx` belongs to another package.
fn alternatives(release: &Release) -> Result<(), String> {
    let place = Place::new(release, "alternatives")?;
    let (root, bin) = (&place.folder, place.folder.join("usr/bin"));
    write(&bin.join("maketx"), "of another package\n")?;
    for file in
        ["usr/lib/granita/bin/maketx", "usr/lib/granita/bin/iv", "usr/share/man/man1/granita-maketx.1.gz"]
    {
        write(&root.join(file), "")?;
    }
    for folder in ["etc/alternatives", "var/lib/dpkg/alternatives", "var/log"] {
        run(Command::new("mkdir").arg("-p").arg(root.join(folder)))?;
    }
    let script = |name: &str, word: &str| {
        let path = release.work.join("deb/DEBIAN").join(name);
        let mut sh = Command::new("sh");
        answer(sh.env("DPKG_ROOT", root).arg(path).arg(word)).map(|_| ())
    };
    let is_foreign =
        || std::fs::read_to_string(bin.join("maketx")).is_ok_and(|text| text.contains("another"));
    script("postinst", "configure")?;
    let iv = std::fs::read_link(bin.join("iv")).map_err(|e| format!("deb: /usr/bin/iv: {e}"))?;
    if iv != Path::new("/etc/alternatives/iv") || !is_foreign() {
        return Err(format!("deb: after postinst /usr/bin/iv is {}", iv.display()));
    }
    script("prerm", "remove")?;
    if std::fs::symlink_metadata(bin.join("iv")).is_ok() || !is_foreign() {
        return Err("deb: prerm left /usr/bin/iv, or removed a program of another package".to_owned());
    }
    println!("check: deb: alternatives do not replace a program of another package");
    Ok(())
}

/// Installs the package in a new Debian system, and renders the first image and the first example there.
fn bare_system(release: &Release, package: &Path) -> Result<(), String> {
    if answer(Command::new("mmdebstrap").arg("--version")).is_err() {
        println!("check: deb: mmdebstrap is not installed: not tried in a bare system");
        return Ok(());
    }
    let name = package.file_name().unwrap_or_default().to_string_lossy();
    let place = Place::new(release, "bare")?;
    let script = format!(
        "set -e; start=$(date +%s); apt-get install -y -qq --no-install-recommends /{name} >/dev/null 2>&1; cd /srv; \
         gelato -silent -up z teapot.pyg -o teapot.png; test -s teapot.png; \
         echo check: deb, bare system: $(($(date +%s) - start)) s to the first image; maketx -version; \
         cp -RL /usr/share/doc/granita/examples .; gelato -silent examples/first/first.pyg; \
         iv -info examples/first/out/first.png; dpkg --remove granita >/dev/null; test ! -e /usr/bin/maketx; test ! -e /usr/lib/granita"
    );
    write(&place.folder.join("script"), &script)?;
    let mut make = Command::new("mmdebstrap");
    make.args(["--quiet", "--variant=apt"]);
    make.arg(format!(
        "--customize-hook=copy-in '{}' '{}' /",
        package.display(),
        place.folder.join("script").display()
    ));
    make.arg("--customize-hook=chroot \"$1\" sh /script");
    run(make.args(["bookworm", "/dev/null"]))?;
    println!("check: deb: installed, run and removed in a bare system");
    Ok(())
}
