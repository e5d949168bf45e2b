//! The state machine from outside: calls in, scene and messages out.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod fixture;
mod frames;
mod motion;
mod rendering;
mod saving;
