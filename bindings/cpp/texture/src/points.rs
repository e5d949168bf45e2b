//! Runs lookups of many points, in several threads where the caller wants them.

use crate::failure::Failure;
use crate::types::{At, Points};
use granita_texture::{TextureCache, TextureReader};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The number of points that a thread takes at once. With fewer points, another thread would take longer to start than
/// to look them up.
const CHUNK: usize = 2048;

/// The largest number of channels of one call.
const MOST_CHANNELS: usize = 4096;

/// Points whose numbers are checked.
#[derive(Clone, Copy)]
pub(crate) struct Batch {
    points: Points,
    count: usize,
    pub(crate) channels: usize,
    pub(crate) first_channel: u32,
}

// SAFETY: threads read the arrays of the caller, and write results of different points, which do not overlap by the
// contract of the interface.
unsafe impl Sync for Batch {}

impl Batch {
    /// Checks the numbers of a call.
    pub(crate) fn new(points: &Points, channels: usize) -> Result<Self, Failure> {
        let misuse = |what: String| Err(Failure::Misuse(what));
        let Some(count) = points.columns.checked_mul(points.rows).filter(|n| isize::try_from(*n).is_ok())
        else {
            return misuse(format!("{} x {} points are too many", points.columns, points.rows));
        };
        if channels == 0 || channels > MOST_CHANNELS {
            return misuse(format!("{channels} channels, where 1 to {MOST_CHANNELS} are possible"));
        }
        let Ok(first_channel) = u32::try_from(points.first_channel) else {
            return misuse(format!("the first channel is {}, and not at least 0", points.first_channel));
        };
        if points.result.is_null() && count > 0 {
            return misuse("there is no memory for results (NULL)".to_owned());
        }
        Ok(Self { points: *points, count, channels, first_channel })
    }

    /// Returns the width and height of a rectangle of points.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.points.columns, self.points.rows)
    }

    /// Returns the value of channels that the file lacks.
    ///
    /// # Safety
    /// The array of the caller must have a number for the point.
    #[inline(always)]
    pub(crate) unsafe fn fill(&self, at: At) -> f32 {
        // SAFETY: the contract is the same.
        unsafe { self.points.fill.at(at, 0.0) }
    }

    /// Stores `fill` for all points, in place of lookups.
    ///
    /// # Safety
    /// The contract is that of [`Batch::run`].
    pub(crate) unsafe fn store_fill(&self) {
        let mut values = vec![0.0; self.channels];
        // SAFETY: the contract is the same.
        unsafe {
            self.each((0, self.count), |_, at| {
                values.fill(self.fill(at));
                self.points.store(at, &values);
            });
        }
    }

    /// Looks up all points. `look` receives a reader, the number of the point, its place and the memory of its result.
    ///
    /// # Safety
    /// All arrays of the caller must have the points, and the memory of results must not be used meanwhile.
    pub(crate) unsafe fn run(
        &self,
        cache: &TextureCache,
        threads: usize,
        look: &(impl Fn(&mut TextureReader<'_>, usize, At, &mut [f32]) + Sync),
    ) {
        let chunks = self.count.div_ceil(CHUNK);
        let next = AtomicUsize::new(0);
        let work = || {
            let mut reader = cache.reader();
            let mut values = vec![0.0; self.channels];
            loop {
                let chunk = next.fetch_add(1, Ordering::Relaxed);
                if chunk >= chunks {
                    break;
                }
                let range = (chunk * CHUNK, ((chunk + 1) * CHUNK).min(self.count));
                // SAFETY: the contract is the same, and each point is in one chunk.
                unsafe {
                    self.each(range, |i, at| {
                        look(&mut reader, i, at, &mut values);
                        self.points.store(at, &values);
                    });
                }
            }
        };
        let threads = threads.min(chunks);
        if threads <= 1 {
            return work();
        }
        std::thread::scope(|scope| {
            for _ in 1..threads {
                // Where the system refuses a thread, the others do its work.
                let _ =
                    std::thread::Builder::new().name("texture lookups".to_owned()).spawn_scoped(scope, work);
            }
            work();
        });
    }

    /// Calls `f` with the number and the place of the points of a range.
    #[inline(always)]
    fn each(&self, (from, to): (usize, usize), mut f: impl FnMut(usize, At)) {
        if from >= to {
            return;
        }
        let columns = self.points.columns;
        let (mut x, mut y) = (from % columns, from / columns);
        for i in from..to {
            f(i, (x as isize, y as isize));
            x += 1;
            if x == columns {
                (x, y) = (0, y + 1);
            }
        }
    }
}
