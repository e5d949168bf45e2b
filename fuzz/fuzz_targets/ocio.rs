//! Any bytes for the reader of configurations of colours.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::ocio(bytes));
