//! Builds a tree top down by a binned surface area heuristic, eight children at a time.
//!
//! The method follows Wald: "On fast Construction of SAH-based Bounding Volume Hierarchies", IEEE RT 2007, and Wald
//! et al.: "Getting Rid of Packets", IEEE RT 2008 (children are opened in the order of their surface areas until a
//! node is full). The cost of a leaf is that of the blocks of four that its triangles fill. The tree does not depend
//! on the number of threads.

use crate::layout::{Box3, Link, Node};
use granita_base::parallel_map;
use granita_machine::memory::with_large_pages;
use granita_machine::simd::{NARROW, WIDE};

/// An item to be put into a tree.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Item {
    /// The lower corner. The fourth value is the number of the item.
    lo: [f32; 4],
    /// The upper corner.
    hi: [f32; 4],
}

impl Item {
    /// Returns the item of a triangle with this number.
    pub(crate) fn new(id: u32, bounds: &Box3) -> Self {
        let ([a, b, c], [d, e, f]) = (bounds.lo, bounds.hi);
        Self { lo: [a, b, c, f32::from_bits(id)], hi: [d, e, f, 0.0] }
    }

    /// The number of the item.
    pub(crate) fn id(&self) -> u32 {
        self.lo[3].to_bits()
    }

    /// Returns twice the middle of the box.
    #[inline(always)]
    fn middle(&self) -> [f32; 4] {
        std::array::from_fn(|a| self.lo[a] + self.hi[a])
    }
}

/// A tree without its triangles.
#[derive(Debug, Default)]
pub(crate) struct Topology {
    /// The nodes, the root first. Children come after their parents.
    pub(crate) nodes: Vec<Node>,
    /// For each block: the index of its first item and the number of items.
    pub(crate) blocks: Vec<Span>,
}

/// The consecutive items of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    /// The index of the first item.
    pub(crate) first: u32,
    /// The number of items, 1 to 4.
    pub(crate) count: u32,
}

/// The largest number of bins.
const BINS: usize = 32;
/// The largest number of items of a leaf.
const LEAF: usize = Link::BLOCKS * NARROW;
/// The cost of visiting a node, in blocks.
const NODE_COST: f32 = 1.0;
/// The level from which on items are divided evenly, so that no tree is deeper than [`LEVELS`].
const UNEVEN_LEVELS: usize = 20;
/// The largest number of levels of nodes. Evenly divided, 2^31 items need eleven levels.
pub(crate) const LEVELS: usize = UNEVEN_LEVELS + 12;
/// The number of items from which on a separate thread is worthwhile.
const PARALLEL: usize = 1 << 14;

/// Builds a tree over items on up to `threads` threads. The items are sorted into the order of the leaves.
pub(crate) fn build(items: &mut [Item], threads: usize) -> Topology {
    let mut out = Topology::default();
    if items.is_empty() {
        return out;
    }
    let all = Range::around(items, 0);
    // The capacity is more than the number of nodes. Memory that is not written to is not allocated.
    out.nodes = with_large_pages(items.len() / NARROW + 1);
    subtree(items, all, 0, threads, &mut out);
    out
}

/// The box of some items and the box of their middles.
#[derive(Clone, Copy, Debug)]
struct Extent {
    lo: [f32; 4],
    hi: [f32; 4],
    middle_lo: [f32; 4],
    middle_hi: [f32; 4],
}

#[inline(always)]
fn min4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
}

#[inline(always)]
fn max4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
}

fn half_area(lo: [f32; 4], hi: [f32; 4]) -> f32 {
    let s: [f32; 3] = std::array::from_fn(|a| hi[a] - lo[a]);
    s[0] * s[1] + s[1] * s[2] + s[2] * s[0]
}

impl Extent {
    const EMPTY: Self = Self {
        lo: [f32::INFINITY; 4],
        hi: [f32::NEG_INFINITY; 4],
        middle_lo: [f32::INFINITY; 4],
        middle_hi: [f32::NEG_INFINITY; 4],
    };

    fn of(items: &[Item]) -> Self {
        items.iter().fold(Self::EMPTY, |e, i| {
            let m = i.middle();
            Self {
                lo: min4(i.lo, e.lo),
                hi: max4(i.hi, e.hi),
                middle_lo: min4(m, e.middle_lo),
                middle_hi: max4(m, e.middle_hi),
            }
        })
    }

    fn bounds(&self) -> Box3 {
        Box3 { lo: [self.lo[0], self.lo[1], self.lo[2]], hi: [self.hi[0], self.hi[1], self.hi[2]] }
    }
}

/// Consecutive items.
#[derive(Clone, Copy, Debug)]
struct Range {
    first: usize,
    end: usize,
    extent: Extent,
}

impl Range {
    fn around(items: &[Item], first: usize) -> Self {
        Self { first, end: first + items.len(), extent: Extent::of(items) }
    }

    fn len(&self) -> usize {
        self.end - self.first
    }

    fn area(&self) -> f32 {
        half_area(self.extent.lo, self.extent.hi)
    }
}

fn blocks(items: usize) -> f32 {
    items.div_ceil(NARROW) as f32
}

/// Builds the node for `range`, the first of whose items is `items[0]`, and everything below it.
fn subtree(items: &mut [Item], range: Range, level: usize, threads: usize, out: &mut Topology) {
    let base = range.first;
    let even = level >= UNEVEN_LEVELS;
    let mut children = [range; WIDE];
    let mut n = 1;
    // A leaf is not opened. The root must be a node, even with few items.
    let mut closed = [false; WIDE];
    while n < WIDE {
        let size = |c: &Range| if even { c.len() as f32 } else { c.area() };
        let open = (0..n).filter(|&i| !closed[i] && children[i].len() > NARROW);
        let Some(i) = open.max_by(|&a, &b| size(&children[a]).total_cmp(&size(&children[b]))) else { break };
        let part = children[i];
        match split(&mut items[part.first - base..part.end - base], &part, even) {
            Some((left, right)) => {
                children[i] = left;
                children[n] = right;
                n += 1;
            }
            None => closed[i] = true,
        }
    }
    let node = out.nodes.len();
    out.nodes.push(Node::EMPTY);
    let is_leaf = |i: usize| children[i].len() <= NARROW || closed[i];
    if threads > 1 && range.len() >= PARALLEL {
        return branches(items, &children[..n], is_leaf, level, threads, out);
    }
    // Leaves come first, so that the leaves of a node are consecutive.
    for (slot, child) in children.iter().enumerate().take(n) {
        out.nodes[node].set_bounds(slot, &child.extent.bounds());
        if is_leaf(slot) {
            let link = leaf(child, out);
            out.nodes[node].set_link(slot, link);
        }
    }
    for (slot, child) in children.iter().enumerate().take(n).filter(|(i, _)| !is_leaf(*i)) {
        let link = Link::node(out.nodes.len());
        out.nodes[node].set_link(slot, link);
        subtree(&mut items[child.first - base..child.end - base], *child, level + 1, 1, out);
    }
}

fn leaf(range: &Range, out: &mut Topology) -> Link {
    let first = out.blocks.len();
    let n = range.len().div_ceil(NARROW);
    for k in 0..n {
        let at = range.first + k * NARROW;
        let count = (range.end - at).min(NARROW) as u32;
        out.blocks.push(Span { first: at as u32, count });
    }
    Link::leaf(first, n)
}

/// Builds the children of the last node on any free threads, and stores them in the order of a single thread.
fn branches(
    mut items: &mut [Item],
    children: &[Range],
    is_leaf: impl Fn(usize) -> bool,
    level: usize,
    threads: usize,
    out: &mut Topology,
) {
    let node = out.nodes.len() - 1;
    // The children are ordered by their items.
    let mut order: Vec<usize> = (0..children.len()).collect();
    order.sort_by_key(|&i| children[i].first);
    let mut tasks = Vec::new();
    for &i in &order {
        let (own, rest) = items.split_at_mut(children[i].len());
        items = rest;
        if !is_leaf(i) {
            tasks.push((i, own));
        }
    }
    // The largest come first, so that smaller ones fill the remaining time.
    tasks.sort_by_key(|(i, own)| (usize::MAX - own.len(), *i));
    let inner = threads.div_ceil(tasks.len().max(1));
    let mut done = parallel_map(
        tasks,
        threads,
        || (),
        |(), (i, own)| {
            let mut part = Topology::default();
            subtree(own, children[i], level + 1, inner, &mut part);
            (i, part)
        },
    );
    for (slot, child) in children.iter().enumerate() {
        out.nodes[node].set_bounds(slot, &child.extent.bounds());
        if is_leaf(slot) {
            let link = leaf(child, out);
            out.nodes[node].set_link(slot, link);
        }
    }
    done.sort_by_key(|d| d.0);
    for (slot, mut part) in done {
        let (nodes, blocks) = (out.nodes.len(), out.blocks.len());
        out.nodes[node].set_link(slot, Link::node(nodes));
        part.nodes.iter_mut().for_each(|n| n.move_links(nodes, blocks));
        out.nodes.append(&mut part.nodes);
        out.blocks.append(&mut part.blocks);
    }
}

#[derive(Clone, Copy)]
struct Bin {
    lo: [f32; 4],
    hi: [f32; 4],
    count: u32,
}

impl Bin {
    const EMPTY: Self = Self { lo: [f32::INFINITY; 4], hi: [f32::NEG_INFINITY; 4], count: 0 };
}

/// The assignment of middles to bins.
struct Binning {
    bins: usize,
    lo: [f32; 4],
    scale: [f32; 4],
}

impl Binning {
    fn new(range: &Range) -> Self {
        let bins = (4 + range.len() / 16).min(BINS);
        let e = &range.extent;
        let scale = std::array::from_fn(|a| {
            let size = e.middle_hi[a] - e.middle_lo[a];
            // Sizes whose reciprocal overflows are treated as zero.
            if a < 3 && size > 1e-30 { bins as f32 * 0.99 / size } else { 0.0 }
        });
        Self { bins, lo: e.middle_lo, scale }
    }

    #[inline(always)]
    fn bin(&self, middle: [f32; 4]) -> [usize; 3] {
        std::array::from_fn(|a| {
            let at = ((middle[a] - self.lo[a]) * self.scale[a]) as i32;
            (at as usize).min(BINS - 1)
        })
    }
}

/// Divides items in two; `None` when a single leaf is cheaper.
fn split(items: &mut [Item], range: &Range, even: bool) -> Option<(Range, Range)> {
    let halves = |items: &[Item], at: usize| {
        let (left, right) = items.split_at(at);
        Some((Range::around(left, range.first), Range::around(right, range.first + at)))
    };
    let binning = Binning::new(range);
    let found = if even || binning.scale == [0.0; 4] { None } else { best_plane(items, &binning) };
    let Some((cost, axis, plane)) = found else {
        // All middles are equal, or the uneven levels are used up.
        return if items.len() <= LEAF && !even { None } else { halves(items, items.len() / 2) };
    };
    let area = range.area();
    if items.len() <= LEAF && blocks(items.len()) * area <= NODE_COST * area + cost {
        return None;
    }
    // Items on the wrong side are swapped, and the extents of both sides are collected in the same pass.
    let (mut i, mut j) = (0, items.len());
    let (mut left, mut right) = (Extent::EMPTY, Extent::EMPTY);
    let grow = |e: &mut Extent, item: &Item| {
        let m = item.middle();
        e.lo = min4(item.lo, e.lo);
        e.hi = max4(item.hi, e.hi);
        e.middle_lo = min4(m, e.middle_lo);
        e.middle_hi = max4(m, e.middle_hi);
    };
    let is_left = |item: &Item| binning.bin(item.middle())[axis] < plane;
    loop {
        while i < j && is_left(&items[i]) {
            grow(&mut left, &items[i]);
            i += 1;
        }
        while i < j && !is_left(&items[j - 1]) {
            grow(&mut right, &items[j - 1]);
            j -= 1;
        }
        if i >= j {
            break;
        }
        items.swap(i, j - 1);
    }
    let (first, middle) = (range.first, range.first + i);
    Some((Range { first, end: middle, extent: left }, Range { first: middle, end: range.end, extent: right }))
}

/// Returns the cheapest plane: its cost, axis and the first bin to the right of it.
fn best_plane(items: &[Item], binning: &Binning) -> Option<(f32, usize, usize)> {
    let mut table = [[Bin::EMPTY; BINS]; 3];
    for item in items {
        let at = binning.bin(item.middle());
        for axis in 0..3 {
            let bin = &mut table[axis][at[axis]];
            bin.lo = min4(item.lo, bin.lo);
            bin.hi = max4(item.hi, bin.hi);
            bin.count += 1;
        }
    }
    let mut best: Option<(f32, usize, usize)> = None;
    for (axis, bins) in table.iter().enumerate().filter(|(a, _)| binning.scale[*a] > 0.0) {
        // This pass from the right computes the cost of everything from each plane on.
        let mut right = [(0.0_f32, 0_u32); BINS];
        let mut sum = Bin::EMPTY;
        for k in (1..binning.bins).rev() {
            sum.lo = min4(bins[k].lo, sum.lo);
            sum.hi = max4(bins[k].hi, sum.hi);
            sum.count += bins[k].count;
            right[k] = (half_area(sum.lo, sum.hi) * blocks(sum.count as usize), sum.count);
        }
        let mut sum = Bin::EMPTY;
        for k in 1..binning.bins {
            sum.lo = min4(bins[k - 1].lo, sum.lo);
            sum.hi = max4(bins[k - 1].hi, sum.hi);
            sum.count += bins[k - 1].count;
            if sum.count == 0 || right[k].1 == 0 {
                continue;
            }
            let cost = half_area(sum.lo, sum.hi) * blocks(sum.count as usize) + right[k].0;
            if best.is_none_or(|b| cost < b.0) {
                best = Some((cost, axis, k));
            }
        }
    }
    best
}
