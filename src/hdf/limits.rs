//! What a process that reads a file of others may use.

use std::io;

use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::time::{ClockId, clock_gettime};

/// Address space, bytes: the program itself, the largest chunk of a dataset twice, and one answer.
pub const MEMORY: u64 = 1 << 30;

/// The longest that one answer may take, s: on the clock, and on a core.
pub const SECONDS: u64 = 8;

/// The largest chunk of a dataset, bytes.
pub(super) const CHUNK: u64 = 256 << 20;

/// Elements that are asked for at a time, bytes.
pub(super) const SLICE: u64 = 8 << 20;

/// One row of a dataset, bytes; also the largest answer.
pub(super) const ROW: u64 = 128 << 20;

/// What one call gives of a file of others, bytes.
pub(super) const CALL: u64 = 256 << 20;

/// Texts that are asked for at a time.
pub(super) const TEXTS: u64 = 4096;

/// How often the elements of a dataset may fill its place in the file: deflate packs zeros a thousandfold.
pub(super) const PACKED: u64 = 1100;

/// Limits this process. Files may be open a few at a time: sources of virtual datasets.
///
/// # Errors
/// When the system refuses.
pub(super) fn apply() -> io::Result<()> {
    for (resource, most) in [
        (Resource::As, MEMORY),
        (Resource::Core, 0),
        (Resource::Fsize, 0),
        (Resource::Nofile, 256),
    ] {
        set(resource, most)?;
    }
    Ok(())
}

fn set(resource: Resource, most: u64) -> io::Result<()> {
    let allowed = rustix::process::getrlimit(resource).maximum;
    let most = Some(allowed.map_or(most, |allowed| allowed.min(most)));
    Ok(setrlimit(
        resource,
        Rlimit {
            current: most,
            maximum: most,
        },
    )?)
}

/// Allows this process some seconds on a core from now on; then the system ends it, also when nobody waits for it any more.
///
/// # Errors
/// When the system refuses.
pub(super) fn allow_seconds() -> io::Result<()> {
    let used = clock_gettime(ClockId::ProcessCPUTime).tv_sec.unsigned_abs();
    let maximum = rustix::process::getrlimit(Resource::Cpu).maximum;
    let until = used + 1 + SECONDS;
    let current = Some(maximum.map_or(until, |maximum| maximum.min(until)));
    Ok(setrlimit(Resource::Cpu, Rlimit { current, maximum })?)
}
