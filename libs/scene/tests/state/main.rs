//! Tests of the state machine from outside: calls are the input, scene and messages the output.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod fixture;
mod frames;
mod motion;
mod relighting;
mod rendering;
mod rerender;
mod saving;
