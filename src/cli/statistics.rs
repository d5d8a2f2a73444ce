//! Statistics of a dataset, computed chunk by chunk to save memory.

use std::collections::BTreeMap;

use serde::Serialize;

use deaflow_store::{Artifact, Data, StoreError};

/// Statistics of the elements of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Statistics {
    /// Statistics of numbers.
    Numbers {
        /// The smallest.
        min: f64,
        /// The arithmetic mean.
        mean: f64,
        /// The largest.
        max: f64,
    },
    /// Statistics of texts.
    Texts {
        /// The number of occurrences of each text.
        counts: BTreeMap<String, u64>,
    },
    /// There are no elements.
    None {},
}

#[derive(Default)]
struct Accumulator {
    count: u64,
    sum: f64,
    range: Option<(f64, f64)>,
    texts: BTreeMap<String, u64>,
}

/// Computes the statistics of a dataset of an artifact.
///
/// # Errors
/// When a file is missing or damaged.
pub fn of_dataset(artifact: &Artifact, path: &str) -> Result<Statistics, StoreError> {
    let mut statistics = Accumulator::default();
    if artifact.is_manifest() {
        for chunk in artifact.chunks()? {
            statistics.add(&chunk.read(path)?.data);
        }
    } else {
        statistics.add(&artifact.read(path)?.data);
    }
    Ok(statistics.finish())
}

/// Computes the statistics of elements.
#[must_use]
pub fn of_data(data: &Data) -> Statistics {
    let mut statistics = Accumulator::default();
    statistics.add(data);
    statistics.finish()
}

impl Accumulator {
    fn add(&mut self, data: &Data) {
        match data {
            Data::U8(values) => self.numbers(values.iter().map(|&v| f64::from(v))),
            Data::U32(values) => self.numbers(values.iter().map(|&v| f64::from(v))),
            Data::U64(values) => self.numbers(values.iter().map(|&v| v as f64)),
            Data::F32(values) => self.numbers(values.iter().map(|&v| f64::from(v))),
            Data::F64(values) => self.numbers(values.iter().copied()),
            Data::Text(values) => {
                for text in values {
                    *self.texts.entry(text.clone()).or_default() += 1;
                }
            }
        }
    }

    fn numbers(&mut self, values: impl Iterator<Item = f64>) {
        // Result files, unlike artifacts, contain NaN for missing values.
        for value in values.filter(|value| !value.is_nan()) {
            self.count += 1;
            self.sum += value;
            self.range = Some(
                self.range
                    .map_or((value, value), |(low, high)| (low.min(value), high.max(value))),
            );
        }
    }

    fn finish(self) -> Statistics {
        match self.range {
            Some((min, max)) => Statistics::Numbers {
                min,
                mean: self.sum / self.count as f64,
                max,
            },
            None if !self.texts.is_empty() => Statistics::Texts { counts: self.texts },
            None => Statistics::None {},
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_store::{Dataset, Object, Provenance, Store};

    #[test]
    fn chunks_count_as_one_dataset() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("store")).unwrap();
        let chunk = |values: &[f64], names: &[&str]| {
            let texts = names.iter().map(|&n| n.to_owned()).collect();
            let object = Object::default()
                .with(
                    "v",
                    Dataset::new("mm", "d", &[values.len()], Data::F64(values.to_vec())),
                )
                .with("name", Dataset::new("", "d", &[names.len()], Data::Text(texts)))
                .with("none", Dataset::new("1", "d", &[0], Data::U8(vec![])));
            store.put(&object, &Provenance::default()).unwrap().digest
        };
        let parts = vec![chunk(&[1.0, -2.0], &["a", "b"]), chunk(&[7.0], &["a"])];
        let manifest = store
            .put(&Object::manifest(BTreeMap::new(), parts), &Provenance::default())
            .unwrap();
        let artifact = store.artifact(&manifest.digest).unwrap();
        let numbers = of_dataset(&artifact, "v").unwrap();
        assert_eq!(
            numbers,
            Statistics::Numbers {
                min: -2.0,
                mean: 2.0,
                max: 7.0
            }
        );
        let counts = BTreeMap::from([("a".to_owned(), 2), ("b".to_owned(), 1)]);
        assert_eq!(of_dataset(&artifact, "name").unwrap(), Statistics::Texts { counts });
        assert_eq!(of_dataset(&artifact, "none").unwrap(), Statistics::None {});
        assert_eq!(
            serde_json::to_string(&numbers).unwrap(),
            r#"{"min":-2.0,"mean":2.0,"max":7.0}"#
        );
    }
}
