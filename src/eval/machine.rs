//! Properties of the machine.

use super::control_group;
use super::report::MachineReport;
use crate::math::simd::Isa;
use std::fs;
use std::path::Path;

/// Threads of the current pool, processor, instruction set, and the graphics adapter that renders, if any.
pub fn describe(adapter: Option<String>) -> MachineReport {
    MachineReport {
        threads: rayon::current_num_threads(),
        cpu: cpu_name(),
        simd: Isa::best().name().to_owned(),
        adapter,
    }
}

/// Name of the processor as reported by the system, else its architecture.
fn cpu_name() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

/// Properties that determine the last bits of results besides the settings, as JSON: processor, math
/// library of the system, fused multiply-add, and build profile.
pub fn numerics() -> String {
    let numerics = serde_json::json!({
        "arch": std::env::consts::ARCH,
        "os": std::env::consts::OS,
        "fma": cfg!(target_feature = "fma"),
        "avx2": cfg!(target_feature = "avx2"),
        "profile": if cfg!(debug_assertions) { "debug" } else { "release" },
    });
    numerics.to_string()
}

/// Peak resident memory of this process, bytes; `None` if unavailable.
pub fn peak_rss_bytes() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// Current resident memory of this process, bytes; `None` if unavailable.
pub fn rss_bytes() -> Option<u64> {
    status_bytes("VmRSS:")
}

/// Memory available to this process without swapping, bytes, within the limits of its container; `None` if
/// unavailable.
pub fn available_bytes() -> Option<u64> {
    let free = file_bytes("/proc/meminfo", "MemAvailable:");
    let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let left = control_group::available_bytes(&groups, Path::new("/sys/fs/cgroup"));
    free.into_iter().chain(left).min()
}

fn status_bytes(field: &str) -> Option<u64> {
    file_bytes("/proc/self/status", field)
}

fn file_bytes(path: &str, field: &str) -> Option<u64> {
    let text = fs::read_to_string(path).ok()?;
    let value = text.lines().find_map(|line| line.strip_prefix(field))?;
    let kilobytes: u64 = value.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}
