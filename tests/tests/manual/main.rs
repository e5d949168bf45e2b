//! Tests of the manual: pages and parts of pages that are made from tables in the code, scenes that are rendered,
//! commands that are run, and errors that must be reported as described. `cargo xtask tidy` checks the links.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod attributes;
mod blocks;
mod calls;
mod errors;
mod functions;
mod index;
mod pages;
mod pasted;
mod scenes;
mod signature;

use granita_tests::repository;

/// Compares a file with its expected text, or replaces it under `cargo xtask bless manual`.
fn kept(name: &str, text: &str) {
    let path = repository().join(name);
    let mut kept = std::fs::read_to_string(&path).unwrap_or_default();
    let blesses = std::env::var("GRANITA_BLESS").is_ok_and(|what| what == "manual" || what == "all");
    if blesses && kept != text {
        std::fs::write(&path, text).unwrap();
        text.clone_into(&mut kept);
    }
    assert!(kept == text, "{} is not what the table says: cargo xtask bless manual", path.display());
}
