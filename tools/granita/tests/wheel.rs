//! Tests of `packaging/wheel.py` and of `python -m gelato`, with a program that prints its words.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Returns a file of the checkout.
fn checkout(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(file)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim().to_owned()
}

/// True when the Python on the search path reads `pyproject.toml`.
fn has_python() -> bool {
    if !granita_needs::has("python3") {
        return false;
    }
    let works = Command::new("python3").args(["-c", "import tomllib"]).output().unwrap().status.success();
    if !works {
        granita_needs::skip("tomllib (Python 3.11)");
    }
    works
}

/// Writes a wheel into `out`, and returns its path.
fn wheel(folder: &Path, out: &str, time: &str) -> PathBuf {
    let out = folder.join(out);
    std::fs::create_dir_all(&out).unwrap();
    let done = Command::new("python3")
        .arg(checkout("packaging/wheel.py"))
        .arg(checkout("bindings/python"))
        .args([folder.join("home"), folder.join("doc"), out.clone()])
        .arg("py3-none-any")
        .env("SOURCE_DATE_EPOCH", time)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", text(&done.stderr));
    let name = format!("gelato_renderer-{}-py3-none-any.whl", env!("CARGO_PKG_VERSION"));
    out.join(name)
}

/// Checks the sums of the record against the files, and unpacks them with their permissions.
const UNPACK: &str = r#"
import base64, csv, hashlib, os, sys, zipfile
archive = zipfile.ZipFile(sys.argv[1])
record = next(name for name in archive.namelist() if name.endswith("/RECORD"))
rows = {row[0]: row[1:] for row in csv.reader(archive.read(record).decode().splitlines())}
assert set(rows) == set(archive.namelist()), set(rows) ^ set(archive.namelist())
for entry in archive.infolist():
    data = archive.read(entry)
    if entry.filename != record:
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        assert rows[entry.filename] == ["sha256=" + digest, str(len(data))], entry.filename
    os.chmod(archive.extract(entry, sys.argv[2]), entry.external_attr >> 16)
"#;

#[test]
fn the_wheel_has_a_right_record_and_runs_its_tools() {
    if !has_python() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let write = |name: &str, text: &str| {
        std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
        std::fs::write(at(name), text).unwrap();
    };
    write("home/bin/granita", "#!/bin/sh\necho ran \"$@\"\n");
    write("home/lib/libgranita_texture.so", "");
    write("home/examples/first/first.pyg", "Render ()\n");
    write("home/examples/data/model.obj", "");
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "LICENSES-OF-OTHERS", "sbom.cdx.json"] {
        write(&format!("doc/{name}"), name);
    }
    let (first, second) = (wheel(folder.path(), "a", "1700000000"), wheel(folder.path(), "b", "1700000000"));
    assert_eq!(std::fs::read(&first).unwrap(), std::fs::read(second).unwrap());
    let site = at("site");
    let unpacked = Command::new("python3").args(["-c", UNPACK]).args([&first, &site]).output().unwrap();
    assert!(unpacked.status.success(), "{}", text(&unpacked.stderr));
    let python = |words: &[&str]| -> Output {
        let mut python = Command::new("python3");
        python.args(["-m", "gelato"]).args(words).current_dir(folder.path()).env_remove("GELATOHOME");
        python.env("PYTHONPATH", &site).env("PYTHONDONTWRITEBYTECODE", "1").output().unwrap()
    };
    assert_eq!(text(&python(&["maketx", "-envlatl", "a b"]).stdout), "ran maketx -envlatl a b");
    assert_eq!(text(&python(&["home"]).stdout), site.join("gelato/suite").display().to_string());
    let rendered = text(&python(&["first", "here"]).stdout);
    assert!(rendered.starts_with("ran gelato -cwd here -threads "), "{rendered}");
    assert!(
        rendered.ends_with("here/examples/first/out/first.png")
            && at("here/examples/first/first.pyg").is_file()
            && at("here/examples/data/model.obj").is_file()
    );
    assert_eq!(python(&[]).status.code(), Some(2));
    let program = "from gelato import _renderer; print (_renderer._program())";
    let mut found = Command::new("python3");
    found.args(["-c", program]).env("PYTHONPATH", &site).env("PYTHONDONTWRITEBYTECODE", "1");
    let found = found.env_remove("GELATO").env_remove("GELATOHOME").output().unwrap();
    assert_eq!(text(&found.stdout), site.join("gelato/suite/bin/granita").display().to_string());
    let program = "from granita import texture; print (texture.library_path ())";
    let mut found = Command::new("python3");
    found.args(["-c", program]).env("PYTHONPATH", &site).env("PYTHONDONTWRITEBYTECODE", "1");
    let found = found.env_remove("GRANITA_TEXTURE_LIB").env_remove("GELATOHOME").output().unwrap();
    let library = site.join("gelato/suite/lib/libgranita_texture.so");
    assert_eq!(text(&found.stdout), library.display().to_string(), "{}", text(&found.stderr));
    let script = Command::new(site.join("gelato/suite/bin/iv")).arg("-info").output().unwrap();
    assert_eq!(text(&script.stdout), "ran iv -info");
    let info = site.join(format!("gelato_renderer-{}.dist-info", env!("CARGO_PKG_VERSION")));
    let metadata = std::fs::read_to_string(info.join("METADATA")).unwrap();
    for line in ["Name: gelato-renderer", "License-Expression: MIT OR Apache-2.0", "Requires-Python: >=3.8"] {
        assert!(metadata.lines().any(|found| found == line), "{line}");
    }
    let commands = std::fs::read_to_string(info.join("entry_points.txt")).unwrap();
    assert!(commands.contains("gelato = gelato.__main__:run_gelato") && !commands.contains("maketx"));
}

#[test]
fn a_package_without_tools_says_so() {
    if !granita_needs::has("python3") {
        return;
    }
    let out = Command::new("python3")
        .args(["-m", "gelato", "first"])
        .env_remove("GELATOHOME")
        .env("PYTHONPATH", checkout("bindings/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(1));
    assert!(text(&out.stderr).contains("there are no tools in this package"), "{}", text(&out.stderr));
}
