//! What the process says about itself.

/// Memory that the process holds now (resident set), bytes; 0 where the system does not tell.
pub fn resident_bytes() -> u64 {
    // The second number of statm is the resident set in pages of 4 KiB (proc_pid_statm(5)).
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = statm.split_whitespace().nth(1).and_then(|n| n.parse::<u64>().ok());
    pages.unwrap_or(0) * 4096
}
