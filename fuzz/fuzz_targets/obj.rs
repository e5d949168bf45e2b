//! Any bytes for the reader of obj.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::obj(bytes));
