//! The tree of all triangles that do not move.

use crate::TriangleMesh;
use crate::build::{self, Item, Topology};
use crate::layout::{Block, Box3, Link, Node};
use crate::probe::{Scale, still_plane};
use crate::tree::Tree;
use granita_base::{Vec3, parallel_map};
use granita_machine::memory::with_large_pages;
use granita_machine::simd::{NARROW, Simd, WIDE};

/// Triangles that do not move and are stored elsewhere. They are not copied before the tree is built.
pub trait Triangles: Sync {
    /// The number of triangles.
    fn count(&self) -> usize;

    /// Returns the vertices of a triangle; `None` for one that is never hit.
    fn triangle(&self, triangle: usize) -> Option<[Vec3; 3]>;
}

/// Returns the vertices of a triangle that is stored elsewhere, if it can be hit.
pub(crate) fn corners_elsewhere(triangles: &dyn Triangles, t: usize) -> Option<[Vec3; 3]> {
    triangles.triangle(t).filter(|v| v.iter().all(|p| p.is_finite()))
}

/// The tree of all triangles that do not move.
#[derive(Debug, Default)]
pub(crate) struct StillTree {
    nodes: Vec<Node>,
    blocks: Vec<Block>,
}

impl StillTree {
    pub(crate) fn new(
        meshes: &[TriangleMesh],
        elsewhere: &[Option<&dyn Triangles>],
        first: &[u32],
        scale: Scale,
        threads: usize,
    ) -> Self {
        let count = |mesh: usize| match elsewhere[mesh] {
            Some(triangles) => triangles.count(),
            None if meshes[mesh].times.len() == 1 => meshes[mesh].triangles.len(),
            None => 0,
        };
        let corners = |mesh: usize, t: usize| -> Option<[Vec3; 3]> {
            if let Some(triangles) = elsewhere[mesh] {
                return corners_elsewhere(triangles, t).map(|v| v.map(|p| scale.point(p)));
            }
            meshes[mesh].triangle_bound(t)?;
            let [a, b, c] = meshes[mesh].triangles[t].map(|v| meshes[mesh].positions[0].get(v as usize));
            Some([*a?, *b?, *c?].map(|p| scale.point(p)))
        };
        let mut items = Vec::with_capacity((0..meshes.len()).map(count).sum());
        for (m, first) in first.iter().enumerate() {
            for t in 0..count(m) {
                if let Some(vertices) = corners(m, t) {
                    items.push(Item::new(first + t as u32, &Box3::around(&vertices)));
                }
            }
        }
        let Topology { mut nodes, blocks: spans } = build::build(&mut items, threads);
        nodes.shrink_to_fit();
        // The boxes are not needed any more, and their memory is freed before the blocks are allocated.
        let ids: Vec<u32> = items.iter().map(Item::id).collect();
        drop(items);
        let mut blocks = with_large_pages(spans.len());
        blocks.resize(spans.len(), Block::EMPTY);
        let part = spans.len().div_ceil(threads.max(1)).max(1);
        parallel_map(
            spans.chunks(part).zip(blocks.chunks_mut(part)),
            threads,
            || (),
            |(), (spans, blocks)| {
                for (span, block) in spans.iter().zip(blocks) {
                    let own = &ids[span.first as usize..][..span.count as usize];
                    for (lane, &id) in own.iter().enumerate() {
                        let mesh = first.partition_point(|f| *f <= id) - 1;
                        if let Some(vertices) = corners(mesh, (id - first[mesh]) as usize) {
                            block.set(lane, id, &vertices);
                        }
                    }
                }
            },
        );
        Self { nodes, blocks }
    }

    /// The number of blocks.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.blocks.len()
    }

    /// The blocks of triangles.
    pub(crate) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    pub(crate) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.blocks.capacity() * size_of::<Block>()
    }
}

impl Tree for StillTree {
    #[inline(always)]
    fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    #[inline(always)]
    fn planes<'a, S: Simd + 'a>(&'a self, s: S, node: usize) -> impl Fn(usize) -> S::F8 {
        still_plane(s, &self.nodes[node])
    }

    #[inline(always)]
    fn links(&self, node: usize) -> &[u32; WIDE] {
        self.nodes[node].links()
    }

    #[inline(always)]
    fn block<'a>(&'a self, block: usize, _: &'a mut Block) -> &'a Block {
        &self.blocks[block]
    }

    #[inline(always)]
    fn bounds(&self, block: &Block, lane: usize) -> Box3 {
        Box3::around(&block.vertices(lane).map(Vec3::from_array))
    }

    #[inline(always)]
    fn prefetch<S: Simd>(&self, s: S, link: Link) {
        if link.is_leaf() {
            s.prefetch(&self.blocks[link.blocks().start]);
        } else {
            s.prefetch(&self.nodes[link.0 as usize]);
        }
    }
}

const _: () = assert!(NARROW == 4);
