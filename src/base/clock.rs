//! The time that a thread has been on a core.

use std::time::Instant;

/// Seconds that this thread has been on a core, so that other work on the machine does not count; where the system does
/// not tell, seconds that have passed.
#[must_use]
pub fn thread_seconds() -> f64 {
    thread_local!(static START: Instant = Instant::now());
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.with(|start| start.elapsed().as_secs_f64()), |ns| 1e-9 * ns)
}
