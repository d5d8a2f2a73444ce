//! The log file of a run: one line per event, with its time. A run that builds nothing writes none. The first line
//! names the
//! file of the pipeline, the last one marks the end of the run; without it, the run was killed or is still running.

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

/// The beginning of a log, before the path of the pipeline.
const BEGUN: &str = "run of ";

/// The beginning of the line of overrides, before a JSON map of paths and values; there is none without overrides.
const CHANGED: &str = "changed by --set ";

/// The last line.
const ENDED: &str = "ended";

/// A log file that is created when the first stage is built.
pub struct RunLog {
    store: Store,
    /// Its name in the folder of the store.
    pub name: String,
    /// The line of overrides, which follows the first event.
    changed: Option<String>,
    state: Mutex<LogState>,
}

enum LogState {
    /// Lines to write once something is built.
    Waiting(Vec<String>),
    Open(File),
    /// Writing has failed, for this reason.
    Failed(String),
}

impl Drop for RunLog {
    fn drop(&mut self) {
        self.end();
    }
}

impl RunLog {
    pub fn new(store: &Store, pipeline: &Path, overrides: &BTreeMap<String, String>) -> Self {
        let now = Environment::system().now();
        let first = one_line(&now, &format!("{BEGUN}{}", pipeline.display()));
        let changed = (!overrides.is_empty()).then(|| one_line(&now, &format!("{CHANGED}{}", json!(overrides))));
        Self {
            store: store.clone(),
            name: log_name(&now, std::process::id()),
            changed,
            state: Mutex::new(LogState::Waiting(vec![first])),
        }
    }

    /// Marks the end of the run; nothing is written after that. Dropping the log does so too.
    pub fn end(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let LogState::Open(file) = &mut *state {
            let text = one_line(&Environment::system().now(), ENDED);
            *state = match file.write_all(text.as_bytes()) {
                Ok(()) => LogState::Waiting(Vec::new()),
                Err(why) => LogState::Failed(why.to_string()),
            };
        }
    }

    /// Writes an event.
    pub fn write(&self, event: &Event) {
        let Some(mut text) = line(event) else { return };
        if let Event::StageFailed(report) = event {
            text += &format!(": {}", report.why.as_deref().unwrap_or_default());
        }
        let text = one_line(&Environment::system().now(), &text);
        // A panic elsewhere leaves a valid state: it is changed in one step.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let next = match std::mem::replace(&mut *state, LogState::Waiting(Vec::new())) {
            LogState::Waiting(mut lines) => {
                lines.push(text);
                if lines.len() == 2 {
                    lines.extend(self.changed.clone());
                }
                match event {
                    Event::StageStarted { .. } | Event::StageFailed(_) => self.open(&lines),
                    _ => Ok(LogState::Waiting(lines)),
                }
            }
            LogState::Open(file) => written(file, &text),
            LogState::Failed(why) => Ok(LogState::Failed(why)),
        };
        *state = next.unwrap_or_else(LogState::Failed);
    }

    fn open(&self, lines: &[String]) -> Result<LogState, String> {
        let file = self
            .store
            .create_log(&self.name)
            .map_err(|e: StoreError| e.to_string())?;
        written(file, &lines.concat())
    }

    /// Returns why the log is incomplete, if it is.
    pub fn failure(&self) -> Option<String> {
        match &*self.state.lock().unwrap_or_else(PoisonError::into_inner) {
            LogState::Failed(why) => Some(why.clone()),
            LogState::Waiting(_) | LogState::Open(_) => None,
        }
    }
}

/// A run that was killed, or is still running.
pub struct UnfinishedRun {
    /// The file of its pipeline.
    pub path: PathBuf,
    /// When it began, in UTC, RFC 3339.
    pub begun: String,
    /// The overrides: values by dotted path.
    pub overrides: BTreeMap<String, String>,
    /// Its last event.
    pub last: String,
    /// Its log file, in the folder of the store.
    pub log: String,
}

/// Returns the runs whose log has no end, newest first, except those whose command has been run to an end since.
///
/// # Errors
/// When the store cannot be read.
pub fn unfinished(store: &Store) -> Result<Vec<UnfinishedRun>, StoreError> {
    let read = |log: String| {
        let text = store.read_log(&log)?;
        let mut lines = text.lines().filter_map(|line| line.split_once(' '));
        let (begun, first) = lines.next()?;
        let path = PathBuf::from(first.strip_prefix(BEGUN)?);
        let changed = lines.clone().take(2).find_map(|(_, text)| text.strip_prefix(CHANGED));
        let last = lines.next_back().map_or("", |(_, text)| text);
        (last != ENDED).then(|| UnfinishedRun {
            path,
            begun: begun.to_owned(),
            overrides: changed
                .and_then(|changed| serde_json::from_str(changed).ok())
                .unwrap_or_default(),
            last: last.to_owned(),
            log,
        })
    };
    let mut found: Vec<UnfinishedRun> = store.logs()?.into_iter().filter_map(read).collect();
    let Some(oldest) = found.last().map(|run| run.begun.clone()) else {
        return Ok(found);
    };
    for run in store.runs()? {
        let run = run?;
        // All times have one format, so that they can be compared as texts.
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

/// Formats a line of a log.
fn one_line(now: &str, text: &str) -> String {
    format!("{now} {}\n", printable(text).replace('\n', " "))
}

fn written(mut file: File, text: &str) -> Result<LogState, String> {
    file.write_all(text.as_bytes()).map_err(|e| e.to_string())?;
    Ok(LogState::Open(file))
}
