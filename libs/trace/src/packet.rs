//! Traversal of a tree by packets of up to 64 coherent rays.
//!
//! The rays of a packet have the same signs of their directions and the same longest axis. A node is tested once for
//! the whole packet, by intervals that contain the values of all rays, and each child that may be hit is then tested
//! against eight rays at once. A triangle is tested against eight rays at once, too. The operations for each ray are
//! those of single rays, one by one. The intervals contain the results of these operations, because rounding is
//! monotonic. A packet therefore finds the same hits as its rays alone, to the bit. Where few rays of a packet enter a
//! part of the tree, they traverse it one by one.
//!
//! The method combines the streams of Barringer, Akenine-Moller: "Dynamic Ray Stream Traversal", ACM TOG 33(4), 2014,
//! with the interval test of Boulos, Wald, Shirley: "Geometric and Arithmetic Culling Methods for Entire Ray Packets",
//! UUCS-06-010, 2006.

use crate::Ray;
use crate::build::LEVELS;
use crate::group::{Class, Group, Lane};
use crate::layout::{Block, Link};
use crate::probe::{Probe, Wide};
use crate::scene::Scene;
use crate::single::{Best, RayScratch, Verdict, through};
use crate::tree::Tree;
use granita_machine::simd::{NARROW, Simd, WIDE};

/// The largest number of rays of a packet.
pub(crate) const RAYS: usize = 64;
/// The number of groups of eight rays.
const GROUPS: usize = RAYS / WIDE;
/// Fewer rays than this traverse a part of the tree one by one.
const FEW: u32 = 6;
/// Fewer rays than this are tested one by one against the children of a node.
const SOME: u32 = 8;
/// Fewer rays of a group than this are tested one by one against the triangles of a block.
const LANES: u32 = 5;
/// Batches with fewer rays than this are traced one by one.
const LEAST: usize = 16;
/// The number of rays from one ray to the next whose coherence is tested.
const STEP: usize = 7;
/// The smallest cosine between the directions of coherent rays.
const COSINE: f32 = 0.9;
/// The largest distance between the origins of coherent rays, in the units of the tree.
const ORIGIN: f32 = 0.25;

/// True when up to [`RAYS`] rays are worth traversing together, judged by some of them.
#[inline(always)]
pub(crate) fn is_coherent(rays: &[Ray], scene: &Scene) -> bool {
    let Some(middle) = rays.get(rays.len() / 2).filter(|_| rays.len() >= LEAST) else { return false };
    let least = COSINE * COSINE * middle.dir.length_squared();
    rays.iter().step_by(STEP).all(|ray| {
        let dot = middle.dir.dot(ray.dir);
        let off = scene.scale.point(ray.origin - middle.origin);
        // The comparisons fail for NaN.
        (dot > 0.0)
            & (dot * dot > least * ray.dir.length_squared())
            & (off.length_squared() < ORIGIN * ORIGIN)
    })
}

/// Intervals that contain the values of all rays of a packet.
#[derive(Clone, Copy, Debug)]
struct Frustum {
    /// The origins with the nearest near planes.
    near_origin: [f32; 3],
    /// The origins with the farthest far planes.
    far_origin: [f32; 3],
    /// The inverses of the smallest and the largest absolute value.
    inverse: [[f32; 2]; 3],
    tmin: f32,
    tmax: f32,
}

impl Frustum {
    /// Returns the children of a node that a ray of the packet may enter, as bits, and lower limits of the distances.
    #[inline(always)]
    fn enter<S: Simd>(&self, s: S, plane: &impl Fn(usize) -> S::F8, rows: [usize; 3]) -> (u32, Lane) {
        let (mut near, mut far) = (s.splat8(self.tmin), s.splat8(self.tmax));
        for (a, row) in rows.into_iter().enumerate() {
            let (small, large) = (s.splat8(self.inverse[a][0]), s.splat8(self.inverse[a][1]));
            let n = s.sub8(plane(row), s.splat8(self.near_origin[a]));
            let f = s.sub8(plane(row ^ 1), s.splat8(self.far_origin[a]));
            // An undefined product, 0 times infinity, is the second of both. The result is then undefined, too, and
            // the axis is ignored, as it is for single rays.
            near = s.max8(s.min8(s.mul8(n, small), s.mul8(n, large)), near);
            far = s.min8(s.max8(s.mul8(f, small), s.mul8(f, large)), far);
        }
        (s.le8(near, far), s.store8(near))
    }
}

/// Returns the smallest and the largest value of some rays.
#[inline(always)]
fn range<S: Simd>(s: S, groups: &[Group; GROUPS], rays: u64, of: impl Fn(&Group) -> &Lane) -> (f32, f32) {
    let (mut lo, mut hi) = (s.splat8(f32::INFINITY), s.splat8(f32::NEG_INFINITY));
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    for (g, group) in groups.iter().enumerate() {
        let own = rays >> (WIDE * g) & 255;
        let x = of(group);
        if own == 255 {
            (lo, hi) = (s.min8(s.load8(x), lo), s.max8(s.load8(x), hi));
        } else if own != 0 {
            for k in (0..WIDE).filter(|k| own >> k & 1 != 0) {
                least = if x[k] < least { x[k] } else { least };
                most = if x[k] > most { x[k] } else { most };
            }
        }
    }
    let (lo, hi) = (s.store8(lo), s.store8(hi));
    for k in 0..WIDE {
        least = if lo[k] < least { lo[k] } else { least };
        most = if hi[k] > most { hi[k] } else { most };
    }
    (least, most)
}

/// A part of the tree that is still to be visited.
#[derive(Clone, Copy, Debug)]
struct Entry {
    link: Link,
    /// A lower limit of the distances at which the rays enter.
    near: f32,
    /// The rays that enter, as bits.
    rays: u64,
}

/// Rays that are traversed together, and their best hits.
#[derive(Clone, Debug)]
pub(crate) struct Packet {
    groups: [Group; GROUPS],
    class: Class,
    frustum: Frustum,
    stack: [Entry; LEVELS * (WIDE - 1) + WIDE],
}

impl Packet {
    /// Returns a packet without rays.
    pub(crate) fn new() -> Self {
        Self {
            groups: [Group::EMPTY; GROUPS],
            class: Class::new(0),
            frustum: Frustum {
                near_origin: [0.0; 3],
                far_origin: [0.0; 3],
                inverse: [[0.0; 2]; 3],
                tmin: 0.0,
                tmax: 0.0,
            },
            stack: [Entry { link: Link(0), near: 0.0, rays: 0 }; _],
        }
    }

    /// Replaces the rays by up to 64 others. Returns those that may hit something, as bits.
    #[inline(always)]
    pub(crate) fn load(&mut self, rays: &[Ray], scene: &Scene) -> u64 {
        let mut there = 0;
        for (g, rays) in rays.chunks(WIDE).enumerate().take(GROUPS) {
            there |= u64::from(self.groups[g].load(rays, scene.scale, &scene.bounds)) << (WIDE * g);
        }
        there
    }

    /// Selects the class of the first of some rays, and returns the rays of this class.
    #[inline(always)]
    pub(crate) fn select(&mut self, rays: u64) -> u64 {
        let first = rays.trailing_zeros() as usize & (RAYS - 1);
        let class = self.groups[first / WIDE].class[first % WIDE];
        self.class = Class::new(class);
        let mut same = 0;
        for (g, group) in self.groups.iter_mut().enumerate() {
            if rays >> (WIDE * g) & 255 == 0 {
                continue;
            }
            group.shear(self.class);
            for k in 0..WIDE {
                same |= u64::from(group.class[k] == class) << (WIDE * g + k);
            }
        }
        same & rays
    }

    /// Returns a ray of the selected class, and its best hit.
    #[inline(always)]
    pub(crate) fn result(&self, k: usize) -> (Probe, Best) {
        let (group, k) = (&self.groups[k / WIDE], k % WIDE);
        (group.probe(k, self.class), Best { met: group.met(k), id: group.id[k] })
    }

    /// Computes the intervals of some rays of the selected class.
    #[inline(always)]
    pub(crate) fn enclose<S: Simd>(&mut self, s: S, rays: u64) {
        let groups = &self.groups;
        for a in 0..3 {
            let (lo, hi) = range(s, groups, rays, |g| &g.inverse[a]);
            let (near_lo, near_hi) = range(s, groups, rays, |g| &g.near_origin[a]);
            let (far_lo, far_hi) = range(s, groups, rays, |g| &g.far_origin[a]);
            let f = &mut self.frustum;
            if self.class.near_row[a] & 1 == 0 {
                (f.near_origin[a], f.far_origin[a], f.inverse[a]) = (near_hi, far_lo, [lo, hi]);
            } else {
                (f.near_origin[a], f.far_origin[a], f.inverse[a]) = (near_lo, far_hi, [hi, lo]);
            }
        }
        self.frustum.tmin = range(s, groups, rays, |g| &g.tmin).0;
        self.frustum.tmax = range(s, groups, rays, |g| &g.tmax).1;
    }

    /// Finds the best hits of all rays in a tree: the closest ones, or any.
    #[inline(always)]
    pub(crate) fn through<S: Simd, const ANY: bool>(
        &mut self,
        s: S,
        tree: &impl Tree,
        all: u64,
        scratch: &mut RayScratch,
    ) {
        if tree.is_empty() {
            return;
        }
        let mut room = Block::EMPTY;
        let mut size = 1;
        self.stack[0] = Entry { link: Link::node(0), near: f32::MIN, rays: all };
        while size > 0 {
            size -= 1;
            let Entry { link, near, rays } = self.stack[size];
            let mut rays = rays & self.reaching(s, near, rays);
            if rays.count_ones() < FEW {
                while rays != 0 {
                    let k = rays.trailing_zeros() as usize & (RAYS - 1);
                    rays &= rays - 1;
                    self.single::<S, ANY>(s, tree, link, k, scratch);
                }
            } else if link.is_leaf() {
                for k in link.blocks() {
                    let block = tree.block(k, &mut room);
                    self.leaf::<S, ANY>(s, tree, block, rays);
                }
            } else {
                self.node(s, tree, link, rays, &mut size);
            }
        }
    }

    /// Returns the rays whose search goes on at a distance, as bits.
    #[inline(always)]
    fn reaching<S: Simd>(&self, s: S, near: f32, rays: u64) -> u64 {
        let near = s.splat8(near);
        let mut out = 0;
        for (g, group) in self.groups.iter().enumerate() {
            if rays >> (WIDE * g) & 255 != 0 {
                out |= u64::from(s.le8(near, s.load8(&group.tmax))) << (WIDE * g);
            }
        }
        out
    }

    /// Traverses a part of the tree by one ray.
    #[inline(always)]
    pub(crate) fn single<S: Simd, const ANY: bool>(
        &mut self,
        s: S,
        tree: &impl Tree,
        link: Link,
        k: usize,
        scratch: &mut RayScratch,
    ) {
        let group = &mut self.groups[k / WIDE];
        let k = k % WIDE;
        if group.tmax[k] == f32::NEG_INFINITY {
            return;
        }
        let probe = group.probe(k, self.class);
        let wide = Wide::new(s, &probe);
        let verdict = if ANY { Verdict::Stop } else { Verdict::Take };
        let mut best = Best { met: group.met(k), id: group.id[k] };
        let more = through(s, (tree, link), (&probe, &wide), scratch, &mut best, &mut |_, _, _| verdict);
        group.take(k, &best.met, best.id, !more);
    }

    /// Pushes the children of a node that some rays enter, so that the nearest is popped first.
    #[inline(always)]
    fn node<S: Simd>(&mut self, s: S, tree: &impl Tree, link: Link, rays: u64, size: &mut usize) {
        let node = link.0 as usize;
        let plane = tree.planes(s, node);
        let links = tree.links(node);
        let (masks, near) = if rays.count_ones() < SOME {
            self.children_by_ray(s, &plane, rays)
        } else {
            self.children(s, &plane, rays)
        };
        let base = *size;
        for c in 0..WIDE {
            if masks[c] == 0 {
                continue;
            }
            let entry = Entry { link: Link(links[c]), near: near[c], rays: masks[c] };
            tree.prefetch(s, entry.link);
            let mut at = *size;
            while at > base && self.stack[at - 1].near < entry.near {
                self.stack[at] = self.stack[at - 1];
                at -= 1;
            }
            self.stack[at] = entry;
            *size += 1;
        }
    }

    /// Returns for each child of a node the rays that enter it, as bits, and a lower limit of their distances.
    #[inline(always)]
    fn children<S: Simd>(&self, s: S, plane: &impl Fn(usize) -> S::F8, rays: u64) -> ([u64; WIDE], Lane) {
        let rows = self.class.near_row;
        let (mut hit, near) = self.frustum.enter(s, plane, rows);
        let first = [s.store8(plane(rows[0])), s.store8(plane(rows[1])), s.store8(plane(rows[2]))];
        let second =
            [s.store8(plane(rows[0] ^ 1)), s.store8(plane(rows[1] ^ 1)), s.store8(plane(rows[2] ^ 1))];
        let mut masks = [0; WIDE];
        while hit != 0 {
            let c = hit.trailing_zeros() as usize & 7;
            hit &= hit - 1;
            let planes = [
                [s.splat8(first[0][c]), s.splat8(second[0][c])],
                [s.splat8(first[1][c]), s.splat8(second[1][c])],
                [s.splat8(first[2][c]), s.splat8(second[2][c])],
            ];
            let mut mask = 0;
            for (g, group) in self.groups.iter().enumerate() {
                if rays >> (WIDE * g) & 255 != 0 {
                    mask |= u64::from(group.enter(s, &planes)) << (WIDE * g);
                }
            }
            masks[c] = mask & rays;
        }
        (masks, near)
    }

    /// Does the same as [`Packet::children`] for few rays.
    #[inline(always)]
    fn children_by_ray<S: Simd>(
        &self,
        s: S,
        plane: &impl Fn(usize) -> S::F8,
        mut rays: u64,
    ) -> ([u64; WIDE], Lane) {
        let mut masks = [0; WIDE];
        let mut least = s.splat8(f32::INFINITY);
        while rays != 0 {
            let k = rays.trailing_zeros() as usize & (RAYS - 1);
            let bit = rays & rays.wrapping_neg();
            rays &= rays - 1;
            let probe = self.groups[k / WIDE].probe(k % WIDE, self.class);
            let (mut hit, near) = Wide::new(s, &probe).enter(s, plane, probe.tmax);
            least = s.min8(s.load8(&near), least);
            while hit != 0 {
                masks[hit.trailing_zeros() as usize & 7] |= bit;
                hit &= hit - 1;
            }
        }
        (masks, s.store8(least))
    }

    /// Tests some rays against the triangles of a block.
    #[inline(always)]
    fn leaf<S: Simd, const ANY: bool>(&mut self, s: S, tree: &impl Tree, block: &Block, rays: u64) {
        for g in 0..GROUPS {
            let own = (rays >> (WIDE * g) & 255) as u32;
            if own == 0 {
                continue;
            }
            if own.count_ones() >= LANES {
                for lane in (0..NARROW).filter(|lane| block.id[*lane] != u32::MAX) {
                    let vertices = block.vertices(lane);
                    let mut mask = self.groups[g].candidates(s, &vertices, self.class) & own;
                    while mask != 0 {
                        let k = WIDE * g + (mask.trailing_zeros() as usize & 7);
                        mask &= mask - 1;
                        self.meet::<ANY>(tree, block, lane, k);
                    }
                }
                continue;
            }
            let mut own = own;
            while own != 0 {
                let k = WIDE * g + (own.trailing_zeros() as usize & 7);
                own &= own - 1;
                let probe = self.groups[g].probe(k % WIDE, self.class);
                let mut mask = Wide::new(s, &probe).candidates(s, block, probe.tmax);
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize & 3;
                    mask &= mask - 1;
                    self.meet::<ANY>(tree, block, lane, k);
                }
            }
        }
    }

    /// Tests a ray against a triangle of a block, exactly.
    #[inline(always)]
    fn meet<const ANY: bool>(&mut self, tree: &impl Tree, block: &Block, lane: usize, k: usize) {
        let group = &mut self.groups[k / WIDE];
        let k = k % WIDE;
        if ANY && group.tmax[k] == f32::NEG_INFINITY {
            return;
        }
        let probe = group.probe(k, self.class);
        let bounds = || tree.bounds(block, lane);
        let Some(met) = probe.meet(&block.vertices(lane), bounds, probe.tmax) else { return };
        let id = block.id[lane];
        if met.t < probe.tmax || id < group.id[k] {
            group.take(k, &met, id, ANY);
        }
    }
}
