//! Runs compiled shaders with the executor, and compares them with closed forms and with each other.

mod batched;
mod bundled;
mod control;
mod derivatives;
mod equivalence;
mod fixture;
mod forms;
mod functions;
mod language;
mod layers;
mod lights;
mod limits;
mod lookups;
mod manual;
mod messages;
mod nan;
mod optimise;
mod parts;
mod tapes;
