//! Tests effects that the reference names and that no other test asserts, with small scenes that are rendered in this
//! process. Each test is named in its rows of `tests/ledger.tsv`.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod camera;
mod clients;
mod lights;
mod mattes;
mod object;
mod output;
mod scene;
mod support;
mod surfaces;
