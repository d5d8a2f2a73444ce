//! Who works in a store, as others read it: on a shared file system a lock of this machine says nothing to another.

use std::fs;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use deaflow_base::host_name;

/// A process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// Name of its machine.
    pub host: String,
    /// Its number there.
    pub pid: u32,
    /// The command that it runs.
    pub command: String,
    /// When it began to work in the store, in UTC by its machine's clock: for people.
    pub since: String,
    /// The machine since it was started, and which numbering of processes is meant.
    machine: String,
    /// When the process began, in ticks of the machine: numbers are given again.
    began: u64,
}

impl Owner {
    /// This process.
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

    /// Whether it is known to have ended: it was of this machine, and is not there any more. Of another machine nobody can say.
    pub fn is_gone(&self) -> bool {
        !self.machine.is_empty() && self.machine == machine() && began(self.pid) != Some(self.began)
    }

    /// For people.
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

/// Empty where the system does not say: then nobody is known to have ended.
fn machine() -> String {
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    let numbering = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
    match (boot.trim(), numbering.to_str()) {
        ("", _) | (_, None | Some("")) => String::new(),
        (boot, Some(numbering)) => format!("{boot} {numbering}"),
    }
}

/// When a process began; none where there is no such process. The name of the program, in brackets, may hold anything.
fn began(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let (_, rest) = stat.rsplit_once(')')?;
    // A process that has ended and was not waited for does nothing any more.
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
