//! The connection to a child process that reads untrusted files.

use std::io::{self, ErrorKind, Read};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::elements::{self, Elements};
use super::error::{HdfError, how};
use super::limits::SECONDS;
use super::message::{self, FileRequest, Reply, Response, Started};

/// The time that each response, and each MiB of elements, adds to the remaining time of a session, up to [`SECONDS`].
/// So a file with many slow responses is given up, and a large file is not.
const PER_RESPONSE: Duration = Duration::from_millis(50);
const PER_MEBIBYTE: Duration = Duration::from_millis(250);

static READER: OnceLock<fn() -> Command> = OnceLock::new();

/// Sets the command that runs [`super::serve`]. The binary does so at start; another program that reads untrusted HDF5
/// files with this library must do so too. Only the first call has an effect.
pub fn set_reader(command: fn() -> Command) {
    READER.get_or_init(|| command);
}

/// Returns whether untrusted files can be read.
pub(super) fn has_reader() -> bool {
    READER.get().is_some()
}

/// Lets unit tests read untrusted files by the test `the_process_that_other_tests_start` of their program, which must
/// call [`super::serve`].
#[doc(hidden)]
pub fn read_by_test() {
    set_reader(|| {
        let mut command = Command::new(std::env::current_exe().unwrap_or_default());
        command.args(["the_process_that_other_tests_start", "--ignored"]);
        command
    });
}

/// A running child process.
pub(super) struct Session {
    child: Child,
    socket: UnixStream,
    left: Duration,
}

/// A response with its elements.
pub(super) enum Received {
    Plain(Response),
    Elements(Elements),
}

impl Session {
    /// Starts a process and waits until it runs. It loads no plugins, which a file could request.
    ///
    /// # Errors
    /// If it cannot be started, or ends before it runs, as where its program is not found.
    pub fn start(path: &Path) -> Result<Self, HdfError> {
        let reader = READER.get();
        let command = reader.ok_or_else(|| HdfError::NoReader { path: path.to_owned() })?;
        Self::of(command()).map_err(|source| HdfError::Process {
            path: path.to_owned(),
            source,
        })
    }

    fn of(mut command: Command) -> io::Result<Self> {
        let (socket, other) = UnixStream::pair()?;
        command
            .env("HDF5_PLUGIN_PRELOAD", "::")
            .env_remove("HDF5_PLUGIN_PATH")
            .stdin(OwnedFd::from(other))
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let mut session = Self {
            child: command.spawn()?,
            socket,
            left: Duration::from_secs(SECONDS),
        };
        let words = std::iter::once(command.get_program()).chain(command.get_args());
        let words = words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
        // From here on the process alone has the other end of the socket, so reading ends when it does.
        drop(command);
        match session.wait_until_started() {
            Ok(()) => Ok(session),
            Err(error) => Err(io::Error::other(match session.end(&error) {
                Some(status) => format!("`{words}` ended at once ({})", how(status)),
                None => format!("`{words}` does not respond: {error}"),
            })),
        }
    }

    fn wait_until_started(&self) -> io::Result<()> {
        let mut timed = Timed {
            socket: &self.socket,
            until: Instant::now() + self.left,
        };
        let _: Started = message::receive(&mut timed)?.ok_or(ErrorKind::UnexpectedEof)?;
        Ok(())
    }

    /// Sends a request and waits for the response.
    ///
    /// # Errors
    /// If the process reports a failure ([`HdfError::Failed`]), after which it accepts further requests; or if it
    /// crashes or exceeds the time, after which it has ended.
    pub fn request(&mut self, path: &Path, request: &FileRequest) -> Result<Received, HdfError> {
        let start = Instant::now();
        match self.exchange(request, start + self.left) {
            Ok((reply, bytes)) => {
                let mebibytes = (bytes.len() >> 20) as u32;
                let more = PER_RESPONSE + PER_MEBIBYTE * mebibytes;
                self.left = (self.left.saturating_sub(start.elapsed()) + more).min(Duration::from_secs(SECONDS));
                self.interpret(path, reply, &bytes)
            }
            Err(error) => Err(self.ended(path, &error)),
        }
    }

    fn exchange(&mut self, request: &FileRequest, until: Instant) -> io::Result<(Reply, Vec<u8>)> {
        self.socket.set_write_timeout(Some(self.left.max(PER_RESPONSE)))?;
        message::send(&mut self.socket, request, &[])?;
        let mut timed = Timed {
            socket: &self.socket,
            until,
        };
        let reply: Reply = message::receive(&mut timed)?.ok_or(ErrorKind::UnexpectedEof)?;
        let bytes = match &reply {
            Ok(Response::Numbers(_, count)) => message::bytes(&mut timed, *count)?,
            _ => Vec::new(),
        };
        Ok((reply, bytes))
    }

    fn interpret(&mut self, path: &Path, reply: Reply, bytes: &[u8]) -> Result<Received, HdfError> {
        Ok(match reply.map_err(|failure| HdfError::failed(path, failure))? {
            Response::Numbers(element, _) => {
                let elements = elements::from_bytes(&element, bytes);
                Received::Elements(elements.ok_or_else(|| HdfError::Broken {
                    path: path.to_owned(),
                    how: "its response is invalid".to_owned(),
                })?)
            }
            Response::Texts(texts) => Received::Elements(Elements::Text(texts)),
            plain => Received::Plain(plain),
        })
    }

    fn ended(&mut self, path: &Path, error: &io::Error) -> HdfError {
        let path = path.to_owned();
        if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) {
            return HdfError::Endless { path };
        }
        let status = self.end(error);
        let how = status.map_or_else(|| format!("its response cannot be read: {error}"), how);
        HdfError::Broken { path, how }
    }

    /// Returns how the process ended, if an error of the socket means that it has.
    fn end(&mut self, error: &io::Error) -> Option<ExitStatus> {
        // Its end of the socket is closed when it has ended; an invalid response may come from a running process.
        let has_ended = matches!(
            error.kind(),
            ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe | ErrorKind::ConnectionReset
        );
        if has_ended { self.child.wait().ok() } else { None }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A socket with a deadline for reading.
struct Timed<'a> {
    socket: &'a UnixStream,
    until: Instant,
}

impl Read for Timed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        self.socket.set_read_timeout(Some(left))?;
        let mut socket = self.socket;
        socket.read(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_does_not_start_is_not_the_fault_of_a_file() {
        let mut command = Command::new("sh");
        command.args(["-c", "exit 7"]);
        let Err(source) = Session::of(command) else {
            panic!("it has ended");
        };
        let path = Path::new("fine.h5").to_owned();
        let error = HdfError::Process { path, source };
        let text = error.to_string();
        assert!(!error.is_of_the_file());
        assert!(
            text.contains("fine.h5: `sh -c exit 7` ended at once (exit status: 7)"),
            "{text}"
        );
        assert!(Session::of(Command::new("/there/is/no/program")).is_err());
    }
}
