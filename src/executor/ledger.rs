//! The ledger: a note in the store on what has been submitted for a pipeline, so that another submitter can continue.

use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use deaflow_base::{Digest, host_name};

/// The number of ended arrays that are kept.
const KEPT: usize = 100;

/// The name of the note.
pub const LEDGER: &str = "ledger";

/// The submitted arrays of a pipeline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// The options of the submitter.
    #[serde(rename = "recipe")]
    pub options: SubmitOptions,
    /// Part of the names of its arrays that distinguishes them from those of other stores.
    pub mark: String,
    /// Number of arrays submitted so far.
    #[serde(rename = "begun")]
    pub submitted: u32,
    /// The latest arrays.
    pub arrays: Vec<Array>,
}

/// The options of a submitter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SubmitOptions {
    /// `slurm` or `command`.
    pub engine: String,
    /// Path and content of the profile, if there is one.
    pub profile: Option<(String, String)>,
    /// The command that submits workers, if not in the profile.
    pub submit: Option<String>,
    /// The stage up to which to build.
    pub until: Option<String>,
    /// Whether to build the other stages if one fails.
    pub keep_going: bool,
}

/// One array of workers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Array {
    /// Its unique name.
    pub name: String,
    /// The stages that it builds.
    pub stages: Vec<String>,
    /// Number of workers it was submitted with.
    pub workers: u32,
    /// Number of queued or running workers, as far as is known.
    #[serde(rename = "living")]
    pub active: u32,
    /// Its number, if the engine reports it.
    pub number: Option<String>,
    /// Time of submission in UTC, by the submitter's clock.
    pub since: String,
    /// Number of finished pieces of its stages at submission.
    pub before: u64,
    /// Time of the last checkpoint in the store at submission, s since 1970.
    pub checkpoint: u64,
    /// Whether the engine did not confirm it.
    pub refused: bool,
}

impl Ledger {
    /// Returns the arrays that may have queued or running workers.
    pub fn active(&self) -> impl Iterator<Item = &Array> {
        self.arrays.iter().filter(|array| array.active > 0)
    }

    /// Notes that no array has workers any more.
    pub fn end_all(&mut self) {
        self.arrays.iter_mut().for_each(|array| array.active = 0);
    }

    /// Adds an array and drops the oldest of those that have ended. `before` and `checkpoint` as in [`Array`].
    pub fn add(&mut self, topic: &str, stages: Vec<String>, workers: u32, (before, checkpoint): (u64, u64)) -> Array {
        let now = SystemTime::now();
        if self.mark.is_empty() {
            let since = now.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
            let text = format!("{} {} {}", host_name(), std::process::id(), since.as_nanos());
            self.mark = Digest::of(text.as_bytes()).short()[..6].to_owned();
        }
        self.submitted += 1;
        let ended = self.arrays.iter().filter(|array| array.active == 0).count();
        let mut surplus = ended.saturating_sub(KEPT);
        self.arrays.retain(|array| {
            let is_dropped = array.active == 0 && surplus > 0;
            surplus -= usize::from(is_dropped);
            !is_dropped
        });
        let array = Array {
            name: format!("deaflow-{topic}-{}-{}", self.mark, self.submitted),
            stages,
            workers,
            active: workers,
            number: None,
            since: humantime::format_rfc3339_seconds(now).to_string(),
            before,
            checkpoint,
            refused: false,
        };
        self.arrays.push(array.clone());
        array
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_active_arrays_are_kept() {
        let mut ledger = Ledger::default();
        let mut names = std::collections::BTreeSet::new();
        let first = ledger.add("topic", vec!["solved".to_owned()], 2, (0, 0));
        for _ in 0..2 * KEPT {
            let array = ledger.add("topic", Vec::new(), 1, (0, 0));
            assert!(names.insert(array.name));
            ledger.arrays.last_mut().unwrap().active = 0;
        }
        assert_eq!(ledger.active().collect::<Vec<_>>(), [&first]);
        assert!(ledger.arrays.len() <= KEPT + 2);
        let mut elsewhere = Ledger::default();
        let other = elsewhere.add("topic", Vec::new(), 1, (0, 0));
        assert_ne!(other.name, first.name, "that of another store");
        let text = serde_json::to_string(&ledger).unwrap();
        assert_eq!(serde_json::from_str::<Ledger>(&text).unwrap(), ledger);
    }
}
