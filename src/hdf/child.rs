//! The process that reads untrusted files: `deaflow read-hdf5`, which only this program starts.

use std::io::{self, ErrorKind, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

use super::error::Failure;
use super::limits;
use super::message::{self, FileRequest, Reply, Started};
use super::respond::Responder;

/// The command that starts it. It is not for users.
pub const COMMAND: &str = "read-hdf5";

/// Answers requests from the socket on standard input until the other side closes it. First it says that it runs.
///
/// # Errors
/// If standard input is not a connected socket, or the limits cannot be set.
pub fn serve() -> io::Result<()> {
    let mut socket = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    // Fails without a socket, while an error can still be printed.
    socket.peer_addr()?;
    limits::apply()?;
    message::send(&mut socket, &Started, &[])?;
    let mut responder = Responder::default();
    while let Some(request) = message::receive::<FileRequest>(&mut socket)? {
        limits::allow_seconds()?;
        let (reply, bytes) = responder.respond(&request);
        send_reply(&mut socket, &reply, &bytes)?;
    }
    Ok(())
}

/// Sends a reply. If it is too long for a message, which is known before anything is sent, sends a failure instead.
fn send_reply(socket: &mut impl Write, reply: &Reply, bytes: &[u8]) -> io::Result<()> {
    match message::send(socket, reply, bytes) {
        Err(error) if error.kind() == ErrorKind::InvalidData => {
            let refused: Reply = Err(Failure::Refused(
                "its names and attributes are longer than allowed".into(),
            ));
            message::send(socket, &refused, &[])
        }
        sent => sent,
    }
}
