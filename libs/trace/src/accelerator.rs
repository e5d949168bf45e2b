//! The interface to processors that trace rays against a copy of a tracer's triangles.

use crate::{Hit, Ray, Tracer};
use std::fmt::Debug;
use std::sync::Arc;

/// Copies tracers to another processor.
pub trait Accelerator: Debug + Send + Sync {
    /// Returns a copy; `None` when the processor cannot hold it or trace against it. Rays are then traced by the
    /// tracer itself.
    fn copy(&self, tracer: &Arc<Tracer>) -> Option<Box<dyn TracerCopy>>;

    /// Returns the work so far as lines for the statistics.
    fn report(&self) -> String;
}

/// A copy of a tracer. It finds the same hits, to the bit. It is shared between threads.
pub trait TracerCopy: Debug + Send + Sync {
    /// Does the same as [`Tracer::closest`]. Returns false when it could not, or the batch is too small to be worth it.
    /// `hits` is unspecified then.
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> bool;

    /// Does the same as [`Tracer::any`]. Returns false when it could not, or the batch is too small to be worth it.
    /// `blocked` is unspecified then.
    fn any(&self, rays: &[Ray], blocked: &mut [bool]) -> bool;
}
