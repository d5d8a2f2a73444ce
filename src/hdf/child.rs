//! The process that reads files of others: `deaflow read-hdf5`, which only this program starts.

use std::io::{self, ErrorKind, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

use super::answer::Answers;
use super::error::Failure;
use super::limits;
use super::message::{self, Question, Reply};

/// The word on the command line that starts it. It is no command for people.
pub const COMMAND: &str = "read-hdf5";

/// Answers what comes over the socket on standard input until the other side ends.
///
/// # Errors
/// When standard input is no socket of this program, or the system refuses limits.
pub fn serve() -> io::Result<()> {
    let mut socket = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    // Whoever starts it by hand has no socket there, and is told while writing is still allowed.
    socket.peer_addr()?;
    limits::apply()?;
    let mut answers = Answers::default();
    while let Some(question) = message::receive::<Question>(&mut socket)? {
        limits::allow_seconds()?;
        let (reply, bytes) = answers.answer(&question);
        tell(&mut socket, &reply, &bytes)?;
    }
    Ok(())
}

/// An answer too long for a message is refused: it is encoded before a byte of it is sent.
fn tell(socket: &mut impl Write, reply: &Reply, bytes: &[u8]) -> io::Result<()> {
    match message::send(socket, reply, bytes) {
        Err(error) if error.kind() == ErrorKind::InvalidData => {
            let refused: Reply = Err(Failure::Refused("its description is too long".into()));
            message::send(socket, &refused, &[])
        }
        sent => sent,
    }
}
