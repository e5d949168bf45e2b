//! Any bytes for the reader of live images.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::display(bytes));
