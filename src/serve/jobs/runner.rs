//! A run of a pipeline that was begun on the page: `deaflow run` in a process of its own, which a person could have started.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use super::kept::lock;

/// Events that are kept.
const KEPT: usize = 500;

/// Bytes of what a run prints at its end.
const PRINTED: u64 = 1 << 16;

/// How long a run that was asked to end may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// Between two looks at whether it has ended.
const PAUSE: Duration = Duration::from_millis(50);

/// The run that was begun here, if one was.
#[derive(Default)]
pub struct Runner(Mutex<Option<Begun>>);

struct Begun {
    pipeline: String,
    /// The values that it was given, by their paths.
    set: BTreeMap<String, String>,
    child: Child,
    /// When it began, and how long it took as far as it was seen to end.
    start: Instant,
    took: Option<Duration>,
    /// Whether it was asked to end.
    is_stopped: bool,
    told: Arc<Mutex<Told>>,
}

impl Begun {
    /// Whether it goes on.
    fn is_running(&mut self) -> bool {
        let is_running = matches!(self.child.try_wait(), Ok(None));
        if !is_running && self.took.is_none() {
            self.took = Some(self.start.elapsed());
        }
        is_running
    }
}

/// What a run has told.
#[derive(Default)]
struct Told {
    /// The last events but those of progress.
    events: VecDeque<Value>,
    /// The stages that are under way.
    stages: BTreeMap<String, Steps>,
    /// What it has printed at its end: warnings, the results, and where they are.
    printed: String,
}

/// How far a stage has come.
#[derive(Default)]
struct Steps {
    done: u64,
    /// The part that is done of the step that is under way.
    part: f64,
    all: u64,
    unit: String,
    note: String,
}

impl Told {
    fn hear(&mut self, event: Value) {
        let name = event["name"].as_str().unwrap_or_default().to_owned();
        let steps = event["steps"].as_u64().unwrap_or_default();
        let text = |key: &str| event[key].as_str().unwrap_or_default().to_owned();
        match event["event"].as_str().unwrap_or_default() {
            "stage-started" => {
                let begun = Steps {
                    all: steps,
                    unit: text("unit"),
                    ..Steps::default()
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
        if self.events.len() > KEPT {
            self.events.pop_front();
        }
    }

    fn stages(&self) -> Vec<Value> {
        let one = |(name, steps): (&String, &Steps)| {
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
    /// Begins a run, of which one at a time goes on: false where one does.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn begin(&self, pipeline: String, set: BTreeMap<String, String>, mut command: Command) -> io::Result<bool> {
        let mut held = lock(&self.0);
        if held.as_mut().is_some_and(Begun::is_running) {
            return Ok(false);
        }
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let told: Arc<Mutex<Told>> = Arc::default();
        if let Some(mut stdout) = child.stdout.take() {
            let told = Arc::clone(&told);
            let listen = move || {
                let mut bytes = Vec::new();
                // What cannot be read is not shown, and what is beyond is taken from the pipe, so that nobody waits.
                let _ = stdout.by_ref().take(PRINTED).read_to_end(&mut bytes);
                let _ = io::copy(&mut stdout, &mut io::sink());
                lock(&told).printed = String::from_utf8_lossy(&bytes).into_owned();
            };
            std::thread::Builder::new().name("printed".to_owned()).spawn(listen)?;
        }
        if let Some(stderr) = child.stderr.take() {
            let told = Arc::clone(&told);
            // It ends with the process that writes.
            let listen = move || {
                for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                    let event =
                        serde_json::from_str(&line).unwrap_or_else(|_| json!({ "event": "line", "text": line }));
                    lock(&told).hear(event);
                }
            };
            std::thread::Builder::new().name("run".to_owned()).spawn(listen)?;
        }
        *held = Some(Begun {
            pipeline,
            set,
            child,
            start: Instant::now(),
            took: None,
            is_stopped: false,
            told,
        });
        Ok(true)
    }

    /// What has become of it.
    #[must_use]
    pub fn told(&self) -> Value {
        let mut held = lock(&self.0);
        let Some(begun) = held.as_mut() else {
            return json!({ "pipeline": null, "running": false, "exit_code": null, "stages": [], "events": [] });
        };
        let is_running = begun.is_running();
        let ended = begun.child.try_wait().ok().flatten();
        let told = lock(&begun.told);
        json!({
            "pipeline": begun.pipeline,
            "pid": begun.child.id(),
            "set": begun.set,
            "running": is_running,
            "exit_code": ended.and_then(|status| status.code()),
            "stopped": begun.is_stopped,
            "seconds": begun.took.unwrap_or_else(|| begun.start.elapsed()).as_secs_f64(),
            "printed": told.printed,
            "stages": told.stages(),
            "events": told.events.iter().collect::<Vec<_>>(),
        })
    }

    /// How far it has come; null where none goes on.
    #[must_use]
    pub fn progress(&self) -> Value {
        let mut held = lock(&self.0);
        let Some(begun) = held.as_mut() else { return Value::Null };
        match begun.is_running() {
            true => {
                json!({ "pipeline": begun.pipeline, "pid": begun.child.id(), "stages": lock(&begun.told).stages() })
            }
            false => Value::Null,
        }
    }

    /// Asks it to end.
    pub fn stop(&self) {
        if let Some(begun) = lock(&self.0).as_mut() {
            begun.is_stopped |= begun.is_running();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_added_up_until_the_stage_ends() {
        let mut told = Told::default();
        for event in [
            json!({ "event": "stage-started", "name": "a", "kind": "solve", "steps": 8, "unit": "patterns" }),
            json!({ "event": "resumed", "name": "a", "steps": 2 }),
            json!({ "event": "progress", "name": "a", "steps": 3 }),
            json!({ "event": "part", "name": "a", "done": 0.5 }),
            json!({ "event": "note", "name": "a", "text": "so far" }),
        ] {
            told.hear(event);
        }
        let expected = json!({ "name": "a", "done": 5.5, "steps": 8, "unit": "patterns", "note": "so far" });
        assert_eq!(told.stages(), [expected]);
        told.hear(json!({ "event": "stage-finished", "name": "a" }));
        assert!(told.stages().is_empty());
        assert_eq!(told.events.len(), 2, "progress is no news");
    }
}
