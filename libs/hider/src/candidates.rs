//! The samples that a micropolygon may hit.

use super::lanes::{LANES, Lanes, Signs};

/// The lists of [`Candidates`]. The indices of samples are stored as the bits of numbers.
const LISTS: usize = 6;

/// A sample that a micropolygon may hit.
#[derive(Clone, Copy)]
pub(super) struct Candidate<T> {
    /// The index of the sample.
    pub(super) sample: T,
    /// Its raster position.
    pub(super) x: T,
    pub(super) y: T,
    /// Its time.
    pub(super) time: T,
    /// Its point on the lens, in camera space units.
    pub(super) lens_x: T,
    pub(super) lens_y: T,
}

impl<T> Candidate<T> {
    fn lists(self) -> [T; LISTS] {
        [self.sample, self.x, self.y, self.time, self.lens_x, self.lens_y]
    }
}

/// The samples that a micropolygon may hit, kept from one micropolygon to the next.
#[derive(Default)]
pub(super) struct Candidates {
    len: usize,
    /// The members of [`Candidate`], with room for more.
    lists: [Vec<f32>; LISTS],
}

impl Candidates {
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Makes room for eight more candidates and for loads behind the last one.
    #[inline(always)]
    fn reserve(&mut self) {
        if self.len + 2 * LANES > self.lists[0].len() {
            self.grow();
        }
    }

    #[cold]
    fn grow(&mut self) {
        let size = (2 * self.lists[0].len()).max(256);
        self.lists.iter_mut().for_each(|list| list.resize(size, 0.0));
    }

    /// Appends one candidate.
    #[inline(always)]
    pub(super) fn push(&mut self, sample: usize, one: Candidate<f32>) {
        self.reserve();
        let one = Candidate { sample: f32::from_bits(sample as u32), ..one };
        for (list, value) in self.lists.iter_mut().zip(one.lists()) {
            list[self.len] = value;
        }
        self.len += 1;
    }

    /// Appends those of eight consecutive samples, from the index `first` on, whose bits are set in `mask`.
    #[inline(always)]
    pub(super) fn push_lanes(&mut self, simd: impl Signs, mask: u32, first: usize, eight: Candidate<Lanes>) {
        self.reserve();
        let first = first as u32;
        let sample = Lanes(std::array::from_fn(|i| f32::from_bits(first + i as u32)));
        for (list, lanes) in self.lists.iter_mut().zip(Candidate { sample, ..eight }.lists()) {
            list[self.len..self.len + LANES].copy_from_slice(&simd.pack(lanes, mask).0);
        }
        self.len += mask.count_ones() as usize;
    }

    /// Returns the eight candidates from the index `at` on. Those behind the last one have any values.
    #[inline(always)]
    pub(super) fn eight(&self, at: usize) -> Candidate<Lanes> {
        let [sample, x, y, time, lens_x, lens_y] = self.lists.each_ref().map(|list| Lanes::load(list, at));
        Candidate { sample, x, y, time, lens_x, lens_y }
    }
}

impl Candidate<Lanes> {
    /// Returns the index of the sample of a lane.
    #[inline(always)]
    pub(super) fn sample(&self, lane: usize) -> usize {
        self.sample.0[lane].to_bits() as usize
    }
}
