//! The tree of all moving triangles.
//!
//! Each node has a box for the first time of all meshes and one for the last. Between these times boxes are
//! interpolated as vertices are. The boxes of a triangle that does not move in one straight line are large enough for
//! its path.

use crate::TriangleMesh;
use crate::build::{self, Item, Topology};
use crate::layout::{Block, Box3, Link, Node};
use crate::probe::{Scale, still_plane};
use crate::tree::Tree;
use granita_base::Vec3;
use granita_machine::simd::{Simd, WIDE};

/// A tree of moving triangles.
#[derive(Debug)]
pub(crate) struct MovingTree {
    /// The moving meshes. The entries of meshes that do not move are empty.
    meshes: Vec<TriangleMesh>,
    /// The number of the first triangle of each mesh.
    first: Vec<u32>,
    scale: Scale,
    /// The first and the last time.
    times: [f32; 2],
    nodes: Vec<MovingNode>,
    /// The numbers of triangles in groups of four; `u32::MAX` for none.
    blocks: Vec<[u32; 4]>,
}

/// A node at the first and at the last time. The links are those of the first.
#[derive(Clone, Debug)]
struct MovingNode {
    ends: [Node; 2],
}

/// The boxes of a triangle at the first and at the last time.
type Ends = [Box3; 2];

impl MovingTree {
    pub(crate) fn new(meshes: Vec<TriangleMesh>, first: &[u32], scale: Scale, threads: usize) -> Self {
        let moving = || meshes.iter().filter(|m| m.times.len() > 1);
        let earliest = moving().fold(f32::INFINITY, |t, m| t.min(m.times[0]));
        let latest = moving().fold(f32::NEG_INFINITY, |t, m| t.max(m.times[m.times.len() - 1]));
        let mut tree = Self {
            first: first.to_vec(),
            scale,
            times: [earliest, latest],
            nodes: Vec::new(),
            blocks: Vec::new(),
            meshes,
        };
        let mut items = Vec::new();
        for (m, mesh) in tree.meshes.iter().enumerate().filter(|(_, m)| m.times.len() > 1) {
            for t in 0..mesh.triangles.len() {
                if mesh.triangle_bound(t).is_some() {
                    // Items are sorted by their positions in the middle of the time range.
                    let [a, b] = tree.ends(m, t);
                    items.push(Item::new(first[m] + t as u32, &a.between(&b, 0.5)));
                }
            }
        }
        let Topology { nodes, blocks } = build::build(&mut items, threads);
        tree.blocks = blocks
            .iter()
            .map(|span| {
                let mut ids = [u32::MAX; 4];
                let own = &items[span.first as usize..][..span.count as usize];
                ids.iter_mut().zip(own).for_each(|(id, item)| *id = item.id());
                ids
            })
            .collect();
        drop(items);
        // Children come after their parents.
        let mut around = vec![[Box3::EMPTY; 2]; nodes.len()];
        tree.nodes = nodes.into_iter().map(|n| MovingNode { ends: [n.clone(), n] }).collect();
        for k in (0..tree.nodes.len()).rev() {
            let mut node = tree.nodes[k].clone();
            let children: Vec<(usize, Link)> = node.ends[0].children().collect();
            for (slot, link) in children {
                let ends = if link.is_leaf() {
                    let ids = tree.blocks[link.blocks()].iter().flatten().filter(|id| **id != u32::MAX);
                    ids.fold([Box3::EMPTY; 2], |all, id| {
                        let (mesh, triangle) = tree.place(*id);
                        union(&all, &tree.ends(mesh, triangle))
                    })
                } else {
                    around[link.0 as usize]
                };
                around[k] = union(&around[k], &ends);
                for (node, bounds) in node.ends.iter_mut().zip(&ends) {
                    node.set_bounds(slot, bounds);
                }
            }
            tree.nodes[k] = node;
        }
        tree
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The number of blocks.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.blocks.len()
    }

    /// The number of bytes of memory of the tree and its meshes.
    pub(crate) fn bytes(&self) -> usize {
        let mesh = |m: &TriangleMesh| {
            let vertices: usize = m.positions.iter().map(Vec::capacity).sum();
            vertices * size_of::<Vec3>() + m.triangles.capacity() * size_of::<[u32; 3]>()
        };
        self.nodes.capacity() * size_of::<MovingNode>()
            + self.blocks.capacity() * size_of::<[u32; 4]>()
            + self.meshes.iter().map(mesh).sum::<usize>()
    }

    /// Returns the tree at a time.
    pub(crate) fn at(&self, time: f32) -> MovedTree<'_> {
        let [t0, t1] = self.times;
        MovedTree { tree: self, time, alpha: self.alpha(time.clamp(t0, t1)) }
    }

    fn alpha(&self, time: f32) -> f32 {
        let [t0, t1] = self.times.map(f64::from);
        ((f64::from(time) - t0) / (t1 - t0)) as f32
    }

    /// Returns the mesh and triangle of a number.
    fn place(&self, id: u32) -> (usize, usize) {
        let mesh = self.first.partition_point(|f| *f <= id) - 1;
        (mesh, (id - self.first[mesh]) as usize)
    }

    fn vertices(&self, mesh: usize, triangle: usize, time: f32) -> [Vec3; 3] {
        self.meshes[mesh].triangle_at(triangle, time).map(|p| self.scale.point(p))
    }

    /// Returns boxes whose interpolation contains the triangle at all times.
    fn ends(&self, mesh: usize, triangle: usize) -> Ends {
        let at = |time: f32| Box3::around(&self.vertices(mesh, triangle, time));
        let mut ends = self.times.map(at);
        let (mut lo, mut hi) = ([0.0_f32; 3], [0.0_f32; 3]);
        let inner = self.meshes[mesh].times.iter().filter(|t| self.times[0] < **t && **t < self.times[1]);
        for &time in inner {
            let (blend, own) = (ends[0].between(&ends[1], self.alpha(time)), at(time));
            for a in 0..3 {
                lo[a] = lo[a].max(blend.lo[a] - own.lo[a]);
                hi[a] = hi[a].max(own.hi[a] - blend.hi[a]);
            }
        }
        for a in 0..3 {
            // The padding covers the rounding of the interpolation of vertices and boxes.
            let size = ends.iter().fold(0.0_f32, |s, e| s.max(e.lo[a].abs()).max(e.hi[a].abs()));
            let room = 1e-6 * (size + lo[a] + hi[a]);
            for end in &mut ends {
                end.lo[a] -= lo[a] + room;
                end.hi[a] += hi[a] + room;
            }
        }
        ends
    }
}

fn union(a: &Ends, b: &Ends) -> Ends {
    [a[0].union(&b[0]), a[1].union(&b[1])]
}

/// A [`MovingTree`] at one time.
pub(crate) struct MovedTree<'a> {
    tree: &'a MovingTree,
    time: f32,
    alpha: f32,
}

impl Tree for MovedTree<'_> {
    fn is_empty(&self) -> bool {
        self.tree.nodes.is_empty()
    }

    #[inline(always)]
    fn planes<'a, S: Simd + 'a>(&'a self, s: S, node: usize) -> impl Fn(usize) -> S::F8 {
        let [a, b] = &self.tree.nodes[node].ends;
        let (alpha, rest) = (s.splat8(self.alpha), s.splat8(1.0 - self.alpha));
        let (first, second) = (still_plane(s, a), still_plane(s, b));
        // The operations are those of `Box3::between`, one by one.
        move |row: usize| s.add8(s.mul8(first(row), rest), s.mul8(second(row), alpha))
    }

    #[inline(always)]
    fn links(&self, node: usize) -> &[u32; WIDE] {
        self.tree.nodes[node].ends[0].links()
    }

    #[inline(always)]
    fn block<'a>(&'a self, block: usize, room: &'a mut Block) -> &'a Block {
        *room = Block::EMPTY;
        for (lane, &id) in self.tree.blocks[block].iter().enumerate().filter(|(_, id)| **id != u32::MAX) {
            let (mesh, triangle) = self.tree.place(id);
            if !self.tree.meshes[mesh].exists_at(self.time) {
                continue;
            }
            room.set(lane, id, &self.tree.vertices(mesh, triangle, self.time));
        }
        room
    }

    fn bounds(&self, block: &Block, lane: usize) -> Box3 {
        let (mesh, triangle) = self.tree.place(block.id[lane]);
        let [a, b] = self.tree.ends(mesh, triangle);
        a.between(&b, self.alpha)
    }

    #[inline(always)]
    fn prefetch<S: Simd>(&self, s: S, link: Link) {
        if !link.is_leaf() {
            s.prefetch(&self.tree.nodes[link.0 as usize]);
        }
    }
}
