//! The package of Debian, made by `dpkg-deb`.
//!
//! The layout of `$GELATOHOME` is `/usr/lib/granita`. Everything elsewhere in `/usr` are links to it, man pages,
//! completions, and the files of a desktop. `maketx`, `imgtool` and `iv` are alternatives of Debian, because the
//! packages openimageio-tools and mame-tools have programs of these names: no file of another package is replaced.

use super::{Release, modes};
use crate::files::{answer, copy, emptied, link, made, read, repository, run, write};
use crate::home::PROGRAM;
use std::path::{Path, PathBuf};

/// The tools whose plain names belong to the package.
const OWN_NAMES: [&str; 5] = ["gelato", "gslc", "gsoinfo", "oiio-maketx", "topyg"];
/// The tools whose plain names are alternatives.
pub(super) const SHARED_NAMES: [&str; 3] = ["maketx", "imgtool", "iv"];

/// The newest symbols of libstdc++ by the version of the package.
const LIBSTDCXX: [(u32, u32); 12] = [
    (21, 5),
    (22, 6),
    (24, 7),
    (25, 8),
    (26, 9),
    (28, 10),
    (29, 11),
    (30, 12),
    (31, 13),
    (32, 13),
    (33, 14),
    (34, 15),
];

const MAINTAINER: &str = "The Granita authors <granita@localhost>";

/// The libraries that the window of `iv` loads while it runs.
const RECOMMENDED: &str =
    "libx11-6, libx11-xcb1, libxcursor1, libxi6, libxkbcommon-x11-0, libegl1, libvulkan1, python3";

const DESCRIPTION: &str = "\
Description: suite for images and light
 A film renderer (gelato), a shading language (gslc, gsoinfo), a texture
 maker (maketx), an image processor (imgtool), an image viewer (iv), a
 converter of scenes (topyg), and the libraries libgelato, libgsoargs and
 libgranita_texture with their headers. All tools run as \"granita TOOL\".
 .
 maketx, imgtool and iv are alternatives, beside the programs of
 openimageio-tools and mame-tools.
";

/// Makes the package, and returns its path.
pub(super) fn make(release: &Release) -> Result<PathBuf, String> {
    let architecture = answer(release.command("dpkg-architecture").arg("-qDEB_HOST_ARCH"))
        .or_else(|_| answer(release.command("dpkg").arg("--print-architecture")))?;
    let root = emptied(release.work.join("deb"))?;
    let home = root.join("usr/lib/granita");
    made(root.join("usr/lib"))?;
    run(release.command("cp").args(["--archive", "--no-preserve=ownership"]).arg(&release.home).arg(&home))?;
    programs(&root)?;
    documents(release, &root)?;
    libraries(&root, &home)?;
    desktop(&root)?;
    modes(&root)?;
    control(release, &root, &architecture)?;
    // dpkg-deb replaces only times after that of the release.
    let time = format!("@{}", release.epoch);
    run(release.command("find").arg(&root).args(["-exec", "touch", "-h", "-d", &time, "{}", "+"]))?;
    let path = release.out.join(format!("granita_{}_{architecture}.deb", release.version));
    let mut pack = release.command("dpkg-deb");
    run(pack.args(["--root-owner-group", "-Zxz", "--build"]).arg(&root).arg(&path))?;
    Ok(path)
}

/// Links the programs into `/usr/bin`.
fn programs(root: &Path) -> Result<(), String> {
    OWN_NAMES
        .iter()
        .chain([&PROGRAM])
        .try_for_each(|name| link(&format!("../lib/granita/bin/{name}"), &root.join("usr/bin").join(name)))
}

/// Moves man pages, completions and documents to the places where Debian looks for them.
fn documents(release: &Release, root: &Path) -> Result<(), String> {
    let (home, share) = (root.join("usr/lib/granita"), root.join("usr/share"));
    let moved = |from: &Path, to: &Path| {
        made(to.parent().unwrap_or(to).to_owned())?;
        std::fs::rename(from, to).map_err(|e| format!("{} to {}: {e}", from.display(), to.display()))
    };
    let completions = [
        ("bash-completion/completions", "bash-completion/completions", ""),
        ("zsh/site-functions", "zsh/vendor-completions", "_"),
        ("fish/vendor_completions.d", "fish/vendor_completions.d", ""),
    ];
    for (from, to, before) in completions {
        let after = if from.starts_with("fish") { ".fish" } else { "" };
        for name in OWN_NAMES.iter().chain([&PROGRAM]) {
            let file = format!("{before}{name}{after}");
            moved(&home.join("share").join(from).join(&file), &share.join(to).join(&file))?;
        }
    }
    let pages = share.join("man/man1");
    moved(&home.join("share/man/man1"), &pages)?;
    for name in SHARED_NAMES {
        let page = pages.join(format!("{name}.1"));
        std::fs::remove_file(&page).map_err(|e| format!("{}: {e}", page.display()))?;
    }
    run(release.command("sh").current_dir(&pages).args(["-c", "gzip -9n *.1"]))?;
    std::fs::remove_dir_all(home.join("share")).map_err(|e| format!("{}: {e}", home.display()))?;
    let doc = share.join("doc/granita");
    moved(&home.join("doc"), &doc.join("manual"))?;
    for name in ["sbom.cdx.json", "LICENSES-OF-OTHERS"] {
        moved(&doc.join("manual").join(name), &doc.join(name))?;
    }
    let time = answer(release.command("date").args(["-R", "--date", &format!("@{}", release.epoch)]))?;
    let entry = format!(
        "granita ({}) unstable; urgency=medium\n\n  * The changes are in manual/CHANGELOG.md.\n\n -- {MAINTAINER}  {time}\n",
        release.version
    );
    write(&doc.join("changelog"), &entry)?;
    run(release.command("gzip").arg("-9n").arg(doc.join("changelog")))?;
    copy(&repository().join("packaging/debian/copyright"), &doc)?;
    link("../../share/doc/granita/manual", &home.join("doc"))?;
    link("../../../lib/granita/examples", &doc.join("examples"))
}

/// Links the libraries and headers, and tells pkg-config and CMake about them.
fn libraries(root: &Path, home: &Path) -> Result<(), String> {
    let lib = root.join("usr/lib").join(format!("{}-linux-gnu", std::env::consts::ARCH));
    for name in ["libgelato.so", "libgsoargs.so", "libgranita_texture.so"] {
        link(&format!("../granita/lib/{name}"), &lib.join(name))?;
    }
    link("../lib/granita/include", &root.join("usr/include/granita"))?;
    for name in ["gelato.pc", "gsoargs.pc", "granita_texture.pc"] {
        // The file is not where its relative paths start.
        let text = read(&home.join("lib/pkgconfig").join(name))?;
        write(&lib.join("pkgconfig").join(name), &text.replace("${pcfiledir}/../..", "/usr/lib/granita"))?;
    }
    for package in ["Gelato", "GranitaTexture"] {
        let file = format!("{package}Config.cmake");
        let text = format!("include (\"/usr/lib/granita/lib/cmake/{package}/{file}\")\n");
        write(&lib.join("cmake").join(package).join(file), &text)?;
    }
    Ok(())
}

/// Copies the entry of `iv` in menus, and the types of files.
fn desktop(root: &Path) -> Result<(), String> {
    let from = repository().join("packaging/debian");
    copy(&from.join("granita-iv.desktop"), &made(root.join("usr/share/applications"))?)?;
    copy(&from.join("granita.xml"), &made(root.join("usr/share/mime/packages"))?)
}

/// Writes what `dpkg` reads about the package.
fn control(release: &Release, root: &Path, architecture: &str) -> Result<(), String> {
    let folder = made(root.join("DEBIAN"))?;
    // The sizes of folders differ between file systems.
    let sizes =
        answer(release.command("find").arg(root.join("usr")).args(["-type", "f", "-printf", "%s\n"]))?;
    let size = sizes.lines().filter_map(|bytes| bytes.parse::<u64>().ok()).sum::<u64>().div_ceil(1024);
    let (version, depends) = (release.version, depends(release)?);
    let text = format!(
        "Package: granita\nVersion: {version}\nArchitecture: {architecture}\nMaintainer: {MAINTAINER}\n\
         Installed-Size: {size}\nDepends: {depends}\nRecommends: {RECOMMENDED}\nSection: graphics\nPriority: optional\n\
         {DESCRIPTION}"
    );
    write(&folder.join("control"), &text)?;
    for script in ["postinst", "prerm"] {
        copy(&repository().join("packaging/debian").join(script), &folder)?;
        run(release.command("chmod").arg("755").arg(folder.join(script)))?;
    }
    Ok(())
}

/// Returns the packages with the libraries that the programs need.
fn depends(release: &Release) -> Result<String, String> {
    let needs = &release.needs;
    let (major, minor) = needs.promised();
    let mut packages = vec![format!("libc6 (>= {major}.{minor})")];
    for library in &needs.libraries {
        let stem = library.split(".so").next().unwrap_or_default();
        match stem {
            "libc" | "libm" | "libdl" | "libpthread" | "librt" | "libutil" => (),
            _ if stem.starts_with("ld-linux") => (),
            "libgcc_s" => packages.push("libgcc-s1 | libgcc1".to_owned()),
            "libstdc++" => packages.push(match needs.glibcxx.get(2) {
                Some(newest) => {
                    let row = LIBSTDCXX.iter().find(|(symbols, _)| symbols >= newest);
                    let row = row.ok_or(format!("no package of Debian is known for GLIBCXX_3.4.{newest}"))?;
                    format!("libstdc++6 (>= {})", row.1)
                }
                None => "libstdc++6".to_owned(),
            }),
            _ => return Err(format!("no package of Debian is known for {library}")),
        }
    }
    Ok(packages.join(", "))
}
