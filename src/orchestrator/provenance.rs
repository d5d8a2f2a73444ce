//! Host, clock and program of a run. They reach artifacts only as their provenance.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use deaflow_base::{ActionKey, VERSION, build, host_name};
use deaflow_store::{Action, Provenance};

/// The environment of a run.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Host name of the machine.
    pub host: String,
    /// Version of the program.
    pub version: String,
    /// BLAKE3 digest of the sources, the Cargo lock file and the features of the program.
    pub build: String,
    /// Architecture, operating system and processor.
    pub target: String,
    /// Returns the current time.
    pub clock: fn() -> SystemTime,
}

/// The duration of a piece of work.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// From start to end, s.
    pub seconds: f64,
    /// Measured times by name, s.
    pub measurements: Vec<(String, f64)>,
}

impl Environment {
    /// Returns the environment of this process.
    #[must_use]
    pub fn system() -> Self {
        let read = |path| std::fs::read_to_string(path).unwrap_or_default();
        let processor = read("/proc/cpuinfo")
            .lines()
            .find_map(|line| line.strip_prefix("model name")?.split_once(':'))
            .map_or_else(|| "unknown processor".to_owned(), |(_, name)| name.trim().to_owned());
        let (architecture, system) = (std::env::consts::ARCH, std::env::consts::OS);
        Self {
            host: host_name(),
            version: VERSION.to_owned(),
            build: build().to_owned(),
            target: format!("{architecture}-{system}, {processor}"),
            clock: SystemTime::now,
        }
    }

    /// Returns the text that identifies builds which can resume each other's checkpoints.
    #[must_use]
    pub fn build_of_checkpoints(&self) -> String {
        format!("build {}, {}", self.build, self.target)
    }

    /// Returns the time in UTC, RFC 3339 with milliseconds.
    #[must_use]
    pub fn now(&self) -> String {
        rfc3339((self.clock)())
    }

    /// Returns the seconds since an earlier reading of the clock; 0 if the clock was set back.
    #[must_use]
    pub fn seconds_since(&self, start: SystemTime) -> f64 {
        (self.clock)()
            .duration_since(start)
            .unwrap_or(Duration::ZERO)
            .as_secs_f64()
    }

    /// Returns the provenance of the artifact of an action.
    #[must_use]
    pub fn provenance(&self, action: &Action, key: ActionKey, timing: Timing) -> Provenance {
        Provenance {
            created: self.now(),
            host: self.host.clone(),
            version: self.version.clone(),
            build: self.build.clone(),
            target: self.target.clone(),
            seconds: timing.seconds,
            action: Some(key),
            kind: action.kind.clone(),
            recipe: action.recipe,
            parameters: action.parameters.to_string(),
            inputs: action.inputs.clone(),
            measurements: timing.measurements,
        }
    }
}

/// Formats a time in UTC; times before 1970 become 1970-01-01.
fn rfc3339(time: SystemTime) -> String {
    humantime::format_rfc3339_millis(time.max(UNIX_EPOCH)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_written_as_the_calendar_has_them() {
        // From `date -u -d @N +%FT%T`.
        let text = |seconds| rfc3339(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(text(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(text(951_782_400), "2000-02-29T00:00:00.000Z");
        assert_eq!(text(1_709_251_199), "2024-02-29T23:59:59.000Z");
        assert_eq!(text(4_102_444_800), "2100-01-01T00:00:00.000Z");
        assert_eq!(
            rfc3339(UNIX_EPOCH + Duration::from_millis(1500)),
            "1970-01-01T00:00:01.500Z"
        );
    }
}
