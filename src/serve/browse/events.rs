//! A stream of the status of the store.

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::json;

use super::runs::status_document;
use crate::http::{ApiError, LineSender, Request, Response};
use crate::state::ServerState;

/// Time between two checks.
const INTERVAL: Duration = Duration::from_millis(500);

/// After this time without a change, the status is sent again, so that a closed connection is noticed.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// Sends the document of `/api/status`, a line each time that it changes.
///
/// # Errors
/// If no thread can be started.
pub fn events(state: &Arc<ServerState>, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let (lines, response) = LineSender::new();
    let state = Arc::clone(state);
    let watch = move || {
        let mut last = json!(null);
        let mut sent = Instant::now();
        while !lines.is_closed() {
            // After an error the store may be readable again at the next check.
            let now = status_document(&state).unwrap_or_else(|error| error.document());
            if now != last || sent.elapsed() > KEEP_ALIVE {
                if !lines.send(&now) {
                    return;
                }
                (last, sent) = (now, Instant::now());
            }
            sleep(INTERVAL);
        }
    };
    let started = std::thread::Builder::new().name("events".to_owned()).spawn(watch);
    started.map_err(|error| ApiError::new(503, format!("cannot start the event stream: {error}")))?;
    Ok(response)
}
