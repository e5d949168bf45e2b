//! Work on many items by several threads.

use parking_lot::Mutex;
use std::panic::resume_unwind;

/// Calls `work` for every item on up to `threads` threads, this one included. Returns the results in the order of the
/// items.
///
/// Items are taken in their order. Each thread makes a state of its own with `state` before its first item.
///
/// ```
/// let squares = granita_base::parallel_map(0..5, 2, || (), |(), i| i * i);
/// assert_eq!(squares, [0, 1, 4, 9, 16]);
/// ```
///
/// # Panics
/// When `state` or `work` panics, after all threads have ended.
pub fn parallel_map<T, S, R, I>(
    items: I,
    threads: usize,
    state: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, T) -> R + Sync,
) -> Vec<R>
where
    I: IntoIterator<Item = T, IntoIter: ExactSizeIterator + Send>,
    R: Send,
{
    let items = items.into_iter();
    let count = items.len();
    if count == 0 {
        return Vec::new();
    }
    if threads.min(count) <= 1 {
        let mut state = state();
        return items.map(|item| work(&mut state, item)).collect();
    }
    let items = Mutex::new(items.enumerate());
    let run = || {
        let mut own: Vec<(usize, R)> = Vec::new();
        let mut made = None;
        loop {
            let next = items.lock().next();
            let Some((index, item)) = next else { break own };
            own.push((index, work(made.get_or_insert_with(&state), item)));
        }
    };
    let mut results = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads.min(count)).map(|_| scope.spawn(run)).collect();
        let mut results = run();
        for other in others {
            match other.join() {
                Ok(own) => results.extend(own),
                Err(panic) => resume_unwind(panic),
            }
        }
        results
    });
    results.sort_unstable_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::parallel_map;
    use std::panic::catch_unwind;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn parallel_results_have_the_order_of_the_items() {
        for threads in [0, 1, 2, 7, 100] {
            let states = AtomicUsize::new(0);
            let state = || states.fetch_add(1, Ordering::Relaxed);
            let mut cells = vec![0; 50];
            let parts = parallel_map(cells.chunks_mut(4), threads, state, |_, part| {
                part.fill(threads);
                part.len()
            });
            assert_eq!((parts.len(), parts[12], cells), (13, 2, vec![threads; 50]));
            assert!((1..=threads.clamp(1, 13)).contains(&states.into_inner()), "{threads}");
        }
        let nothing = parallel_map(Vec::<u8>::new(), 4, || unreachable!(), |(): &mut (), _| ());
        assert!(nothing.is_empty());
    }

    #[test]
    fn a_panic_of_a_worker_reaches_the_caller() {
        let work = |(): &mut (), i| assert_ne!(i, 30);
        assert!(catch_unwind(|| parallel_map(0..40, 3, || (), work)).is_err());
    }
}
