// tidy: tests
//! Tests of the C++ interface with the compilers that are installed: headers, libraries and plugins.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod border;
mod color;
mod examples;
mod headers;
mod pack;
mod reference;
mod shadeops;
mod support;
mod texture;
