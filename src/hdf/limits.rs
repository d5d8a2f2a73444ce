//! Limits of a process that reads an untrusted file.

use std::io;

use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::time::{ClockId, clock_gettime};

/// Address space, bytes: for the program, the largest chunk of a dataset twice, and one response.
pub const MEMORY: u64 = 1 << 30;

/// Maximum duration of a response, s: elapsed time and processor time.
pub const SECONDS: u64 = 8;

/// The largest chunk of a dataset, bytes.
pub(super) const CHUNK: u64 = 256 << 20;

/// Elements that are requested at a time, bytes.
pub(super) const SLICE: u64 = 8 << 20;

/// Maximum length of a row of a dataset and of a response, bytes.
pub(super) const ROW: u64 = 128 << 20;

/// Maximum result of one call for an untrusted file, bytes.
pub(super) const CALL: u64 = 256 << 20;

/// Texts that are requested at a time.
pub(super) const TEXTS: u64 = 4096;

/// Maximum compression ratio: deflate reaches 1000 for zeros.
pub(super) const PACKED: u64 = 1100;

/// Sets the limits of this process. Some open files are needed for sources of virtual datasets.
///
/// # Errors
/// If the system reports an error.
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

/// Allows this process some more seconds of processor time, after which the system ends it, even if no process waits
/// for it.
///
/// # Errors
/// If the system reports an error.
pub(super) fn allow_seconds() -> io::Result<()> {
    let used = clock_gettime(ClockId::ProcessCPUTime).tv_sec.unsigned_abs();
    let maximum = rustix::process::getrlimit(Resource::Cpu).maximum;
    let until = used + 1 + SECONDS;
    let current = Some(maximum.map_or(until, |maximum| maximum.min(until)));
    Ok(setrlimit(Resource::Cpu, Rlimit { current, maximum })?)
}
