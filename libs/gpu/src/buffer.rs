//! Buffers, and data in several of them.

use crate::device::Counters;
use crate::{Device, GpuError};
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use wgpu::BufferUsages;

/// A buffer of the device. Its memory is counted until it is dropped.
#[derive(Debug)]
pub struct Buffer {
    raw: wgpu::Buffer,
    bytes: u64,
    counters: Arc<Counters>,
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.counters.bytes.fetch_sub(self.bytes, Ordering::Relaxed);
        self.raw.destroy();
    }
}

impl Buffer {
    /// Makes a buffer of words that are zero. `what` names it in errors.
    ///
    /// # Errors
    /// Returns an error when the buffer is larger than a binding, the memory is used up or the device is lost.
    pub fn zeroed(device: &Device, what: &'static str, words: u64) -> Result<Self, GpuError> {
        let bytes = words.max(4).saturating_mul(4);
        if bytes > device.limits().binding_bytes {
            return Err(GpuError::Limit { what, asked: bytes, most: device.limits().binding_bytes });
        }
        Self::new(
            device,
            what,
            bytes,
            BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        )
    }

    /// Makes a buffer with these words, which may be longer than they. The rest is zero.
    ///
    /// # Errors
    /// Returns the errors of [`Buffer::zeroed`].
    pub fn of(device: &Device, what: &'static str, words: &[u32]) -> Result<Self, GpuError> {
        let buffer = Self::zeroed(device, what, words.len() as u64)?;
        buffer.write(device, words)?;
        Ok(buffer)
    }

    /// Replaces the first words.
    ///
    /// # Errors
    /// Returns an error when the buffer is shorter, or the device is lost.
    pub fn write(&self, device: &Device, words: &[u32]) -> Result<(), GpuError> {
        let asked = words.len() as u64 * 4;
        if asked > self.bytes {
            return Err(GpuError::Limit { what: "bytes of a buffer", asked, most: self.bytes });
        }
        device.check()?;
        device
            .scoped(|| device.queue.write_buffer(&self.raw, 0, bytemuck::cast_slice(words)))
            .map_err(|error| device.check().err().unwrap_or(GpuError::Failed { what: error.to_string() }))
    }

    /// Returns the first words.
    ///
    /// # Errors
    /// Returns an error when the device is lost, or there is no memory for the copy.
    pub fn read(&self, device: &Device, words: usize) -> Result<Vec<u32>, GpuError> {
        device.check()?;
        if words == 0 {
            return Ok(Vec::new());
        }
        let bytes = words as u64 * 4;
        let staging =
            Self::new(device, "bytes of results", bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST)?;
        let mapped = Arc::new(Mutex::new(None));
        let answer = mapped.clone();
        let done = device.scoped(|| {
            let mut encoder = device.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&self.raw, 0, &staging.raw, 0, Some(bytes));
            device.queue.submit([encoder.finish()]);
            staging.raw.map_async(wgpu::MapMode::Read, .., move |result| *answer.lock() = Some(result));
        });
        done.map_err(|error| device.failure(error.to_string()))?;
        device.wait()?;
        if !matches!(*mapped.lock(), Some(Ok(()))) {
            return Err(device.failure("the result of a kernel cannot be read".to_owned()));
        }
        let view = staging.raw.get_mapped_range(..).map_err(|error| device.failure(error.to_string()))?;
        Ok(bytemuck::pod_collect_to_vec(&view[..]))
    }

    pub(crate) fn new_stamps(device: &Device) -> Result<Self, GpuError> {
        Self::new(device, "time stamps", 16, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC)
    }

    fn new(device: &Device, what: &'static str, bytes: u64, usage: BufferUsages) -> Result<Self, GpuError> {
        device.check()?;
        device.reserve(what, bytes)?;
        let descriptor =
            wgpu::BufferDescriptor { label: Some(what), size: bytes, usage, mapped_at_creation: false };
        match device.scoped(|| device.device.create_buffer(&descriptor)) {
            Ok(raw) => Ok(Self { raw, bytes, counters: device.counters.clone() }),
            Err(error) => {
                let used = device.counters.bytes.fetch_sub(bytes, Ordering::Relaxed) - bytes;
                let memory = GpuError::Memory { what, asked: bytes, used };
                let is_memory = matches!(error, wgpu::Error::OutOfMemory { .. });
                let failed = GpuError::Failed { what: error.to_string() };
                Err(device.check().err().unwrap_or(if is_memory { memory } else { failed }))
            }
        }
    }

    pub(crate) fn raw(&self) -> &wgpu::Buffer {
        &self.raw
    }

    /// The number of bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Records of equal size in as many buffers as they need, because a binding is limited. The number of records of each
/// page but the last is the same power of two.
#[derive(Debug)]
pub struct Pages {
    buffers: Vec<Buffer>,
    /// The binary logarithm of the number of records of a page.
    shift: u32,
}

impl Pages {
    /// Stores records of `width` words each. There is at least one page.
    ///
    /// # Errors
    /// Returns an error when a binding does not hold one record, the memory is used up or the device is lost.
    pub fn of(device: &Device, what: &'static str, words: &[u32], width: usize) -> Result<Self, GpuError> {
        let most = device.limits().binding_bytes;
        let record = width.max(1) as u64 * 4;
        let Some(shift) = (most / record).min(1 << 31).checked_ilog2() else {
            return Err(GpuError::Limit { what, asked: record, most });
        };
        let page = (1_usize << shift).saturating_mul(width.max(1));
        let mut buffers = Vec::new();
        for part in words.chunks(page) {
            buffers.push(Buffer::of(device, what, part)?);
        }
        if buffers.is_empty() {
            buffers.push(Buffer::of(device, what, &[])?);
        }
        Ok(Self { buffers, shift })
    }

    /// The buffers.
    pub fn buffers(&self) -> &[Buffer] {
        &self.buffers
    }

    /// The binary logarithm of the number of records of a page.
    pub fn shift(&self) -> u32 {
        self.shift
    }

    /// The number of bytes.
    pub fn bytes(&self) -> u64 {
        self.buffers.iter().map(Buffer::bytes).sum()
    }
}
