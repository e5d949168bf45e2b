//! Any bytes for the reader of spatial databases.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::sdb(bytes));
