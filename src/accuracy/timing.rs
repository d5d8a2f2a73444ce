//! The time that a method takes on one core.

use deaflow_base::{is_interrupted, thread_seconds};

/// Work is repeated until it takes this many seconds, since the system counts the time on a core in milliseconds.
const ENOUGH: f64 = 0.15;

/// Returns the result of some work on this thread, and its time on one core in seconds. Short work is done once to warm
/// up, and then repeated, until an interrupt.
///
/// # Errors
/// When the work fails.
pub fn timed<T, E>(mut work: impl FnMut() -> Result<T, E>) -> Result<(T, f64), E> {
    let start = thread_seconds();
    let result = work()?;
    let first = thread_seconds() - start;
    if first >= ENOUGH || is_interrupted() {
        return Ok((result, first));
    }
    let (start, mut rounds) = (thread_seconds(), 0);
    loop {
        work()?;
        rounds += 1;
        let spent = thread_seconds() - start;
        if spent >= ENOUGH || is_interrupted() {
            return Ok((result, spent / f64::from(rounds)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_work_takes_longer_and_errors_are_returned() {
        let sum = |n: u64| move || Ok::<u64, ()>((0..n).fold(1, |a, b| std::hint::black_box(a ^ b)));
        let [(_, once), (_, tenfold)] = [1 << 20, 10 << 20].map(|n| timed(sum(n)).unwrap());
        assert!(once > 0.0 && tenfold > 3.0 * once, "{once} {tenfold}");
        assert_eq!(timed(|| Err::<(), u8>(7)), Err(7));
    }
}
