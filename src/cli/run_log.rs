//! The log file of a run: each event in a line, with its time. A run that builds nothing writes none. The first line names the file of the
//! pipeline and the last says that the run has ended: where that is missing it was killed, or goes on.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde_json::json;

use super::progress::line;
use deaflow_base::printable;
use deaflow_orchestrator::{Environment, Event};
use deaflow_store::{Store, StoreError, log_name};

/// The first words of a log, before the path of the pipeline.
const BEGUN: &str = "run of ";

/// The first words of the line that says what `--set` changed, before these values by their paths in JSON; none where nothing is changed.
const CHANGED: &str = "changed by --set ";

/// Its last line.
const ENDED: &str = "ended";

/// A log file that is created when there is something to say.
pub struct RunLog<'a> {
    store: &'a Store,
    /// Its name in the folder of the store.
    pub name: String,
    /// The line of what `--set` changed, to be written after the first event.
    changed: Option<String>,
    state: Mutex<State>,
}

enum State {
    /// Lines that are worth a file only when something is built.
    Waiting(Vec<String>),
    Open(File),
    /// Why nothing more is written.
    Failed(String),
}

impl Drop for RunLog<'_> {
    fn drop(&mut self) {
        self.end();
    }
}

impl<'a> RunLog<'a> {
    pub fn new(store: &'a Store, pipeline: &Path, overrides: &BTreeMap<String, String>) -> Self {
        let now = Environment::system().now();
        let first = one_line(&now, &format!("{BEGUN}{}", pipeline.display()));
        let changed = (!overrides.is_empty()).then(|| one_line(&now, &format!("{CHANGED}{}", json!(overrides))));
        Self {
            store,
            name: log_name(&now, std::process::id()),
            changed,
            state: Mutex::new(State::Waiting(vec![first])),
        }
    }

    /// Writes down that the run has ended, however it did; nothing is written after that. So it does when it is dropped.
    pub fn end(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let State::Open(file) = &mut *state {
            let text = one_line(&Environment::system().now(), ENDED);
            *state = match file.write_all(text.as_bytes()) {
                Ok(()) => State::Waiting(Vec::new()),
                Err(why) => State::Failed(why.to_string()),
            };
        }
    }

    /// Writes down an event.
    pub fn tell(&self, event: &Event) {
        let Some(mut text) = line(event) else { return };
        if let Event::StageFailed(report) = event {
            text += &format!(": {}", report.why.as_deref().unwrap_or_default());
        }
        let text = one_line(&Environment::system().now(), &text);
        // It is changed in one step: a panic elsewhere leaves a state that is right.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let next = match std::mem::replace(&mut *state, State::Waiting(Vec::new())) {
            State::Waiting(mut lines) => {
                lines.push(text);
                if lines.len() == 2 {
                    lines.extend(self.changed.clone());
                }
                match event {
                    Event::StageStarted { .. } | Event::StageFailed(_) => self.open(&lines),
                    _ => Ok(State::Waiting(lines)),
                }
            }
            State::Open(file) => written(file, &text),
            State::Failed(why) => Ok(State::Failed(why)),
        };
        *state = next.unwrap_or_else(State::Failed);
    }

    fn open(&self, lines: &[String]) -> Result<State, String> {
        let file = self
            .store
            .create_log(&self.name)
            .map_err(|e: StoreError| e.to_string())?;
        written(file, &lines.concat())
    }

    /// Why it is not whole, if it is not.
    pub fn trouble(&self) -> Option<String> {
        match &*self.state.lock().unwrap_or_else(PoisonError::into_inner) {
            State::Failed(why) => Some(why.clone()),
            State::Waiting(_) | State::Open(_) => None,
        }
    }
}

/// A run that was killed, or goes on.
pub struct Unfinished {
    /// The file of its pipeline.
    pub path: PathBuf,
    /// When it began, in UTC, RFC 3339.
    pub begun: String,
    /// What `--set` changed: values by their dotted paths.
    pub overrides: BTreeMap<String, String>,
    /// The last that it said.
    pub last: String,
    /// Its log file, in the folder of the store.
    pub log: String,
}

/// Runs of which the log does not say that they have ended, newest first. One whose command has been run to an end since is none: what it had
/// come to has been gone on with.
///
/// # Errors
/// When the store cannot be read.
pub fn unfinished(store: &Store) -> Result<Vec<Unfinished>, StoreError> {
    let read = |log: String| {
        let text = store.read_log(&log)?;
        let mut lines = text.lines().filter_map(|line| line.split_once(' '));
        let (begun, first) = lines.next()?;
        let path = PathBuf::from(first.strip_prefix(BEGUN)?);
        let changed = lines.clone().take(2).find_map(|(_, said)| said.strip_prefix(CHANGED));
        let last = lines.next_back().map_or("", |(_, said)| said);
        (last != ENDED).then(|| Unfinished {
            path,
            begun: begun.to_owned(),
            overrides: changed
                .and_then(|changed| serde_json::from_str(changed).ok())
                .unwrap_or_default(),
            last: last.to_owned(),
            log,
        })
    };
    let mut found: Vec<Unfinished> = store.logs()?.into_iter().filter_map(read).collect();
    let Some(oldest) = found.last().map(|run| run.begun.clone()) else {
        return Ok(found);
    };
    for run in store.runs()? {
        let run = run?;
        // Times are written alike, so that their order is that of their texts.
        if run.created <= oldest {
            break;
        }
        found.retain(|open| {
            let is_same = Path::new(&run.path) == open.path && run.overrides == open.overrides;
            !(is_same && run.created > open.begun)
        });
    }
    Ok(found)
}

/// A line of a log.
fn one_line(now: &str, text: &str) -> String {
    format!("{now} {}\n", printable(text).replace('\n', " "))
}

fn written(mut file: File, text: &str) -> Result<State, String> {
    file.write_all(text.as_bytes()).map_err(|e| e.to_string())?;
    Ok(State::Open(file))
}
