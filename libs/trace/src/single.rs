//! Traversal of a tree by one ray.
//!
//! The nearest children are visited first. Children that begin behind the best hit so far are skipped.

use crate::build::LEVELS;
use crate::layout::{Block, Link};
use crate::probe::{Met, Probe, Wide};
use crate::tree::Tree;
use granita_machine::simd::{Simd, WIDE};

/// The decision about a hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The hit is ignored.
    Pass,
    /// The hit is the best so far.
    Take,
    /// The search ends with this hit.
    Stop,
}

/// Scratch for the traversal of trees, which is made once for many rays that are traced one by one.
///
/// It holds the children that are still to be visited, as the bits of their entry distances above their links.
#[derive(Clone, Debug)]
pub struct RayScratch([u64; LEVELS * (WIDE - 1) + WIDE]);

impl Default for RayScratch {
    fn default() -> Self {
        Self([0; _])
    }
}

/// The best hit so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    pub(crate) met: Met,
    /// The number of the triangle; `u32::MAX` for none.
    pub(crate) id: u32,
}

impl Best {
    /// Returns the value for a ray that has hit nothing yet.
    #[inline(always)]
    pub(crate) fn none(probe: &Probe) -> Self {
        Self { met: Met { t: probe.tmax, b1: 0.0, b2: 0.0 }, id: u32::MAX }
    }
}

/// Visits all triangles below a link whose boxes the ray hits before the best hit so far. Returns false when the search
/// was stopped.
#[inline(always)]
pub(crate) fn through<S: Simd>(
    s: S,
    (tree, mut link): (&impl Tree, Link),
    (probe, wide): (&Probe, &Wide<S>),
    stack: &mut RayScratch,
    best: &mut Best,
    judge: &mut impl FnMut(&Probe, &Met, u32) -> Verdict,
) -> bool {
    if tree.is_empty() {
        return true;
    }
    let stack = &mut stack.0;
    let mut room = Block::EMPTY;
    let mut size = 0;
    loop {
        while !link.is_leaf() {
            let node = link.0 as usize;
            let (mask, near) = wide.enter(s, &tree.planes(s, node), best.met.t);
            let links = tree.links(node);
            if mask == 0 {
                match pop(stack, &mut size, best.met.t) {
                    Some(next) => link = next,
                    None => return true,
                }
                continue;
            }
            link = nearest(s, tree, Children { mask, near, links }, stack, &mut size);
        }
        for k in link.blocks() {
            let block = tree.block(k, &mut room);
            let mut mask = wide.candidates(s, block, best.met.t);
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize & 3;
                mask &= mask - 1;
                let bounds = || tree.bounds(block, lane);
                let Some(met) = probe.meet(&block.vertices(lane), bounds, best.met.t) else { continue };
                let id = block.id[lane];
                if met.t < best.met.t || id < best.id {
                    match judge(probe, &met, id) {
                        Verdict::Pass => {}
                        Verdict::Take => *best = Best { met, id },
                        Verdict::Stop => {
                            *best = Best { met, id };
                            return false;
                        }
                    }
                }
            }
        }
        match pop(stack, &mut size, best.met.t) {
            Some(next) => link = next,
            None => return true,
        }
    }
}

/// The children of a node that a ray hits.
struct Children<'a> {
    /// The slots of the children that were not taken, as bits.
    mask: u32,
    /// The distances at which the ray enters the children.
    near: [f32; WIDE],
    links: &'a [u32; WIDE],
}

impl Children<'_> {
    /// Takes a child and returns its slot.
    #[inline(always)]
    fn take(&mut self) -> usize {
        let slot = self.mask.trailing_zeros() as usize;
        self.mask &= self.mask - 1;
        slot
    }

    /// Returns a child as it is stored in [`RayScratch`].
    #[inline(always)]
    fn entry(&self, slot: usize) -> u64 {
        u64::from(self.near[slot & 7].to_bits()) << 32 | u64::from(self.links[slot & 7])
    }
}

/// Returns the nearest of at least one child, and pushes the others so that the nearest of them is popped first.
#[inline(always)]
fn nearest<S: Simd>(
    s: S,
    tree: &impl Tree,
    mut children: Children<'_>,
    stack: &mut [u64],
    size: &mut usize,
) -> Link {
    let a = children.take();
    if children.mask == 0 {
        return Link(children.links[a & 7]);
    }
    let b = children.take();
    let (a, b) = (children.entry(a), children.entry(b));
    tree.prefetch(s, Link(a as u32));
    tree.prefetch(s, Link(b as u32));
    // Compared as integers, the values are ordered by distance, except for negative distances, where any order is
    // valid.
    let (first, second) = if (a as i64) < (b as i64) { (a, b) } else { (b, a) };
    if children.mask == 0 {
        stack[*size] = second;
        *size += 1;
        return Link(first as u32);
    }
    // The nearest child is pushed last, so that it is visited first.
    let base = *size;
    stack[*size] = second;
    stack[*size + 1] = first;
    *size += 2;
    while children.mask != 0 {
        let slot = children.take();
        let next = children.entry(slot);
        tree.prefetch(s, Link(next as u32));
        let mut at = *size;
        *size += 1;
        while at > base && (stack[at - 1] as i64) < (next as i64) {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = next;
    }
    *size -= 1;
    Link(stack[*size] as u32)
}

/// Pops the next child that is not behind the best hit. A child at the same distance is kept, because it may hold a
/// triangle with a smaller number.
#[inline(always)]
fn pop(stack: &[u64], size: &mut usize, tmax: f32) -> Option<Link> {
    while *size > 0 {
        *size -= 1;
        let entry = stack[*size];
        if f32::from_bits((entry >> 32) as u32) <= tmax {
            return Some(Link(entry as u32));
        }
    }
    None
}
