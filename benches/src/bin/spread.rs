//! Simulates a frame that many machines render together (`gelato -net`).
//!
//! `cargo run --release -p granita-benches --bin spread`
//!
//! The schedule is that of the renderer (`granita_render::Schedule`). Workers, connections and time are simulated. The
//! times of the buckets are measured: three scenes are rendered with one thread, and their buckets are scaled to a
//! frame of 3840 x 2160 pixels that takes 20 minutes of one core. Every worker has one thread and its own speed. Some
//! are slow, some stop, and some end. All share the connection of the coordinator. The table has
//! - the time of the frame, and the efficiency: 20 minutes over the time and the number of workers;
//! - the time between the last answers of the worker that ended first and of the one that ended last;
//! - the work that was done twice, and that of the margins of divided buckets;
//! - the part of the time in which the coordinator was busy, and the time of the simulation.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_benches::{measure_into, release_tool, repository};
use granita_image::PixelRect;
use granita_render::{Schedule, Task};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

/// The scenes, under `benches/frames`.
const SCENES: [(&str, &str); 3] =
    [("displaced.pyg", "even"), ("pot.pyg", "objects in the middle"), ("mirrors.pyg", "costly in one part")];

/// The numbers of workers.
const WORKERS: [usize; 7] = [1, 8, 16, 64, 128, 256, 500];

/// The seconds of the frame on one core.
const FRAME: f64 = 1200.0;

/// The side of a bucket in pixels, and the number of buckets of the frame.
const SIDE: i32 = 32;
const BUCKETS: usize = 120 * 68;

/// The bytes of the pixels of a bucket: four channels of floats.
const BYTES: f64 = (SIDE * SIDE * 16) as f64;

/// The bytes that the connection of the coordinator carries in a second (10 Gbit/s).
const BANDWIDTH: f64 = 1.25e9;

/// The seconds that a message travels.
const LATENCY: f64 = 2e-4;

/// The seconds that the coordinator takes for an answer: decryption, checks, and the copy to the image. It is about
/// twice the time that was measured for a bucket on this machine.
const HANDLING: f64 = 6e-5;

/// The seconds for which a worker reads the scene before its first bucket.
const READING: f64 = 1.0;

/// The seconds between two looks for something late, and those of silence before others get the tasks of a worker.
const GLANCE: f64 = 0.05;
const SUSPICIOUS: f64 = 5.0;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    None,
    /// Every 20th worker takes four times as long.
    Slow,
    /// Every 20th worker ends after a random time, and every 20th one stops.
    Failing,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    /// A worker asks for tasks.
    Ask(usize),
    /// A worker has rendered a task.
    Done(usize, Task),
    /// An answer is at the coordinator.
    Arrived(usize, Task),
    /// The coordinator notices that a worker is gone or silent.
    Gone(usize),
    Silent(usize),
    /// Workers are asked for tasks that they have not begun.
    AskBack,
}

/// An event at a time, ordered by time and then by number.
#[derive(Debug, Clone, Copy, PartialEq)]
struct At(f64, u64, Event);

impl Eq for At {}

impl PartialOrd for At {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for At {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

struct Worker {
    /// The factor of the time of buckets.
    factor: f64,
    queue: VecDeque<Task>,
    rendering: Option<Task>,
    /// The number of tasks that the coordinator counts.
    tasks: usize,
    /// The time at which it stops or ends.
    until: f64,
    ends: bool,
    /// True when it waits for a task.
    waits: bool,
}

struct Simulation<'a> {
    times: &'a [f64],
    schedule: Schedule,
    next: std::ops::Range<usize>,
    workers: Vec<Worker>,
    events: BinaryHeap<Reverse<At>>,
    count: u64,
    now: f64,
    /// The times until which the connection and the coordinator are busy.
    line: f64,
    coordinator: f64,
    /// The seconds that the coordinator worked.
    worked: f64,
    /// The seconds of all tasks that were rendered, on a worker of factor 1.
    rendered: f64,
}

fn main() -> ExitCode {
    granita_benches::exit("spread", run())
}

fn run() -> Result<(), String> {
    println!(
        "{:<15} {:<8} {:>7} {:>9} {:>10} {:>12} {:>10} {:>11} {:>8}",
        "scene",
        "trouble",
        "workers",
        "seconds",
        "efficiency",
        "last - first",
        "more work",
        "coordinator",
        "took"
    );
    for (scene, about) in SCENES {
        let times = measured(scene)?;
        let longest = times.iter().copied().fold(0.0, f64::max);
        println!("{scene}: {about}; the longest bucket takes {longest:.2} s");
        for trouble in [Trouble::None, Trouble::Slow, Trouble::Failing] {
            for count in WORKERS {
                if trouble != Trouble::None && count < 20 {
                    continue;
                }
                let real = Instant::now();
                let mut simulation = Simulation::new(&times, count, trouble);
                let idle = simulation.run();
                let real = real.elapsed().as_secs_f64();
                println!(
                    "{scene:<15} {:<8} {count:>7} {:>9.2} {:>10.3} {idle:>12.2} {:>8.2} % {:>9.1} % {real:>6.1} s",
                    format!("{trouble:?}").to_lowercase(),
                    simulation.now,
                    FRAME / (simulation.now * count as f64),
                    (100.0 * (simulation.rendered / FRAME - 1.0)).max(0.0),
                    100.0 * simulation.worked / simulation.now
                );
            }
        }
    }
    let answers = BUCKETS as f64;
    println!(
        "the coordinator is saturated by {:.0} workers, whatever the scene, and its connection by {:.0}",
        FRAME / (answers * HANDLING),
        FRAME / (answers * BYTES / BANDWIDTH)
    );
    Ok(())
}

/// Renders a scene and returns the times of the buckets of the frame, in the order of the buckets.
fn measured(scene: &str) -> Result<Vec<f64>, String> {
    let gelato = release_tool("gelato")?;
    let place = tempfile::tempdir().map_err(|error| error.to_string())?;
    let found = repository().join("benches").join("frames").join(scene);
    let text = format!(
        "Attribute (\"int[2] limits:bucketsize\", (16, 16))\nOutput (\"out.tif\", \"tiff\", \"rgb\", \"camera\")\nInput (\"{}\")\n",
        found.display()
    );
    std::fs::write(place.path().join("scene.pyg"), text).map_err(|error| error.to_string())?;
    let report = place.path().join("statistics.json");
    let mut command = Command::new(gelato);
    command.current_dir(place.path()).args([
        "-silent",
        "-threads",
        "1",
        "-statistics-json",
        "statistics.json",
        "scene.pyg",
    ]);
    measure_into(&place.path().join("said"), command)?;
    times(&report)
}

/// Reads the times of buckets, and scales them to the frame.
fn times(report: &Path) -> Result<Vec<f64>, String> {
    let text = std::fs::read_to_string(report).map_err(|error| error.to_string())?;
    let document: serde_json::Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let list = document.pointer("/frames/0/cameras/0/bucket_seconds").and_then(|list| list.as_array());
    let list = list.ok_or("the statistics have no times of buckets")?;
    let measured: Vec<f64> = list.iter().filter_map(serde_json::Value::as_f64).collect();
    if measured.is_empty() {
        return Err("the statistics have no times of buckets".to_owned());
    }
    let of_frame: Vec<f64> = (0..BUCKETS).map(|bucket| measured[bucket * measured.len() / BUCKETS]).collect();
    let sum: f64 = of_frame.iter().sum();
    Ok(of_frame.into_iter().map(|seconds| seconds * FRAME / sum).collect())
}

/// Returns a number from 0 to 1 that depends on a worker.
fn random(worker: usize, what: u32) -> f64 {
    f64::from(granita_base::hash::unit(granita_base::hash::words(&[worker as u32, what])))
}

impl<'a> Simulation<'a> {
    fn new(times: &'a [f64], count: usize, trouble: Trouble) -> Self {
        let mut schedule = Schedule::new(times.len());
        let workers = (0..count).map(|worker| {
            schedule.join(worker);
            let slow = trouble == Trouble::Slow && worker % 20 == 7;
            let ends = trouble == Trouble::Failing && worker % 20 == 7;
            let stops = trouble == Trouble::Failing && worker % 20 == 13;
            let until = READING + random(worker, 1) * FRAME / count as f64;
            Worker {
                factor: if slow { 4.0 } else { 0.9 + 0.2 * random(worker, 0) },
                queue: VecDeque::new(),
                rendering: None,
                tasks: 0,
                until: if ends || stops { until } else { f64::INFINITY },
                ends,
                waits: false,
            }
        });
        let workers: Vec<Worker> = workers.collect();
        let mut simulation = Self {
            times,
            schedule,
            next: 0..times.len(),
            workers,
            events: BinaryHeap::new(),
            count: 0,
            now: 0.0,
            line: 0.0,
            coordinator: 0.0,
            worked: 0.0,
            rendered: 0.0,
        };
        for worker in 0..count {
            simulation.after(READING, Event::Ask(worker));
            let Worker { until, ends, .. } = simulation.workers[worker];
            if until.is_finite() {
                let event = if ends { Event::Gone(worker) } else { Event::Silent(worker) };
                simulation.after(until + if ends { LATENCY } else { SUSPICIOUS }, event);
            }
        }
        simulation
    }

    fn after(&mut self, seconds: f64, event: Event) {
        self.count += 1;
        self.events.push(Reverse(At(self.now + seconds, self.count, event)));
    }

    /// Runs until all buckets are done. Returns the seconds between the last answers of the first and the last worker.
    fn run(&mut self) -> f64 {
        let mut last = vec![0.0; self.workers.len()];
        while let Some(Reverse(At(now, _, event))) = self.events.pop() {
            self.now = now;
            match event {
                Event::Ask(worker) => self.give(worker),
                Event::Done(worker, task) => self.rendered_task(worker, task),
                Event::Arrived(worker, task) => {
                    self.schedule.finish(worker, task, now);
                    self.workers[worker].tasks -= 1;
                    last[worker] = now;
                    if self.schedule.is_done() {
                        break;
                    }
                    self.give(worker);
                }
                Event::AskBack => (0..self.workers.len()).for_each(|worker| self.ask_back(worker)),
                Event::Gone(worker) => self.schedule.leave(worker),
                Event::Silent(worker) => self.schedule.suspect(worker, true),
            }
        }
        let alive = || last.iter().zip(&self.workers).filter(|(_, w)| w.until.is_infinite()).map(|(t, _)| *t);
        alive().fold(0.0, f64::max) - alive().fold(f64::INFINITY, f64::min)
    }

    fn is_alive(&self, worker: usize) -> bool {
        self.workers[worker].until > self.now
    }

    /// Gives tasks to a worker as the connection of the renderer does.
    fn give(&mut self, worker: usize) {
        self.workers[worker].waits = false;
        if !self.is_alive(worker) && self.workers[worker].ends {
            return;
        }
        while self.workers[worker].tasks < 2 {
            let idle = self.workers[worker].tasks == 0;
            let rect = PixelRect::at(0, 0, SIDE as u32, SIDE as u32);
            let next = &mut self.next;
            let Some(task) = self.schedule.take(worker, idle, self.now, &mut || next.next(), &|_| rect)
            else {
                break;
            };
            if idle && self.next.is_empty() {
                self.after(GLANCE, Event::AskBack);
            }
            self.workers[worker].tasks += 1;
            self.workers[worker].queue.push_back(task);
        }
        if self.workers[worker].tasks == 0 && !self.schedule.is_done() && !self.workers[worker].waits {
            self.workers[worker].waits = true;
            self.after(GLANCE, Event::Ask(worker));
        }
        self.begin(worker, LATENCY);
    }

    /// Lets an idle worker begin its next task.
    fn begin(&mut self, worker: usize, delay: f64) {
        if self.workers[worker].rendering.is_some() || !self.is_alive(worker) {
            return;
        }
        let Some(task) = self.workers[worker].queue.pop_front() else { return };
        self.workers[worker].rendering = Some(task);
        self.schedule.begun(worker, task, self.now + delay);
        let seconds = self.seconds(task) * self.workers[worker].factor;
        self.after(delay + seconds, Event::Done(worker, task));
    }

    /// Returns the seconds of a task on a worker of factor 1. A part has margins, so that it takes more than its share.
    fn seconds(&self, task: Task) -> f64 {
        self.times[task.bucket] * [1.0, 0.35, 0.13][task_depth(task)]
    }

    /// Sends the pixels of a task, and begins the next one.
    fn rendered_task(&mut self, worker: usize, task: Task) {
        if !self.is_alive(worker) {
            return;
        }
        self.rendered += self.seconds(task);
        self.workers[worker].rendering = None;
        self.begin(worker, 0.0);
        self.line = self.line.max(self.now) + BYTES / BANDWIDTH;
        self.coordinator = self.coordinator.max(self.line + LATENCY) + HANDLING;
        self.worked += HANDLING;
        let arrives = self.coordinator - self.now;
        self.after(arrives, Event::Arrived(worker, task));
    }

    /// Takes back tasks of a worker that it has not begun.
    fn ask_back(&mut self, worker: usize) {
        for task in self.schedule.revoked(worker) {
            if let Some(at) = self.workers[worker].queue.iter().position(|other| *other == task) {
                self.workers[worker].queue.remove(at);
                self.workers[worker].tasks -= 1;
                self.schedule.dropped(worker, task);
            }
        }
    }
}

/// Returns how often the bucket of a task was divided.
fn task_depth(task: Task) -> usize {
    match task.part {
        0 => 0,
        1..=4 => 1,
        _ => 2,
    }
}
