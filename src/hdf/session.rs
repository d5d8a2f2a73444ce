//! A process that reads files of others, seen from this one.

use std::io::{self, ErrorKind, Read};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::elements::{self, Elements};
use super::error::{HdfError, how};
use super::limits::SECONDS;
use super::message::{self, Answer, Question, Reply};

/// What each answer, and each MiB of elements, adds to the time that a session may still take, up to [`SECONDS`]. So a
/// file that takes long time and again is given up, and a large one is not.
const PER_ANSWER: Duration = Duration::from_millis(50);
const PER_MEBIBYTE: Duration = Duration::from_millis(250);

static READER: OnceLock<fn() -> Command> = OnceLock::new();

/// Names the command that runs [`super::serve`]. The binary of this program does so as it begins; another program that
/// reads HDF5 files of others through this library must as well. The first call counts.
pub fn set_reader(command: fn() -> Command) {
    READER.get_or_init(|| command);
}

/// Whether files of others can be read.
pub(super) fn has_reader() -> bool {
    READER.get().is_some()
}

/// Has the unit tests of a room read files of others by a test of their own program,
/// `the_process_that_other_tests_start`, which is to call [`super::serve`].
#[doc(hidden)]
pub fn read_by_test() {
    set_reader(|| {
        let mut command = Command::new(std::env::current_exe().unwrap_or_default());
        command.args(["the_process_that_other_tests_start", "--ignored"]);
        command
    });
}

/// A running process.
pub(super) struct Session {
    child: Child,
    socket: UnixStream,
    left: Duration,
}

/// An answer with its elements, if it has some.
pub(super) enum Told {
    Plain(Answer),
    Elements(Elements),
}

impl Session {
    /// Starts a process. It loads no plugins, which a file can ask for by a number.
    pub fn start(path: &Path) -> Result<Self, HdfError> {
        let refused = |source: io::Error| HdfError::Process {
            path: path.to_owned(),
            source,
        };
        let mut command = READER
            .get()
            .ok_or_else(|| HdfError::NoReader { path: path.to_owned() })?();
        let (socket, other) = UnixStream::pair().map_err(refused)?;
        command
            .env("HDF5_PLUGIN_PRELOAD", "::")
            .env_remove("HDF5_PLUGIN_PATH")
            .stdin(OwnedFd::from(other))
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Ok(Self {
            child: command.spawn().map_err(refused)?,
            socket,
            left: Duration::from_secs(SECONDS),
        })
    }

    /// Asks and waits for the answer, as long as there is time.
    ///
    /// # Errors
    /// If the process refuses ([`HdfError::Failed`]), after which it can be asked on; or when it breaks down or takes
    /// too long, after which it is gone.
    pub fn ask(&mut self, path: &Path, question: &Question) -> Result<Told, HdfError> {
        let start = Instant::now();
        let told = self.exchange(question, start + self.left);
        match told {
            Ok((reply, bytes)) => {
                let mebibytes = (bytes.len() >> 20) as u32;
                let more = PER_ANSWER + PER_MEBIBYTE * mebibytes;
                self.left = (self.left.saturating_sub(start.elapsed()) + more).min(Duration::from_secs(SECONDS));
                self.told(path, reply, &bytes)
            }
            Err(error) => Err(self.ended(path, &error)),
        }
    }

    fn exchange(&mut self, question: &Question, until: Instant) -> io::Result<(Reply, Vec<u8>)> {
        self.socket.set_write_timeout(Some(self.left.max(PER_ANSWER)))?;
        message::send(&mut self.socket, question, &[])?;
        let mut timed = Timed {
            socket: &self.socket,
            until,
        };
        let reply: Reply = message::receive(&mut timed)?.ok_or(ErrorKind::UnexpectedEof)?;
        let bytes = match &reply {
            Ok(Answer::Numbers(_, count)) => message::bytes(&mut timed, *count)?,
            _ => Vec::new(),
        };
        Ok((reply, bytes))
    }

    fn told(&mut self, path: &Path, reply: Reply, bytes: &[u8]) -> Result<Told, HdfError> {
        Ok(match reply.map_err(|failure| HdfError::failed(path, failure))? {
            Answer::Numbers(element, _) => {
                let elements = elements::from_bytes(&element, bytes);
                Told::Elements(elements.ok_or_else(|| HdfError::Broken {
                    path: path.to_owned(),
                    how: "its answer makes no sense".to_owned(),
                })?)
            }
            Answer::Texts(texts) => Told::Elements(Elements::Text(texts)),
            plain => Told::Plain(plain),
        })
    }

    fn ended(&mut self, path: &Path, error: &io::Error) -> HdfError {
        let path = path.to_owned();
        if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) {
            return HdfError::Endless { path };
        }
        // Its end of the socket is closed when it is gone; an answer that cannot be read may come from one that is not.
        let gone = matches!(
            error.kind(),
            ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe | ErrorKind::ConnectionReset
        );
        let status = if gone { self.child.wait().ok() } else { None };
        let how = status.map_or_else(|| format!("its answer cannot be read: {error}"), how);
        HdfError::Broken { path, how }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A socket that is read until some time.
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
