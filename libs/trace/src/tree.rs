//! What a tree of triangles must be able to do to be gone through.

use crate::layout::{Block, Box3, Link};
use crate::probe::Wide;
use crate::simd::{Simd, WIDE};

/// What a tree must be able to show to be gone through.
pub(crate) trait Tree {
    /// Whether there is anything in it.
    fn is_empty(&self) -> bool;

    /// The children of a node that a ray meets up to `tmax`, where it enters them, and what they are.
    fn enter<S: Simd>(
        &self,
        s: S,
        node: usize,
        wide: &Wide<S>,
        tmax: f32,
    ) -> (u32, [f32; WIDE], &[u32; WIDE]);

    /// The triangles of a block; `room` is where to put them if they do not lie ready.
    fn block<'a>(&'a self, block: usize, room: &'a mut Block) -> &'a Block;

    /// Box of a triangle of a block.
    fn bounds(&self, block: &Block, lane: usize) -> Box3;

    /// Asks for what is behind a link.
    fn prefetch<S: Simd>(&self, s: S, link: Link);
}
