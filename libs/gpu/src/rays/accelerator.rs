//! A device that traces the rays of frames.

use super::{GpuTracer, Traced};
use crate::{Device, GpuError, GpuStatistics};
use granita_base::Reporter;
use granita_trace::{Accelerator, Hit, Ray, Tracer, TracerCopy};
use parking_lot::Mutex;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Smaller batches are traced by the CPU. The device needs some hundred microseconds for any batch.
const LEAST_RAYS: usize = 1 << 12;

/// A device that traces large batches of rays against triangles that do not move. Hits are those of the CPU. When the
/// device fails, the frame is finished by the CPU, with one warning.
#[derive(Clone)]
pub struct GpuAccelerator(Arc<Shared>);

struct Shared {
    device: Arc<Device>,
    reporter: Reporter,
    /// Set when the device failed.
    failed: AtomicBool,
    traced: Mutex<Traced>,
}

impl fmt::Debug for GpuAccelerator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("GpuAccelerator").field(&self.0.device.adapter().name).finish()
    }
}

impl GpuAccelerator {
    /// Returns an accelerator that warns by `reporter` when the device fails.
    pub fn new(device: Arc<Device>, reporter: Reporter) -> Self {
        let (failed, traced) = (AtomicBool::new(false), Mutex::default());
        Self(Arc::new(Shared { device, reporter, failed, traced }))
    }

    /// Returns the rays so far.
    pub fn traced(&self) -> Traced {
        *self.0.traced.lock()
    }

    /// Returns the work of the device so far.
    pub fn statistics(&self) -> GpuStatistics {
        self.0.device.statistics()
    }
}

impl Shared {
    /// Counts rays, or warns. Returns whether they were traced.
    fn take(&self, result: Result<Traced, GpuError>) -> bool {
        match result {
            Ok(more) => {
                let mut traced = self.traced.lock();
                traced.rays += more.rays;
                traced.by_cpu += more.by_cpu;
                traced.seconds += more.seconds;
                true
            }
            Err(error) => {
                self.fail(&error);
                false
            }
        }
    }

    fn fail(&self, error: &GpuError) {
        if !self.failed.swap(true, Ordering::Relaxed) {
            let name = &self.device.adapter().name;
            self.reporter.warning(format!("-gpu: {name}: {error}; the CPU traces the rays"));
        }
    }

    fn takes(&self, rays: usize) -> bool {
        rays >= LEAST_RAYS && !self.failed.load(Ordering::Relaxed)
    }
}

impl Accelerator for GpuAccelerator {
    fn copy(&self, tracer: &Arc<Tracer>) -> Option<Box<dyn TracerCopy>> {
        if self.0.failed.load(Ordering::Relaxed) {
            return None;
        }
        match GpuTracer::new(self.0.device.clone(), tracer.clone()) {
            Ok(resident) => Some(Box::new(Copied { shared: self.0.clone(), resident })),
            // The CPU traces sets that move, and trees that are too large.
            Err(GpuError::Unsupported { .. }) => None,
            Err(error @ (GpuError::Memory { .. } | GpuError::Limit { .. })) => {
                let name = &self.0.device.adapter().name;
                self.0.reporter.info(format!("-gpu: {name}: {error}; the CPU traces this set"));
                None
            }
            Err(error) => {
                self.0.fail(&error);
                None
            }
        }
    }

    fn report(&self) -> String {
        let (traced, work) = (self.traced(), self.statistics());
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        format!(
            "  {:<34} {} rays in {} runs, {:.3} s there, {:.1} MiB at most, {:.1} MiB now\n",
            format!("gpu {}", self.0.device.adapter().name),
            traced.rays,
            work.runs,
            traced.seconds,
            mib(work.peak_bytes),
            mib(work.bytes)
        )
    }
}

/// The triangles of a set on the device.
struct Copied {
    shared: Arc<Shared>,
    resident: GpuTracer,
}

impl fmt::Debug for Copied {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Copied").field(&self.resident.bytes()).finish()
    }
}

impl TracerCopy for Copied {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) -> bool {
        self.shared.takes(rays.len()) && self.shared.take(self.resident.closest(rays, hits))
    }

    fn any(&self, rays: &[Ray], blocked: &mut [bool]) -> bool {
        self.shared.takes(rays.len()) && self.shared.take(self.resident.any(rays, blocked))
    }
}
