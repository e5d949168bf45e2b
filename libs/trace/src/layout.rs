//! The memory layout of nodes and leaves.

use granita_base::Vec3;
use granita_machine::simd::{NARROW, WIDE};

/// A reference from a node to another node, or to one to four blocks of triangles.
///
/// Bit 31 marks leaves. Bits 29 and 30 of a leaf are the number of blocks minus one, and the lower bits are the index
/// of the first block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Link(pub(crate) u32);

impl Link {
    /// The bit that marks leaves.
    pub(crate) const LEAF: u32 = 1 << 31;
    /// The largest number of blocks of a leaf.
    pub(crate) const BLOCKS: usize = 4;
    /// The mask of the first block.
    const FIRST: u32 = (1 << 29) - 1;

    /// Returns a link to the node of this index.
    pub(crate) fn node(index: usize) -> Self {
        assert!(index < Self::LEAF as usize, "{index} nodes are more than a link can tell apart");
        Self(index as u32)
    }

    /// Returns a link to the blocks from `first` on.
    pub(crate) fn leaf(first: usize, blocks: usize) -> Self {
        assert!((1..=Self::BLOCKS).contains(&blocks), "a leaf of {blocks} blocks");
        assert!(
            first <= Self::FIRST as usize,
            "{first} blocks of triangles are more than a link can tell apart"
        );
        Self(Self::LEAF | (blocks as u32 - 1) << 29 | first as u32)
    }

    /// True when the link refers to triangles.
    #[inline(always)]
    pub(crate) fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Returns the blocks of a leaf.
    #[inline(always)]
    pub(crate) fn blocks(self) -> std::ops::Range<usize> {
        let first = (self.0 & Self::FIRST) as usize;
        first..first + (self.0 >> 29 & 3) as usize + 1
    }

    /// Returns the link adjusted to a list in which `nodes` nodes and `blocks` blocks precede.
    pub(crate) fn moved(self, nodes: usize, blocks: usize) -> Self {
        if self.is_leaf() {
            let of = self.blocks();
            Self::leaf(of.start + blocks, of.len())
        } else {
            Self::node(self.0 as usize + nodes)
        }
    }
}

/// The lower planes of the boxes of missing children. The upper ones are its negative. The value is finite, so that
/// boxes can be interpolated.
const NOWHERE: f32 = f32::MAX;

/// The row of a node that holds the links.
const LINKS: usize = 6;

/// A node: the boxes of up to eight children, as lower and upper planes of x, y and z, and the links to the children.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// The bits of the planes in rows 0 to 5, and the links in row 6. There are eight rows, so that an index needs no
    /// bounds check.
    rows: [[u32; WIDE]; 8],
}

impl Node {
    /// A node without children. No ray hits its boxes.
    pub(crate) const EMPTY: Self = {
        let (none, all) = ([NOWHERE.to_bits(); WIDE], [(-NOWHERE).to_bits(); WIDE]);
        Self { rows: [none, all, none, all, none, all, [0; WIDE], [0; WIDE]] }
    };

    /// Returns a row of planes: `2 * axis` for the lower ones, `2 * axis + 1` for the upper ones.
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> &[u32; WIDE] {
        &self.rows[row & 7]
    }

    /// Returns the links of the children. Those of missing children are undefined.
    #[inline(always)]
    pub(crate) fn links(&self) -> &[u32; WIDE] {
        &self.rows[LINKS]
    }

    /// Returns the slots and links of the children that exist.
    pub(crate) fn children(&self) -> impl Iterator<Item = (usize, Link)> + '_ {
        let there = |slot: &usize| self.rows[0][*slot] != NOWHERE.to_bits();
        (0..WIDE).filter(there).map(|slot| (slot, Link(self.rows[LINKS][slot])))
    }

    /// Sets the box of a child.
    pub(crate) fn set_bounds(&mut self, slot: usize, bounds: &Box3) {
        for axis in 0..3 {
            self.rows[2 * axis][slot] = bounds.lo[axis].to_bits();
            self.rows[2 * axis + 1][slot] = bounds.hi[axis].to_bits();
        }
    }

    /// Sets the link of a child.
    pub(crate) fn set_link(&mut self, slot: usize, link: Link) {
        self.rows[LINKS][slot] = link.0;
    }

    /// Adjusts the links of all children; see [`Link::moved`].
    pub(crate) fn move_links(&mut self, nodes: usize, blocks: usize) {
        for slot in 0..WIDE {
            if self.rows[0][slot] != NOWHERE.to_bits() {
                self.rows[LINKS][slot] = Link(self.rows[LINKS][slot]).moved(nodes, blocks).0;
            }
        }
    }
}

/// A box in the coordinates of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Box3 {
    /// The lower corner.
    pub(crate) lo: [f32; 3],
    /// The upper corner.
    pub(crate) hi: [f32; 3],
}

impl Box3 {
    /// The empty box.
    pub(crate) const EMPTY: Self = Self { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    /// Returns the smallest box around points.
    pub(crate) fn around(points: &[Vec3]) -> Self {
        let mut b = Self::EMPTY;
        for p in points {
            b = b.union(&Self { lo: p.to_array(), hi: p.to_array() });
        }
        b
    }

    /// Returns the smallest box around both boxes.
    #[inline]
    pub(crate) fn union(&self, other: &Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].min(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].max(other.hi[a])),
        }
    }

    /// Interpolates between two boxes, plane by plane. Rounding is monotonic, so that the contents stay inside.
    pub(crate) fn between(&self, other: &Self, alpha: f32) -> Self {
        let mix = |a: f32, b: f32| a * (1.0 - alpha) + b * alpha;
        Self {
            lo: std::array::from_fn(|a| mix(self.lo[a], other.lo[a])),
            hi: std::array::from_fn(|a| mix(self.hi[a], other.hi[a])),
        }
    }
}

/// Up to four triangles, coordinate by coordinate.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub(crate) struct Block {
    /// The coordinates by vertex, axis and triangle. Missing triangles have NaN, which no ray hits.
    pub(crate) v: [[[f32; NARROW]; 3]; 3],
    /// The numbers of the triangles among all triangles of the tracer.
    pub(crate) id: [u32; NARROW],
}

impl Block {
    /// A block without triangles.
    pub(crate) const EMPTY: Self = Self { v: [[[f32::NAN; NARROW]; 3]; 3], id: [u32::MAX; NARROW] };

    /// Stores a triangle in a lane.
    pub(crate) fn set(&mut self, lane: usize, id: u32, vertices: &[Vec3; 3]) {
        for (v, p) in vertices.iter().enumerate() {
            for axis in 0..3 {
                self.v[v][axis][lane] = p[axis];
            }
        }
        self.id[lane] = id;
    }

    /// Returns the vertices of a lane.
    #[inline]
    pub(crate) fn vertices(&self, lane: usize) -> [[f32; 3]; 3] {
        std::array::from_fn(|v| std::array::from_fn(|axis| self.v[v][axis][lane]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_hold_valid_indices_and_refuse_larger_ones() {
        let most = Link::FIRST as usize;
        assert_eq!(Link::leaf(most - 7, 3).moved(99, 7).blocks(), most..most + 3);
        assert_eq!(Link::node(5).moved(1 << 20, 7).0, 5 + (1 << 20));
        assert!(!Link::node(Link::LEAF as usize - 1).is_leaf());
        // A larger index would be read as another link.
        let refused: [fn() -> Link; 5] = [
            || Link::leaf(Link::FIRST as usize + 1, 1),
            || Link::leaf(0, Link::BLOCKS + 1),
            || Link::node(Link::LEAF as usize),
            || Link::leaf(Link::FIRST as usize, 2).moved(0, 1),
            || Link::node(Link::LEAF as usize - 1).moved(1, 0),
        ];
        for make in refused {
            assert!(std::panic::catch_unwind(make).is_err());
        }
    }
}
