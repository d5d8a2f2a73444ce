//! What building a stage will take, foretold from what such stages have taken in this store.
//!
//! Of all recorded costs of the kind, those count whose parameters, RECIPE and machine differ least. Work is measured in
//! steps, each by its weight (elements, individuals); a stage that is one piece of work reads its inputs in every step, so
//! there a step counts by the length of the inputs too. The range spans what was measured, widened the more the stages differ.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::base::Canonical;
use crate::store::Cost;

/// How many of the nearest costs count: the latest.
const LATEST: usize = 8;

/// Parameters by dotted path.
pub type Leaves = BTreeMap<String, String>;

/// A range with its likely value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// It will hardly be less.
    pub low: f64,
    /// The most likely.
    pub likely: f64,
    /// It will hardly be more.
    pub high: f64,
}

/// What building will take.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Price {
    /// From the beginning of the stage to its end, s.
    pub seconds: Estimate,
    /// Length of the files to be written, bytes.
    pub bytes: Estimate,
}

/// What stale stages take together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bill {
    /// How many stages are stale.
    pub stale: usize,
    /// What building them takes, as far as something can be foretold.
    pub price: Option<Price>,
    /// How many of them have no price.
    pub unpriced: usize,
}

impl Bill {
    /// The bill of stale stages by their prices.
    #[must_use]
    pub fn of(prices: impl Iterator<Item = Option<Price>> + Clone) -> Self {
        Self {
            stale: prices.clone().count(),
            unpriced: prices.clone().filter(Option::is_none).count(),
            price: prices.flatten().reduce(Price::plus),
        }
    }
}

/// Work to be foretold.
#[derive(Clone, Debug)]
pub struct Work {
    /// Kind of the stage.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Its parameters.
    pub parameters: Leaves,
    /// Name of the machine.
    pub host: String,
    /// Threads.
    pub jobs: u64,
    /// Steps to do.
    pub steps: u64,
    /// How much work a step is, in comparison with the same kind at other parameters.
    pub weight: f64,
    /// Chunks to build, or `None` where the stage is one piece of work.
    pub chunks: Option<u64>,
    /// Length of all inputs, bytes; `None` where it is not known.
    pub input_bytes: Option<u64>,
}

impl Estimate {
    fn scaled(self, factor: f64) -> Self {
        Self {
            low: factor * self.low,
            likely: factor * self.likely,
            high: factor * self.high,
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            low: self.low + other.low,
            likely: self.likely + other.likely,
            high: self.high + other.high,
        }
    }

    /// The range and the median of some values, widened by a factor.
    fn of(mut values: Vec<f64>, widening: f64) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (low, high) = (values.first()?, values.last()?);
        let (left, right) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
        Some(Self {
            low: low / widening,
            likely: 0.5 * (left + right),
            high: high * widening,
        })
    }
}

impl Price {
    /// Both together, one after the other.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            seconds: self.seconds.plus(other.seconds),
            bytes: self.bytes.plus(other.bytes),
        }
    }
}

/// The leaves of canonical parameters as texts.
#[must_use]
pub fn leaves(parameters: &Canonical) -> Leaves {
    let leaves = parameters.leaves().into_iter();
    leaves.map(|(path, value)| (path, value.to_string())).collect()
}

/// What the work will take; `None` where nothing like it has been built in this store.
#[must_use]
pub fn price(costs: &[Cost], work: &Work) -> Option<Price> {
    let mut known: Vec<(usize, &Cost)> = costs
        .iter()
        .filter(|cost| cost.kind == work.kind)
        .map(|cost| (distance(cost, work), cost))
        .collect();
    let nearest = known.iter().map(|(distance, _)| *distance).min()?;
    known.retain(|(distance, _)| *distance == nearest);
    let latest: Vec<&Cost> = known.iter().rev().take(LATEST).map(|(_, cost)| *cost).collect();
    let by_input = latest.iter().all(|cost| cost.input_bytes > 0) && work.chunks.is_none();
    let by_input = work.input_bytes.filter(|_| by_input);
    let widening = widening(nearest, latest.len());
    let seconds = latest.iter().map(|cost| {
        let threads = (cost.jobs.min(cost.chunks.max(1))) as f64;
        let steps = cost.steps as f64 * cost.weight;
        match (work.chunks, by_input) {
            (Some(_), _) => cost.seconds * threads / steps,
            (None, Some(_)) => cost.seconds / (steps * cost.input_bytes as f64),
            (None, None) => cost.seconds / steps,
        }
    });
    let seconds = Estimate::of(seconds.collect(), widening)?;
    let threads = work.chunks.map_or(1, |chunks| work.jobs.min(chunks)).max(1);
    let steps = work.steps as f64;
    let amount = steps * work.weight * by_input.map_or(1.0, |bytes| bytes as f64) / threads as f64;
    // Of a chunked stage files grow with the samples; what the steps of any other leave behind does not grow with them.
    let bytes = latest.iter().map(|cost| match work.chunks {
        Some(_) => cost.bytes as f64 / cost.steps as f64 * steps,
        None => cost.bytes as f64,
    });
    Some(Price {
        seconds: seconds.scaled(amount),
        bytes: Estimate::of(bytes.collect(), if nearest == 0 { 1.0 } else { widening })?,
    })
}

/// How many things differ.
fn distance(cost: &Cost, work: &Work) -> usize {
    // Chunks that are all of one length have that in common, others do not: what only one side says is no difference.
    let differing = work.parameters.iter().filter(|(path, value)| {
        let then = cost.parameters.get(*path);
        then.is_some_and(|then| then != *value)
    });
    let others = [
        cost.recipe != work.recipe,
        cost.host != work.host,
        // The threads of a stage in one piece share its work in a way that is its own.
        work.chunks.is_none() && cost.jobs != work.jobs,
    ];
    differing.count() + others.iter().filter(|other| **other).count()
}

/// The same again, measured once or twice: a third more or less. Something else: up to two or four times more or less.
fn widening(distance: usize, measured: usize) -> f64 {
    match (distance, measured) {
        (0, 0..=2) => 1.33,
        (0, _) => 1.15,
        (1..=2, _) => 2.0,
        _ => 4.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters(order: &str) -> Leaves {
        BTreeMap::from([("order".to_owned(), order.to_owned()), ("mesh".into(), "2".into())])
    }

    fn cost(steps: u64, seconds: f64) -> Cost {
        Cost {
            kind: "solve".into(),
            recipe: 1,
            parameters: parameters("1"),
            host: "here".into(),
            jobs: 2,
            steps,
            weight: 1.0,
            chunks: 10,
            input_bytes: 1000,
            seconds,
            bytes: 50 * steps,
            created: String::new(),
        }
    }

    fn work(chunks: Option<u64>, steps: u64) -> Work {
        Work {
            kind: "solve".into(),
            recipe: 1,
            parameters: parameters("1"),
            host: "here".into(),
            jobs: 2,
            steps,
            weight: 1.0,
            chunks,
            input_bytes: Some(2000),
        }
    }

    #[test]
    fn chunks_cost_by_their_samples_and_threads() {
        // Three runs of 100 samples on two threads: 0.02, 0.04, 0.03 s of one thread a sample.
        let costs = [cost(100, 1.0), cost(100, 2.0), cost(100, 1.5)];
        let found = price(&costs, &work(Some(5), 200)).unwrap();
        assert!((found.seconds.likely - 200.0 * 0.03 / 2.0).abs() < 1e-12);
        assert!((found.seconds.low - 200.0 * 0.02 / 2.0 / 1.15).abs() < 1e-12);
        assert!((found.seconds.high - 200.0 * 0.04 / 2.0 * 1.15).abs() < 1e-12);
        assert_eq!(found.bytes.likely, 10_000.0);
        // One chunk is no faster with two threads.
        let one = price(&costs, &work(Some(1), 200)).unwrap();
        assert_eq!(one.seconds.likely, 2.0 * found.seconds.likely);
    }

    #[test]
    fn a_stage_in_one_piece_costs_by_its_steps_and_inputs() {
        let costs = [Cost {
            chunks: 1,
            ..cost(8, 4.0)
        }];
        let found = price(&costs, &work(None, 16)).unwrap();
        assert!((found.seconds.likely - 16.0).abs() < 1e-12, "{found:?}");
        assert_eq!(found.bytes.likely, 400.0);
        // As long as the length of the inputs is not known, they are taken to be as they were.
        let unknown = Work {
            input_bytes: None,
            ..work(None, 16)
        };
        assert!((price(&costs, &unknown).unwrap().seconds.likely - 8.0).abs() < 1e-12);
    }

    #[test]
    fn the_nearest_costs_count_and_doubt_widens_the_range() {
        let other = Cost {
            parameters: parameters("2"),
            ..cost(100, 50.0)
        };
        let found = price(&[other.clone(), cost(100, 1.0)], &work(Some(10), 100)).unwrap();
        assert!((found.seconds.likely - 1.0).abs() < 1e-12);
        let found = price(&[other], &work(Some(10), 100)).unwrap();
        assert!((found.seconds.likely - 50.0).abs() < 1e-12 && (found.seconds.high - 100.0).abs() < 1e-12);
        // Four times the elements, four times the time.
        let finer = Work {
            weight: 4.0,
            ..work(Some(10), 100)
        };
        let found = price(&[cost(100, 1.0)], &finer).unwrap();
        assert!((found.seconds.likely - 4.0).abs() < 1e-12);
        assert_eq!(price(&[], &work(Some(1), 1)), None);
        let train = Work {
            kind: "train".into(),
            ..work(None, 1)
        };
        assert_eq!(price(&[cost(1, 1.0)], &train), None);
    }
}
