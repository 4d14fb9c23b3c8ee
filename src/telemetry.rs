//! What the process says about itself: logs, memory, times.

mod histogram;
mod log;
#[cfg(feature = "otel")]
mod otel;

pub use histogram::{BOUNDS_S, Distribution, Histogram};
pub use log::{check_log, end_log, log_as, log_to_stderr, set_log_level};

/// Memory that the process holds now (resident set), bytes; 0 where the system does not tell.
pub fn resident_bytes() -> u64 {
    // The second number of statm is the resident set in pages of 4 KiB (proc_pid_statm(5)).
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = statm.split_whitespace().nth(1).and_then(|n| n.parse::<u64>().ok());
    pages.unwrap_or(0) * 4096
}

/// The most memory that the process has held so far (resident set), bytes; 0 where the system does
/// not tell.
pub fn peak_resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
