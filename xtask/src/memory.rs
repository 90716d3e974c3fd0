//! What the operating system says about this process.

/// The most memory that was resident at once, in bytes.
///
/// On Linux `VmHWM` of `/proc/self/status`. `getrusage` has the same figure on every Unix, but Linux counts
/// the program into it that ran in this process before `exec`, here cargo; so it is only the fallback. `None`
/// on other systems.
pub(crate) fn peak_resident() -> Option<u64> {
    high_water_mark().or_else(max_rss)
}

/// Memory that can still be had without swapping, in bytes; `None` where the system has no such figure.
pub(crate) fn available() -> Option<u64> {
    kibibytes("/proc/meminfo", "MemAvailable:")
}

fn high_water_mark() -> Option<u64> {
    kibibytes("/proc/self/status", "VmHWM:")
}

/// A line `NAME   123 kB` of one of Linux' files, in bytes.
fn kibibytes(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(unix)]
fn max_rss() -> Option<u64> {
    use nix::sys::resource::{UsageWho, getrusage};
    // Apple counts bytes, everyone else kibibytes.
    let unit = if cfg!(target_vendor = "apple") { 1 } else { 1024 };
    let usage = getrusage(UsageWho::RUSAGE_SELF).ok()?;
    u64::try_from(usage.max_rss()).ok().map(|rss| rss * unit)
}

#[cfg(not(unix))]
fn max_rss() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    #[cfg(unix)]
    #[test]
    fn both_sources_see_a_large_allocation() {
        let block = vec![1u8; 64 << 20];
        assert!(std::hint::black_box(&block).iter().map(|&b| u64::from(b)).sum::<u64>() == 64 << 20);
        assert!(super::peak_resident().is_some_and(|bytes| bytes > 64 << 20));
        assert!(super::max_rss().is_some_and(|bytes| bytes > 64 << 20));
        assert!(super::available().is_some() || !cfg!(target_os = "linux"));
    }
}
