//! Tests re-rendering (reference chapter 11) by random sequences of edits.
//!
//! A sequence makes two to ten edits in one of eight small scenes. Two sessions run the same calls: one keeps what it
//! can between frames, the other renders each frame anew. All pixels of all images of each frame must be equal to the
//! bit. A third session makes all edits at once, after a frame of a few pixels, and its images must be those of the
//! last frame. The sessions have different numbers of threads.
//!
//! `cargo xtask rerender` runs many sequences.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on fails; one prints what it does"
)]

mod edits;
mod files;
mod model;
mod play;
mod player;
mod reuse;
mod scenes;
mod special;

use play::{Played, sequence};

/// Plays the sequences of consecutive seeds.
fn play(seeds: std::ops::Range<u32>) -> Played {
    let mut sum = Played::default();
    for seed in seeds {
        let played = sequence(seed).unwrap_or_else(|what| panic!("{what}"));
        sum.frames += played.frames;
        sum.edits += played.edits;
        sum.changes += played.changes;
    }
    sum
}

#[test]
fn ten_random_sequences_are_the_same_to_the_bit_as_frames_rendered_anew() {
    let played = play(1..11);
    // Sequences whose edits change nothing would test nothing.
    assert!(played.changes * 2 > played.edits / 2, "{played:?}");
}

/// Plays the sequences that `cargo xtask rerender` requests by environment variables.
#[test]
#[ignore = "cargo xtask rerender runs it"]
fn many_random_sequences_are_the_same_to_the_bit_as_frames_rendered_anew() {
    let number = |name: &str, or: u32| std::env::var(name).map_or(or, |text| text.parse().unwrap());
    let (count, seed) = (number("GRANITA_RERENDER_SEQUENCES", 500), number("GRANITA_RERENDER_SEED", 1));
    let begin = std::time::Instant::now();
    let mut sum = Played::default();
    for (done, seed) in (seed..seed.saturating_add(count)).enumerate() {
        let played = play(seed..seed + 1);
        sum.frames += played.frames;
        sum.edits += played.edits;
        sum.changes += played.changes;
        if (done + 1) % 50 == 0 || done + 1 == count as usize {
            let seconds = begin.elapsed().as_secs_f64();
            println!("rerender: {} sequences, seed {seed}, {sum:?}, {seconds:.0} s", done + 1);
        }
    }
}
