//! The tree: topology by obvhs, bounds and layout our own.
//!
//! obvhs builds a binary tree over the boxes, normalized to the unit cube so that no scale overflows or vanishes.
//! Only its topology is used: bounds are computed again from the boxes themselves, and up to four levels of children
//! are pulled into one node whose boxes are tested together.

use granita_base::Bound;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

/// Boxes in a node.
pub(crate) const WIDTH: usize = 4;

/// A node: the boxes of up to four children, axis by axis.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// Lower corners; infinite for children that are not there.
    pub(crate) lo: [[f32; WIDTH]; 3],
    /// Upper corners; minus infinite for children that are not there.
    pub(crate) hi: [[f32; WIDTH]; 3],
    /// Index of the child node, or of the first primitive of a leaf.
    pub(crate) child: [u32; WIDTH],
    /// Primitives in a leaf; 0 for a child node.
    pub(crate) count: [u32; WIDTH],
}

impl Node {
    const EMPTY: Self = Self {
        lo: [[f32::INFINITY; WIDTH]; 3],
        hi: [[f32::NEG_INFINITY; WIDTH]; 3],
        child: [0; WIDTH],
        count: [0; WIDTH],
    };

    fn set_bound(&mut self, slot: usize, bound: &Bound) {
        for axis in 0..3 {
            self.lo[axis][slot] = bound.min[axis];
            self.hi[axis][slot] = bound.max[axis];
        }
    }
}

/// A tree over boxes.
#[derive(Debug, Default)]
pub(crate) struct Bvh {
    /// Nodes, the root first; none without primitives.
    pub(crate) nodes: Vec<Node>,
    /// Primitives in the order of the leaves.
    pub(crate) order: Vec<u32>,
    /// Box around everything.
    pub(crate) bound: Bound,
    /// How many entries a traversal stack needs at most.
    pub(crate) stack: usize,
}

impl Bvh {
    /// Builds the tree; all boxes are finite and not empty.
    pub(crate) fn build(boxes: &[Bound]) -> Self {
        let bound = boxes.iter().fold(Bound::EMPTY, |all, b| all.union(*b));
        if boxes.is_empty() {
            return Self { bound, ..Self::default() };
        }
        let normalized = normalize(boxes, &bound);
        let options = BvhBuildParams { pre_split: false, ..BvhBuildParams::medium_build() };
        let binary = build_bvh2(&normalized, options, &mut std::time::Duration::default());
        let bounds = node_bounds(&binary, boxes);
        let mut tree = Self { nodes: Vec::new(), order: binary.primitive_indices.clone(), bound, stack: 0 };
        let depth = tree.widen(&binary, &bounds);
        tree.stack = depth * (WIDTH - 1) + WIDTH;
        tree
    }

    /// Pulls levels of the binary tree together. Returns the depth.
    fn widen(&mut self, binary: &Bvh2, bounds: &[Bound]) -> usize {
        let leaf = |i: usize| binary.nodes[i].prim_count > 0;
        let mut depth = 1;
        // (binary node, wide node, depth); the root may itself be a leaf.
        self.nodes.push(Node::EMPTY);
        let mut open = vec![(0_usize, 0_usize, 1_usize)];
        while let Some((from, to, level)) = open.pop() {
            depth = depth.max(level);
            let mut children = [0_usize; WIDTH];
            let mut n = 1;
            children[0] = from;
            while n < WIDTH {
                // Open the child with the largest surface.
                let area = |i: &usize| {
                    let s = bounds[children[*i]].size();
                    // Doubles: areas of large scenes overflow.
                    let s = [f64::from(s.x), f64::from(s.y), f64::from(s.z)];
                    s[0] * s[1] + s[1] * s[2] + s[2] * s[0]
                };
                let inner = (0..n).filter(|&i| !leaf(children[i]));
                let Some(largest) = inner.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
                let first = binary.nodes[children[largest]].first_index as usize;
                children[largest] = first;
                children[n] = first + 1;
                n += 1;
            }
            for (slot, &child) in children.iter().enumerate().take(n) {
                let source = &binary.nodes[child];
                self.nodes[to].set_bound(slot, &bounds[child]);
                if source.prim_count > 0 {
                    self.nodes[to].child[slot] = source.first_index;
                    self.nodes[to].count[slot] = source.prim_count;
                } else {
                    let index = self.nodes.len();
                    self.nodes.push(Node::EMPTY);
                    self.nodes[to].child[slot] = index as u32;
                    open.push((child, index, level + 1));
                }
            }
        }
        depth
    }
}

/// Boxes moved and scaled into the unit cube.
fn normalize(boxes: &[Bound], all: &Bound) -> Vec<Aabb> {
    let min = [0, 1, 2].map(|a| f64::from(all.min[a]));
    let size = (0..3).fold(0.0_f64, |size, a| size.max(f64::from(all.max[a]) - min[a]));
    let scale = if size > 0.0 { 1.0 / size } else { 1.0 };
    let corner = |p: granita_base::Vec3| -> [f32; 3] {
        std::array::from_fn(|a| ((f64::from(p[a]) - min[a]) * scale) as f32)
    };
    boxes.iter().map(|b| Aabb::new(corner(b.min).into(), corner(b.max).into())).collect()
}

/// Bounds of all binary nodes from the boxes of their primitives.
fn node_bounds(binary: &Bvh2, boxes: &[Bound]) -> Vec<Bound> {
    let mut bounds = vec![Bound::EMPTY; binary.nodes.len()];
    let mut open = vec![(0_usize, false)];
    while let Some((i, done)) = open.pop() {
        let node = &binary.nodes[i];
        let first = node.first_index as usize;
        if node.prim_count > 0 {
            let of_leaf = &binary.primitive_indices[first..first + node.prim_count as usize];
            bounds[i] = of_leaf.iter().fold(Bound::EMPTY, |b, &p| b.union(boxes[p as usize]));
        } else if done {
            bounds[i] = bounds[first].union(bounds[first + 1]);
        } else {
            open.extend([(i, true), (first, false), (first + 1, false)]);
        }
    }
    bounds
}
