//! Runs the binary with little memory and against the clock, for input that is meant to hold it up.

use std::fs::File;
use std::io::{Read, Seek};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::{Ended, Workspace};

/// Address space in KiB: far more than any refusal takes, far less than a bomb would.
const MEMORY: u32 = 4 << 20;

/// Generous, since machines may be busy; what blocks or never ends takes longer still.
const PATIENCE: Duration = Duration::from_secs(60);

/// The exit codes that docs/cli.md lists.
const DOCUMENTED: [i32; 5] = [0, 1, 2, 3, 4];

impl Workspace {
    /// Runs a command with 4 GiB of address space; it must end, by itself and with a documented exit code.
    pub fn bounded(&self, arguments: &[&str]) -> Ended {
        let mut command = self.command(&[]);
        let binary = command.get_program().to_owned();
        command = self.dressed("sh");
        command.args(["-c", &format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\"")]);
        let ended = await_end(command.arg(binary).args(arguments));
        let code = ended.code.unwrap_or(-1);
        assert!(DOCUMENTED.contains(&code), "{arguments:?}: {code}: {}", ended.stderr);
        assert!(!ended.stderr.contains("panicked"), "{arguments:?}: {}", ended.stderr);
        ended
    }

    /// Runs a command that must refuse what it is given: as bad input or damage, in words that a person can read.
    pub fn refused(&self, arguments: &[&str]) -> String {
        let ended = self.bounded(arguments);
        let shown: String = ended.stderr.chars().take(2000).collect();
        assert!(
            matches!(ended.code, Some(2 | 4)),
            "{arguments:?}: {:?}: {shown}",
            ended.code
        );
        assert!(shown.starts_with("error: "), "{arguments:?}: {shown}");
        assert!(
            ended.stderr.len() < 20_000,
            "{arguments:?}: {} bytes",
            ended.stderr.len()
        );
        let odd = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
        assert!(!ended.stderr.contains(odd), "{arguments:?}: {shown:?}");
        ended.stderr
    }
}

/// Waits for a command, but not for ever. Its output goes to files, which do not fill up as pipes do.
pub fn await_end(command: &mut Command) -> Ended {
    let (mut out, mut err) = (tempfile::tempfile().unwrap(), tempfile::tempfile().unwrap());
    command.stdin(Stdio::null());
    command
        .stdout(out.try_clone().unwrap())
        .stderr(err.try_clone().unwrap());
    let mut child = command.spawn().unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > PATIENCE {
            end(&mut child);
            panic!("{command:?} did not end: {}", text(&mut err));
        }
        sleep(Duration::from_millis(4));
    };
    Ended {
        code: status.code(),
        stdout: text(&mut out),
        stderr: text(&mut err),
    }
}

fn end(child: &mut Child) {
    child.kill().unwrap();
    child.wait().unwrap();
}

fn text(file: &mut File) -> String {
    let mut bytes = Vec::new();
    file.rewind().unwrap();
    file.read_to_end(&mut bytes).unwrap();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Makes a named pipe: whoever opens it to read waits for a writer that never comes.
pub fn pipe(path: &std::path::Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}
