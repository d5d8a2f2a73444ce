//! The log file of a run: each event in a line, with its time. A run that builds nothing writes none.

use std::fs::File;
use std::io::Write;
use std::sync::{Mutex, PoisonError};

use super::progress::line;
use crate::base::printable;
use crate::orchestrator::{Environment, Event};
use crate::store::{Store, StoreError, log_name};

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
    pub fn new(store: &'a Store) -> Self {
        Self {
            store,
            name: log_name(&Environment::system().now(), std::process::id()),
            state: Mutex::new(State::Waiting(Vec::new())),
        }
    }

    /// Writes down an event.
    pub fn tell(&self, event: &Event) {
        let Some(mut text) = line(event) else { return };
        if let Event::StageFailed(report) = event {
            text += &format!(": {}", report.why.as_deref().unwrap_or_default());
        }
        let text = format!(
            "{} {}\n",
            Environment::system().now(),
            printable(&text).replace('\n', " ")
        );
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

fn written(mut file: File, text: &str) -> Result<State, String> {
    file.write_all(text.as_bytes()).map_err(|e| e.to_string())?;
    Ok(State::Open(file))
}
