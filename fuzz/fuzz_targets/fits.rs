//! Any bytes for the reader of fits.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::fits(bytes));
