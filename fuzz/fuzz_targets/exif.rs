//! Any bytes for the reader of exif.

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| granita_tests::fuzz::exif(bytes));
