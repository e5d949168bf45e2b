//! Registers, views of them, results before they are stored, and the pool of their memory.

use crate::run::strings::StringId;
use crate::{Lane, Lane3};

/// One register. Component `c` of lane `i` is at `c * lanes + i` when varying, at `c` when uniform. Elements of an
/// array follow each other (`element * components + component`). A register of strings holds the bits of their
/// [`StringId`]s.
#[derive(Debug, Default)]
pub(crate) struct Slot {
    pub(crate) data: Vec<f32>,
    pub(crate) varying: bool,
}

/// Read access to the values of a symbol.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View<'a> {
    pub(crate) data: &'a [f32],
    /// The number of lanes of the grid.
    pub(crate) n: usize,
    pub(crate) varying: bool,
    /// The number of components of one element.
    pub(crate) components: usize,
    /// The number of elements; 1 when not an array.
    pub(crate) elements: usize,
}

impl<'a> View<'a> {
    /// Returns component `c` of element 0. A single component stands for all.
    #[inline(always)]
    pub(crate) fn lane(&self, c: usize) -> Lane<'a> {
        self.lane_at(0, c)
    }

    /// Returns component `c` of element `e`.
    #[inline(always)]
    pub(crate) fn lane_at(&self, e: usize, c: usize) -> Lane<'a> {
        let c = if self.components == 1 { 0 } else { c.min(self.components - 1) };
        self.flat(e.min(self.elements - 1) * self.components + c)
    }

    /// Returns component `k` of all components of all elements.
    #[inline(always)]
    pub(crate) fn flat(&self, k: usize) -> Lane<'a> {
        if self.varying {
            Lane { values: &self.data[k * self.n..(k + 1) * self.n], stride: 1 }
        } else {
            Lane { values: &self.data[k..=k], stride: 0 }
        }
    }

    /// Returns three components.
    #[inline(always)]
    pub(crate) fn triple(&self) -> Lane3<'a> {
        Lane3 { xyz: std::array::from_fn(|c| self.lane(c)) }
    }

    /// Component `c` as the diagonal matrix of a float, or as it is.
    pub(crate) fn matrix_at(&self, i: usize) -> [f32; 16] {
        if self.components == 16 {
            std::array::from_fn(|c| self.lane(c).get(i))
        } else {
            let x = self.lane(0).get(i);
            std::array::from_fn(|c| if c % 5 == 0 { x } else { 0.0 })
        }
    }

    /// Returns the number of lane `i`.
    pub(crate) fn get(&self, i: usize) -> f32 {
        self.lane(0).get(i)
    }

    /// Returns the string of lane `i`.
    pub(crate) fn string(&self, i: usize) -> StringId {
        StringId::from_register(self.get(i))
    }
}

/// A result that is being computed.
#[derive(Debug)]
pub(crate) struct Out {
    pub(crate) data: Vec<f32>,
    /// The number of lanes; 1 when uniform.
    pub(crate) width: usize,
    pub(crate) varying: bool,
}

impl Out {
    /// Returns the values of component `c`.
    pub(crate) fn part(&mut self, c: usize) -> &mut [f32] {
        &mut self.data[c * self.width..(c + 1) * self.width]
    }

    /// Returns three components at once.
    pub(crate) fn parts3(&mut self) -> [&mut [f32]; 3] {
        let (x, rest) = self.data.split_at_mut(self.width);
        let (y, rest) = rest.split_at_mut(self.width);
        [x, y, &mut rest[..self.width]]
    }

    /// Returns component `c` for reading. A single component stands for all.
    pub(crate) fn lane(&self, c: usize) -> Lane<'_> {
        let c = if self.data.len() == self.width { 0 } else { c };
        Lane { values: &self.data[c * self.width..(c + 1) * self.width], stride: usize::from(self.varying) }
    }

    /// Returns three components for reading.
    pub(crate) fn triple(&self) -> Lane3<'_> {
        Lane3 { xyz: std::array::from_fn(|c| self.lane(c)) }
    }

    /// Sets component `c` of lane `i`.
    pub(crate) fn set(&mut self, c: usize, i: usize, v: f32) {
        self.data[c * self.width + i] = v;
    }

    /// Sets string `k` of lane `i`.
    pub(crate) fn set_string(&mut self, k: usize, i: usize, id: StringId) {
        self.set(k, i, id.to_register());
    }

    /// Sets three components of lane `i`.
    pub(crate) fn set3(&mut self, i: usize, v: granita_base::Vec3) {
        for c in 0..3 {
            self.data[c * self.width + i] = v[c];
        }
    }
}

/// Buffers for reuse. After the first grids no buffer is reallocated.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    free: Vec<Vec<f32>>,
}

impl Pool {
    /// Returns a buffer of `len` undefined numbers.
    pub(crate) fn take(&mut self, len: usize) -> Vec<f32> {
        // It is one that is large enough, else the last.
        let fit = self.free.iter().rposition(|b| b.capacity() >= len);
        let mut buffer = match fit {
            Some(k) => self.free.swap_remove(k),
            None => self.free.pop().unwrap_or_default(),
        };
        if buffer.len() > len {
            buffer.truncate(len);
        } else {
            buffer.resize(len, 0.0);
        }
        buffer
    }

    /// Returns a buffer to the pool.
    pub(crate) fn give(&mut self, buffer: Vec<f32>) {
        self.free.push(buffer);
    }
}

/// The lanes that a statement affects.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Mask {
    /// True for each lane that is on.
    pub(crate) on: Vec<bool>,
    /// The lanes that are on, increasing.
    pub(crate) active: Vec<u32>,
}

impl Mask {
    /// Sets all of `n` lanes.
    pub(crate) fn fill(&mut self, n: usize) {
        self.on.clear();
        self.on.resize(n, true);
        self.active.clear();
        self.active.extend(0..n as u32);
    }

    /// Sets the lanes of a list.
    pub(crate) fn set_active(&mut self, n: usize, active: &[u32]) {
        self.on.clear();
        self.on.resize(n, false);
        self.active.clear();
        for &i in active {
            if (i as usize) < n && !self.on[i as usize] {
                self.on[i as usize] = true;
                self.active.push(i);
            }
        }
    }

    /// Clears all lanes.
    pub(crate) fn clear(&mut self) {
        self.on.fill(false);
        self.active.clear();
    }

    /// Copies into existing memory.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.on.clear();
        self.on.extend_from_slice(&other.on);
        self.active.clear();
        self.active.extend_from_slice(&other.active);
    }

    /// Adds lanes.
    pub(crate) fn add(&mut self, other: &Self) {
        if other.active.is_empty() {
            return;
        }
        if self.active.is_empty() {
            self.copy_from(other);
            return;
        }
        for &i in &other.active {
            self.on[i as usize] = true;
        }
        self.rebuild();
    }

    /// Keeps the lanes for which `keep` is true.
    pub(crate) fn retain(&mut self, mut keep: impl FnMut(usize) -> bool) {
        let on = &mut self.on;
        self.active.retain(|&i| {
            let stays = keep(i as usize);
            on[i as usize] = stays;
            stays
        });
    }

    /// Rebuilds the list from the flags.
    fn rebuild(&mut self) {
        self.active.clear();
        self.active.extend((0..self.on.len() as u32).filter(|&i| self.on[i as usize]));
    }

    pub(crate) fn count(&self) -> usize {
        self.active.len()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.active.is_empty()
    }
}

/// The lanes that a function computes one by one.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Work<'a> {
    /// The single lane of a uniform value.
    One,
    /// All lanes.
    All(usize),
    /// Some lanes.
    Some(&'a [u32]),
}

impl Work<'_> {
    /// Calls `f` for each lane.
    #[inline]
    pub(crate) fn each(self, mut f: impl FnMut(usize)) {
        match self {
            Self::One => f(0),
            Self::All(n) => (0..n).for_each(f),
            Self::Some(active) => active.iter().for_each(|&i| f(i as usize)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_keep_their_active_lanes() {
        let mut a = Mask::default();
        a.fill(4);
        let mut b = Mask::default();
        b.set_active(4, &[3, 1]);
        assert_eq!(b.on, [false, true, false, true]);
        a.retain(|i| i != 2);
        assert_eq!(a.active, [0, 1, 3]);
        b.retain(|i| i == 3);
        let mut c = Mask::default();
        c.set_active(4, &[2]);
        c.add(&b);
        assert_eq!((c.active.as_slice(), c.count()), (&[2, 3][..], 2));
        c.clear();
        assert!(c.is_empty());
        c.add(&a);
        assert_eq!(c, a);
    }

    #[test]
    fn views_replicate_floats() {
        let v = View { data: &[2.0], n: 3, varying: false, components: 1, elements: 1 };
        assert_eq!(v.triple().get(2), granita_base::Vec3::splat(2.0));
        assert_eq!(v.matrix_at(0)[5], 2.0);
        let w = View {
            data: &[0.0, 1.0, 10.0, 11.0, 20.0, 21.0],
            n: 2,
            varying: true,
            components: 3,
            elements: 1,
        };
        assert_eq!(w.triple().get(1), granita_base::Vec3::new(1.0, 11.0, 21.0));
        // An index past the end takes the nearest value and never panics.
        assert_eq!(w.lane_at(7, 7).get(0), 20.0);
    }
}
