//! What stages have cost: a line of JSON for each stage that was built, from which plans foretell what the next one takes.
//!
//! It is experience, not truth: no key, no artifact and no record depends on it, and it may be deleted at any time.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;

use serde::{Deserialize, Serialize};

use super::atomic;
use super::error::StoreError;
use super::open::Store;
use deaflow_base::read_own;

/// When the file is longer than this, the older half of its lines goes, bytes.
const LONG: usize = 1 << 20;

/// What building a stage, or its missing chunks, has cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Kind of the stage.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Canonical parameters: dotted path and value of every leaf.
    pub parameters: BTreeMap<String, String>,
    /// Name of the machine.
    pub host: String,
    /// Threads of the run.
    pub jobs: u64,
    /// Steps that were done: samples, epochs, generations.
    pub steps: u64,
    /// How much work a step was, in comparison with the same kind at other parameters.
    #[serde(default = "one")]
    pub weight: f64,
    /// Chunks that were built; 1 where the stage is not chunked.
    pub chunks: u64,
    /// Length of all inputs, bytes.
    pub input_bytes: u64,
    /// Samples that have no stable solution: to find that out takes many times as long as to solve.
    #[serde(default)]
    pub unstable: u64,
    /// Its part of the time of the run, s: what went by while it was at work, divided by the stages that were at work. What it would take
    /// alone is about that.
    pub seconds: f64,
    /// From the beginning of the stage to its end, s; none where that was not written down.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elapsed: Option<f64>,
    /// Length of the files that were written, bytes.
    pub bytes: u64,
    /// When it ended, in UTC, RFC 3339.
    pub created: String,
}

impl Store {
    /// Adds what a stage has cost.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn put_cost(&self, cost: &Cost) -> Result<(), StoreError> {
        let path = self.layout.costs();
        let mut line = serde_json::to_vec(cost)?;
        line.push(b'\n');
        // One write at the end of the file: two processes that add at once do not mix their lines. A line that was cut off
        // by a full disk is ended first, so that it does not swallow this one.
        let known = self.cost_lines();
        if known.last().is_some_and(|last| *last != b'\n') {
            line.insert(0, b'\n');
        }
        if known.len() + line.len() > LONG {
            let half = known.len() / 2;
            let cut = known[half..].iter().position(|byte| *byte == b'\n');
            let mut kept = cut.map_or_else(Vec::new, |at| known[half + at + 1..].to_vec());
            kept.extend_from_slice(&line);
            let folder = self.temporary()?;
            return atomic::write(&folder.path().join("costs"), &path, &kept);
        }
        // Through a link the line would end up in somebody else's file.
        if fs::symlink_metadata(&path).is_ok_and(|metadata| !metadata.is_file()) {
            return Err(StoreError::damaged(&path, "it is not a file"));
        }
        let opened = File::options().append(true).create(true).open(&path);
        opened
            .and_then(|mut file| file.write_all(&line))
            .map_err(StoreError::io("write", &path))
    }

    /// All costs that are remembered, oldest first. A line, or a file, that cannot be read is passed over.
    #[must_use]
    pub fn costs(&self) -> Vec<Cost> {
        let lines = self.cost_lines();
        let lines = lines.split(|byte| *byte == b'\n');
        let costs = lines.filter_map(|line| serde_json::from_slice::<Cost>(line).ok());
        costs.filter(Cost::is_sensible).collect()
    }

    fn cost_lines(&self) -> Vec<u8> {
        let path = self.layout.costs();
        // Nothing, or nothing that this program wrote, or nothing that can be read: no run fails for want of a price.
        read_own(&path, 4 * LONG as u64).unwrap_or_default()
    }
}

fn one() -> f64 {
    1.0
}

impl Cost {
    fn is_sensible(&self) -> bool {
        let weight = self.weight.is_finite() && self.weight > 0.0;
        weight && self.steps > 0 && self.chunks > 0 && self.jobs > 0 && self.seconds.is_finite() && self.seconds >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cost(steps: u64) -> Cost {
        Cost {
            kind: "solve".into(),
            recipe: 1,
            parameters: BTreeMap::from([("order".into(), "1".into())]),
            host: "here".into(),
            jobs: 2,
            steps,
            weight: 4.0,
            chunks: 1,
            input_bytes: 10,
            unstable: 0,
            seconds: 0.5,
            elapsed: Some(0.75),
            bytes: 100,
            created: "2026-01-01T00:00:00.000Z".into(),
        }
    }

    #[test]
    fn costs_survive_damage_and_stay_short() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(store.costs(), []);
        store.put_cost(&cost(1)).unwrap();
        // A line cut off in the middle, as a full disk leaves it.
        let path = store.layout.costs();
        let whole = fs::read(&path).unwrap();
        fs::write(&path, [&whole[..], &whole[..20]].concat()).unwrap();
        store.put_cost(&cost(2)).unwrap();
        assert_eq!(store.costs(), [cost(1), cost(2)]);
        // What means nothing is passed over.
        store.put_cost(&cost(0)).unwrap();
        assert_eq!(store.costs().len(), 2);

        let many = whole.repeat(LONG / whole.len());
        fs::write(&path, many).unwrap();
        store.put_cost(&cost(3)).unwrap();
        let costs = store.costs();
        assert!(fs::metadata(&path).unwrap().len() < LONG as u64 * 6 / 10);
        assert_eq!((costs.first(), costs.last()), (Some(&cost(1)), Some(&cost(3))));
    }

    #[test]
    fn something_else_in_its_place_is_no_memory() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        fs::create_dir(store.layout.costs()).unwrap();
        assert_eq!(store.costs(), []);
        assert!(matches!(store.put_cost(&cost(1)), Err(StoreError::Damaged { .. })));
    }
}
