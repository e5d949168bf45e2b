//! Tests every reader with its corpus and mutations of it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::fuzz::{TARGETS, mutated};
use granita_tests::repository;

/// The number of mutations of each file of the corpus. libFuzzer runs millions.
const MUTATIONS: u32 = 150;

#[test]
fn readers_do_not_panic_on_their_corpus_and_mutations() {
    for (name, target) in TARGETS {
        let folder = repository().join("fuzz").join("corpus").join(name);
        let mut files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{}: no corpus", folder.display());
        for file in files {
            let seed = std::fs::read(&file).unwrap();
            target(&seed);
            for number in 0..MUTATIONS {
                let bytes = mutated(&seed, number);
                let survived = std::panic::catch_unwind(|| target(&bytes)).is_ok();
                assert!(survived, "{name}: mutation {number} of {}", file.display());
            }
        }
    }
}
