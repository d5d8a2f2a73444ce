//! What has been submitted for a pipeline: a note in the store, so that whoever comes later goes on with it.

use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use deaflow_base::{Digest, host_name};

/// Arrays that have ended are remembered that long, for people.
const REMEMBERED: usize = 100;

/// The name of the note.
pub const LEDGER: &str = "ledger";

/// What has been submitted for a pipeline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// How to go on with it.
    pub recipe: Recipe,
    /// What tells its arrays from those of other stores.
    pub mark: String,
    /// Arrays that were ever begun.
    pub begun: u32,
    /// The last of them.
    pub arrays: Vec<Array>,
}

/// What a submitter was asked to do.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// `slurm` or `command`.
    pub engine: String,
    /// The file of the profile and what stands in it, if there is one.
    pub profile: Option<(String, String)>,
    /// What submits workers, where the profile does not say it.
    pub submit: Option<String>,
    /// The last stage.
    pub until: Option<String>,
    /// Whether to build all that can be built although something failed.
    pub keep_going: bool,
}

/// One array of workers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Array {
    /// Its name, which no other has.
    pub name: String,
    /// The stages that it builds.
    pub stages: Vec<String>,
    /// How many workers it was begun with.
    pub workers: u32,
    /// How many of them wait or work, as far as is known.
    pub living: u32,
    /// Its number, where the engine told it.
    pub number: Option<String>,
    /// When it was submitted, in UTC by its submitter's clock.
    pub since: String,
    /// Pieces of its stages that were there before it.
    pub before: u64,
    /// When the last checkpoint of the store before it was written, s since 1970.
    pub checkpoint: u64,
    /// Whether the engine has not said that it took it.
    pub refused: bool,
}

impl Ledger {
    /// The arrays of which workers may wait or work.
    pub fn living(&self) -> impl Iterator<Item = &Array> {
        self.arrays.iter().filter(|array| array.living > 0)
    }

    /// A new array; of those that have ended the oldest are forgotten.
    /// `before` and `checkpoint` as in [`Array`].
    pub fn begin(&mut self, topic: &str, stages: Vec<String>, workers: u32, (before, checkpoint): (u64, u64)) -> Array {
        let now = SystemTime::now();
        if self.mark.is_empty() {
            let since = now.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
            let text = format!("{} {} {}", host_name(), std::process::id(), since.as_nanos());
            self.mark = Digest::of(text.as_bytes()).short()[..6].to_owned();
        }
        self.begun += 1;
        let ended = self.arrays.iter().filter(|array| array.living == 0).count();
        let mut surplus = ended.saturating_sub(REMEMBERED);
        self.arrays.retain(|array| {
            let goes = array.living == 0 && surplus > 0;
            surplus -= usize::from(goes);
            !goes
        });
        let array = Array {
            name: format!("deaflow-{topic}-{}-{}", self.mark, self.begun),
            stages,
            workers,
            living: workers,
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
    fn names_are_given_once_and_what_lives_is_kept() {
        let mut ledger = Ledger::default();
        let mut names = std::collections::BTreeSet::new();
        let first = ledger.begin("topic", vec!["solved".to_owned()], 2, (0, 0));
        for _ in 0..2 * REMEMBERED {
            let array = ledger.begin("topic", Vec::new(), 1, (0, 0));
            assert!(names.insert(array.name));
            ledger.arrays.last_mut().unwrap().living = 0;
        }
        assert_eq!(ledger.living().collect::<Vec<_>>(), [&first]);
        assert!(ledger.arrays.len() <= REMEMBERED + 2);
        let mut elsewhere = Ledger::default();
        let other = elsewhere.begin("topic", Vec::new(), 1, (0, 0));
        assert_ne!(other.name, first.name, "that of another store");
        let text = serde_json::to_string(&ledger).unwrap();
        assert_eq!(serde_json::from_str::<Ledger>(&text).unwrap(), ledger);
    }
}
