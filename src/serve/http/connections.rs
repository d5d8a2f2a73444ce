//! The open connections. When there are too many, one without the token makes room, so that strangers cannot shut the
//! owner out.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::task::AbortHandle;

/// Connections at a time; a browser opens six.
pub const MAX_CONNECTIONS: usize = 64;

/// The open connections, the oldest first.
#[derive(Default)]
pub struct Connections(Vec<Connection>);

struct Connection {
    task: AbortHandle,
    /// Whether a request on it had the token.
    is_admitted: Arc<AtomicBool>,
}

impl Connections {
    /// Returns whether there is room for a connection, for which the oldest one without the token is closed if
    /// necessary.
    pub fn make_room(&mut self) -> bool {
        self.0.retain(|connection| !connection.task.is_finished());
        if self.0.len() < MAX_CONNECTIONS {
            return true;
        }
        let is_stranger = |connection: &Connection| !connection.is_admitted.load(Ordering::Relaxed);
        let Some(oldest) = self.0.iter().position(is_stranger) else {
            return false;
        };
        self.0.remove(oldest).task.abort();
        true
    }

    /// Adds a connection with its task.
    pub fn add(&mut self, task: AbortHandle, is_admitted: Arc<AtomicBool>) {
        self.0.push(Connection { task, is_admitted });
    }
}
