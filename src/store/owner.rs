//! The process that uses a store, as shown to other machines.

use std::fs;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use deaflow_base::host_name;

/// A process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// Name of its machine.
    pub host: String,
    /// Its process ID.
    pub pid: u32,
    /// Its command.
    pub command: String,
    /// When it opened the store, in UTC by the clock of its machine.
    pub since: String,
    /// Boot ID and process namespace of its machine.
    machine: String,
    /// When it started, in ticks of the machine, because process IDs are reused.
    began: u64,
}

impl Owner {
    /// Returns this process.
    pub fn this() -> Self {
        let pid = std::process::id();
        Self {
            host: host_name(),
            pid,
            command: std::env::args().skip(1).take(1).collect(),
            since: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            machine: machine(),
            began: began(pid).unwrap_or_default(),
        }
    }

    /// Whether it is known to have ended: it was of this machine, and is not there any more. Of another machine nobody
    /// can say.
    pub fn is_gone(&self) -> bool {
        !self.machine.is_empty() && self.machine == machine() && began(self.pid) != Some(self.began)
    }

    /// Describes the process.
    pub fn text(&self) -> String {
        let Self {
            host,
            pid,
            command,
            since,
            ..
        } = self;
        format!("process {pid} on {host} (`deaflow {command}`, since {since})")
    }
}

/// Returns the identity of the machine; empty if unknown.
fn machine() -> String {
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    let numbering = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
    match (boot.trim(), numbering.to_str()) {
        ("", _) | (_, None | Some("")) => String::new(),
        (boot, Some(numbering)) => format!("{boot} {numbering}"),
    }
}

/// Returns when a process started, if it exists. The program name in parentheses may contain anything.
fn began(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let (_, rest) = stat.rsplit_once(')')?;
    // A zombie process has ended.
    let mut fields = rest.split_whitespace();
    let state = fields.next()?;
    (state != "Z").then(|| fields.nth(18)?.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_of_this_machine_is_gone_when_it_has_ended() {
        let own = Owner::this();
        assert!(!own.is_gone() && own.began > 0, "{own:?}");
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let other = Owner {
            pid: child.id(),
            began: began(child.id()).unwrap(),
            ..own.clone()
        };
        assert!(!other.is_gone());
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(other.is_gone());
        let again = Owner {
            began: 1,
            ..own.clone()
        };
        assert!(again.is_gone(), "its number has been given again");
        let elsewhere = Owner {
            machine: "another".to_owned(),
            ..other
        };
        assert!(!elsewhere.is_gone(), "nobody can say");
    }
}
