//! Tests the Python package, if Python is installed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Tools, repository};
use std::process::Command;

#[test]
fn the_python_package_passes_its_tests() {
    if !granita_needs::has("python3") {
        return;
    }
    let tools = Tools::build().unwrap();
    let ran = Command::new("python3")
        .arg(repository().join("bindings/python/tests/test_gelato.py"))
        .env("GELATO", tools.program("gelato"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
}
