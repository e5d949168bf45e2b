//! A tree of boxes, which finds the parts of a scene that a ray passes.

use crate::Ray;
use crate::build::{self, Item, Span, Topology};
use crate::layout::{Box3, Link, Node};
use crate::probe::{Probe, Scale, Wide, still_plane};
use granita_base::Bound;
use granita_machine::simd::{Kernel, Simd, dispatch};

/// A tree of boxes around parts of a scene.
#[derive(Debug)]
pub struct BoxTree {
    nodes: Vec<Node>,
    spans: Vec<Span>,
    /// The indices and boxes in the order of the leaves.
    boxes: Vec<(u32, Box3)>,
    scale: Scale,
    bounds: Box3,
    bound: Bound,
}

/// A box that a ray passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// The index of the box.
    pub index: u32,
    /// The distance at which the ray enters the box, or its start, in units of the ray's direction. It is never
    /// behind a hit inside of the box.
    pub enters: f32,
}

/// Scratch for [`BoxTree::visit`], which is made once for many rays.
#[derive(Clone, Debug, Default)]
pub struct BoxScratch {
    stack: Vec<(f32, Link)>,
    inside: Vec<(f32, u32)>,
}

/// The arguments of [`BoxTree::visit`].
struct Visit<'a> {
    boxes: &'a BoxTree,
    ray: &'a Ray,
    room: &'a mut BoxScratch,
    passed: &'a mut dyn FnMut(Passage) -> f32,
}

impl Kernel for Visit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.boxes.visit_with(s, self.ray, self.room, self.passed);
    }
}

impl BoxTree {
    /// Returns a tree of `boxes`. Boxes that are empty or not finite are never passed.
    pub fn new(boxes: &[Bound]) -> Self {
        let there = |b: &Bound| !b.is_empty() && b.is_finite();
        let bound = boxes.iter().filter(|b| there(b)).fold(Bound::EMPTY, |all, b| all.union(*b));
        let scale = Scale::of(&bound);
        let mut items: Vec<Item> = boxes
            .iter()
            .enumerate()
            .filter(|(_, b)| there(b))
            .map(|(i, b)| Item::new(i as u32, &scale.bounds(b)))
            .collect();
        let Topology { mut nodes, blocks } = build::build(&mut items, 1);
        nodes.shrink_to_fit();
        let boxes = items.iter().map(|i| (i.id(), scale.bounds(&boxes[i.id() as usize]))).collect();
        Self { nodes, spans: blocks, boxes, scale, bounds: scale.bounds(&bound), bound }
    }

    /// Returns the box around all boxes.
    pub fn bound(&self) -> Bound {
        self.bound
    }

    /// The number of bytes of memory that the tree occupies.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>()
            + self.spans.capacity() * size_of::<Span>()
            + self.boxes.capacity() * size_of::<(u32, Box3)>()
    }

    /// Calls `passed` with each box that the ray passes, mostly in the order in which the ray may hit their contents.
    /// `passed` returns how far the ray goes from then on, and boxes beyond are skipped. A negative distance ends the
    /// visit.
    pub fn visit(&self, ray: &Ray, room: &mut BoxScratch, passed: &mut dyn FnMut(Passage) -> f32) {
        dispatch(Visit { boxes: self, ray, room, passed });
    }

    #[inline(always)]
    fn visit_with<S: Simd>(
        &self,
        s: S,
        ray: &Ray,
        BoxScratch { stack, inside }: &mut BoxScratch,
        passed: &mut dyn FnMut(Passage) -> f32,
    ) {
        let Some(probe) = Probe::new(ray, self.scale, &self.bounds).filter(|_| !self.nodes.is_empty()) else {
            return;
        };
        let wide = Wide::new(s, &probe);
        let mut tmax = probe.tmax;
        stack.clear();
        stack.push((f32::NEG_INFINITY, Link::node(0)));
        while let Some((near, link)) = stack.pop() {
            if near > tmax {
                continue;
            }
            if !link.is_leaf() {
                let node = &self.nodes[link.0 as usize];
                let (mask, near) = wide.enter(s, &still_plane(s, node), tmax);
                let first = stack.len();
                let met = node.children().filter(|(slot, _)| mask >> slot & 1 != 0);
                stack.extend(met.map(|(slot, link)| (near[slot], link)));
                stack[first..].sort_by(|a, b| b.0.total_cmp(&a.0));
                continue;
            }
            inside.clear();
            for span in &self.spans[link.blocks()] {
                for (index, b) in &self.boxes[span.first as usize..][..span.count as usize] {
                    let (near, far) = probe.through(b);
                    if near <= far && probe.tmin <= far && near <= tmax {
                        inside.push((near, *index));
                    }
                }
            }
            inside.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for &(near, index) in inside.iter() {
                if near > tmax {
                    break;
                }
                let enters = probe.distance(near.max(probe.tmin)).max(ray.tmin);
                let reach = passed(Passage { index, enters });
                if reach < 0.0 {
                    return;
                }
                tmax = tmax.min(probe.within(reach));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{Vec3, hash};
    use granita_machine::simd::Portable;

    fn random(i: u32, d: u32) -> f32 {
        hash::unit(hash::words(&[i, d]))
    }

    fn point(i: u32, d: u32) -> Vec3 {
        Vec3::new(random(i, d), random(i, d + 1), random(i, d + 2))
    }

    #[test]
    fn the_box_tree_finds_the_boxes_of_a_linear_search() {
        let boxes: Vec<Bound> = (0..300)
            .map(|i| {
                let (a, size) = (point(i, 0) * 10.0, point(i, 3) * point(i, 3));
                if i % 50 == 7 { Bound::EMPTY } else { Bound { min: a, max: a + size } }
            })
            .collect();
        let tree = BoxTree::new(&boxes);
        let (mut found, mut room) = (0, BoxScratch::default());
        for i in 0..2000 {
            let (origin, to) = (point(i, 10) * 20.0 - 5.0, point(i, 13) * 10.0);
            let dir = if i % 9 == 0 { Vec3::X } else { to - origin };
            let ray = Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time: 0.0 };
            let mut passed = vec![None; boxes.len()];
            let mut list = Vec::new();
            tree.visit(&ray, &mut room, &mut |p| {
                assert_eq!(passed[p.index as usize], None);
                passed[p.index as usize] = Some(p.enters);
                list.push(p);
                f32::INFINITY
            });
            let mut portable = Vec::new();
            tree.visit_with(Portable, &ray, &mut room, &mut |p| {
                portable.push(p);
                f32::INFINITY
            });
            assert_eq!(list, portable);
            for (b, passed) in boxes.iter().zip(&passed) {
                let a = (b.min - origin) / dir;
                let c = (b.max - origin) / dir;
                let near = a.min(c).max_element().max(0.0);
                let far = a.max(c).min_element();
                let sure = 1e-4 * (1.0 + near.abs());
                if near.is_nan() || far.is_nan() || (far - near).abs() < sure || b.is_empty() {
                    continue;
                }
                assert_eq!(near <= far, passed.is_some(), "{b:?} {ray:?}");
                if let Some(enters) = passed {
                    assert!((enters - near).abs() < sure && *enters <= near + 1e-6 * near.abs().max(1.0));
                    found += 1;
                }
            }
        }
        assert!(found > 500, "{found}");
    }

    #[test]
    fn boxes_beyond_the_returned_distance_are_skipped() {
        let boxes: Vec<Bound> = (0..100)
            .map(|i| Bound { min: Vec3::new(i as f32, 0.0, 0.0), max: Vec3::new(i as f32 + 0.5, 1.0, 1.0) })
            .collect();
        let tree = BoxTree::new(&boxes);
        let ray = Ray {
            origin: Vec3::new(-3.0, 0.5, 0.5),
            tmin: 0.0,
            dir: Vec3::X * 2.0,
            tmax: f32::INFINITY,
            time: 0.0,
        };
        let ask = |answer: &dyn Fn(Passage) -> f32| {
            let mut seen = Vec::new();
            tree.visit(&ray, &mut BoxScratch::default(), &mut |p| {
                seen.push(p.index);
                answer(p)
            });
            seen.sort_unstable();
            seen
        };
        assert_eq!(ask(&|_| f32::INFINITY).len(), 100);
        // The ray ends at x = 7. It passes boxes 0 to 7, and boxes that were visited before `passed` returned.
        let some = ask(&|_| 5.0);
        assert!(
            some.iter().filter(|i| **i > 7).count() <= 1 && (0..7).all(|i| some.contains(&i)),
            "{some:?}"
        );
        assert_eq!(ask(&|_| -1.0).len(), 1);
        let nothing = BoxTree::new(&[]);
        nothing.visit(&ray, &mut BoxScratch::default(), &mut |_| panic!("nothing is passed"));
    }
}
