//! The memory that this process can still get: the minimum of what the machine, the control groups
//! and the limits of the process leave.

use std::fs::read_to_string;
use std::path::{Component, Path, PathBuf};

use crate::process::{kib, left_by_limits};

/// Returns the number of bytes that the process can still get without swapping. `None` if it cannot
/// be determined.
pub fn available_bytes() -> Option<u64> {
    available(Path::new("/"), false)
}

/// Returns the number of bytes that the process can still get, including free swap.
pub fn available_bytes_and_swap() -> Option<u64> {
    available(Path::new("/"), true)
}

/// Returns the number of bytes that the process can still get before the system kills it, including
/// free swap of the machine. The limits of the process itself do not count: beyond them an
/// allocation fails. Nor does `memory.high`, which slows a process down, and before a kill all of
/// the file cache is evicted.
pub fn bytes_before_a_kill() -> Option<u64> {
    before_a_kill(Path::new("/"))
}

fn before_a_kill(root: &Path) -> Option<u64> {
    [machine(root, true), groups(root, true)].into_iter().flatten().min()
}

/// Returns the minimum over machine, groups and limits. `root` is `/`, or a folder of a test.
fn available(root: &Path, swap: bool) -> Option<u64> {
    [machine(root, swap), groups(root, false), left_by_limits(root)].into_iter().flatten().min()
}

fn machine(root: &Path, swap: bool) -> Option<u64> {
    kib(&root.join("proc/meminfo"), "MemAvailable:").map(|free| {
        let swap = swap.then(|| kib(&root.join("proc/meminfo"), "SwapFree:"));
        free.saturating_add(swap.flatten().unwrap_or(0))
    })
}

/// File names of one version of control groups.
struct Version {
    /// Beyond the first, the system kills.
    limits: &'static [&'static str],
    current: &'static str,
    /// Keys in `memory.stat` of the file cache, which `current` includes: what can be evicted
    /// without a loss of speed, and what is in use.
    cache: [&'static str; 2],
}

const V1: Version = Version {
    limits: &["memory.limit_in_bytes"],
    current: "memory.usage_in_bytes",
    cache: ["total_inactive_file ", "total_active_file "],
};

const V2: Version = Version {
    limits: &["memory.max", "memory.high"],
    current: "memory.current",
    cache: ["inactive_file ", "active_file "],
};

/// Returns the bytes that the control groups of this process leave: its own group and all its
/// parents. With `kill`, before they kill it.
fn groups(root: &Path, kill: bool) -> Option<u64> {
    let own = read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    let mounts = read_to_string(root.join("proc/self/mountinfo")).unwrap_or_default();
    let mounts: Vec<Mount> = mounts.lines().filter_map(Mount::parse).collect();
    let left_by = |line: &str| {
        let mut parts = line.splitn(3, ':');
        let (number, controllers, path) = (parts.next()?, parts.next()?, parts.next()?);
        let v2 = number == "0" && controllers.is_empty();
        if !v2 && !controllers.split(',').any(|name| name == "memory") {
            return None;
        }
        let mount = mounts.iter().find(|mount| mount.v2 == v2)?;
        mount.left(root, path, if v2 { &V2 } else { &V1 }, kill)
    };
    own.lines().filter_map(left_by).min()
}

/// A mount of control groups that count memory.
struct Mount {
    v2: bool,
    /// Path of the group that appears at the mount point.
    group: String,
    place: PathBuf,
}

impl Mount {
    /// Parses a line of `/proc/self/mountinfo`.
    fn parse(line: &str) -> Option<Self> {
        let (before, after) = line.split_once(" - ")?;
        let mut after = after.split(' ');
        let (kind, options) = (after.next()?, after.nth(1).unwrap_or(""));
        let v2 = match kind {
            "cgroup2" => true,
            "cgroup" if options.split(',').any(|option| option == "memory") => false,
            _ => return None,
        };
        let mut before = before.split(' ').skip(3);
        Some(Self { v2, group: before.next()?.to_string(), place: before.next()?.into() })
    }

    /// Returns the minimum of the bytes that the groups from `path` up to the mount point leave.
    fn left(&self, root: &Path, path: &str, version: &Version, kill: bool) -> Option<u64> {
        // Inside a container, the process's group is the mount point, or lies outside the mount.
        let below = Path::new(path).strip_prefix(&self.group).unwrap_or(Path::new(""));
        let plain = |part: &Component| matches!(part, Component::Normal(_));
        let below: PathBuf = below.components().filter(plain).collect();
        let mount = root.join(self.place.strip_prefix("/").unwrap_or(&self.place));
        let groups = below.ancestors().map(|group| mount.join(group));
        groups.filter_map(|group| version.left(&group, kill)).min()
    }
}

impl Version {
    /// Returns the bytes that one group leaves; `None` if the group has no limit.
    fn left(&self, group: &Path, kill: bool) -> Option<u64> {
        let number = |name: &str| -> Option<u64> {
            read_to_string(group.join(name)).ok()?.trim().parse().ok()
        };
        let (limits, cache) = if kill {
            (&self.limits[..1], &self.cache[..])
        } else {
            (self.limits, &self.cache[..1])
        };
        let limit = limits.iter().filter_map(|name| number(name)).min()?;
        let stat = read_to_string(group.join("memory.stat")).unwrap_or_default();
        let of_line =
            |line: &str| cache.iter().find_map(|key| line.strip_prefix(key)?.parse::<u64>().ok());
        let cache = stat.lines().filter_map(of_line).sum();
        let used = number(self.current).unwrap_or(0).saturating_sub(cache);
        Some(limit.saturating_sub(used))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    /// Computes the available bytes on a machine with 1000 MiB and these files.
    fn machine(files: &[(&str, &str)]) -> Option<u64> {
        let root = root(files);
        let [without, with] = [false, true].map(|swap| available(root.path(), swap));
        assert!(with == without || with == Some(without.unwrap() + MIB));
        without
    }

    fn root(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        let all =
            [("proc/meminfo", "MemTotal: 9 kB\nMemAvailable:  1024000 kB\nSwapFree: 1024 kB\n")];
        for (name, text) in all.iter().chain(files) {
            let path = root.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        root
    }

    const V2_MOUNT: (&str, &str) = (
        "proc/self/mountinfo",
        "22 1 0:21 / /proc rw - proc proc rw\n41 31 0:38 / /sys/fs/cgroup rw,relatime shared:4 - cgroup2 cgroup2 rw\n",
    );

    #[test]
    fn without_limits_all_memory_of_the_machine_is_available() {
        assert_eq!(machine(&[]), Some(1000 * MIB));
        let group = ("proc/self/cgroup", "0::/a\n");
        let max = ("sys/fs/cgroup/a/memory.max", "max\n");
        assert_eq!(machine(&[V2_MOUNT, group, max]), Some(1000 * MIB));
        let garbage = ("proc/self/cgroup", "0:\n::\nmemory\n9:memory\n");
        assert_eq!(machine(&[V2_MOUNT, garbage]), Some(1000 * MIB));
    }

    #[test]
    fn the_smallest_of_nested_groups_decides() {
        let group = ("proc/self/cgroup", "0::/job/step/task\n");
        let own = ("sys/fs/cgroup/job/step/task/memory.max", "943718400\n");
        let used = ("sys/fs/cgroup/job/step/task/memory.current", "104857600\n");
        assert_eq!(machine(&[V2_MOUNT, group, own, used]), Some(800 * MIB));
        // The file cache can be evicted.
        let stat = ("sys/fs/cgroup/job/step/task/memory.stat", "anon 5\ninactive_file 52428800\n");
        assert_eq!(machine(&[V2_MOUNT, group, own, used, stat]), Some(850 * MIB));
        let above = ("sys/fs/cgroup/job/memory.max", "524288000");
        let taken = ("sys/fs/cgroup/job/memory.current", "419430400");
        assert_eq!(machine(&[V2_MOUNT, group, own, used, above, taken]), Some(100 * MIB));
        let high = ("sys/fs/cgroup/job/step/memory.high", "10485760");
        assert_eq!(machine(&[V2_MOUNT, group, own, used, above, taken, high]), Some(10 * MIB));
        let over = ("sys/fs/cgroup/job/step/memory.current", "10485761");
        assert_eq!(machine(&[V2_MOUNT, group, high, over]), Some(0));
    }

    #[test]
    fn before_a_kill_all_of_the_file_cache_is_evicted() {
        let group = ("proc/self/cgroup", "0::/a\n");
        let max = ("sys/fs/cgroup/a/memory.max", "943718400\n");
        let high = ("sys/fs/cgroup/a/memory.high", "10485760\n");
        let used = ("sys/fs/cgroup/a/memory.current", "629145600\n");
        let stat = (
            "sys/fs/cgroup/a/memory.stat",
            "anon 5\ninactive_file 52428800\nactive_file 209715200\n",
        );
        let files = [V2_MOUNT, group, max, high, used, stat];
        assert_eq!(before_a_kill(root(&files).path()), Some(550 * MIB));
        assert_eq!(machine(&files), Some(0));
        assert_eq!(before_a_kill(root(&[]).path()), Some(1001 * MIB));
    }

    #[test]
    fn in_a_container_the_group_is_the_root() {
        let max = ("sys/fs/cgroup/memory.max", "104857600");
        for path in ["0::/\n", "0::/../other\n", "0::/docker/abc\n"] {
            assert_eq!(
                machine(&[V2_MOUNT, ("proc/self/cgroup", path), max]),
                Some(100 * MIB),
                "{path}"
            );
        }
        let mount = (
            "proc/self/mountinfo",
            "41 31 0:38 /docker/abc /sys/fs/cgroup ro - cgroup2 cgroup rw\n",
        );
        let inner = ("sys/fs/cgroup/in/memory.max", "52428800");
        let group = ("proc/self/cgroup", "0::/docker/abc/in\n");
        assert_eq!(machine(&[mount, group, max, inner]), Some(50 * MIB));
    }

    #[test]
    fn version_one_of_control_groups_is_read() {
        let mounts = (
            "proc/self/mountinfo",
            "32 31 0:29 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n\
             35 31 0:32 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n\
             41 31 0:38 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n",
        );
        let group = ("proc/self/cgroup", "5:devices:/\n4:memory,hugetlb:/slurm/job_1\n0::/\n");
        let own = ("sys/fs/cgroup/memory/slurm/job_1/memory.limit_in_bytes", "471859200");
        let used = ("sys/fs/cgroup/memory/slurm/job_1/memory.usage_in_bytes", "157286400");
        let stat = (
            "sys/fs/cgroup/memory/slurm/job_1/memory.stat",
            "inactive_file 1\ntotal_inactive_file 52428800\n",
        );
        let root = ("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712");
        assert_eq!(machine(&[mounts, group, own, used, stat, root]), Some(350 * MIB));
    }

    #[test]
    fn limits_of_the_process_are_subtracted() {
        let limits = |space: &str, data: &str| {
            format!(
                "Limit                     Soft Limit           Hard Limit           Units     \n\
                 Max data size             {data}            unlimited            bytes     \n\
                 Max address space         {space}           unlimited            bytes     \n"
            )
        };
        let status = ("proc/self/status", "VmPeak: 1 kB\nVmSize:  102400 kB\nVmData:  51200 kB\n");
        let with = |space: &str, data: &str| {
            machine(&[("proc/self/limits", &limits(space, data)), status])
        };
        assert_eq!(with("unlimited", "unlimited"), Some(1000 * MIB));
        assert_eq!(with("209715200", "unlimited"), Some(100 * MIB));
        assert_eq!(with("209715200", "104857600"), Some(50 * MIB));
        assert_eq!(with("1", "unlimited"), Some(0));
    }
}
