//! Counts and times of the work that a frame did and avoided.

use crate::output::halves::DenoisedError;
use crate::passes::PassReport;
use parking_lot::Mutex;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Counters of one frame, added to from any thread.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) primitives: AtomicU64,
    pub(crate) primitives_built: AtomicU64,
    pub(crate) primitives_off_screen: AtomicU64,
    pub(crate) primitives_split: AtomicU64,
    pub(crate) primitives_hidden: AtomicU64,
    pub(crate) pieces_culled: AtomicU64,
    pub(crate) grids: AtomicU64,
    pub(crate) grids_shaded: AtomicU64,
    pub(crate) grids_unshaded: AtomicU64,
    pub(crate) points_shaded: AtomicU64,
    pub(crate) grids_hidden: AtomicU64,
    pub(crate) samples: AtomicU64,
    pub(crate) buckets: AtomicU64,
    pub(crate) shade_nanos: AtomicU64,
    pub(crate) dice_nanos: AtomicU64,
    pub(crate) hide_nanos: AtomicU64,
    pub(crate) filter_nanos: AtomicU64,
    pub(crate) bucket_times: Mutex<BucketTimes>,
}

/// The times of the buckets that the threads of a frame rendered.
#[derive(Clone, Debug, Default)]
pub(crate) struct BucketTimes {
    /// The place of each bucket in the order in which they were begun, and its time.
    pub(crate) of_buckets: Vec<(usize, Duration)>,
    /// The time from the first bucket to the end of the last one.
    pub(crate) all: Duration,
}

impl BucketTimes {
    /// Returns the seconds of the buckets, in the order in which they were begun.
    fn in_order(&self) -> Vec<f32> {
        let mut order = self.of_buckets.clone();
        order.sort_unstable();
        order.iter().map(|(_, time)| time.as_secs_f32()).collect()
    }

    /// Returns the time that `threads` threads would take, when each begins the next bucket as soon as it is free.
    fn by(&self, threads: usize) -> Duration {
        let mut ends: BinaryHeap<Reverse<Duration>> = (0..threads).map(|_| Reverse(Duration::ZERO)).collect();
        let mut order = self.of_buckets.clone();
        order.sort_unstable_by_key(|(number, _)| *number);
        let mut last = Duration::ZERO;
        for (_, time) in order {
            let begin = ends.pop().map_or(Duration::ZERO, |Reverse(end)| end);
            last = last.max(begin + time);
            ends.push(Reverse(begin + time));
        }
        last
    }
}

/// Adds to a counter.
pub(crate) fn add(counter: &AtomicU64, n: usize) {
    counter.fetch_add(n as u64, Ordering::Relaxed);
}

/// Adds a time to a counter of nanoseconds.
pub(crate) fn add_time(counter: &AtomicU64, time: Duration) {
    counter.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
}

/// The numbers of threads for which the statistics predict the speed-up.
const MANY_THREADS: [usize; 2] = [16, 64];

/// The statistics of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Statistics {
    pub primitives: u64,
    pub primitives_built: u64,
    /// Primitives that were built for their bound and dropped because they are not in view.
    pub primitives_off_screen: u64,
    /// Primitives that were split because a bucket may see them.
    pub primitives_split: u64,
    /// Visits of buckets to primitives that were hidden.
    pub primitives_hidden: u64,
    /// Pieces of split primitives that are not in view.
    pub pieces_culled: u64,
    pub grids: u64,
    /// Grids whose surface shaders ran.
    pub grids_shaded: u64,
    /// Grids that were diced without surface shaders, because their colours were not requested.
    pub grids_unshaded: u64,
    pub points_shaded: u64,
    /// Visits of buckets to grids that were hidden.
    pub grids_hidden: u64,
    pub samples: u64,
    pub buckets: u64,
    /// Sums over all threads.
    pub shade_time: Duration,
    pub dice_time: Duration,
    pub hide_time: Duration,
    pub filter_time: Duration,
    /// The time from start to end.
    pub frame_time: Duration,
    /// The seconds of each bucket, in the order in which they were begun.
    pub bucket_seconds: Vec<f32>,
    /// The longest time of a bucket.
    pub longest_bucket: Duration,
    /// The time before the first bucket and after the last one.
    pub outside_buckets: Duration,
    /// The largest speed-up over one thread that 16 and 64 threads can reach, from the times of the buckets and the
    /// order in which they are begun. Threads that wait for each other or for memory make it smaller.
    pub speed_ups: [f64; 2],
    pub threads: usize,
    /// What a frame in re-rendering mode took from those before it; `None` for other frames.
    pub reuse: Option<Reuse>,
    /// The passes of an image that is their sum; `None` for other frames. The counts are then those of all passes.
    pub passes: Option<PassReport>,
    /// How the noise of the images was removed; `None` where it was left.
    pub denoised: Option<Denoised>,
}

/// What was done to denoise the images of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Denoised {
    /// The name and the version of the library.
    pub library: String,
    /// The time for the albedo and the normals.
    pub features: Duration,
    /// The time of the library.
    pub filter: Duration,
    /// The largest error of an image without its noise; `None` where none was measured.
    pub error: Option<DenoisedError>,
    /// The largest error that an image would have without its noise, which it keeps because it has the requested error
    /// only with it.
    pub rejected: Option<DenoisedError>,
}

impl Denoised {
    /// Returns the errors for people.
    pub(crate) fn errors(&self) -> String {
        let error = self.error.map(|error| format!("; denoised {}", error.text())).unwrap_or_default();
        let rejected = |error: DenoisedError| format!("; keeps its noise, denoised {}", error.text());
        error + &self.rejected.map(rejected).unwrap_or_default()
    }

    /// Returns a text for people.
    fn text(&self) -> String {
        let [features, filter] = [self.features, self.filter].map(|time| time.as_secs_f64());
        let error = self.error.map(|error| format!("; error {}", error.text())).unwrap_or_default();
        format!("by {}: {filter:.2} s, and {features:.2} s for albedo and normals{error}", self.library)
    }
}

/// What a frame in re-rendering mode took from those before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Reuse {
    /// True when nothing was kept that the frame could use.
    pub is_anew: bool,
    pub lights_changed: u64,
    pub files_changed: u64,
    /// Objects that other lights illuminate than before.
    pub objects_changed: u64,
    pub buckets_kept: u64,
    /// Buckets whose samples see what they saw, and that were composited and filtered with new colours.
    pub buckets_composited: u64,
    /// Batches of grids whose colours stayed.
    pub batches_kept: u64,
    /// Batches of grids whose surface shaders ran again.
    pub batches_shaded: u64,
    /// The bytes that are kept for the next frame: the results of lights.
    pub light_bytes: u64,
    /// The answers to other questions of shaders.
    pub query_bytes: u64,
    /// Grids, before and after they were shaded.
    pub grid_bytes: u64,
    /// What the samples see.
    pub sample_bytes: u64,
}

impl Reuse {
    /// Returns all counts by the names of the fields, for programs.
    pub fn counts(&self) -> [(&'static str, u64); 12] {
        [
            ("anew", u64::from(self.is_anew)),
            ("lights_changed", self.lights_changed),
            ("files_changed", self.files_changed),
            ("objects_changed", self.objects_changed),
            ("buckets_kept", self.buckets_kept),
            ("buckets_composited", self.buckets_composited),
            ("batches_kept", self.batches_kept),
            ("batches_shaded", self.batches_shaded),
            ("light_bytes", self.light_bytes),
            ("query_bytes", self.query_bytes),
            ("grid_bytes", self.grid_bytes),
            ("sample_bytes", self.sample_bytes),
        ]
    }

    /// Returns rows of a table for people.
    fn rows(&self) -> [(&'static str, String); 4] {
        let mb = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
        let changed = match self.is_anew {
            true => "all, the frame is rendered anew".to_owned(),
            false => format!(
                "{} lights, {} files, the lights of {} objects",
                self.lights_changed, self.files_changed, self.objects_changed
            ),
        };
        [
            ("changed since the last frame", changed),
            (
                "  buckets",
                format!("{} kept, {} composited again", self.buckets_kept, self.buckets_composited),
            ),
            (
                "  batches of grids",
                format!("{} kept, {} shaded again", self.batches_kept, self.batches_shaded),
            ),
            (
                "  kept for the next frame",
                format!(
                    "lights {}, other answers {}, grids {}, samples {}",
                    mb(self.light_bytes),
                    mb(self.query_bytes),
                    mb(self.grid_bytes),
                    mb(self.sample_bytes)
                ),
            ),
        ]
    }
}

impl Counters {
    /// Returns the current values of the counters.
    pub(crate) fn statistics(&self, frame_time: Duration, threads: usize) -> Statistics {
        let n = |c: &AtomicU64| c.load(Ordering::Relaxed);
        let time = |c: &AtomicU64| Duration::from_nanos(n(c));
        let times = self.bucket_times.lock();
        let outside_buckets = frame_time.saturating_sub(times.all);
        let seconds = |threads: usize| (outside_buckets + times.by(threads)).as_secs_f64();
        Statistics {
            primitives: n(&self.primitives),
            primitives_built: n(&self.primitives_built),
            primitives_off_screen: n(&self.primitives_off_screen),
            primitives_split: n(&self.primitives_split),
            primitives_hidden: n(&self.primitives_hidden),
            pieces_culled: n(&self.pieces_culled),
            grids: n(&self.grids),
            grids_shaded: n(&self.grids_shaded),
            grids_unshaded: n(&self.grids_unshaded),
            points_shaded: n(&self.points_shaded),
            grids_hidden: n(&self.grids_hidden),
            samples: n(&self.samples),
            buckets: n(&self.buckets),
            shade_time: time(&self.shade_nanos),
            dice_time: time(&self.dice_nanos),
            hide_time: time(&self.hide_nanos),
            filter_time: time(&self.filter_nanos),
            frame_time,
            bucket_seconds: times.in_order(),
            longest_bucket: times.of_buckets.iter().map(|(_, time)| *time).max().unwrap_or_default(),
            outside_buckets,
            speed_ups: MANY_THREADS.map(|threads| seconds(1) / seconds(threads).max(1e-9)),
            threads,
            reuse: None,
            passes: None,
            denoised: None,
        }
    }
}

impl Statistics {
    /// Returns all counts by the names of the fields, for programs.
    pub fn counts(&self) -> [(&'static str, u64); 14] {
        [
            ("threads", self.threads as u64),
            ("buckets", self.buckets),
            ("samples", self.samples),
            ("primitives", self.primitives),
            ("primitives_built", self.primitives_built),
            ("primitives_off_screen", self.primitives_off_screen),
            ("primitives_split", self.primitives_split),
            ("primitives_hidden", self.primitives_hidden),
            ("pieces_culled", self.pieces_culled),
            ("grids", self.grids),
            ("grids_shaded", self.grids_shaded),
            ("grids_unshaded", self.grids_unshaded),
            ("grids_hidden", self.grids_hidden),
            ("points_shaded", self.points_shaded),
        ]
    }

    /// Returns all times by name, in seconds. Those of stages are sums over all threads.
    pub fn seconds(&self) -> [(&'static str, f64); 7] {
        [
            ("frame", self.frame_time.as_secs_f64()),
            ("dice", self.dice_time.as_secs_f64()),
            ("shade", self.shade_time.as_secs_f64()),
            ("hide", self.hide_time.as_secs_f64()),
            ("filter", self.filter_time.as_secs_f64()),
            ("longest_bucket", self.longest_bucket.as_secs_f64()),
            ("outside_buckets", self.outside_buckets.as_secs_f64()),
        ]
    }

    /// Returns a table for people, without a final line break.
    pub fn report(&self, camera: &str) -> String {
        let seconds = |d: Duration| format!("{:.3} s", d.as_secs_f64());
        let unused_primitives = self.primitives_built.saturating_sub(self.primitives_split);
        let [with_16, with_64] = self.speed_ups;
        let rows: [(&str, String); 16] = [
            ("frame", format!("{} with {} threads", seconds(self.frame_time), self.threads)),
            ("buckets", format!("{}, the longest {}", self.buckets, seconds(self.longest_bucket))),
            ("  before the first, after the last", seconds(self.outside_buckets)),
            ("  speed-up with 16, 64 threads", format!("at most {with_16:.1}, {with_64:.1}")),
            ("samples", self.samples.to_string()),
            ("primitives", self.primitives.to_string()),
            ("  not in view", self.primitives_off_screen.to_string()),
            ("  never split", unused_primitives.saturating_sub(self.primitives_off_screen).to_string()),
            ("pieces not in view", self.pieces_culled.to_string()),
            ("grids", self.grids.to_string()),
            ("  shaded", format!("{} ({} points)", self.grids_shaded, self.points_shaded)),
            ("  diced, shading not needed", self.grids_unshaded.to_string()),
            ("  never diced", self.grids.saturating_sub(self.grids_shaded + self.grids_unshaded).to_string()),
            (
                "visits that found all hidden",
                format!("{} of primitives, {} of grids", self.primitives_hidden, self.grids_hidden),
            ),
            (
                "dice + shade, all threads",
                format!("{} + {}", seconds(self.dice_time), seconds(self.shade_time)),
            ),
            (
                "hide + filter, all threads",
                format!("{} + {}", seconds(self.hide_time), seconds(self.filter_time)),
            ),
        ];
        let mut text = format!("Statistics of camera \"{camera}\"");
        let reuse = self.reuse.as_ref().map(Reuse::rows);
        let passes = self.passes.iter().map(|passes| ("passes", passes.text()));
        let denoised = self.denoised.iter().map(|done| ("denoised", done.text()));
        for (what, value) in rows.into_iter().chain(passes).chain(denoised).chain(reuse.into_iter().flatten())
        {
            // Writing to a string does not fail.
            let _ = write!(text, "\n  {what:<34} {value}");
        }
        // The report has the image with the largest error. The others follow.
        let images =
            self.passes.iter().filter(|report| report.images.len() > 1).flat_map(|report| &report.images);
        for (image, error) in images.filter_map(|image| Some((image, image.error.as_ref()?))) {
            let _ = write!(text, "\n    {:<32} {}", image.name, error.text());
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_bucket_at_the_end_limits_the_speed_up() {
        let times = |seconds: &[u64]| BucketTimes {
            of_buckets: seconds
                .iter()
                .copied()
                .enumerate()
                .rev()
                .map(|(k, s)| (k, Duration::from_secs(s)))
                .collect(),
            all: Duration::from_secs(seconds.iter().sum()),
        };
        let by = |seconds: &[u64], threads| times(seconds).by(threads).as_secs();
        assert_eq!(by(&[1, 1, 1, 3], 1), 6);
        assert_eq!(by(&[1, 1, 1, 3], 2), 4);
        assert_eq!(by(&[3, 1, 1, 1], 2), 3);
        assert_eq!(by(&[], 64), 0);
        let counters = Counters { bucket_times: Mutex::new(times(&[1; 64])), ..Counters::default() };
        let statistics = counters.statistics(Duration::from_secs(68), 1);
        assert_eq!(statistics.outside_buckets, Duration::from_secs(4));
        assert_eq!(statistics.speed_ups, [68.0 / 8.0, 68.0 / 5.0]);
    }
}
