//! What goes on, told as it happens.

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::json;

use super::runs::standing;
use crate::http::{Answer, Lines, Refusal, Request};
use crate::state::ServedState;

/// Between two looks.
const BEAT: Duration = Duration::from_millis(500);

/// After so long without news a line says that there are none: who is gone is known by that.
const QUIET: Duration = Duration::from_secs(15);

/// What `/api/status` says, in a line each time that it is another.
///
/// # Errors
/// When the system gives no thread.
pub fn events(state: &Arc<ServedState>, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let (lines, answer) = Lines::new();
    let state = Arc::clone(state);
    let tell = move || {
        let mut last = json!(null);
        let mut told = Instant::now();
        while !lines.is_closed() {
            let now = match standing(&state) {
                Ok(now) => now,
                // It may be there again at the next look.
                Err(refusal) => refusal.document(),
            };
            if now != last || told.elapsed() > QUIET {
                if !lines.send(&now) {
                    return;
                }
                (last, told) = (now, Instant::now());
            }
            sleep(BEAT);
        }
    };
    let begun = std::thread::Builder::new().name("events".to_owned()).spawn(tell);
    begun.map_err(|error| Refusal::new(503, format!("nothing can be listened to: {error}")))?;
    Ok(answer)
}
