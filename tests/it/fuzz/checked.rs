//! What every input is held to.

use std::time::{Duration, Instant};

use super::mutate::Seeds;

/// No input of a few kilobytes takes longer.
const PATIENCE: Duration = Duration::from_secs(10);

/// Reads the sound inputs, which have to be accepted, and those that were found, and gives what reads one that is
/// changed as random bytes say. `read` tells whether it accepts.
pub fn checked<'a>(seeds: &'a Seeds, read: impl Fn(&[u8]) -> bool + 'a) -> impl Fn(&[u8]) + 'a {
    let timed = move |bytes: &[u8]| in_time(|| read(bytes));
    for (at, input) in seeds.inputs.iter().enumerate() {
        let is_accepted = timed(input);
        assert!(
            is_accepted || at >= seeds.sound,
            "refused: {:?}",
            String::from_utf8_lossy(input)
        );
    }
    move |entropy: &[u8]| {
        timed(&seeds.mutated(entropy));
    }
}

/// Does something that takes no longer than anything may.
pub fn in_time<T>(work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    let took = start.elapsed();
    assert!(took < PATIENCE, "{took:?}");
    result
}

/// A refusal says something, in a length that a person reads.
pub fn is_told(message: &str) {
    assert!(!message.is_empty() && message.len() < 20_000, "{message:?}");
}
