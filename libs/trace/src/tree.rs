//! The interface of a tree of triangles for traversal.

use crate::layout::{Block, Box3, Link};
use crate::probe::Wide;
use granita_machine::simd::{Simd, WIDE};

/// The operations of a tree that traversal needs.
pub(crate) trait Tree {
    /// True when the tree contains no triangles.
    fn is_empty(&self) -> bool;

    /// Returns the children of a node that a ray hits up to `tmax`, the distances at which it enters them, and their
    /// links.
    fn enter<S: Simd>(
        &self,
        s: S,
        node: usize,
        wide: &Wide<S>,
        tmax: f32,
    ) -> (u32, [f32; WIDE], &[u32; WIDE]);

    /// Returns the triangles of a block. `room` is storage for them if they are not stored in the tree.
    fn block<'a>(&'a self, block: usize, room: &'a mut Block) -> &'a Block;

    /// Returns the box of a triangle of a block.
    fn bounds(&self, block: &Block, lane: usize) -> Box3;

    /// Prefetches the target of a link.
    fn prefetch<S: Simd>(&self, s: S, link: Link);
}
