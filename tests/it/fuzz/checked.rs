//! Checks for every input.

use std::time::{Duration, Instant};

use super::mutate::Seeds;

/// The longest time for an input of a few kilobytes.
const MAX_DURATION: Duration = Duration::from_secs(10);

/// Reads the valid inputs, which must be accepted, and those of the corpus. Returns a function that changes an input as
/// random bytes determine, and reads it. `read` returns whether it accepts the input.
pub fn checked<'a>(seeds: &'a Seeds, read: impl Fn(&[u8]) -> bool + 'a) -> impl Fn(&[u8]) + 'a {
    let timed = move |bytes: &[u8]| in_time(|| read(bytes));
    for (at, input) in seeds.inputs.iter().enumerate() {
        let is_accepted = timed(input);
        assert!(
            is_accepted || at >= seeds.valid,
            "rejected: {:?}",
            String::from_utf8_lossy(input)
        );
    }
    move |entropy: &[u8]| {
        timed(&seeds.mutated(entropy));
    }
}

/// Runs some work and checks its duration.
pub fn in_time<T>(work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    let took = start.elapsed();
    assert!(took < MAX_DURATION, "{took:?}");
    result
}

/// Checks that an error message is neither empty nor very long.
pub fn check_message(message: &str) {
    assert!(!message.is_empty() && message.len() < 20_000, "{message:?}");
}
