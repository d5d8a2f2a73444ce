//! A run of a pipeline that the page started: `deaflow run` in a process of its own.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use crate::cache::lock;

/// Number of events kept.
const MAX_EVENTS: usize = 500;

/// Bytes of the output that a run prints at its end.
const MAX_OUTPUT: u64 = 1 << 16;

/// Time that a run has to end after an interrupt before it is killed.
const PATIENCE: Duration = Duration::from_secs(5);

/// Time between two checks whether it has ended.
const PAUSE: Duration = Duration::from_millis(50);

/// The run that this server started, if any.
#[derive(Default)]
pub struct Runner(Mutex<Option<StartedRun>>);

struct StartedRun {
    pipeline: String,
    /// The `--set` values, by path.
    set: BTreeMap<String, String>,
    child: Child,
    /// Start time, and the duration once the end was seen.
    start: Instant,
    took: Option<Duration>,
    /// Whether it was interrupted by the page.
    is_stopped: bool,
    progress: Arc<Mutex<RunProgress>>,
}

impl StartedRun {
    /// Whether it is still running; stores the duration at the first call after its end.
    fn is_running(&mut self) -> bool {
        let is_running = matches!(self.child.try_wait(), Ok(None));
        if !is_running && self.took.is_none() {
            self.took = Some(self.start.elapsed());
        }
        is_running
    }
}

/// Events and output of a run.
#[derive(Default)]
struct RunProgress {
    /// The last events, without progress events.
    events: VecDeque<Value>,
    /// The stages that are being built.
    stages: BTreeMap<String, StageProgress>,
    /// The output at its end: warnings, results and their paths.
    printed: String,
}

/// Progress of a stage.
#[derive(Default)]
struct StageProgress {
    done: u64,
    /// The fraction of the current step that is done.
    part: f64,
    all: u64,
    unit: String,
    note: String,
}

impl RunProgress {
    fn add_event(&mut self, event: Value) {
        let name = event["name"].as_str().unwrap_or_default().to_owned();
        let steps = event["steps"].as_u64().unwrap_or_default();
        let text = |key: &str| event[key].as_str().unwrap_or_default().to_owned();
        match event["event"].as_str().unwrap_or_default() {
            "stage-started" => {
                let begun = StageProgress {
                    all: steps,
                    unit: text("unit"),
                    ..StageProgress::default()
                };
                self.stages.insert(name, begun);
            }
            "stage-finished" | "stage-failed" => {
                self.stages.remove(&name);
            }
            "progress" | "resumed" | "part" | "note" | "chunk-built" => {
                let stage = self.stages.entry(name).or_default();
                match event["event"].as_str() {
                    Some("part") => stage.part = event["done"].as_f64().unwrap_or_default(),
                    Some("note") => stage.note = text("text"),
                    Some("chunk-built") => {}
                    _ => (stage.done, stage.part) = (stage.done + steps, 0.0),
                }
                return;
            }
            _ => {}
        }
        self.events.push_back(event);
        if self.events.len() > MAX_EVENTS {
            self.events.pop_front();
        }
    }

    fn stages(&self) -> Vec<Value> {
        let one = |(name, steps): (&String, &StageProgress)| {
            json!({
                "name": name,
                "done": steps.done as f64 + steps.part,
                "steps": steps.all,
                "unit": steps.unit,
                "note": steps.note,
            })
        };
        self.stages.iter().map(one).collect()
    }
}

impl Runner {
    /// Starts a run. Returns false if one is already running.
    ///
    /// # Errors
    /// If the process or its reader threads cannot be started.
    pub fn start(&self, pipeline: String, set: BTreeMap<String, String>, mut command: Command) -> io::Result<bool> {
        let mut current = lock(&self.0);
        if current.as_mut().is_some_and(StartedRun::is_running) {
            return Ok(false);
        }
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let progress: Arc<Mutex<RunProgress>> = Arc::default();
        if let Some(mut stdout) = child.stdout.take() {
            let progress = Arc::clone(&progress);
            let listen = move || {
                let mut bytes = Vec::new();
                // The rest is read and dropped, so that the process does not block on a full pipe.
                let _ = stdout.by_ref().take(MAX_OUTPUT).read_to_end(&mut bytes);
                let _ = io::copy(&mut stdout, &mut io::sink());
                lock(&progress).printed = String::from_utf8_lossy(&bytes).into_owned();
            };
            std::thread::Builder::new()
                .name("run-output".to_owned())
                .spawn(listen)?;
        }
        if let Some(stderr) = child.stderr.take() {
            let progress = Arc::clone(&progress);
            // The thread ends when the process closes the pipe.
            let listen = move || {
                for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                    let event =
                        serde_json::from_str(&line).unwrap_or_else(|_| json!({ "event": "line", "text": line }));
                    lock(&progress).add_event(event);
                }
            };
            std::thread::Builder::new()
                .name("run-events".to_owned())
                .spawn(listen)?;
        }
        *current = Some(StartedRun {
            pipeline,
            set,
            child,
            start: Instant::now(),
            took: None,
            is_stopped: false,
            progress,
        });
        Ok(true)
    }

    /// Returns the state of the run as a document.
    #[must_use]
    pub fn document(&self) -> Value {
        let mut current = lock(&self.0);
        let Some(run) = current.as_mut() else {
            return json!({ "pipeline": null, "running": false, "exit_code": null, "stages": [], "events": [] });
        };
        let is_running = run.is_running();
        let status = run.child.try_wait().ok().flatten();
        let progress = lock(&run.progress);
        json!({
            "pipeline": run.pipeline,
            "pid": run.child.id(),
            "set": run.set,
            "running": is_running,
            "exit_code": status.and_then(|status| status.code()),
            "stopped": run.is_stopped,
            "seconds": run.took.unwrap_or_else(|| run.start.elapsed()).as_secs_f64(),
            "printed": progress.printed,
            "stages": progress.stages(),
            "events": progress.events.iter().collect::<Vec<_>>(),
        })
    }

    /// Returns the progress of the stages; null if nothing is running.
    #[must_use]
    pub fn progress(&self) -> Value {
        let mut current = lock(&self.0);
        let Some(run) = current.as_mut() else {
            return Value::Null;
        };
        match run.is_running() {
            true => json!({ "pipeline": run.pipeline, "pid": run.child.id(), "stages": lock(&run.progress).stages() }),
            false => Value::Null,
        }
    }

    /// Interrupts the run.
    pub fn stop(&self) {
        if let Some(run) = lock(&self.0).as_mut() {
            run.is_stopped |= run.is_running();
            interrupt(&mut run.child);
        }
    }

    /// Interrupts the run, waits for its end, and kills it if that takes too long.
    pub fn end(&self) {
        let mut current = lock(&self.0);
        let Some(run) = current.as_mut() else { return };
        interrupt(&mut run.child);
        let interrupted = Instant::now();
        while matches!(run.child.try_wait(), Ok(None)) {
            if interrupted.elapsed() > PATIENCE {
                // Finished artifacts stay, and unfinished files are never visible.
                let _ = run.child.kill();
                let _ = run.child.wait();
                return;
            }
            std::thread::sleep(PAUSE);
        }
    }
}

/// Sends SIGINT to a process that is still running.
fn interrupt(child: &mut Child) {
    if matches!(child.try_wait(), Ok(None))
        && let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw)
    {
        // It may have ended meanwhile.
        let _ = kill_process(pid, Signal::INT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_added_up_until_the_stage_ends() {
        let mut told = RunProgress::default();
        for event in [
            json!({ "event": "stage-started", "name": "a", "kind": "solve", "steps": 8, "unit": "patterns" }),
            json!({ "event": "resumed", "name": "a", "steps": 2 }),
            json!({ "event": "progress", "name": "a", "steps": 3 }),
            json!({ "event": "part", "name": "a", "done": 0.5 }),
            json!({ "event": "note", "name": "a", "text": "so far" }),
        ] {
            told.add_event(event);
        }
        let expected = json!({ "name": "a", "done": 5.5, "steps": 8, "unit": "patterns", "note": "so far" });
        assert_eq!(told.stages(), [expected]);
        told.add_event(json!({ "event": "stage-finished", "name": "a" }));
        assert!(told.stages().is_empty());
        assert_eq!(told.events.len(), 2, "progress events are not kept");
    }
}
