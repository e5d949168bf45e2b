//! Tests of schedules, without a clock and connections.

use super::*;
use granita_base::hash;
use std::collections::BTreeMap;

const BUCKET: PixelRect = PixelRect { x0: 32, y0: 64, x1: 64, y1: 95 };

#[test]
fn parts_of_a_bucket_cover_it_without_overlap() {
    for depth in 0..=MOST_DIVISIONS {
        let mut tasks = vec![Task::whole(0)];
        for _ in 0..depth {
            tasks = tasks.into_iter().flat_map(Task::quarters).collect();
        }
        let mut seen = BTreeMap::new();
        for task in &tasks {
            assert_eq!(task.depth(), depth);
            assert!(Task::whole(0).holds(task.part) && task.holds(task.part));
            let rect = task.rect(&BUCKET);
            for y in rect.y0..rect.y1 {
                for x in rect.x0..rect.x1 {
                    *seen.entry((x, y)).or_insert(0) += 1;
                }
            }
        }
        assert_eq!(seen.len(), BUCKET.width() * BUCKET.height());
        assert!(seen.values().all(|n| *n == 1), "{depth}");
    }
    let quarters: Vec<u32> = Task { bucket: 0, part: 2 }.quarters().map(|task| task.part).collect();
    assert_eq!(quarters, [9, 10, 11, 12]);
    assert!(!Task { bucket: 0, part: 1 }.holds(9) && Task { bucket: 0, part: 2 }.holds(9));
}

/// A schedule with the buckets that nobody had.
struct Frame {
    schedule: Schedule,
    next: std::ops::Range<usize>,
}

impl Frame {
    fn new(buckets: usize, workers: usize) -> Self {
        let mut schedule = Schedule::new(buckets);
        (0..workers).for_each(|worker| schedule.join(worker));
        Self { schedule, next: 0..buckets }
    }

    fn take(&mut self, worker: usize, now: f64) -> Option<Task> {
        self.schedule.take(worker, true, now, &mut || self.next.next(), &|_| BUCKET)
    }

    /// Takes a bucket and renders it at once.
    fn render(&mut self, worker: usize, now: f64, seconds: f64) -> Option<Answer> {
        let task = self.take(worker, now)?;
        self.schedule.begun(worker, task, now);
        self.schedule.finish(worker, task, now + seconds)
    }
}

#[test]
fn a_late_bucket_is_rendered_in_parts_by_those_who_wait() {
    let mut frame = Frame::new(5, 3);
    let slow = frame.take(0, 0.0).unwrap();
    frame.schedule.begun(0, slow, 0.0);
    for now in [0.0, 0.1, 0.2, 0.3] {
        assert_eq!(frame.render(1, now, 0.1), Some(Answer::Whole));
    }
    // It is not late yet.
    assert_eq!(frame.take(1, 0.45), None);
    let quarters: Vec<Task> = (0..4).map(|k| frame.take(1 + k % 2, 0.6).unwrap()).collect();
    assert_eq!(quarters.iter().map(|task| task.part).collect::<Vec<_>>(), [1, 2, 3, 4]);
    // The worker that has the bucket gets none of its parts.
    assert_eq!(frame.take(0, 0.6), None);
    for (k, task) in quarters.iter().enumerate() {
        frame.schedule.begun(1 + k % 2, *task, 0.6);
        let expected = if k == 3 { Answer::Whole } else { Answer::Part };
        assert_eq!(frame.schedule.finish(1 + k % 2, *task, 0.7), Some(expected));
    }
    assert!(frame.schedule.is_done() && frame.schedule.left().is_empty());
    assert_eq!(frame.schedule.finish(0, slow, 9.0), Some(Answer::Late));
    assert_eq!(frame.schedule.finish(0, slow, 9.0), None);
}

#[test]
fn tasks_that_were_not_begun_are_asked_back() {
    let mut frame = Frame::new(2, 2);
    let (first, second) = (frame.take(0, 0.0).unwrap(), frame.take(0, 0.0).unwrap());
    frame.schedule.begun(0, first, 0.0);
    assert_eq!(frame.take(1, 0.1), None);
    assert_eq!(frame.take(1, 0.5), Some(second));
    assert_eq!(frame.schedule.revoked(0), [second]);
    assert!(frame.schedule.revoked(0).is_empty());
    frame.schedule.dropped(0, second);
    // It has one copy, and the worker that gave it back may have it again when that is lost.
    assert_eq!(frame.take(0, 0.6), None);
    frame.schedule.leave(1);
    assert_eq!(frame.take(0, 0.7), Some(second));
}

#[test]
fn tasks_of_lost_and_silent_workers_go_to_others() {
    let mut frame = Frame::new(3, 3);
    let tasks = [0, 1, 2].map(|worker| frame.take(worker, 0.0).unwrap());
    frame.schedule.begun(1, tasks[1], 0.0);
    frame.schedule.leave(0);
    assert_eq!(frame.take(2, 0.1), Some(tasks[0]));
    frame.schedule.suspect(1, true);
    assert!(!frame.schedule.is_abandoned());
    assert_eq!(frame.take(2, 0.1), Some(tasks[1]));
    // The answer of the silent worker counts when it is the first one.
    frame.schedule.suspect(1, false);
    assert_eq!(frame.schedule.finish(1, tasks[1], 1.0), Some(Answer::Whole));
    assert_eq!(frame.schedule.finish(2, tasks[1], 1.1), Some(Answer::Late));
    frame.schedule.suspect(1, true);
    frame.schedule.suspect(2, true);
    assert!(frame.schedule.is_abandoned());
    assert_eq!(frame.schedule.left(), [0, 2]);
}

#[test]
fn a_bucket_that_a_worker_cannot_render_is_left() {
    let mut frame = Frame::new(2, 1);
    let (first, second) = (frame.take(0, 0.0).unwrap(), frame.take(0, 0.0).unwrap());
    frame.schedule.fail(0, first);
    assert_eq!(frame.schedule.finish(0, second, 0.1), Some(Answer::Whole));
    assert!(frame.schedule.is_done());
    assert_eq!(frame.schedule.left(), [first.bucket]);
}

#[test]
fn parts_whose_worker_is_lost_are_rendered_when_the_bucket_is_lost_too() {
    let mut frame = Frame::new(4, 3);
    let slow = frame.take(0, 0.0).unwrap();
    frame.schedule.begun(0, slow, 0.0);
    (0..3).for_each(|k| assert_eq!(frame.render(1, 0.1 * f64::from(k), 0.1), Some(Answer::Whole)));
    let quarter = frame.take(1, 1.0).unwrap();
    frame.schedule.leave(1);
    frame.schedule.leave(0);
    let mut parts: Vec<u32> = std::iter::from_fn(|| frame.take(2, 1.0)).map(|task| task.part).collect();
    parts.sort_unstable();
    assert_eq!((quarter.part, parts), (1, vec![1, 2, 3, 4]));
}

/// Workers of different speeds come, go, are silent and give tasks back, in random order. Every bucket is completed
/// exactly once, and no worker gets a bucket, or a part of it, that it may have rendered.
#[test]
fn frames_of_unreliable_workers_are_completed() {
    for seed in 0..300_u32 {
        let mut count = 0;
        let mut random = |n: usize| {
            count += 1;
            (hash::unit(hash::words(&[seed, count])) * n as f32) as usize
        };
        let buckets = 1 + random(40);
        let mut frame = Frame::new(buckets, 0);
        let mut complete = vec![0; buckets];
        let mut parts: Vec<Vec<u32>> = vec![Vec::new(); buckets];
        let (mut workers, mut joined) = (Vec::new(), 0);
        let mut loans: Vec<(usize, Task, bool)> = Vec::new();
        let mut had: Vec<(usize, usize)> = Vec::new();
        let mut now = 0.0;
        for step in 0.. {
            assert!(step < 100_000, "{seed}: {frame:?}", frame = frame.schedule);
            if frame.schedule.is_done() {
                break;
            }
            now += 0.05;
            if workers.is_empty() || random(40) == 0 && workers.len() < 6 {
                frame.schedule.join(joined);
                workers.push(joined);
                joined += 1;
            }
            let worker = workers[random(workers.len())];
            let own: Vec<usize> = (0..loans.len()).filter(|k| loans[*k].0 == worker).collect();
            match random(8) {
                0 if workers.len() > 1 && random(6) == 0 => {
                    workers.retain(|w| *w != worker);
                    loans.retain(|loan| loan.0 != worker);
                    frame.schedule.leave(worker);
                }
                1 => frame.schedule.suspect(worker, random(2) == 0),
                2 => {
                    for task in frame.schedule.revoked(worker) {
                        let at = loans.iter().position(|loan| *loan == (worker, task, false));
                        if let Some(at) = at {
                            loans.swap_remove(at);
                            had.retain(|(w, bucket)| (*w, *bucket) != (worker, task.bucket));
                            frame.schedule.dropped(worker, task);
                        }
                    }
                }
                3 | 4 if own.len() < 3 => {
                    if let Some(task) = frame.take(worker, now) {
                        assert!(!had.contains(&(worker, task.bucket)), "{seed}: {task:?}");
                        if task.part == 0 {
                            had.push((worker, task.bucket));
                        }
                        assert!(!loans.iter().any(|loan| loan.0 == worker && loan.1 == task));
                        loans.push((worker, task, false));
                    }
                }
                5 => {
                    if let Some(k) = own.iter().find(|k| !loans[**k].2) {
                        loans[*k].2 = true;
                        frame.schedule.begun(worker, loans[*k].1, now);
                    }
                }
                // Slow ones finish seldom.
                6 if worker % 3 != 0 || random(9) == 0 => {
                    if let Some(k) = own.iter().find(|k| loans[**k].2) {
                        let (_, task, _) = loans.swap_remove(*k);
                        match frame.schedule.finish(worker, task, now).unwrap() {
                            Answer::Late => (),
                            Answer::Part => parts[task.bucket].push(task.part),
                            Answer::Whole => {
                                parts[task.bucket].push(task.part);
                                complete[task.bucket] += 1;
                            }
                        }
                    }
                }
                _ => (),
            }
            assert!(!frame.schedule.is_stuck(), "{seed}");
        }
        assert!(complete.iter().all(|n| *n == 1), "{seed}: {complete:?}");
        // The parts that arrived cover each bucket.
        for parts in parts {
            let covers = |task: Task| parts.iter().any(|part| Task { part: *part, ..task }.holds(task.part));
            let leaves = Task::whole(0).quarters().flat_map(Task::quarters);
            assert!(leaves.into_iter().all(covers), "{seed}: {parts:?}");
        }
    }
}
