//! The Python package, where there is a Python.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test that cannot go on fails, and says why")]

use granita_tests::{Tools, has_program, repository};
use std::process::Command;

#[test]
fn the_package_works() {
    if !has_program("python3") {
        return eprintln!("python3 is not installed: the package is not tested");
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
