//! CPU time of a thread, and times for people.

use std::time::Instant;

/// Returns the CPU time of this thread in seconds, or elapsed time if the system does not report it. Other work on the
/// machine does not count.
#[must_use]
pub fn thread_seconds() -> f64 {
    thread_local!(static START: Instant = Instant::now());
    let statistics = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = statistics.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.with(|start| start.elapsed().as_secs_f64()), |ns| 1e-9 * ns)
}

/// Formats a UTC time in RFC 3339 for people: `2026-11-21 15:52:21 UTC`. Another text is returned unchanged.
#[must_use]
pub fn readable_time(rfc3339: &str) -> String {
    match rfc3339.get(..19) {
        Some(time) if time.as_bytes()[10] == b'T' => format!("{} UTC", time.replace('T', " ")),
        _ => rfc3339.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_formatted_for_people() {
        assert_eq!(readable_time("2026-11-21T15:52:21.226Z"), "2026-11-21 15:52:21 UTC");
        assert_eq!(readable_time("soon"), "soon");
        assert_eq!(readable_time("a text that is no time"), "a text that is no time");
    }
}
