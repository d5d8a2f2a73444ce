//! A reader that gives up a server that sends or takes data too slowly.

use std::error::Error;
use std::fmt;
use std::io::{self, ErrorKind, Read};
use std::time::{Duration, Instant};

/// Minimum rate in bytes per second.
const MIN_RATE: u64 = 1000;

/// Time after which the rate is checked.
pub const SLOW_AFTER: Duration = Duration::from_secs(60);

/// The rate was too low.
#[derive(Debug)]
pub struct TooSlow {
    after: Duration,
}

impl fmt::Display for TooSlow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "less than {MIN_RATE} bytes per second; given up after {} s",
            self.after.as_secs()
        )
    }
}

impl Error for TooSlow {}

impl TooSlow {
    /// Whether an error of a reader says that the rate was too low.
    pub fn is_cause(error: &io::Error) -> bool {
        error.get_ref().is_some_and(|inner| inner.is::<Self>())
    }
}

/// Reads bytes that go to or come from a server.
pub struct Paced<R> {
    inner: R,
    start: Instant,
    bytes: u64,
    slow_after: Duration,
}

impl<R> Paced<R> {
    /// Checks the rate from this time on, usually [`SLOW_AFTER`].
    pub fn after(inner: R, slow_after: Duration) -> Self {
        Self {
            inner,
            start: Instant::now(),
            bytes: 0,
            slow_after,
        }
    }
}

impl<R: Read> Read for Paced<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.bytes += count as u64;
        let after = self.start.elapsed();
        let is_slow = after >= self.slow_after && self.bytes as f64 / after.as_secs_f64() < MIN_RATE as f64;
        match is_slow && count > 0 {
            true => Err(io::Error::new(ErrorKind::TimedOut, TooSlow { after })),
            false => Ok(count),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends one byte at each call.
    struct Drip;

    impl Read for Drip {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            std::thread::sleep(Duration::from_millis(5));
            buffer[0] = b'x';
            Ok(1)
        }
    }

    #[test]
    fn a_server_that_drips_is_given_up_and_a_fast_or_short_one_is_not() {
        let mut all = Vec::new();
        let error = Paced::after(Drip, Duration::from_millis(50))
            .read_to_end(&mut all)
            .unwrap_err();
        assert!(TooSlow::is_cause(&error), "{error}");
        assert!(!all.is_empty() && all.len() < 1000);
        let bytes = vec![0; 1 << 20];
        assert_eq!(
            Paced::after(&bytes[..], Duration::ZERO).read_to_end(&mut all).unwrap(),
            1 << 20
        );
        // The end of a short response is no drip.
        let mut short = Paced::after(Drip.take(3), Duration::from_secs(60));
        assert_eq!(short.read_to_end(&mut all).unwrap(), 3);
    }
}
