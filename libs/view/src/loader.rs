//! Reads tiles in the background, visible ones first.

use crate::grid::Needs;
use crate::pyramid::Pyramid;
use parking_lot::{Condvar, Mutex, MutexGuard};
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A tile to be read.
#[derive(Clone, Debug)]
struct Job {
    pyramid: Arc<Pyramid>,
    level: usize,
    /// The column and the row; `None` to make the rough image.
    tile: Option<(u32, u32)>,
}

type Task = Box<dyn FnOnce() + Send>;

#[derive(Default)]
struct State {
    jobs: VecDeque<Job>,
    tasks: VecDeque<Task>,
    /// The number of threads at work.
    busy: usize,
    /// The tiles that could not be read, by the id of the page in the store, level, column and row. They are not tried
    /// again.
    failed: BTreeSet<(u64, usize, u32, u32)>,
    stop: bool,
    woken: Option<Instant>,
}

/// The longest time for which a tile waits to be shown while others arrive.
const SOON: Duration = Duration::from_millis(40);

struct Shared {
    state: Mutex<State>,
    wanted: Condvar,
    done: Condvar,
    arrivals: AtomicU64,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Each change under the lock is a single step, so the state is consistent after a panic.
        self.state.lock()
    }
}

/// Threads that read tiles, and run long tasks when there are none to read. Dropping this ends them.
pub struct Loader {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl std::fmt::Debug for Loader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Loader({} threads)", self.threads.len())
    }
}

impl Loader {
    /// Starts the threads. `wake` is called from a thread of the loader, after the last tile or task, and at intervals
    /// of at least 40 ms while there are more.
    pub fn new(threads: usize, wake: impl Fn() + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            wanted: Condvar::new(),
            done: Condvar::new(),
            arrivals: AtomicU64::new(0),
            wake: Box::new(wake),
        });
        let threads = (0..threads.max(1))
            .map(|_| {
                let shared = shared.clone();
                std::thread::spawn(move || work(&shared))
            })
            .collect();
        Self { shared, threads }
    }

    /// Sets the requested tiles, in order. Earlier requests that have not started are dropped.
    pub fn want<'a>(&self, wanted: impl IntoIterator<Item = (&'a Arc<Pyramid>, &'a Needs)>) {
        let mut jobs = VecDeque::new();
        let mut state = self.shared.lock();
        for (pyramid, needs) in wanted {
            let failed = |t: &(u32, u32)| state.failed.contains(&(pyramid.number(), needs.level, t.0, t.1));
            let missing = needs.tiles.iter().filter(|t| !pyramid.has(needs.level, t.0, t.1) && !failed(t));
            let job = |tile| Job { pyramid: pyramid.clone(), level: needs.level, tile };
            let first = jobs.len();
            jobs.extend(missing.map(|tile| job(Some(*tile))));
            match jobs.len() > first {
                true if pyramid.wants_sketch() => jobs.push_front(job(None)),
                true => {}
                // No tile is missing.
                false => pyramid.no_sketch(),
            }
        }
        state.jobs = jobs;
        drop(state);
        self.shared.wanted.notify_all();
    }

    /// Runs a task when there is no tile to read.
    pub fn run(&self, task: impl FnOnce() + Send + 'static) {
        self.shared.lock().tasks.push_back(Box::new(task));
        self.shared.wanted.notify_all();
    }

    /// Returns the number of tiles and tasks done so far.
    pub fn arrivals(&self) -> u64 {
        self.shared.arrivals.load(Ordering::Acquire)
    }

    /// True when there is nothing to do.
    pub fn is_idle(&self) -> bool {
        let state = self.shared.lock();
        state.jobs.is_empty() && state.tasks.is_empty() && state.busy == 0
    }

    /// Waits until there is nothing to do.
    pub fn wait(&self) {
        let mut state = self.shared.lock();
        while !(state.jobs.is_empty() && state.tasks.is_empty() && state.busy == 0) {
            self.shared.done.wait(&mut state);
        }
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.stop = true;
        state.jobs.clear();
        state.tasks.clear();
        drop(state);
        self.shared.wanted.notify_all();
        for thread in self.threads.drain(..) {
            // The panic of a thread was reported already.
            let _ = thread.join();
        }
    }
}

/// The next work of a thread.
enum Next {
    Tile(Job),
    Task(Task),
}

fn work(shared: &Shared) {
    let mut state = shared.lock();
    loop {
        if state.stop {
            return;
        }
        let next = match state.jobs.pop_front() {
            Some(job) => Some(Next::Tile(job)),
            None => state.tasks.pop_front().map(Next::Task),
        };
        let Some(next) = next else {
            shared.done.notify_all();
            shared.wanted.wait(&mut state);
            continue;
        };
        state.busy += 1;
        drop(state);
        let failed = match next {
            Next::Tile(Job { pyramid, tile: None, .. }) => {
                pyramid.make_sketch();
                None
            }
            Next::Tile(job @ Job { tile: Some((tx, ty)), .. }) => {
                let read = job.pyramid.tile(job.level, tx, ty);
                read.err().map(|_| (job.pyramid.number(), job.level, tx, ty))
            }
            Next::Task(task) => {
                // The result of a task that panics is missing. The other tasks continue.
                let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(task));
                None
            }
        };
        shared.arrivals.fetch_add(1, Ordering::Release);
        state = shared.lock();
        state.busy -= 1;
        state.failed.extend(failed);
        if state.jobs.is_empty() || state.woken.is_none_or(|woken| woken.elapsed() >= SOON) {
            state.woken = Some(Instant::now());
            drop(state);
            (shared.wake)();
            state = shared.lock();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Access, Reduce, Source, TILE, Tile, TileStore};
    use granita_image::PixelType;

    struct Striped;

    impl Source for Striped {
        fn levels(&self) -> usize {
            1
        }
        fn size(&self, _level: usize) -> (u32, u32) {
            (10 * TILE, 4 * TILE)
        }
        fn channels(&self) -> usize {
            1
        }
        fn pixel_type(&self) -> PixelType {
            PixelType::U8
        }
        fn access(&self) -> Access {
            Access::Tiles
        }
        fn read(&self, _level: usize, tx: u32, ty: u32) -> crate::Result<Vec<((u32, u32), Tile)>> {
            if tx == 3 {
                return Err(crate::ViewError::Misuse { what: "a hole".to_owned() });
            }
            Ok(vec![((tx, ty), Tile::zeros(TILE, TILE, 1, PixelType::U8))])
        }
    }

    #[test]
    fn requested_tiles_are_loaded_and_failing_ones_tried_once() {
        let store = TileStore::default();
        let pyramid = Arc::new(Pyramid::new(Arc::new(Striped), &store, vec![Reduce::Mean]));
        let loader = Loader::new(3, || ());
        let needs = Needs { level: 0, tiles: (0..10).flat_map(|x| (0..4).map(move |y| (x, y))).collect() };
        loader.want([(&pyramid, &needs)]);
        loader.wait();
        assert!(pyramid.has(0, 9, 3) && !pyramid.has(0, 3, 0));
        let before = loader.arrivals();
        loader.want([(&pyramid, &needs)]);
        loader.wait();
        assert_eq!(loader.arrivals(), before);
        let (sender, receiver) = std::sync::mpsc::channel();
        loader.run(|| panic!("a task that fails"));
        loader.run(move || sender.send(7).unwrap());
        assert_eq!(receiver.recv().unwrap(), 7);
        loader.wait();
        assert!(loader.is_idle());
    }
}
