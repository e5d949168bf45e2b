//! The memory of the machine and of this process.

/// Returns the value of a line of a system file, in bytes.
fn line(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Returns the memory of the machine, in bytes; `None` where the system does not report it.
pub(crate) fn installed_bytes() -> Option<u64> {
    line("/proc/meminfo", "MemTotal")
}

/// Returns the peak memory of this process so far, in bytes; `None` where the system does not report it.
pub(crate) fn peak_bytes() -> Option<u64> {
    line("/proc/self/status", "VmHWM")
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn installed_and_peak_memory_are_measured() {
        let (installed, peak) = (installed_bytes().unwrap(), peak_bytes().unwrap());
        assert!(peak > 100_000 && installed > peak);
        assert_eq!(line("/proc/nothing", "X"), None);
    }
}
