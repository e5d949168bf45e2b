//! The errors of devices.

/// An error of a device. Callers go on without the device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// No adapter fits the choice.
    #[error("{what}")]
    NoAdapter {
        /// The reason.
        what: String,
    },
    /// The adapter lacks something that the work needs.
    #[error("adapter \"{adapter}\" has no {what}")]
    Unsupported {
        /// The name of the adapter.
        adapter: String,
        /// The missing feature.
        what: String,
    },
    /// The work is larger than a limit of the adapter.
    #[error("{what}: {asked} are more than the {most} of this adapter")]
    Limit {
        /// The quantity, with its unit.
        what: &'static str,
        /// The requested number.
        asked: u64,
        /// The limit.
        most: u64,
    },
    /// The memory of the device is used up.
    #[error("{what}: no memory of the device is left for {asked} bytes, beside {used} bytes that are used")]
    Memory {
        /// The purpose of the memory.
        what: &'static str,
        /// The requested number of bytes.
        asked: u64,
        /// The number of bytes of this device that are in use.
        used: u64,
    },
    /// The device was lost: its driver was reset or removed, or the device was destroyed.
    #[error("the device was lost: {what}")]
    Lost {
        /// The reason that the driver reports.
        what: String,
    },
    /// The driver, or the translation of a kernel, reports an error.
    #[error("{what}")]
    Failed {
        /// The report.
        what: String,
    },
}
