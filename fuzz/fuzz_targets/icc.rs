//! Any bytes for the reader of ICC profiles.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::icc(bytes));
