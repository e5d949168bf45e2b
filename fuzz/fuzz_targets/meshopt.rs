//! Any bytes for the reader of meshopt.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::meshopt(bytes));
