//! The interface of a tree of triangles for traversal.

use crate::layout::{Block, Box3, Link};
use granita_machine::simd::{Simd, WIDE};

/// The operations of a tree that traversal needs.
pub(crate) trait Tree {
    /// True when the tree contains no triangles.
    fn is_empty(&self) -> bool;

    /// Returns the planes of a node by their row, as [`crate::layout::Node::row`] does.
    fn planes<'a, S: Simd + 'a>(&'a self, s: S, node: usize) -> impl Fn(usize) -> S::F8;

    /// Returns the links of a node.
    fn links(&self, node: usize) -> &[u32; WIDE];

    /// Returns the triangles of a block. `room` is storage for them if they are not stored in the tree.
    fn block<'a>(&'a self, block: usize, room: &'a mut Block) -> &'a Block;

    /// Returns the box of a triangle of a block.
    fn bounds(&self, block: &Block, lane: usize) -> Box3;

    /// Prefetches the target of a link.
    fn prefetch<S: Simd>(&self, s: S, link: Link);
}
