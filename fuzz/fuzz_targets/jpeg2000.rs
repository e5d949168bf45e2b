//! Any bytes for the reader of jpeg2000.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::jpeg2000(bytes));
