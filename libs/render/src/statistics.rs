//! What a frame did, what it could leave out, and what that cost.

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
}

/// Adds to a counter.
pub(crate) fn add(counter: &AtomicU64, n: usize) {
    counter.fetch_add(n as u64, Ordering::Relaxed);
}

/// Adds a time to a counter of nanoseconds.
pub(crate) fn add_time(counter: &AtomicU64, time: Duration) {
    counter.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
}

/// What a frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Statistics {
    pub primitives: u64,
    pub primitives_built: u64,
    /// Built for their bound, and dropped because they are not in view.
    pub primitives_off_screen: u64,
    /// Split because a bucket may see them.
    pub primitives_split: u64,
    /// Visits of primitives by buckets that found them hidden.
    pub primitives_hidden: u64,
    /// Pieces of split primitives that are not in view.
    pub pieces_culled: u64,
    pub grids: u64,
    /// Grids whose surface shaders ran.
    pub grids_shaded: u64,
    /// Grids that were diced without running surface shaders, which nobody wanted.
    pub grids_unshaded: u64,
    pub points_shaded: u64,
    /// Visits of grids by buckets that found them hidden.
    pub grids_hidden: u64,
    pub samples: u64,
    pub buckets: u64,
    /// Sums over all threads.
    pub shade_time: Duration,
    pub dice_time: Duration,
    pub hide_time: Duration,
    pub filter_time: Duration,
    /// From beginning to end.
    pub frame_time: Duration,
    pub threads: usize,
}

impl Counters {
    /// The counters as they stand.
    pub(crate) fn statistics(&self, frame_time: Duration, threads: usize) -> Statistics {
        let n = |c: &AtomicU64| c.load(Ordering::Relaxed);
        let time = |c: &AtomicU64| Duration::from_nanos(n(c));
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
            threads,
        }
    }
}

/// What shading a frame looked up and built, for all its cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct ShadingStatistics {
    pub rays: u64,
    /// Of them, rays that only ask whether anything is in the way.
    pub shadow_rays: u64,
    pub ray_hits_shaded: u64,
    /// Geometry sets that rays could have asked for.
    pub ray_structures: u64,
    /// Of them, those that were asked for and built.
    pub ray_structures_built: u64,
    /// Triangles that there were for rays at the end.
    pub ray_triangles: u64,
    /// What structures for rays took in memory at the end, with all that hits are shaded from.
    pub ray_bytes: u64,
    /// Parts of primitives that were tessellated for rays, those made again included.
    pub ray_tessellations: u64,
    /// Of them, those given up to make room for others.
    pub ray_tessellations_given_up: u64,
    /// Most bytes of tessellations held at once.
    pub ray_tessellation_bytes_peak: u64,
    /// Points whose indirect light or occlusion was sampled.
    pub light_records: u64,
    /// Rays of those.
    pub light_rays: u64,
    /// Points of grids that took indirect light or occlusion from records.
    pub light_points: u64,
    pub texture_files: u64,
    /// Files that were no MIP maps.
    pub texture_automipmaps: u64,
    pub texture_lookups: u64,
    /// Times a thread asked the cache for a tile that it did not have at hand.
    pub texture_tile_requests: u64,
    /// Of them, those for tiles that the cache did not have either.
    pub texture_tiles_read: u64,
    pub texture_bytes_read: u64,
    /// Most bytes of tiles held at once.
    pub texture_bytes_peak: u64,
}

impl ShadingStatistics {
    /// All counts by the names of the fields, for machines.
    pub fn counts(&self) -> [(&'static str, u64); 20] {
        [
            ("rays", self.rays),
            ("shadow_rays", self.shadow_rays),
            ("ray_hits_shaded", self.ray_hits_shaded),
            ("ray_structures", self.ray_structures),
            ("ray_structures_built", self.ray_structures_built),
            ("ray_triangles", self.ray_triangles),
            ("ray_bytes", self.ray_bytes),
            ("ray_tessellations", self.ray_tessellations),
            ("ray_tessellations_given_up", self.ray_tessellations_given_up),
            ("ray_tessellation_bytes_peak", self.ray_tessellation_bytes_peak),
            ("light_records", self.light_records),
            ("light_rays", self.light_rays),
            ("light_points", self.light_points),
            ("texture_files", self.texture_files),
            ("texture_automipmaps", self.texture_automipmaps),
            ("texture_lookups", self.texture_lookups),
            ("texture_tile_requests", self.texture_tile_requests),
            ("texture_tiles_read", self.texture_tiles_read),
            ("texture_bytes_read", self.texture_bytes_read),
            ("texture_bytes_peak", self.texture_bytes_peak),
        ]
    }

    /// A table for people, without a final line break.
    pub fn report(&self) -> String {
        let kb = |bytes: u64| bytes / 1024;
        let rows = [
            ("rays", self.rays.to_string()),
            ("  shadow rays", self.shadow_rays.to_string()),
            ("  hits shaded", self.ray_hits_shaded.to_string()),
            (
                "  structures built",
                format!(
                    "{} of {} ({} triangles, {} KB)",
                    self.ray_structures_built,
                    self.ray_structures,
                    self.ray_triangles,
                    kb(self.ray_bytes)
                ),
            ),
            (
                "  tessellations made",
                format!(
                    "{} ({} given up, at most {} KB at once)",
                    self.ray_tessellations,
                    self.ray_tessellations_given_up,
                    kb(self.ray_tessellation_bytes_peak)
                ),
            ),
            (
                "indirect light, occlusion",
                format!(
                    "{} records of {} rays for {} points",
                    self.light_records, self.light_rays, self.light_points
                ),
            ),
            (
                "texture files",
                format!("{} ({} made into MIP maps)", self.texture_files, self.texture_automipmaps),
            ),
            ("  lookups", self.texture_lookups.to_string()),
            (
                "  tiles asked for",
                format!(
                    "{}, {} not there and read ({} KB, at most {} KB at once)",
                    self.texture_tile_requests,
                    self.texture_tiles_read,
                    kb(self.texture_bytes_read),
                    kb(self.texture_bytes_peak)
                ),
            ),
        ];
        rows.iter().map(|(what, value)| format!("  {what:<34} {value}")).collect::<Vec<_>>().join("\n")
    }
}

impl Statistics {
    /// All counts by the names of the fields, for machines.
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

    /// All times by name, in seconds; those of stages are sums over all threads.
    pub fn seconds(&self) -> [(&'static str, f64); 5] {
        [
            ("frame", self.frame_time.as_secs_f64()),
            ("dice", self.dice_time.as_secs_f64()),
            ("shade", self.shade_time.as_secs_f64()),
            ("hide", self.hide_time.as_secs_f64()),
            ("filter", self.filter_time.as_secs_f64()),
        ]
    }

    /// A table for people, without a final line break.
    pub fn report(&self, camera: &str) -> String {
        let seconds = |d: Duration| format!("{:.3} s", d.as_secs_f64());
        let unused_primitives = self.primitives_built.saturating_sub(self.primitives_split);
        let rows: [(&str, String); 14] = [
            ("frame", format!("{} with {} threads", seconds(self.frame_time), self.threads)),
            ("buckets", self.buckets.to_string()),
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
        for (what, value) in rows {
            // Writing to a string does not fail.
            let _ = write!(text, "\n  {what:<34} {value}");
        }
        text
    }
}
