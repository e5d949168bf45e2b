//! Any bytes for the reader of tiff.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::tiff(bytes));
