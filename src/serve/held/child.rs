//! A run of a pipeline that was begun on the page: `deaflow run` in a process of its own, which a person could have started.

use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use super::kept::lock;

/// Events that are kept.
const KEPT: usize = 500;

/// How long a run that was asked to end may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// Between two looks at whether it has ended.
const PAUSE: Duration = Duration::from_millis(50);

/// The run that was begun here, if one was.
#[derive(Default)]
pub struct Runner(Mutex<Option<Begun>>);

struct Begun {
    pipeline: String,
    child: Child,
    events: Arc<Mutex<VecDeque<Value>>>,
}

impl Runner {
    /// Begins a run, of which one at a time goes on: false where one does.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn begin(&self, pipeline: String, mut command: Command) -> io::Result<bool> {
        let mut held = lock(&self.0);
        if let Some(begun) = held.as_mut()
            && matches!(begun.child.try_wait(), Ok(None))
        {
            return Ok(false);
        }
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let events: Arc<Mutex<VecDeque<Value>>> = Arc::default();
        if let Some(stderr) = child.stderr.take() {
            let told = Arc::clone(&events);
            // It ends with the process that writes.
            let listen = move || {
                for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                    let event =
                        serde_json::from_str(&line).unwrap_or_else(|_| json!({ "event": "line", "text": line }));
                    let mut told = lock(&told);
                    told.push_back(event);
                    if told.len() > KEPT {
                        told.pop_front();
                    }
                }
            };
            std::thread::Builder::new().name("run".to_owned()).spawn(listen)?;
        }
        *held = Some(Begun {
            pipeline,
            child,
            events,
        });
        Ok(true)
    }

    /// What has become of it.
    #[must_use]
    pub fn told(&self) -> Value {
        let mut held = lock(&self.0);
        let Some(begun) = held.as_mut() else {
            return json!({ "pipeline": null, "running": false, "exit_code": null, "events": [] });
        };
        let ended = begun.child.try_wait().ok().flatten();
        json!({
            "pipeline": begun.pipeline,
            "running": ended.is_none(),
            "exit_code": ended.and_then(|status| status.code()),
            "events": lock(&begun.events).iter().collect::<Vec<_>>(),
        })
    }

    /// Asks it to end.
    pub fn stop(&self) {
        if let Some(begun) = lock(&self.0).as_mut() {
            stop(&mut begun.child);
        }
    }

    /// Ends it, and waits for that a while.
    pub fn end(&self) {
        let mut held = lock(&self.0);
        let Some(begun) = held.as_mut() else { return };
        stop(&mut begun.child);
        let asked = Instant::now();
        while matches!(begun.child.try_wait(), Ok(None)) {
            if asked.elapsed() > PATIENCE {
                // What it has built stays, and nothing that is visible is half-done.
                let _ = begun.child.kill();
                let _ = begun.child.wait();
                return;
            }
            std::thread::sleep(PAUSE);
        }
    }
}

/// Asks a process to end; one that has ended is asked nothing.
fn stop(child: &mut Child) {
    if matches!(child.try_wait(), Ok(None))
        && let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw)
    {
        // It may end by itself meanwhile.
        let _ = kill_process(pid, Signal::INT);
    }
}
