//! Which process renders which bucket of a frame, and when a second process gets a bucket that is late.
//!
//! The schedule knows no clock and no connection: every call says at which second it happens. So a simulation can run
//! it as the renderer does.

use crate::PixelRect;
use std::collections::{BTreeMap, VecDeque};

/// A bucket, or a part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Task {
    /// The number of the bucket.
    pub bucket: usize,
    /// 0 for the whole bucket. The quarters of part `n` are the parts `4n + 1` to `4n + 4`: upper left, upper right,
    /// lower left, lower right.
    pub part: u32,
}

impl Task {
    /// Returns the task of a whole bucket.
    pub fn whole(bucket: usize) -> Self {
        Self { bucket, part: 0 }
    }

    /// Returns the pixels of this task, from those of its bucket. It is empty when the bucket is too small for such a
    /// part.
    pub fn rect(&self, bucket: &PixelRect) -> PixelRect {
        if self.part == 0 {
            return *bucket;
        }
        let whole = Self { part: (self.part - 1) / 4, ..*self }.rect(bucket);
        let middle = [whole.x0 + (whole.x1 - whole.x0) / 2, whole.y0 + (whole.y1 - whole.y0) / 2];
        let quarter = (self.part - 1) % 4;
        let (x0, x1) = if quarter.is_multiple_of(2) { (whole.x0, middle[0]) } else { (middle[0], whole.x1) };
        let (y0, y1) = if quarter < 2 { (whole.y0, middle[1]) } else { (middle[1], whole.y1) };
        PixelRect { x0, x1, y0, y1 }
    }

    /// Returns its quarters.
    fn quarters(self) -> impl Iterator<Item = Self> {
        (1..=4).map(move |k| Self { part: 4 * self.part + k, ..self })
    }

    /// Returns the number of times that the bucket was divided.
    fn depth(&self) -> u32 {
        let mut part = self.part;
        let mut depth = 0;
        while part > 0 {
            part = (part - 1) / 4;
            depth += 1;
        }
        depth
    }

    /// True when `part` is this part or lies within it.
    fn holds(&self, mut part: u32) -> bool {
        while part > self.part {
            part = (part - 1) / 4;
        }
        part == self.part
    }
}

/// The largest number of times that a bucket is divided. Parts are then a sixteenth of it.
const MOST_DIVISIONS: u32 = 2;

/// The least side of a part in pixels. Smaller ones would cost more for the margins of filters than they save.
const LEAST_SIDE: i32 = 6;

/// The factor of the usual time of a bucket after which it is late.
const LATE: f64 = 2.0;

/// The least number of seconds after which a bucket is late.
const LEAST_LATE: f64 = 0.5;

/// The largest number of workers that render the same task at the same time.
const MOST_COPIES: usize = 2;

/// The seconds after which it is looked again for something late.
const QUIET: f64 = 0.02;

/// What the pixels of a task are worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// They are there already, or the bucket failed.
    Late,
    /// They are a part of a bucket that has other parts missing.
    Part,
    /// With them, the bucket is complete.
    Whole,
}

/// A task at a worker.
#[derive(Clone, Copy, Debug)]
struct Loan {
    worker: usize,
    taken: f64,
    /// The time when the worker began it.
    begun: Option<f64>,
}

/// The state of a bucket.
#[derive(Clone, Debug, Default)]
struct Bucket {
    /// The parts that are done.
    done: Vec<u32>,
    /// True when nothing of it is expected any more.
    over: bool,
    /// The workers that have begun the whole bucket, or may have. They must not get it or a part of it again, because
    /// they drop what they made for it.
    holders: Vec<usize>,
}

/// A worker that takes tasks.
#[derive(Clone, Debug, Default)]
struct Member {
    /// The number of its tasks.
    tasks: usize,
    is_silent: bool,
    /// The tasks that it shall give back.
    revoked: Vec<Task>,
}

/// The distribution of the buckets of a frame over workers.
#[derive(Debug, Default)]
pub struct Schedule {
    buckets: Vec<Bucket>,
    /// Tasks that come before new buckets.
    returned: VecDeque<Task>,
    /// The tasks at workers, sorted by bucket.
    out: BTreeMap<Task, Vec<Loan>>,
    /// The seconds of the whole buckets that are done.
    seconds: Vec<f64>,
    /// The number of such buckets at the last computation of their median, and the median.
    usual: (usize, f64),
    /// The buckets that no worker could render.
    failed: Vec<usize>,
    /// The number of buckets that are not over.
    missing: usize,
    members: BTreeMap<usize, Member>,
    /// The time until which nothing is late, because nothing was late a moment ago.
    quiet: f64,
}

impl Schedule {
    /// Returns the schedule of a number of buckets, none of which was rendered.
    pub fn new(buckets: usize) -> Self {
        Self { buckets: vec![Bucket::default(); buckets], missing: buckets, ..Self::default() }
    }

    /// Adds a worker. Every worker of a frame has a number of its own.
    pub fn join(&mut self, worker: usize) {
        self.members.insert(worker, Member::default());
    }

    /// Returns a task for a worker at the time `now`, in seconds. `next` returns the next bucket that no worker had.
    /// When there is none, a worker with an idle thread gets what others have not begun, or a part of what takes them
    /// long. `rect` returns the pixels of a bucket.
    pub fn take(
        &mut self,
        worker: usize,
        is_idle: bool,
        now: f64,
        next: &mut dyn FnMut() -> Option<usize>,
        rect: &dyn Fn(usize) -> PixelRect,
    ) -> Option<Task> {
        let new = self.take_returned(worker).or_else(|| next().map(Task::whole));
        let task = match new {
            None if is_idle && now >= self.quiet => {
                let task = self.take_waiting(worker, now).or_else(|| self.take_late(worker, now, rect));
                if task.is_none() {
                    self.quiet = now + QUIET;
                }
                task?
            }
            new => new?,
        };
        if task.part == 0 {
            self.buckets[task.bucket].holders.push(worker);
        }
        self.out.entry(task).or_default().push(Loan { worker, taken: now, begun: None });
        if let Some(member) = self.members.get_mut(&worker) {
            member.tasks += 1;
        }
        Some(task)
    }

    /// Returns a task that was given back.
    fn take_returned(&mut self, worker: usize) -> Option<Task> {
        let at = self.returned.iter().position(|task| self.may_have(worker, *task))?;
        self.returned.remove(at)
    }

    /// True when a worker may render a task.
    fn may_have(&self, worker: usize, task: Task) -> bool {
        let bucket = &self.buckets[task.bucket];
        let has = || self.out.get(&task).is_some_and(|loans| loans.iter().any(|loan| loan.worker == worker));
        !bucket.over && !self.has(task) && !bucket.holders.contains(&worker) && !has()
    }

    /// True when a task of other workers may be given to this one as well.
    fn may_copy(&self, worker: usize, task: Task, loans: &[Loan]) -> bool {
        loans.len() < MOST_COPIES && self.may_have(worker, task) && !self.is_divided(task)
    }

    /// Returns a task that another worker has not begun. It is the one that would wait longest, the last of the worker
    /// with the most tasks. Those of silent workers come first.
    fn take_waiting(&mut self, worker: usize, now: f64) -> Option<Task> {
        let patience = self.usual().unwrap_or(LEAST_LATE).min(LEAST_LATE) / 2.0;
        let key = |task: &Task, loan: &Loan| {
            let member = self.members.get(&loan.worker);
            let (is_silent, tasks) = member.map_or((false, 0), |member| (member.is_silent, member.tasks));
            let waits = loan.begun.is_none() && now - loan.taken > patience;
            (waits || is_silent).then_some((is_silent, tasks, *task))
        };
        let mut best = None;
        for (task, loans) in &self.out {
            // Copies of a task are at work already.
            let [loan] = &loans[..] else { continue };
            let key = key(task, loan);
            if key.is_some() && key > best.map(|(key, _)| key) && self.may_copy(worker, *task, loans) {
                best = key.map(|key| (key, loan.worker));
            }
        }
        let ((_, _, task), from) = best?;
        if let Some(member) = self.members.get_mut(&from) {
            member.revoked.push(task);
        }
        Some(task)
    }

    /// Returns a quarter of the task that has taken longest, when it is late. A task that is too small for quarters is
    /// returned itself.
    fn take_late(&mut self, worker: usize, now: f64, rect: &dyn Fn(usize) -> PixelRect) -> Option<Task> {
        // A part of a bucket may take as long as a bucket.
        let limit = (LATE * self.usual()?).max(LEAST_LATE);
        let mut latest = None;
        for (task, loans) in &self.out {
            let begun = loans.iter().filter_map(|loan| loan.begun).fold(f64::INFINITY, f64::min);
            if now - begun > limit
                && latest.is_none_or(|(_, since)| begun < since)
                && self.may_copy(worker, *task, loans)
            {
                latest = Some((*task, begun));
            }
        }
        let (task, _) = latest?;
        let area = task.rect(&rect(task.bucket));
        let may_divide =
            task.depth() < MOST_DIVISIONS && (area.x1 - area.x0).min(area.y1 - area.y0) >= 2 * LEAST_SIDE;
        if !may_divide {
            return Some(task);
        }
        let mut quarters = task.quarters();
        let first = quarters.next();
        self.returned.extend(quarters);
        first
    }

    /// Returns the median of the seconds of whole buckets; `None` before a few are done.
    fn usual(&mut self) -> Option<f64> {
        let known = self.seconds.len();
        if known < 3 {
            return None;
        }
        if known > self.usual.0 + self.usual.0 / 16 {
            let mut seconds = self.seconds.clone();
            let median = *seconds.select_nth_unstable_by(known / 2, f64::total_cmp).1;
            self.usual = (known, median);
        }
        Some(self.usual.1)
    }

    /// Marks a task as begun.
    pub fn begun(&mut self, worker: usize, task: Task, now: f64) {
        for loan in self.out.get_mut(&task).into_iter().flatten() {
            if loan.worker == worker {
                loan.begun = Some(now);
            }
        }
    }

    /// Returns the tasks that a worker shall give back if it has not begun them, once each.
    pub fn revoked(&mut self, worker: usize) -> Vec<Task> {
        self.members.get_mut(&worker).map_or_else(Vec::new, |member| std::mem::take(&mut member.revoked))
    }

    /// Removes a task that a worker has given back before it began.
    pub fn dropped(&mut self, worker: usize, task: Task) {
        if self.remove(worker, task).is_some() {
            if task.part == 0 {
                self.buckets[task.bucket].holders.retain(|holder| *holder != worker);
            }
            self.offer(task);
        }
    }

    /// Removes a task of a worker. Returns `None` when it has no such task.
    fn remove(&mut self, worker: usize, task: Task) -> Option<Loan> {
        let loans = self.out.get_mut(&task)?;
        let at = loans.iter().position(|loan| loan.worker == worker)?;
        let loan = loans.swap_remove(at);
        if loans.is_empty() {
            self.out.remove(&task);
        }
        if let Some(member) = self.members.get_mut(&worker) {
            member.tasks -= 1;
        }
        Some(loan)
    }

    /// Gives a task to the next worker, except for the parts that others have.
    fn offer(&mut self, task: Task) {
        if self.is_covered(task) {
            return;
        }
        if self.is_divided(task) {
            task.quarters().for_each(|quarter| self.offer(quarter));
        } else {
            self.returned.push_front(task);
        }
    }

    /// Returns the tasks of a bucket that are at workers, or wait for one.
    fn pending(&self, bucket: usize) -> impl Iterator<Item = Task> + '_ {
        let all = Task::whole(bucket)..Task::whole(bucket + 1);
        let waiting = self.returned.iter().filter(move |task| task.bucket == bucket);
        self.out.range(all).map(|(task, _)| *task).chain(waiting.copied())
    }

    /// True when a task is done, at a worker, or waiting for one, as a whole or in parts.
    fn is_covered(&self, task: Task) -> bool {
        self.has(task)
            || self.pending(task.bucket).any(|other| other.holds(task.part))
            || self.is_divided(task) && task.quarters().all(|quarter| self.is_covered(quarter))
    }

    /// True when a part of a task is done, at a worker, or waiting for one.
    fn is_divided(&self, task: Task) -> bool {
        let within = |part: u32| part != task.part && task.holds(part);
        self.pending(task.bucket).any(|other| within(other.part))
            || self.buckets[task.bucket].done.iter().any(|part| within(*part))
    }

    /// True when the pixels of a task are there.
    fn has(&self, task: Task) -> bool {
        let bucket = &self.buckets[task.bucket];
        bucket.over || bucket.done.iter().any(|done| Task { part: *done, ..task }.holds(task.part))
    }

    /// Accepts the pixels of a task. Returns `None` when the worker had no such task.
    pub fn finish(&mut self, worker: usize, task: Task, now: f64) -> Option<Answer> {
        let loan = self.remove(worker, task)?;
        if self.has(task) {
            return Some(Answer::Late);
        }
        if let Some(begun) = loan.begun.filter(|_| task.part == 0) {
            self.seconds.push(now - begun);
        }
        let bucket = &mut self.buckets[task.bucket];
        let mut task = task;
        bucket.done.push(task.part);
        while task.part > 0 {
            let parent = Task { part: (task.part - 1) / 4, ..task };
            if !parent.quarters().all(|quarter| bucket.done.contains(&quarter.part)) {
                break;
            }
            bucket.done.push(parent.part);
            task = parent;
        }
        if task.part == 0 {
            self.close(task.bucket);
            return Some(Answer::Whole);
        }
        self.returned.retain(|other| other.bucket != task.bucket || !task.holds(other.part));
        Some(Answer::Part)
    }

    /// Marks the bucket of a task as one that workers cannot render.
    pub fn fail(&mut self, worker: usize, task: Task) {
        if self.remove(worker, task).is_some() && !self.buckets[task.bucket].over {
            self.failed.push(task.bucket);
            self.close(task.bucket);
        }
    }

    fn close(&mut self, bucket: usize) {
        self.buckets[bucket].over = true;
        self.missing -= 1;
        self.returned.retain(|other| other.bucket != bucket);
    }

    /// Removes a worker. Others get its tasks.
    pub fn leave(&mut self, worker: usize) {
        let mut lost = Vec::new();
        self.out.retain(|task, loans| {
            let count = loans.len();
            loans.retain(|loan| loan.worker != worker);
            if loans.len() < count {
                lost.push(*task);
            }
            !loans.is_empty()
        });
        self.members.remove(&worker);
        // The first bucket is the first one again.
        for task in lost.into_iter().rev() {
            self.offer(task);
        }
    }

    /// Says whether a worker is silent. Others get its tasks then, while its own answers still count.
    pub fn suspect(&mut self, worker: usize, is_silent: bool) {
        if let Some(member) = self.members.get_mut(&worker) {
            member.is_silent = is_silent;
        }
    }

    /// True when no bucket is missing.
    pub fn is_done(&self) -> bool {
        self.missing == 0
    }

    /// True when there are workers, and all of them are silent.
    pub fn is_abandoned(&self) -> bool {
        !self.members.is_empty() && self.members.values().all(|member| member.is_silent)
    }

    /// True when tasks wait that no worker may have. That is not expected, and would never end.
    pub fn is_stuck(&self) -> bool {
        let is_free = |task: &Task| !self.members.keys().any(|worker| self.may_have(*worker, *task));
        self.out.is_empty() && !self.returned.is_empty() && self.returned.iter().all(is_free)
    }

    /// Returns the number of workers.
    pub fn workers(&self) -> usize {
        self.members.len()
    }

    /// Returns the buckets that were not rendered, in order.
    pub fn left(&self) -> Vec<usize> {
        let missing = |index: &usize| !self.buckets[*index].over || self.failed.contains(index);
        (0..self.buckets.len()).filter(missing).collect()
    }
}

#[cfg(test)]
mod tests;
