//! The priority of buckets, which may change while a frame is rendered (reference 4.5).
//!
//! A viewer sets the priority, and the waiting buckets are sorted again. No pixel depends on it.

use crate::PixelRect;
use crate::bucket::Buckets;
use parking_lot::{Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};

/// The priority of buckets, shared by the renderer and its viewers. It applies to the frame that is being rendered,
/// and is reset before the next one.
#[derive(Debug, Default)]
pub struct Priority {
    wanted: Mutex<Wanted>,
    /// A number that grows with every change.
    version: AtomicU64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Wanted {
    center: Option<[i32; 2]>,
    rectangle: Option<PixelRect>,
}

impl Priority {
    /// Continues in a spiral around this pixel of the image.
    pub fn center(&self, x: i32, y: i32) {
        self.change(|wanted| *wanted = Wanted { center: Some([x, y]), rectangle: None });
    }

    /// Renders these pixels of the image first, then continues as before.
    pub fn rectangle(&self, rect: PixelRect) {
        self.change(|wanted| wanted.rectangle = Some(rect));
    }

    /// Returns the pixel around which the frame continues, and the pixels that come first.
    pub fn current(&self) -> (Option<[i32; 2]>, Option<PixelRect>) {
        let wanted = self.wanted();
        (wanted.center, wanted.rectangle)
    }

    /// Restores the order of the scene.
    pub(crate) fn reset(&self) {
        self.change(|wanted| *wanted = Wanted::default());
    }

    fn wanted(&self) -> MutexGuard<'_, Wanted> {
        self.wanted.lock()
    }

    fn change(&self, change: impl FnOnce(&mut Wanted)) {
        let mut wanted = self.wanted();
        change(&mut wanted);
        self.version.fetch_add(1, Ordering::Release);
    }
}

/// The buckets that were not started.
pub(crate) struct Turns {
    waiting: VecDeque<usize>,
    /// The version that they are sorted by; `None` before the first change.
    ordered: Option<u64>,
}

impl Turns {
    /// Returns the buckets in the order of `list`, until the priority changes.
    pub(crate) fn new(list: impl IntoIterator<Item = usize>, priority: Option<&Priority>) -> Self {
        let ordered = priority.map(|p| p.version.load(Ordering::Acquire));
        Self { waiting: list.into_iter().collect(), ordered }
    }

    /// Returns the next bucket. The buckets are sorted again when `priority` changed.
    pub(crate) fn next(&mut self, buckets: &Buckets, priority: Option<&Priority>) -> Option<usize> {
        if let Some(priority) = priority {
            let version = priority.version.load(Ordering::Acquire);
            if self.ordered != Some(version) {
                self.ordered = Some(version);
                let wanted = *priority.wanted();
                let key = |index: &usize| {
                    let inside = wanted
                        .rectangle
                        .is_some_and(|rect| !buckets.order[*index].intersection(&rect).is_empty());
                    let turn = wanted.center.map(|pixel| buckets.turn_around(*index, pixel));
                    (!inside, turn, *index)
                };
                self.waiting.make_contiguous().sort_by_cached_key(key);
            }
        }
        self.waiting.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bucket::BucketOrder;

    fn buckets() -> Buckets {
        Buckets::new(
            &PixelRect { x0: 0, y0: 0, x1: 80, y1: 60 },
            [20, 20],
            BucketOrder::plain("horizontal"),
            1,
        )
    }

    fn drain(turns: &mut Turns, buckets: &Buckets, priority: &Priority) -> Vec<usize> {
        std::iter::from_fn(|| turns.next(buckets, Some(priority))).collect()
    }

    #[test]
    fn buckets_near_a_requested_pixel_or_rectangle_come_first() {
        let (buckets, priority) = (buckets(), Priority::default());
        let mut turns = Turns::new(0..12, Some(&priority));
        assert_eq!([0, 1].map(|_| turns.next(&buckets, Some(&priority))), [Some(0), Some(1)]);
        // Bucket 10 is column 2 of row 2.
        priority.center(45, 50);
        assert_eq!(turns.next(&buckets, Some(&priority)), Some(10));
        assert_eq!(turns.next(&buckets, Some(&priority)), Some(5));
        // The rectangle touches 4 and 8 only. The spiral continues after them.
        priority.rectangle(PixelRect { x0: 3, y0: 39, x1: 20, y1: 41 });
        assert_eq!(drain(&mut turns, &buckets, &priority), [8, 4, 6, 7, 11, 9, 2, 3]);
    }

    #[test]
    fn every_bucket_is_rendered_once_for_any_requests() {
        let (buckets, priority) = (buckets(), Priority::default());
        let far = [i32::MIN, -1, 0, 59, i32::MAX];
        let mut seen = Vec::new();
        let mut turns = Turns::new(0..12, Some(&priority));
        let wishes = far.iter().flat_map(|x| far.iter().map(move |y| (*x, *y)));
        for (k, (x, y)) in wishes.enumerate() {
            match k % 3 {
                0 => priority.center(x, y),
                1 => priority.rectangle(PixelRect { x0: x, y0: y, x1: y, y1: x }),
                _ => priority.rectangle(PixelRect { x0: x, y0: x, x1: i32::MAX, y1: y }),
            }
            seen.extend(turns.next(&buckets, Some(&priority)));
        }
        seen.sort_unstable();
        assert_eq!(seen, (0..12).collect::<Vec<_>>());
    }

    #[test]
    fn a_reset_removes_earlier_requests() {
        let (buckets, priority) = (buckets(), Priority::default());
        priority.center(70, 50);
        priority.reset();
        let mut turns = Turns::new(0..12, Some(&priority));
        assert_eq!(drain(&mut turns, &buckets, &priority), (0..12).collect::<Vec<_>>());
        assert_eq!(Turns::new([3, 1], None).next(&buckets, None), Some(3));
    }
}
