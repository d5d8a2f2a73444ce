//! The log file of a run: each event in a line, with its time. A run that builds nothing writes none. The first line names the file of the
//! pipeline and the last says that the run has ended: where that is missing it was killed, or goes on.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::progress::line;
use crate::base::printable;
use crate::orchestrator::{Environment, Event};
use crate::store::{Store, StoreError, log_name};

/// The first words of a log, before the path of the pipeline.
const BEGUN: &str = "run of ";

/// Its last line.
const ENDED: &str = "ended";

/// A log file that is created when there is something to say.
pub struct RunLog<'a> {
    store: &'a Store,
    /// Its name in the folder of the store.
    pub name: String,
    state: Mutex<State>,
}

enum State {
    /// Lines that are worth a file only when something is built.
    Waiting(Vec<String>),
    Open(File),
    /// Why nothing more is written.
    Failed(String),
}

impl<'a> RunLog<'a> {
    pub fn new(store: &'a Store, pipeline: &Path) -> Self {
        let now = Environment::system().now();
        let first = one_line(&now, &format!("{BEGUN}{}", pipeline.display()));
        Self {
            store,
            name: log_name(&now, std::process::id()),
            state: Mutex::new(State::Waiting(vec![first])),
        }
    }

    /// Writes down that the run has ended, however it did.
    pub fn end(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let State::Open(file) = &mut *state {
            let text = one_line(&Environment::system().now(), ENDED);
            if let Err(why) = file.write_all(text.as_bytes()) {
                *state = State::Failed(why.to_string());
            }
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
    /// The last that it said.
    pub last: String,
    /// Its log file, in the folder of the store.
    pub log: String,
}

/// Runs of which the log does not say that they have ended, newest first.
///
/// # Errors
/// When the store cannot be read.
pub fn unfinished(store: &Store) -> Result<Vec<Unfinished>, StoreError> {
    let read = |log: String| {
        let text = store.read_log(&log)?;
        let mut lines = text.lines().filter_map(|line| line.split_once(' '));
        let (begun, first) = lines.next()?;
        let path = PathBuf::from(first.strip_prefix(BEGUN)?);
        let last = lines.next_back().map_or("", |(_, said)| said);
        (last != ENDED).then(|| Unfinished {
            path,
            begun: begun.to_owned(),
            last: last.to_owned(),
            log,
        })
    };
    Ok(store.logs()?.into_iter().filter_map(read).collect())
}

/// A line of a log.
fn one_line(now: &str, text: &str) -> String {
    format!("{now} {}\n", printable(text).replace('\n', " "))
}

fn written(mut file: File, text: &str) -> Result<State, String> {
    file.write_all(text.as_bytes()).map_err(|e| e.to_string())?;
    Ok(State::Open(file))
}
