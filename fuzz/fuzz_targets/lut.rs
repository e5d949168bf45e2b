//! Any bytes for the reader of files of tables.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::lut(bytes));
