// tidy: tests
//! The C++ face: headers, libraries, plugins; with the compilers that are installed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod border;
mod examples;
mod headers;
mod reference;
mod shadeops;
mod support;
