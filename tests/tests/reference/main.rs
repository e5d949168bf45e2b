//! Effects that the reference names and that no other test asserts: small scenes, rendered in this process. Each test
//! stands in the rows of `tests/ledger.tsv` that it is for.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod camera;
mod clients;
mod lights;
mod object;
mod output;
mod scene;
mod support;
mod surfaces;
