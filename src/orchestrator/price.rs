//! What building a stage will take, foretold from what such stages have taken in this store.
//!
//! Of all recorded costs of the kind, those count whose parameters, RECIPE and machine differ least, and of these the ones of about as much
//! work. Work is measured in steps, each by its weight (elements, individuals); a stage that is one piece of work takes as long as its inputs
//! are, in each step where a step goes through all of them. What was measured of another sort of work, such as another network, is not taken
//! for this one's. The range spans what was measured, widened the more the stages differ; `docs/tools/prices.py` measures how often it
//! holds what a stage then takes.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use deaflow_base::Canonical;
use deaflow_store::Cost;

/// How many of the nearest costs count: the latest.
const LATEST: usize = 8;

/// What beginning and ending a stage may take beside its work, s.
const SLACK: f64 = 0.05;

/// So many times more or less work is about as much.
const ALIKE: f64 = 3.0;

/// By this power of how many times more or less work there is the range widens: not all of it grows with the work.
const UNLIKE: f64 = 0.25;

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
    /// The part that the stage has of the time of the run, s: what it takes alone. Of stages that are built at once each is at work for longer;
    /// their parts add up to the time of the run.
    pub seconds: Estimate,
    /// Length of the files to be written, bytes.
    pub bytes: Estimate,
}

/// What stale stages take together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PriceTotal {
    /// How many stages are stale.
    pub stale: usize,
    /// What building them takes, as far as something can be foretold.
    pub price: Option<Price>,
    /// How many of them have no price.
    pub unpriced: usize,
}

impl PriceTotal {
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
    /// Whether each step goes through all inputs.
    pub repeats_inputs: bool,
    /// Whether, in one piece, it takes as long as its inputs are.
    pub time_scales_with_inputs: bool,
    /// The parameter with which its files grow, where it is one piece of work.
    pub size_parameter: Option<&'static str>,
    /// Whether most samples are likely to have no stable solution.
    pub mostly_unstable: bool,
    /// Parameters whose values make it another sort of work.
    pub apart: &'static [&'static str],
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

    /// The same with so many s more or less.
    fn give_or_take(self, slack: f64) -> Self {
        Self {
            low: (self.low - slack).max(0.0),
            high: self.high + slack,
            ..self
        }
    }

    /// The range and the median of some times, widened by a factor. Of an even number the lower one in the middle: other work on the
    /// machine makes a stage slower and never faster.
    fn of_times(mut values: Vec<f64>, widening: f64) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let likely = *values.get(values.len().checked_sub(1)? / 2)?;
        let range = Self::of(values, widening)?;
        Some(Self { likely, ..range })
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

/// Why there is no price.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unmeasured {
    /// Nothing of the kind has been built in this store.
    Kind,
    /// Nothing with this value of a parameter.
    Parameter {
        /// The last part of its path.
        name: String,
        /// Its value.
        value: String,
    },
    /// Nothing of which most had no stable solution, as most of this is likely to have none.
    Lost,
}

impl fmt::Display for Unmeasured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind => f.write_str("never measured"),
            Self::Parameter { name, value } => write!(f, "never measured for {name} {value}"),
            Self::Lost => f.write_str("not known: unstable ones take many times as long"),
        }
    }
}

/// What the work will take.
///
/// # Errors
/// When nothing like it has been built in this store.
pub fn price(costs: &[Cost], work: &Work) -> Result<Price, Unmeasured> {
    let mut known: Vec<(usize, &Cost)> = costs
        .iter()
        .filter(|cost| cost.kind == work.kind && apart(cost, work).is_none())
        .map(|cost| (distance(cost, work), cost))
        .collect();
    let Some(nearest) = known.iter().map(|(distance, _)| *distance).min() else {
        let latest = costs.iter().rfind(|cost| cost.kind == work.kind);
        return Err(latest.and_then(|cost| apart(cost, work)).unwrap_or(Unmeasured::Kind));
    };
    // What stable ones took says nothing of others, unless they were so with these very parameters.
    if work.mostly_unstable && nearest > 0 {
        known.retain(|(_, cost)| mostly_unstable(cost));
    }
    let nearest = known
        .iter()
        .map(|(distance, _)| *distance)
        .min()
        .ok_or(Unmeasured::Lost)?;
    known.retain(|(distance, _)| *distance == nearest);
    // Where membranes are lost at other parameters says nothing of these.
    if nearest > 0 && !work.mostly_unstable && !known.iter().all(|(_, cost)| mostly_unstable(cost)) {
        known.retain(|(_, cost)| !mostly_unstable(cost));
    }
    let known = alike(known.into_iter().map(|(_, cost)| cost).collect(), work);
    let latest: Vec<&Cost> = known.iter().rev().take(LATEST).copied().collect();
    let by_input =
        latest.iter().all(|cost| cost.input_bytes > 0) && work.chunks.is_none() && work.time_scales_with_inputs;
    let by_input = work.input_bytes.filter(|_| by_input);
    let ratio = latest
        .iter()
        .map(|cost| unlike(cost, work))
        .fold(f64::INFINITY, f64::min);
    let widening = widening(nearest, latest.len()) * ratio.powf(UNLIKE);
    let each = |cost: &Cost| cost.steps as f64 * cost.weight;
    let seconds = latest.iter().map(|cost| {
        let threads = (cost.jobs.min(cost.chunks.max(1))) as f64;
        match (work.chunks, by_input, work.repeats_inputs) {
            (Some(_), ..) => cost.seconds * threads / each(cost),
            (None, Some(_), true) => cost.seconds / (each(cost) * cost.input_bytes as f64),
            (None, Some(_), false) => cost.seconds / (cost.weight * cost.input_bytes as f64),
            (None, None, _) => cost.seconds / each(cost),
        }
    });
    let seconds = Estimate::of_times(seconds.collect(), widening).ok_or(Unmeasured::Kind)?;
    let threads = work.chunks.map_or(1, |chunks| work.jobs.min(chunks)).max(1);
    let steps = work.steps as f64;
    let amount = match by_input {
        None => steps * work.weight / threads as f64,
        Some(bytes) if work.repeats_inputs => steps * work.weight * bytes as f64,
        Some(bytes) => work.weight * bytes as f64,
    };
    // Of a chunked stage files grow with the samples; what the steps of any other leave behind does not grow with them, but perhaps with a
    // parameter.
    let bytes = latest.iter().map(|cost| match work.chunks {
        Some(_) => cost.bytes as f64 / cost.steps as f64 * steps,
        None => cost.bytes as f64 * size_ratio(cost, work),
    });
    let of_bytes = if nearest == 0 { 1.0 } else { widening };
    Ok(Price {
        seconds: seconds.scaled(amount).give_or_take(SLACK),
        bytes: Estimate::of(bytes.collect(), of_bytes).ok_or(Unmeasured::Kind)?,
    })
}

/// The parameter that makes a cost one of another sort of work.
fn apart(cost: &Cost, work: &Work) -> Option<Unmeasured> {
    let differs = |path: &&&str| sort_at(&cost.parameters, path) != sort_at(&work.parameters, path);
    let path = work.apart.iter().find(differs)?;
    let name = path.rsplit('.').next().unwrap_or(path);
    Some(Unmeasured::Parameter {
        name: name.replace('_', " "),
        value: sort_at(&work.parameters, path),
    })
}

/// Of a value itself; of a mapping the keys, each with the model that it names.
fn sort_at(parameters: &Leaves, path: &str) -> String {
    let none = || "none".to_owned();
    if let Some(value) = parameters.get(path) {
        return if value == "{}" { none() } else { value.clone() };
    }
    let below = format!("{path}.");
    let within = parameters
        .range(below.clone()..)
        .map_while(|(key, value)| Some((key.strip_prefix(&below)?, value)));
    let mut sorts: BTreeMap<&str, &str> = BTreeMap::new();
    for (key, value) in within {
        let (name, rest) = key.split_once('.').unwrap_or((key, ""));
        let model = sorts.entry(name).or_default();
        if rest == "model" {
            *model = value;
        }
    }
    if sorts.is_empty() {
        return none();
    }
    let words = sorts
        .iter()
        .map(|(name, model)| format!("{} {model}", name.replace('_', " ")).trim_end().to_owned());
    words.collect::<Vec<_>>().join(", ")
}

/// How many times as long the files of a stage in one piece will be as those that were written: by the parameter with which they grow.
fn size_ratio(cost: &Cost, work: &Work) -> f64 {
    let number = |leaves: &Leaves| leaves.get(work.size_parameter?)?.parse::<f64>().ok();
    let (then, now) = (number(&cost.parameters), number(&work.parameters));
    match then.zip(now) {
        Some((then, now)) if then > 0.0 => now / then,
        _ => 1.0,
    }
}

/// Whether most of what was solved has no stable solution.
fn mostly_unstable(cost: &Cost) -> bool {
    2 * cost.unstable > cost.steps
}

/// Of some costs those of about as much work, or all where there are none.
fn alike<'a>(costs: Vec<&'a Cost>, work: &Work) -> Vec<&'a Cost> {
    let alike: Vec<&Cost> = costs
        .iter()
        .filter(|cost| unlike(cost, work) <= ALIKE)
        .copied()
        .collect();
    if alike.is_empty() { costs } else { alike }
}

/// How many times more or less work a cost was of, 1 or more. To put together what is there is none.
fn unlike(cost: &Cost, work: &Work) -> f64 {
    if work.steps == 0 {
        return 1.0;
    }
    let of_steps = work.steps as f64 * work.weight / (cost.steps as f64 * cost.weight);
    let of_input = match (work.chunks, work.input_bytes) {
        (None, Some(bytes)) if work.time_scales_with_inputs && cost.input_bytes > 0 && bytes > 0 => {
            bytes as f64 / cost.input_bytes as f64
        }
        _ => 1.0,
    };
    let ratio = match work.repeats_inputs || work.chunks.is_some() || !work.time_scales_with_inputs {
        true => of_steps * of_input,
        false => of_input * work.weight / cost.weight,
    };
    ratio.max(1.0 / ratio)
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

/// How many times what was measured a stage may take, or what part of it: the more things differ, and the fewer were measured.
fn widening(distance: usize, measured: usize) -> f64 {
    match (distance, measured) {
        (0, 0..=2) => 1.6,
        (0, _) => 1.4,
        (1, _) => 2.0,
        (2, _) => 2.5,
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
            unstable: 0,
            seconds,
            elapsed: None,
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
            repeats_inputs: true,
            time_scales_with_inputs: true,
            size_parameter: None,
            mostly_unstable: false,
            apart: &["order"],
            chunks,
            input_bytes: Some(2000),
        }
    }

    /// What solving 100 samples at a voltage took, of which some were unstable.
    fn at(voltage: &str, unstable: u64, seconds: f64) -> Cost {
        let mut cost = Cost {
            unstable,
            ..cost(100, seconds)
        };
        cost.parameters.insert("voltage".into(), voltage.into());
        cost
    }

    #[test]
    fn chunks_cost_by_their_samples_and_threads() {
        // Three runs of 100 samples on two threads: 0.02, 0.04, 0.03 s of one thread a sample.
        let costs = [cost(100, 1.0), cost(100, 2.0), cost(100, 1.5)];
        let found = price(&costs, &work(Some(5), 200)).unwrap();
        assert!((found.seconds.likely - 200.0 * 0.03 / 2.0).abs() < 1e-12);
        // 1.4 for what was measured three times, and twice the work.
        let widening = 1.4 * 2.0_f64.powf(UNLIKE);
        assert!((found.seconds.low - (200.0 * 0.02 / 2.0 / widening - SLACK)).abs() < 1e-12);
        assert!((found.seconds.high - (200.0 * 0.04 / 2.0 * widening + SLACK)).abs() < 1e-12);
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
        // Steps that do not go through the inputs again are counted by these alone.
        let once = Work {
            repeats_inputs: false,
            ..work(None, 16)
        };
        assert!((price(&costs, &once).unwrap().seconds.likely - 8.0).abs() < 1e-12);
    }

    #[test]
    fn another_sort_of_work_has_no_price() {
        let other = Cost {
            parameters: parameters("2"),
            ..cost(100, 50.0)
        };
        let why = price(&[other], &work(Some(10), 100)).unwrap_err();
        assert_eq!(why.to_string(), "never measured for order 1");
        assert_eq!(price(&[], &work(Some(1), 1)).unwrap_err().to_string(), "never measured");
        // All chunks are there, and only the stage is put together.
        let together = price(&[cost(100, 1.0)], &work(Some(0), 0)).unwrap();
        assert_eq!(
            (together.seconds.low, together.seconds.likely, together.seconds.high),
            (0.0, 0.0, SLACK)
        );
    }

    #[test]
    fn a_mapping_is_another_sort_of_work_by_its_keys_and_their_models() {
        let with = |effects: &[(&str, &str)]| -> Leaves {
            effects
                .iter()
                .map(|(path, value)| ((*path).into(), (*value).into()))
                .collect()
        };
        let apart = &["scene.effects"][..];
        let none = with(&[("scene.effects", "{}")]);
        let gent = with(&[
            ("scene.effects.strain_stiffening.jm", "120"),
            ("scene.effects.strain_stiffening.model", "gent"),
        ]);
        let softer = with(&[
            ("scene.effects.strain_stiffening.jm", "90"),
            ("scene.effects.strain_stiffening.model", "gent"),
        ]);
        let more = with(&[
            ("scene.effects.strain_stiffening.model", "gent"),
            ("scene.effects.wrinkling", "true"),
        ]);
        let foretold = |then: &Leaves, now: &Leaves| {
            let known = Cost {
                parameters: then.clone(),
                ..cost(100, 1.0)
            };
            let here = Work {
                parameters: now.clone(),
                apart,
                ..work(Some(10), 100)
            };
            price(&[known], &here).map_err(|why| why.to_string())
        };
        assert!(foretold(&none, &none).is_ok() && foretold(&none, &with(&[])).is_ok());
        assert!(foretold(&gent, &softer).is_ok() && foretold(&more, &more).is_ok());
        assert_eq!(
            foretold(&none, &more).unwrap_err(),
            "never measured for effects strain stiffening gent, wrinkling"
        );
        assert_eq!(foretold(&more, &none).unwrap_err(), "never measured for effects none");
        let auto = with(&[("scene.effects", "auto")]);
        assert_eq!(foretold(&gent, &auto).unwrap_err(), "never measured for effects auto");
    }

    #[test]
    fn of_costs_of_the_same_sort_those_of_as_much_work_count() {
        // Ten samples take 0.1 s each, since most of it is to begin; a thousand take 0.01 s each.
        let costs = [cost(1000, 5.0), cost(10, 0.5)];
        let found = price(&costs, &work(Some(10), 900)).unwrap();
        assert!((found.seconds.likely - 4.5).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn where_membranes_were_lost_or_something_else_was_at_work_says_nothing_of_others() {
        let mut here = work(Some(10), 100);
        here.parameters.insert("voltage".into(), "5".into());
        let costs = [at("3", 0, 1.0), at("12", 100, 20.0)];
        let likely = |costs: &[Cost]| price(costs, &here).unwrap().seconds.likely;
        assert!((likely(&costs) - 1.0).abs() < 1e-12);
        // Where they are lost at the same parameters they will be again, and better than nothing it is.
        assert!((likely(&[at("3", 0, 1.0), at("5", 100, 20.0)]) - 20.0).abs() < 1e-12);
        assert!((likely(&costs[1..]) - 20.0).abs() < 1e-12);
        // One slow stage of two does not count for half.
        assert!((likely(&[at("3", 0, 9.0), at("4", 0, 1.0)]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn where_membranes_are_likely_to_be_lost_what_stable_ones_took_says_nothing() {
        let mut here = Work {
            mostly_unstable: true,
            ..work(Some(10), 100)
        };
        here.parameters.insert("voltage".into(), "12".into());
        let why = price(&[at("5", 0, 1.0)], &here).unwrap_err();
        assert_eq!(why.to_string(), "not known: unstable ones take many times as long");
        // What others that were lost took is near enough, and what was stable with these parameters will be so again.
        let likely = |costs: &[Cost]| price(costs, &here).unwrap().seconds.likely;
        assert!((likely(&[at("5", 0, 1.0), at("11", 90, 40.0)]) - 40.0).abs() < 1e-12);
        assert!((likely(&[at("12", 0, 2.0), at("11", 90, 40.0)]) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn what_does_not_go_by_its_inputs_goes_by_its_steps_and_files_may_grow_with_a_parameter() {
        let costs = [Cost {
            chunks: 1,
            ..cost(8, 4.0)
        }];
        // Inputs twice as long, such as searches of twice as many generations.
        let verify = Work {
            repeats_inputs: false,
            time_scales_with_inputs: false,
            ..work(None, 8)
        };
        assert!((price(&costs, &verify).unwrap().seconds.likely - 4.0).abs() < 1e-12);
        let twice = Work { steps: 16, ..verify };
        assert!((price(&costs, &twice).unwrap().seconds.likely - 8.0).abs() < 1e-12);
        let mut balance = Work {
            size_parameter: Some("target"),
            ..work(None, 8)
        };
        balance.parameters.insert("target".into(), "1000".into());
        let mut known = costs.clone();
        known[0].parameters.insert("target".into(), "200".into());
        assert!((price(&known, &balance).unwrap().bytes.likely - 5.0 * 400.0).abs() < 1e-9);
        // Where it was not known then, as much as then.
        assert!((price(&costs, &balance).unwrap().bytes.likely - 400.0).abs() < 1e-9);
    }

    #[test]
    fn the_nearest_costs_count_and_doubt_widens_the_range() {
        let mut other = cost(100, 50.0);
        other.parameters.insert("mesh".into(), "3".into());
        let found = price(&[other.clone(), cost(100, 1.0)], &work(Some(10), 100)).unwrap();
        assert!((found.seconds.likely - 1.0).abs() < 1e-12);
        let found = price(&[other], &work(Some(10), 100)).unwrap();
        assert!((found.seconds.likely - 50.0).abs() < 1e-12 && (found.seconds.high - 100.0 - SLACK).abs() < 1e-12);
        // Four times the elements, four times the time.
        let finer = Work {
            weight: 4.0,
            ..work(Some(10), 100)
        };
        let found = price(&[cost(100, 1.0)], &finer).unwrap();
        assert!((found.seconds.likely - 4.0).abs() < 1e-12);
        let train = Work {
            kind: "train".into(),
            ..work(None, 1)
        };
        assert_eq!(price(&[cost(1, 1.0)], &train), Err(Unmeasured::Kind));
    }
}
