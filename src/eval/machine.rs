//! CPU and memory of the machine, as the operating system reports them.

use super::report::MachineReport;
use crate::math::simd::Isa;
use std::fs;
use std::path::Path;

/// Describes the machine: threads of the current pool, CPU, instruction set, and the graphics adapter
/// that renders, if any.
pub fn describe(adapter: Option<String>) -> MachineReport {
    MachineReport {
        threads: rayon::current_num_threads(),
        cpu: cpu_name(),
        simd: Isa::best().name().to_owned(),
        adapter,
    }
}

fn cpu_name() -> String {
    // Systems other than Linux have no such file, and the architecture is named instead.
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}

/// Returns properties of the machine that affect the last bits of results, as JSON. These are the CPU,
/// the system's math library, fused multiply-add, and the build profile.
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

/// Returns the peak resident memory of this process in bytes, or `None` if unavailable.
pub fn peak_rss_bytes() -> Option<u64> {
    file_bytes("/proc/self/status", "VmHWM:")
}

/// Returns the current resident memory of this process in bytes, or `None` if unavailable.
pub fn rss_bytes() -> Option<u64> {
    file_bytes("/proc/self/status", "VmRSS:")
}

/// Returns the memory available to this process without swapping, in bytes, or `None` if unavailable.
/// Limits of the process and of its container are respected.
pub fn available_bytes() -> Option<u64> {
    let free = file_bytes("/proc/meminfo", "MemAvailable:");
    let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let left = available_in_groups(&groups, Path::new("/sys/fs/cgroup"));
    let limits = fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    free.into_iter().chain(left).chain(available_in_limits(&limits, &status)).min()
}

/// Returns the memory that this process can hold in total, in bytes: what it holds and what is available.
/// `None` if unavailable.
pub fn obtainable_bytes() -> Option<u64> {
    Some(available_bytes()?.saturating_add(rss_bytes()?))
}

/// Returns the bytes left under the limits of address space and of data (`ulimit -v` and `-d`), `None`
/// without a limit. The texts are those of `/proc/self/limits` and `/proc/self/status`.
fn available_in_limits(limits: &str, status: &str) -> Option<u64> {
    let kinds = [("Max address space", "VmSize:"), ("Max data size", "VmData:")];
    let left = |(limit, used): (&str, &str)| {
        let soft = limits.lines().find_map(|line| line.strip_prefix(limit))?;
        // `unlimited` does not parse.
        let soft: u64 = soft.split_whitespace().next()?.parse().ok()?;
        Some(soft.saturating_sub(bytes_in(status, used)?))
    };
    kinds.into_iter().filter_map(left).min()
}

fn file_bytes(path: &str, field: &str) -> Option<u64> {
    bytes_in(&fs::read_to_string(path).ok()?, field)
}

fn bytes_in(text: &str, field: &str) -> Option<u64> {
    // A number and its unit, which the kernel always writes as `kB` and means as KiB.
    let value = text.lines().find_map(|line| line.strip_prefix(field))?;
    let kilobytes: u64 = value.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}

/// Files with memory limit and usage in cgroup version 1, and the field of `memory.stat` with
/// reclaimable memory. The next constant is for version 2.
const V1: [&str; 3] = ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"];
const V2: [&str; 3] = ["memory.max", "memory.current", "inactive_file"];

/// Returns the bytes available under the tightest limit of the process's cgroups, version 1 or 2.
/// Returns `None` if there is no limit. `groups` is the content of `/proc/self/cgroup`, `root` the
/// cgroup mount point.
fn available_in_groups(groups: &str, root: &Path) -> Option<u64> {
    let of_line = |line: &str| {
        // A line is `id:controllers:path`, without controllers in version 2.
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, group) = (fields.next()?, fields.next()?.trim_start_matches('/'));
        let is_memory = controllers.split(',').any(|name| name == "memory");
        let (top, names) = match (controllers.is_empty(), is_memory) {
            (true, _) => (root.to_owned(), V2),
            (_, true) => (root.join("memory"), V1),
            _ => return None,
        };
        // Limits of all ancestor groups apply as well; in a container the path may not exist at all.
        let below = top.join(group);
        let all = below.ancestors().take_while(|path| path.starts_with(&top));
        all.filter_map(|path| available_in_group(path, names)).min()
    };
    groups.lines().filter_map(of_line).min()
}

fn available_in_group(group: &Path, [limit, used, reclaimable]: [&str; 3]) -> Option<u64> {
    let number = |name: &str| fs::read_to_string(group.join(name)).ok()?.trim().parse::<u64>().ok();
    // `max` does not parse: no limit.
    let (limit, used) = (number(limit)?, number(used)?);
    let stat = fs::read_to_string(group.join("memory.stat")).unwrap_or_default();
    let field = |line: &str| line.strip_prefix(reclaimable)?.trim().parse::<u64>().ok();
    // The kernel frees pages of the file cache before it refuses memory, so they count as available.
    let reclaimable = stat.lines().find_map(field).unwrap_or(0);
    // Usage and limit are read one after the other, so usage may be the larger.
    Some(limit.saturating_sub(used.saturating_sub(reclaimable)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(root: &Path, files: &[(&str, &str)]) {
        for (name, text) in files {
            let path = root.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
    }

    #[test]
    fn limits_of_the_process_count() {
        let status = "VmPeak:\t  9 kB\nVmSize:\t  1000 kB\nVmData:\t   100 kB\n";
        let limits = |space: &str, data: &str| {
            let text = format!(
                "Max data size             {data}            unlimited            bytes     \nMax address space         {space}            unlimited            bytes     \n"
            );
            available_in_limits(&text, status)
        };
        assert_eq!(limits("unlimited", "unlimited"), None);
        assert_eq!(limits("2048000", "unlimited"), Some(1_024_000));
        assert_eq!(limits("2048000", "204800"), Some(102_400));
        assert_eq!(limits("1000", "unlimited"), Some(0), "a limit set below what is in use");
    }

    #[test]
    fn the_tightest_group_of_either_version_counts() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        assert_eq!(available_in_groups("0::/a/b\n", root), None, "no files");
        written(root, &[("a/b/memory.max", "max\n"), ("a/b/memory.current", "5000\n")]);
        assert_eq!(available_in_groups("0::/a/b\n", root), None, "no limit");
        written(
            root,
            &[
                ("a/memory.max", "9000\n"),
                ("a/memory.current", "6000\n"),
                ("a/memory.stat", "anon 5000\ninactive_file 500\nactive_file 1\n"),
            ],
        );
        assert_eq!(available_in_groups("0::/a/b\n", root), Some(3500));
        // A container sees its own group at the root, regardless of the stated path.
        written(root, &[("memory.max", "2000"), ("memory.current", "1500")]);
        assert_eq!(available_in_groups("0::/not/here\n", root), Some(500));
        let v1 = "7:cpu:/x\n3:memory:/job\n";
        assert_eq!(available_in_groups(v1, root), None);
        written(
            root,
            &[
                ("memory/job/memory.limit_in_bytes", "800"),
                ("memory/job/memory.usage_in_bytes", "900"),
                ("memory/job/memory.stat", "total_inactive_file 300\n"),
            ],
        );
        assert_eq!(available_in_groups(v1, root), Some(200));
        assert_eq!(available_in_groups(&format!("{v1}0::/a\n"), root), Some(200));
    }
}
