//! The costs of stages: a line of JSON for each stage that was built, from which plans estimate the cost of others.
//!
//! No key, artifact or record depends on it, and it may be deleted at any time.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;

use serde::{Deserialize, Serialize};

use super::atomic;
use super::error::StoreError;
use super::open::Store;
use deaflow_base::read_own;

/// Length of the file above which the older half of its lines is removed, bytes.
const MAX_LENGTH: usize = 1 << 20;

/// The cost of building a stage or its missing chunks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Kind of the stage.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Canonical parameters: dotted path and value of every leaf.
    pub parameters: BTreeMap<String, String>,
    /// Host name of the machine.
    pub host: String,
    /// Threads of the run.
    pub jobs: u64,
    /// Number of steps: samples, epochs, generations.
    pub steps: u64,
    /// Amount of work of a step, relative to the same kind with other parameters.
    #[serde(default = "one")]
    pub weight: f64,
    /// Number of chunks that were built; 1 for a stage without chunks.
    pub chunks: u64,
    /// Length of all inputs, bytes.
    pub input_bytes: u64,
    /// Number of samples without a stable solution, which take many times longer.
    #[serde(default)]
    pub unstable: u64,
    /// Its share of the time of the run, s: the time is divided equally among the stages that are running. It is about
    /// the time that the stage takes alone.
    pub seconds: f64,
    /// From the start of the stage to its end, s; missing in older files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elapsed: Option<f64>,
    /// Length of the files that were written, bytes.
    pub bytes: u64,
    /// When it ended, in UTC, RFC 3339.
    pub created: String,
}

impl Store {
    /// Appends the cost of a stage.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn put_cost(&self, cost: &Cost) -> Result<(), StoreError> {
        let path = self.layout.costs();
        let mut line = serde_json::to_vec(cost)?;
        line.push(b'\n');
        // A single write at the end of the file keeps lines of several processes apart. If a full disk has cut off the
        // last line, it is ended first.
        let known = self.cost_lines();
        if known.last().is_some_and(|last| *last != b'\n') {
            line.insert(0, b'\n');
        }
        if known.len() + line.len() > MAX_LENGTH {
            let half = known.len() / 2;
            let cut = known[half..].iter().position(|byte| *byte == b'\n');
            let mut kept = cut.map_or_else(Vec::new, |at| known[half + at + 1..].to_vec());
            kept.extend_from_slice(&line);
            let folder = self.temporary()?;
            return atomic::write(&folder.path().join("costs"), &path, &kept);
        }
        // A link would lead to a foreign file.
        if fs::symlink_metadata(&path).is_ok_and(|metadata| !metadata.is_file()) {
            return Err(StoreError::damaged(&path, "it is not a file"));
        }
        let opened = File::options().append(true).create(true).open(&path);
        opened
            .and_then(|mut file| file.write_all(&line))
            .map_err(StoreError::io("write", &path))
    }

    /// Returns the costs, oldest first. Invalid lines and files are ignored.
    #[must_use]
    pub fn costs(&self) -> Vec<Cost> {
        let lines = self.cost_lines();
        let lines = lines.split(|byte| *byte == b'\n');
        let costs = lines.filter_map(|line| serde_json::from_slice::<Cost>(line).ok());
        costs.filter(Cost::is_sensible).collect()
    }

    fn cost_lines(&self) -> Vec<u8> {
        let path = self.layout.costs();
        // A missing or unreadable file only means that there are no prices.
        read_own(&path, 4 * MAX_LENGTH as u64).unwrap_or_default()
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

        let many = whole.repeat(MAX_LENGTH / whole.len());
        fs::write(&path, many).unwrap();
        store.put_cost(&cost(3)).unwrap();
        let costs = store.costs();
        assert!(fs::metadata(&path).unwrap().len() < MAX_LENGTH as u64 * 6 / 10);
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
