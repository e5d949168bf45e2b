//! Tests the Python package, if Python is installed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Tools, repository};
use std::process::{Command, Stdio};

#[test]
fn the_python_package_passes_its_tests() {
    if !granita_needs::has("python3") {
        return;
    }
    let tools = Tools::build().unwrap();
    let folder = repository().join("bindings/python/tests");
    let ran = Command::new("python3")
        .args(["-m", "unittest", "discover", "-s"])
        .arg(folder)
        .env("GELATO", tools.program("gelato"))
        .env("GELATO_CALLS", granita_pyg::call_names().collect::<Vec<_>>().join(" "))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let numpy = Command::new("python3").args(["-c", "import numpy"]).stderr(Stdio::null()).status().unwrap();
    if !numpy.success() {
        granita_needs::skip("numpy (arrays of numpy in the Python package)");
    }
}
