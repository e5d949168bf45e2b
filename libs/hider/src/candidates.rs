//! The samples that a micropolygon may hit.

use super::lanes::{LANES, Lanes};
use granita_machine::simd::Simd;

/// The lists of [`Candidates`] besides the indices of samples.
const LISTS: usize = 5;

/// A sample that a micropolygon may hit.
#[derive(Clone, Copy)]
pub(super) struct Candidate<T> {
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
        [self.x, self.y, self.time, self.lens_x, self.lens_y]
    }
}

/// The samples that a micropolygon may hit, kept from one micropolygon to the next.
#[derive(Default)]
pub(super) struct Candidates {
    len: usize,
    /// The indices of the samples, as the bits of numbers.
    samples: Vec<f32>,
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
        if self.len + 2 * LANES > self.samples.len() {
            self.grow();
        }
    }

    #[cold]
    fn grow(&mut self) {
        let size = (2 * self.samples.len()).max(256);
        self.samples.resize(size, 0.0);
        self.lists.iter_mut().for_each(|list| list.resize(size, 0.0));
    }

    /// Returns the index of the sample of a candidate.
    #[inline(always)]
    pub(super) fn sample(&self, at: usize) -> usize {
        self.samples[at].to_bits() as usize
    }

    /// Appends one candidate.
    #[inline(always)]
    pub(super) fn push(&mut self, sample: usize, one: Candidate<f32>) {
        self.reserve();
        self.samples[self.len] = f32::from_bits(sample as u32);
        for (list, value) in self.lists.iter_mut().zip(one.lists()) {
            list[self.len] = value;
        }
        self.len += 1;
    }

    /// Appends those of eight consecutive samples, from the index `first` on, whose bits are set in `mask`.
    /// Without `DEFOCUS` their points on the lens are left out.
    #[inline(always)]
    pub(super) fn push_lanes<S: Simd, const DEFOCUS: bool>(
        &mut self,
        simd: S,
        mask: u32,
        first: usize,
        eight: Candidate<Lanes<S>>,
    ) {
        self.reserve();
        let first = first as u32;
        let sample = Lanes::from_bits(simd, &std::array::from_fn(|i| first + i as u32));
        let place = self.len..self.len + LANES;
        self.samples[place.clone()].copy_from_slice(&sample.pack(mask).numbers());
        for (list, lanes) in
            self.lists.iter_mut().zip(eight.lists()).take(if DEFOCUS { LISTS } else { LISTS - 2 })
        {
            list[place.clone()].copy_from_slice(&lanes.pack(mask).numbers());
        }
        self.len += mask.count_ones() as usize;
    }

    /// Returns the eight candidates from the index `at` on. Those behind the last one have any values.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, simd: S, at: usize) -> Candidate<Lanes<S>> {
        let [x, y, time, lens_x, lens_y] = &self.lists;
        Candidate {
            x: Lanes::load(simd, x, at),
            y: Lanes::load(simd, y, at),
            time: Lanes::load(simd, time, at),
            lens_x: Lanes::load(simd, lens_x, at),
            lens_y: Lanes::load(simd, lens_y, at),
        }
    }
}
