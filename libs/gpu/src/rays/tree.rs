//! The tree of triangles that is resident on a device: eight children a node, with compressed boxes (Ylitie, Karras,
//! Laine: "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017).
//!
//! The crate `obvhs` decides which triangles are together. Boxes are compressed here. A decompressed plane is the sum
//! that the device computes, in single precision, and it never lies inside of the exact box. So rays enter all boxes
//! around a triangle that they hit, as on the CPU.

use crate::GpuError;
use granita_trace::Resident;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ploc::PlocBuilder;
use obvhs::{Boundable, BvhBuildParams};
use rustc_hash::FxHashMap;

/// The number of words of a node.
pub(crate) const NODE: usize = 20;
/// The number of words of a triangle: three vertices, each with one more word. The first of these is the number of
/// the triangle.
pub(crate) const TRIANGLE: usize = 12;
/// The largest number of levels.
const MOST_LEVELS: u64 = 64;

/// A tree in the form of the device.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<u32>,
    pub(crate) triangles: Vec<u32>,
    /// The number of levels of nodes.
    pub(crate) levels: u32,
}

/// A box, as a lower and an upper corner.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Extent([[f32; 3]; 2]);

impl Extent {
    const EMPTY: Self = Self([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]);

    fn with(self, other: Self) -> Self {
        let lo = std::array::from_fn(|a| self.0[0][a].min(other.0[0][a]));
        let hi = std::array::from_fn(|a| self.0[1][a].max(other.0[1][a]));
        Self([lo, hi])
    }

    fn of(triangle: &[[f32; 3]; 3]) -> Self {
        triangle.iter().fold(Self::EMPTY, |e, v| e.with(Self([*v, *v])))
    }
}

impl Boundable for Extent {
    fn aabb(&self) -> Aabb {
        Aabb::new(self.0[0].into(), self.0[1].into())
    }
}

impl Tree {
    /// Builds the tree of triangles.
    ///
    /// # Errors
    /// Returns an error when the tree has more levels than the device supports.
    pub(crate) fn new(resident: &Resident) -> Result<Self, GpuError> {
        if resident.triangles.is_empty() {
            return Ok(Self::default());
        }
        let extents: Vec<Extent> = resident.triangles.iter().map(Extent::of).collect();
        let built = topology(&extents);
        let order = &built.primitive_indices;
        let of_leaf = |from: u32, n: u32| {
            let own = order.iter().skip(from as usize).take(n as usize);
            own.fold(Extent::EMPTY, |e, i| e.with(extents[*i as usize]))
        };
        // Children come after their parents.
        let mut exact = vec![Extent::EMPTY; built.nodes.len()];
        let mut below = vec![1_u32; built.nodes.len()];
        let mut nodes = vec![0; built.nodes.len() * NODE];
        for (at, node) in built.nodes.iter().enumerate().rev() {
            let mut children = [None; 8];
            for (k, child) in children.iter_mut().enumerate().filter(|(k, _)| !node.is_child_empty(*k)) {
                *child = Some(if node.is_leaf(k) {
                    let (from, n) = node.child_primitives(k);
                    of_leaf(from, n)
                } else {
                    let index = node.child_node_index(k) as usize;
                    if index <= at || index >= exact.len() {
                        let what = format!("a tree whose node {at} has the child {index}");
                        return Err(GpuError::Failed { what });
                    }
                    below[at] = below[at].max(below[index] + 1);
                    exact[index]
                });
            }
            exact[at] = children.iter().flatten().fold(Extent::EMPTY, |e, c| e.with(*c));
            compress(node, &exact[at], &children, &mut nodes[at * NODE..][..NODE]);
        }
        let levels = below[0];
        if u64::from(levels) > MOST_LEVELS {
            return Err(GpuError::Limit {
                what: "levels of a tree",
                asked: levels.into(),
                most: MOST_LEVELS,
            });
        }
        let mut triangles = Vec::with_capacity(order.len() * TRIANGLE);
        for &i in order {
            for (k, v) in resident.triangles[i as usize].iter().enumerate() {
                triangles.extend(v.map(f32::to_bits));
                triangles.push(if k == 0 { resident.numbers[i as usize] } else { 0 });
            }
        }
        Ok(Self { nodes, triangles, levels })
    }
}

/// Decides which boxes are together. Only the structure of the result is used, not its boxes.
fn topology(extents: &[Extent]) -> CwBvh {
    // Equal boxes would give a tree as deep as their number. They are therefore moved apart, by little more than the
    // rounding of their places.
    let mut equal: FxHashMap<[[u32; 3]; 2], u32> = FxHashMap::default();
    let mut apart = |e: &Extent| {
        let before = equal.entry(e.0.map(|corner| corner.map(f32::to_bits))).or_default();
        let place = [*before % 64, *before / 64 % 64, *before / 4096];
        *before += 1;
        let by: [f32; 3] = std::array::from_fn(|a| {
            let (lo, hi) = (e.0[0][a], e.0[1][a]);
            place[a] as f32 * ((hi - lo) * 1e-4 + lo.abs().max(hi.abs()) * 2.4e-7 + 1e-12)
        });
        Extent(e.0.map(|corner| std::array::from_fn(|a| corner[a] + by[a])))
    };
    let boxes: Vec<Extent> = extents.iter().map(&mut apart).collect();
    let how = BvhBuildParams::medium_build();
    let all = (0..boxes.len() as u32).collect();
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        how.ploc_search_distance,
        &boxes,
        all,
        how.sort_precision,
        how.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, how.reinsertion_batch_ratio, None);
    bvh2_to_cwbvh(&binary, 3, true, false)
}

/// Writes a node with the boxes of its children.
fn compress(node: &CwBvhNode, all: &Extent, children: &[Option<Extent>; 8], out: &mut [u32]) {
    out[3] = u32::from(node.imask) << 24;
    out[4] = node.child_base_idx;
    out[5] = node.primitive_base_idx;
    for (k, meta) in node.child_meta.iter().enumerate() {
        out[6 + k / 4] |= u32::from(*meta) << (8 * (k % 4));
    }
    for axis in 0..3 {
        let low = all.0[0][axis];
        let size = f64::from(all.0[1][axis]) - f64::from(low);
        // The first exponent with which 255 steps reach the other side, before rounding.
        let first = (1..254).find(|e| 255.0 * f64::from(step(*e)) >= size).unwrap_or(254);
        let planes = (first..255).find_map(|e| {
            let mut planes = [[0_u8; 2]; 8];
            for (planes, child) in planes.iter_mut().zip(children) {
                if let Some(child) = child {
                    *planes = enclosing(low, step(e), child.0[0][axis], child.0[1][axis])?;
                }
            }
            Some((e, planes))
        });
        let (exponent, planes) = planes.unwrap_or((254, [[0, 255]; 8]));
        out[axis] = low.to_bits();
        out[3] |= exponent << (8 * axis);
        for (k, [lo, hi]) in planes.into_iter().enumerate() {
            out[8 + 4 * axis + k / 4] |= u32::from(lo) << (8 * (k % 4));
            out[10 + 4 * axis + k / 4] |= u32::from(hi) << (8 * (k % 4));
        }
    }
}

/// Returns the distance of two planes of a grid.
fn step(exponent: u32) -> f32 {
    f32::from_bits(exponent << 23)
}

/// Returns the numbers of the planes around an interval; `None` when the grid ends before.
fn enclosing(low: f32, step: f32, lo: f32, hi: f32) -> Option<[u8; 2]> {
    // The device computes this sum.
    let plane = |k: u32| low + k as f32 * step;
    let place = |x: f32| (f64::from(x) - f64::from(low)) / f64::from(step);
    let mut first = place(lo).floor().clamp(0.0, 255.0) as u32;
    while first > 0 && plane(first) > lo {
        first -= 1;
    }
    let mut last = place(hi).ceil().clamp(0.0, 256.0) as u32;
    while last < 256 && plane(last) < hi {
        last += 1;
    }
    Some([u8::try_from(first).ok()?, u8::try_from(last).ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn resident(triangles: Vec<[[f32; 3]; 3]>) -> Resident {
        let numbers = (0..triangles.len() as u32).map(|k| 7 * k).collect();
        Resident { factor: 1.0, bounds: [[-1.0; 3], [1.0; 3]], triangles, numbers }
    }

    /// Visits the tree, and checks that boxes enclose everything below. Returns the numbers of the triangles.
    fn numbers(tree: &Tree, node: usize, around: &Extent) -> Vec<u32> {
        let words = &tree.nodes[node * NODE..][..NODE];
        let byte = |first: usize, k: usize| words[first + k / 4] >> (8 * (k % 4)) & 255;
        let (mut out, mut inner) = (Vec::new(), 0);
        for k in 0..8 {
            let meta = byte(6, k);
            if meta == 0 {
                continue;
            }
            let plane = |axis: usize, which: usize| {
                let low = f32::from_bits(words[axis]);
                low + byte(8 + 4 * axis + 2 * which, k) as f32 * step(words[3] >> (8 * axis) & 255)
            };
            let own = Extent([0, 1].map(|which| std::array::from_fn(|axis| plane(axis, which))));
            let inside =
                |e: &Extent, b: &Extent| (0..3).all(|a| b.0[0][a] <= e.0[0][a] && e.0[1][a] <= b.0[1][a]);
            let below = if words[3] >> (24 + k) & 1 == 1 {
                inner += 1;
                numbers(tree, words[4] as usize + inner - 1, &own)
            } else {
                let from = (words[5] + (meta & 31)) as usize;
                let all = from..from + (meta >> 5).count_ones() as usize;
                all.map(|t| {
                    let words = &tree.triangles[t * TRIANGLE..][..TRIANGLE];
                    let vertex = |v: usize| std::array::from_fn(|a| f32::from_bits(words[4 * v + a]));
                    let extent = Extent::of(&[0, 1, 2].map(vertex));
                    assert!(inside(&extent, &own), "{extent:?} in {own:?}");
                    assert!(inside(&extent, around), "{extent:?} in {around:?}");
                    words[3]
                })
                .collect()
            };
            out.extend(below);
        }
        out
    }

    fn check(triangles: Vec<[[f32; 3]; 3]>) {
        let resident = resident(triangles);
        let tree = Tree::new(&resident).unwrap();
        let everywhere = Extent([[f32::NEG_INFINITY; 3], [f32::INFINITY; 3]]);
        let mut found = numbers(&tree, 0, &everywhere);
        found.sort_unstable();
        assert_eq!(found, resident.numbers);
    }

    #[test]
    fn one_triangle_and_equal_triangles_have_trees() {
        let triangle = [[0.1, 0.2, 0.3], [0.5, 0.2, 0.3], [0.1, -0.7, 0.3]];
        for n in [1, 2, 3, 4, 9, 300, 30_000] {
            check(vec![triangle; n]);
            check(vec![[[0.25; 3]; 3]; n]);
            check(vec![[[0.0; 3]; 3]; n]);
        }
        assert!(Tree::new(&resident(Vec::new())).unwrap().nodes.is_empty());
    }

    proptest! {
        #[test]
        fn compressed_boxes_enclose_their_triangles(
            triangles in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1.0_f32..1.0)), 1..60),
            size in prop::sample::select(vec![1.0_f32, 1e-3, 1e-20, 1e-38]),
            offset in prop::sample::select(vec![0.0_f32, 0.9, -0.5])
        ) {
            let moved = |v: [f32; 3]| v.map(|x| (x * size + offset).clamp(-1.0, 1.0));
            check(triangles.into_iter().map(|t| t.map(moved)).collect());
        }
    }
}
