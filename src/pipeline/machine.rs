//! What the machine says about itself.

use crate::eval::report::MachineReport;
use std::fs;

/// Threads of the current pool, processor, and the graphics adapter that draws, if any.
pub fn describe(adapter: Option<String>) -> MachineReport {
    MachineReport { threads: rayon::current_num_threads(), cpu: cpu_name(), adapter }
}

/// Name of the processor as the system gives it, else its architecture.
fn cpu_name() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

/// Largest resident memory of this process so far, bytes; `None` where the system does not tell.
pub fn peak_rss_bytes() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// Resident memory of this process now, bytes; `None` where the system does not tell.
pub fn rss_bytes() -> Option<u64> {
    status_bytes("VmRSS:")
}

fn status_bytes(field: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let value = status.lines().find_map(|line| line.strip_prefix(field))?;
    let kilobytes: u64 = value.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}
