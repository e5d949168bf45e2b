//! An open device: its limits, memory, errors and time.

use crate::GpuError;
use crate::adapter::{self, Adapter, Choice};
use crate::native::{self, FloatModes};
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Limits below those of the adapter. Tests force the paths of small adapters with them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The largest number of bytes of one binding of a buffer.
    pub binding_bytes: u64,
    /// The largest number of buffers that a kernel uses.
    pub bindings: u32,
    /// The largest number of bytes of all buffers.
    pub memory_bytes: u64,
    /// The largest number of rays, points or inputs of one run of a kernel.
    pub batch: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self { binding_bytes: u64::MAX, bindings: u32::MAX, memory_bytes: u64::MAX, batch: 1 << 22 }
    }
}

/// The work of a device so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GpuStatistics {
    /// The number of bytes of all buffers.
    pub bytes: u64,
    /// The largest number of bytes of all buffers at one time.
    pub peak_bytes: u64,
    /// The number of runs of kernels.
    pub runs: u64,
    /// The time of the runs on the device, in seconds; 0 when the device does not measure time.
    pub seconds: f64,
}

/// The counters behind [`GpuStatistics`].
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) bytes: AtomicU64,
    peak: AtomicU64,
    runs: AtomicU64,
    nanoseconds: AtomicU64,
}

/// What the driver reports by itself.
#[derive(Debug, Default)]
struct Reports {
    lost: Option<String>,
    error: Option<GpuError>,
}

/// An open device. It is shared between threads.
#[derive(Debug)]
pub struct Device {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    adapter: Adapter,
    limits: Limits,
    pub(crate) modes: FloatModes,
    pub(crate) counters: Arc<Counters>,
    reports: Arc<Mutex<Reports>>,
    /// The length of a tick of the clock, in nanoseconds.
    tick: f32,
}

impl Device {
    /// Opens the device of a choice; `None` when no device is to be used, or [`Choice::Auto`] finds none.
    ///
    /// # Errors
    /// Returns an error when there is no adapter of the chosen number, when it cannot run kernels, or when the driver
    /// does not open it.
    pub fn open(choice: Choice, limits: Limits) -> Result<Option<Arc<Self>>, GpuError> {
        let Some((raw, adapter)) = adapter::choose(choice)? else { return Ok(None) };
        if !adapter.abilities.own_modules {
            return Err(GpuError::Unsupported { adapter: adapter.name, what: "own modules".to_owned() });
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("granita"),
            required_features: adapter.abilities.features(),
            required_limits: raw.limits(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(raw.request_device(&descriptor))
            .map_err(|error| GpuError::Failed { what: format!("adapter \"{}\": {error}", adapter.name) })?;
        let reports = Arc::new(Mutex::new(Reports::default()));
        let lost = reports.clone();
        device.set_device_lost_callback(move |reason, text| {
            lost.lock().lost.get_or_insert(if text.is_empty() { format!("{reason:?}") } else { text });
        });
        let errors = reports.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let error = GpuError::Failed { what: error.to_string() };
            errors.lock().error.get_or_insert(error);
        }));
        let limits = Limits {
            binding_bytes: limits.binding_bytes.min(adapter.binding_bytes).min(adapter.buffer_bytes),
            bindings: limits.bindings.min(adapter.bindings),
            batch: limits.batch.clamp(1, 1 << 22),
            ..limits
        };
        let tick = if adapter.abilities.time_stamps { queue.get_timestamp_period() } else { 0.0 };
        let modes = native::float_modes(&raw);
        let counters = Arc::default();
        Ok(Some(Arc::new(Self { device, queue, adapter, limits, modes, counters, reports, tick })))
    }

    /// The description of the adapter.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The limits: the lesser ones of the adapter and of those given to [`Device::open`].
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Returns the work so far.
    pub fn statistics(&self) -> GpuStatistics {
        GpuStatistics {
            bytes: self.counters.bytes.load(Ordering::Relaxed),
            peak_bytes: self.counters.peak.load(Ordering::Relaxed),
            runs: self.counters.runs.load(Ordering::Relaxed),
            seconds: self.counters.nanoseconds.load(Ordering::Relaxed) as f64 * 1e-9,
        }
    }

    /// Destroys the device, as if the driver had lost it. All work on it fails from now on. Tests use it.
    pub fn lose(&self) {
        self.reports.lock().lost.get_or_insert("it was destroyed".to_owned());
        self.device.destroy();
    }

    /// Returns the error that the driver reported, if any. A device with an error stays unusable.
    ///
    /// # Errors
    /// Returns the loss of the device, or the first error that no call returned.
    pub fn check(&self) -> Result<(), GpuError> {
        let reports = self.reports.lock();
        if let Some(what) = &reports.lost {
            return Err(GpuError::Lost { what: what.clone() });
        }
        reports.error.clone().map_or(Ok(()), Err)
    }

    /// Runs `work`, and returns the error that the driver reports for it.
    pub(crate) fn scoped<T>(&self, work: impl FnOnce() -> T) -> Result<T, wgpu::Error> {
        let scopes =
            [wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation]
                .map(|filter| self.device.push_error_scope(filter));
        let out = work();
        // Scopes are popped in the reverse order.
        let [memory, internal, validation] = scopes;
        for scope in [validation, internal, memory] {
            if let Some(error) = pollster::block_on(scope.pop()) {
                return Err(error);
            }
        }
        Ok(out)
    }

    /// Counts the memory of a new buffer.
    ///
    /// # Errors
    /// Returns an error when all buffers would take more than the limit.
    pub(crate) fn reserve(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        let used = self.counters.bytes.fetch_add(bytes, Ordering::Relaxed);
        if used.saturating_add(bytes) > self.limits.memory_bytes {
            self.counters.bytes.fetch_sub(bytes, Ordering::Relaxed);
            return Err(GpuError::Memory { what, asked: bytes, used });
        }
        self.counters.peak.fetch_max(used + bytes, Ordering::Relaxed);
        Ok(())
    }

    /// Counts a run of a kernel. Returns its time in seconds; 0 when the device does not measure time.
    pub(crate) fn count(&self, ticks: Option<u64>) -> f64 {
        self.counters.runs.fetch_add(1, Ordering::Relaxed);
        let nanoseconds = ticks.map_or(0.0, |ticks| ticks as f64 * f64::from(self.tick));
        self.counters.nanoseconds.fetch_add(nanoseconds as u64, Ordering::Relaxed);
        nanoseconds * 1e-9
    }

    /// Returns the loss of the device if it is the cause of a failure.
    pub(crate) fn failure(&self, what: String) -> GpuError {
        self.check().err().unwrap_or(GpuError::Failed { what })
    }

    /// Waits for all work.
    pub(crate) fn wait(&self) -> Result<(), GpuError> {
        if let Err(error) = self.device.poll(wgpu::PollType::wait_indefinitely()) {
            return Err(self.failure(error.to_string()));
        }
        self.check()
    }
}
