//! The interface of an engine, which starts workers on other machines.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::profile::Resources;

/// Time limit of a command of an engine.
const TIME_LIMIT: Duration = Duration::from_secs(60);

/// Time between two checks whether a command has ended.
const PAUSE: Duration = Duration::from_millis(10);

/// Largest output of a command that is read, bytes.
const MAX_OUTPUT: u64 = 64 << 20;

/// Why a command of an engine failed. The state of the workers is then unknown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{command}`: {reason}")]
pub struct EngineError {
    /// The command.
    pub command: String,
    /// The reason.
    pub reason: String,
}

/// An array of workers to be started.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Its unique name.
    pub name: &'a str,
    /// Number of workers.
    pub workers: u32,
    /// Resources of each worker.
    pub resources: &'a Resources,
    /// The command line of a worker.
    pub worker: &'a [String],
    /// The folder of their logs.
    pub logs: &'a str,
}

/// An engine.
pub trait Engine: Sync {
    /// Starts an array of workers; returns its number, if the engine reports it.
    ///
    /// # Errors
    /// If the engine refuses or does not answer. It may have started them anyway.
    fn submit(&self, request: &Request<'_>) -> Result<Option<String>, EngineError>;

    /// Returns the number of queued or running workers by the name of the array; a missing array has none. `None` if
    /// the engine cannot be queried.
    ///
    /// # Errors
    /// If the engine does not answer; the numbers are then unknown.
    fn active_workers(&self, names: &[&str]) -> Result<Option<BTreeMap<String, u32>>, EngineError>;

    /// Cancels arrays, given by name and number.
    ///
    /// # Errors
    /// If the engine refuses or does not answer.
    fn cancel(&self, arrays: &[(&str, Option<&str>)]) -> Result<(), EngineError>;

    /// Returns the largest number of workers in an array.
    fn most_workers(&self) -> u32;
}

/// Runs a command with an input and returns its stdout.
///
/// # Errors
/// If it cannot be run, fails or exceeds the time limit.
pub fn output_of(program: &str, arguments: &[String], input: &str) -> Result<String, EngineError> {
    let failed = |reason: String| EngineError {
        command: program.to_owned(),
        reason,
    };
    let result = run(program, arguments, input);
    result.map_err(|error| failed(error.to_string()))?.map_err(failed)
}

/// Runs a command; the inner error is the message of a command that fails.
fn run(program: &str, arguments: &[String], input: &str) -> io::Result<Result<String, String>> {
    // Files instead of pipes: they need no reader while it runs, and its children may keep them open.
    let (input, output, errors) = (file_with(input)?, file_with("")?, file_with("")?);
    let mut command = Command::new(program);
    for (name, _) in std::env::vars_os() {
        // Settings that hide jobs would make them look ended.
        let name = name.to_string_lossy();
        if name.starts_with("SQUEUE_") || name.starts_with("SCANCEL_") || name == "SLURM_CLUSTERS" {
            command.env_remove(&*name);
        }
    }
    let mut child = command
        .args(arguments)
        .stdin(Stdio::from(input))
        .stdout(output.try_clone()?)
        .stderr(errors.try_clone()?)
        .spawn()?;
    let Some(status) = wait(&mut child)? else {
        return Ok(Err(format!("no response within {} s", TIME_LIMIT.as_secs())));
    };
    let output = text_of(output)?;
    if status.success() {
        return Ok(Ok(output));
    }
    let errors = text_of(errors)?;
    let mut lines = errors.lines().chain(output.lines()).map(str::trim);
    let first = lines.find(|line| !line.is_empty()).unwrap_or("no error message");
    Ok(Err(format!("{first} ({status})")))
}

/// Waits until a command ends. Ends it at the time limit and returns `None`.
fn wait(child: &mut Child) -> io::Result<Option<ExitStatus>> {
    let start = Instant::now();
    loop {
        match child.try_wait()? {
            Some(status) => return Ok(Some(status)),
            None if start.elapsed() < TIME_LIMIT => sleep(PAUSE),
            None => {
                // It may have ended in the meantime.
                let _ = child.kill();
                let _ = child.wait();
                return Ok(None);
            }
        }
    }
}

fn file_with(text: &str) -> io::Result<File> {
    let mut file = tempfile::tempfile()?;
    file.write_all(text.as_bytes())?;
    file.rewind()?;
    Ok(file)
}

fn text_of(mut file: File) -> io::Result<String> {
    let mut bytes = Vec::new();
    file.rewind()?;
    file.take(MAX_OUTPUT).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Runs all commands, even if one fails.
///
/// # Errors
/// The first error.
pub fn run_all(tried: impl Iterator<Item = Result<String, EngineError>>) -> Result<(), EngineError> {
    let tried: Vec<Result<String, EngineError>> = tried.collect();
    tried
        .into_iter()
        .find(Result::is_err)
        .map_or(Ok(()), |failed| failed.map(drop))
}

/// Returns the last line that is not empty.
pub fn last_line(output: &str) -> Option<&str> {
    output.lines().map(str::trim).rfind(|line| !line.is_empty())
}

/// Quotes a command line for a shell.
pub fn quoted(words: &[String]) -> String {
    // No word contains NUL, so quoting cannot fail.
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
    fn a_command_gets_its_input_and_returns_its_output() {
        assert_eq!(output_of("cat", &[], "input").unwrap(), "input");
        let refused = output_of("sh", &words(&["-c", "echo no >&2; exit 3"]), "").unwrap_err();
        assert_eq!(
            (refused.command.as_str(), refused.reason.as_str()),
            ("sh", "no (exit status: 3)")
        );
        assert!(output_of("/no/such/program", &[], "").is_err());
        // A child that keeps running does not delay it.
        let start = Instant::now();
        assert_eq!(
            output_of("sh", &words(&["-c", "sleep 30 & echo 7"]), "").unwrap(),
            "7\n"
        );
        assert!(start.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn a_shell_reads_quoted_words_unchanged() {
        let meant = words(&["a b", "it's", "$HOME", "plain", ""]);
        let script = format!("for word in {}; do echo \"[$word]\"; done", quoted(&meant));
        let output = output_of("sh", &words(&["-c", &script]), "").unwrap();
        assert_eq!(output, "[a b]\n[it's]\n[$HOME]\n[plain]\n[]\n");
    }
}
