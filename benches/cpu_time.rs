//! The clock of the crates' benches, which take it in by its path: a crate for one function would be one more to
//! publish.

use std::time::Duration;

/// The CPU time of this thread, since others share the machine; the time of day where there is no such clock.
pub(crate) fn cpu_time() -> Duration {
    #[cfg(unix)]
    {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec.try_into().expect("less than 10^9"))
    }
    #[cfg(not(unix))]
    std::time::UNIX_EPOCH.elapsed().expect("a clock that runs")
}
