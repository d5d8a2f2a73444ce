//! What starts workers on other machines, as the rest sees it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::profile::Resources;

/// A command of an engine that answers later than that does not answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// Between two looks at whether a command has ended.
const PAUSE: Duration = Duration::from_millis(10);

/// More of an answer is not read, bytes.
const LONGEST: u64 = 64 << 20;

/// Why an engine did not do what was asked. It says nothing of the workers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{command}`: {reason}")]
pub struct EngineError {
    /// The command.
    pub command: String,
    /// What it said.
    pub reason: String,
}

/// An array of workers to be started.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Its name, which no other array has.
    pub name: &'a str,
    /// How many.
    pub workers: u32,
    /// What each is given.
    pub resources: &'a Resources,
    /// The command line of a worker.
    pub worker: &'a [String],
    /// Where workers write what they say.
    pub logs: &'a str,
}

/// An engine.
pub trait Engine: Sync {
    /// Starts an array of workers; gives the number of it, where the engine tells it.
    ///
    /// # Errors
    /// When the engine refuses or does not answer. It may have started them nevertheless.
    fn submit(&self, request: &Request<'_>) -> Result<Option<String>, EngineError>;

    /// How many workers of each array wait or work, by the names of arrays; of an array that is not told none do. None where the engine
    /// cannot be asked.
    ///
    /// # Errors
    /// When the engine does not answer: nothing is known then.
    fn living(&self, names: &[&str]) -> Result<Option<BTreeMap<String, u32>>, EngineError>;

    /// Ends arrays, given by name and number.
    ///
    /// # Errors
    /// When the engine refuses or does not answer.
    fn cancel(&self, arrays: &[(&str, Option<&str>)]) -> Result<(), EngineError>;

    /// The longest array.
    fn most_workers(&self) -> u32;
}

/// Runs a command with an input and gives its stdout.
///
/// # Errors
/// When it cannot be run, fails or does not end.
pub fn ask(program: &str, arguments: &[String], input: &str) -> Result<String, EngineError> {
    let failed = |reason: String| EngineError {
        command: program.to_owned(),
        reason,
    };
    // Files, not pipes: nobody has to read while it runs, and what it starts may hold them open.
    let file = |text: &str| {
        let mut file = tempfile::tempfile()?;
        file.write_all(text.as_bytes())?;
        file.rewind()?;
        Ok::<File, std::io::Error>(file)
    };
    let refused = |error: std::io::Error| failed(error.to_string());
    let (input, output, complaint) = (
        file(input).map_err(refused)?,
        file("").map_err(refused)?,
        file("").map_err(refused)?,
    );
    let mut command = Command::new(program);
    for (name, _) in std::env::vars_os() {
        // Settings that hide jobs would have them taken for ended.
        let name = name.to_string_lossy();
        if name.starts_with("SQUEUE_") || name.starts_with("SCANCEL_") || name == "SLURM_CLUSTERS" {
            command.env_remove(&*name);
        }
    }
    let mut child = command
        .args(arguments)
        .stdin(Stdio::from(input))
        .stdout(output.try_clone().map_err(refused)?)
        .stderr(complaint.try_clone().map_err(refused)?)
        .spawn()
        .map_err(refused)?;
    let start = Instant::now();
    let status = loop {
        match child.try_wait().map_err(refused)? {
            Some(status) => break status,
            None if start.elapsed() < PATIENCE => sleep(PAUSE),
            None => {
                // It may have ended meanwhile.
                let _ = child.kill();
                let _ = child.wait();
                return Err(failed(format!("no response within {} s", PATIENCE.as_secs())));
            }
        }
    };
    let text = |mut file: File| {
        let mut bytes = Vec::new();
        file.rewind()?;
        file.take(LONGEST).read_to_end(&mut bytes)?;
        Ok::<String, std::io::Error>(String::from_utf8_lossy(&bytes).into_owned())
    };
    let said = text(output).map_err(refused)?;
    match status.success() {
        true => Ok(said),
        false => {
            let complaint = text(complaint).map_err(refused)?;
            let lines = complaint.lines().chain(said.lines());
            let last = lines
                .map(str::trim)
                .find(|line| !line.is_empty())
                .unwrap_or("no reason was given");
            Err(failed(format!("{last} ({status})")))
        }
    }
}

/// Runs all commands, whatever becomes of one.
///
/// # Errors
/// The first of those that failed.
pub fn all_tried(tried: impl Iterator<Item = Result<String, EngineError>>) -> Result<(), EngineError> {
    let tried: Vec<Result<String, EngineError>> = tried.collect();
    tried
        .into_iter()
        .find(Result::is_err)
        .map_or(Ok(()), |failed| failed.map(drop))
}

/// The last line that says something.
pub fn last_line(said: &str) -> Option<&str> {
    said.lines().map(str::trim).rfind(|line| !line.is_empty())
}

/// A command line as a shell reads it.
pub fn quoted(words: &[String]) -> String {
    // No word holds a NUL: the system passes none.
    let words = words.iter().map(|word| shlex::try_quote(word).unwrap_or_default());
    words.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|word| (*word).to_owned()).collect()
    }

    #[test]
    fn a_command_is_fed_and_heard() {
        assert_eq!(ask("cat", &[], "said").unwrap(), "said");
        let refused = ask("sh", &words(&["-c", "echo no >&2; exit 3"]), "").unwrap_err();
        assert_eq!(
            (refused.command.as_str(), refused.reason.as_str()),
            ("sh", "no (exit status: 3)")
        );
        assert!(ask("/no/such/program", &[], "").is_err());
        // What it leaves running does not hold it up.
        let start = Instant::now();
        assert_eq!(ask("sh", &words(&["-c", "sleep 30 & echo 7"]), "").unwrap(), "7\n");
        assert!(start.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn a_shell_reads_what_was_meant() {
        let meant = words(&["a b", "it's", "$HOME", "plain", ""]);
        let script = format!("for word in {}; do echo \"[$word]\"; done", quoted(&meant));
        let said = ask("sh", &words(&["-c", &script]), "").unwrap();
        assert_eq!(said, "[a b]\n[it's]\n[$HOME]\n[plain]\n[]\n");
    }
}
