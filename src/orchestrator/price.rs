//! Estimates the time and disk space that building a stage takes, from the costs of similar stages in this store.
//!
//! The estimate uses those recorded costs of the kind whose parameters, RECIPE and machine differ least, and of these
//! the ones with about the same amount of work. Work is the number of steps times their weight (elements, individuals);
//! for a stage in one piece it is proportional to the size of its inputs, in each step if each step reads all of them.
//! Costs of another class, such as another network, are not used. The range spans the measured costs and is widened the
//! more the stages differ. Of much more or less work than was measured a part of the time may be fixed.
//! `docs/tools/prices.py` measures how often the actual cost lies within.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use deaflow_base::Canonical;
use deaflow_store::Cost;

/// Maximum number of costs that are used: the latest of the nearest.
const LATEST: usize = 8;

/// Time for starting and ending a stage, s.
const OVERHEAD: f64 = 0.1;

/// The part of the time of a stage that may not grow with the work is at most this, s: to start processes and to read
/// files. A stage in one piece that goes once through its inputs, such as an audit, may have any fixed part.
const FIXED: f64 = 1.0;

/// Amounts of work up to this ratio count as about the same.
const SIMILAR_RATIO: f64 = 3.0;

/// The range is widened by the ratio of work to this power: not all of the cost grows with the work.
const RATIO_EXPONENT: f64 = 0.25;

/// Parameters by dotted path.
pub type Leaves = BTreeMap<String, String>;

/// A range and the most likely value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Probable minimum.
    pub low: f64,
    /// Most likely value.
    pub likely: f64,
    /// Probable maximum.
    pub high: f64,
}

/// The estimated cost of building a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Price {
    /// Its share of the time of the run, s: the time that it takes alone. Stages that are built in parallel run longer
    /// than this; their shares add up to the time of the run.
    pub seconds: Estimate,
    /// Length of the files to be written, bytes.
    pub bytes: Estimate,
}

/// The estimated cost of all stale stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PriceTotal {
    /// Number of stale stages.
    pub stale: usize,
    /// Sum of the known prices.
    pub price: Option<Price>,
    /// Number of stale stages without a price.
    pub unpriced: usize,
}

impl PriceTotal {
    /// Adds the prices of stale stages.
    #[must_use]
    pub fn of(prices: impl Iterator<Item = Option<Price>> + Clone) -> Self {
        Self {
            stale: prices.clone().count(),
            unpriced: prices.clone().filter(Option::is_none).count(),
            price: prices.flatten().reduce(Price::plus),
        }
    }
}

/// The work whose cost is estimated.
#[derive(Clone, Debug)]
pub struct CostQuery {
    /// Kind of the stage.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Parameters.
    pub parameters: Leaves,
    /// Name of the machine.
    pub host: String,
    /// Number of threads.
    pub jobs: u64,
    /// Steps to do.
    pub steps: u64,
    /// Amount of work of a step, relative to the same kind with other parameters.
    pub weight: f64,
    /// Whether each step reads all inputs.
    pub repeats_inputs: bool,
    /// Whether the duration of a stage in one piece is proportional to the size of its inputs.
    pub time_scales_with_inputs: bool,
    /// The parameter to which the file size of a stage in one piece is proportional.
    pub size_parameter: Option<&'static str>,
    /// Whether most samples are likely to have no stable solution.
    pub mostly_unstable: bool,
    /// Parameters whose values have unrelated costs.
    pub separate_parameters: &'static [&'static str],
    /// Number of chunks to build; `None` for a stage in one piece.
    pub chunks: Option<u64>,
    /// Length of all inputs, bytes; `None` if unknown.
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

    /// Returns the range for `growth` times the work, of whose time a share may be fixed: from that to proportional
    /// growth.
    fn partly_fixed(self, growth: f64, fixed: f64) -> Self {
        let factor = (fixed + (1.0 - fixed) * growth) / growth;
        Self {
            low: self.low * factor.min(1.0),
            likely: self.likely * factor.sqrt(),
            high: self.high * factor.max(1.0),
        }
    }

    /// Widens the range by a number of seconds.
    fn give_or_take(self, slack: f64) -> Self {
        Self {
            low: (self.low - slack).max(0.0),
            high: self.high + slack,
            ..self
        }
    }

    /// Returns the range of some times, widened by a factor, and their lower median: other work on the machine can only
    /// make a stage slower.
    fn of_times(mut values: Vec<f64>, widening: f64) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let likely = *values.get(values.len().checked_sub(1)? / 2)?;
        let range = Self::of(values, widening)?;
        Some(Self { likely, ..range })
    }

    /// Returns the range of some values, widened by a factor, and their median.
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
    /// Adds another price.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            seconds: self.seconds.plus(other.seconds),
            bytes: self.bytes.plus(other.bytes),
        }
    }
}

/// Returns the leaves of canonical parameters as texts.
#[must_use]
pub fn leaves(parameters: &Canonical) -> Leaves {
    let leaves = parameters.leaves().into_iter();
    leaves.map(|(path, value)| (path, value.to_string())).collect()
}

/// Why there is no price.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unmeasured {
    /// No stage of the kind has been built in this store.
    Kind,
    /// No stage with this value of a parameter has been built.
    Parameter {
        /// The last part of its path.
        name: String,
        /// Its value.
        value: String,
    },
    /// Most samples are likely to be unstable, and no such stage has been built.
    Unstable,
}

impl fmt::Display for Unmeasured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind => f.write_str("never measured"),
            Self::Parameter { name, value } => write!(f, "never measured for {name} {value}"),
            Self::Unstable => f.write_str("unknown: unstable samples take many times longer"),
        }
    }
}

/// Estimates the cost of work.
///
/// # Errors
/// If no similar stage has been built in this store.
pub fn price(costs: &[Cost], work: &CostQuery) -> Result<Price, Unmeasured> {
    let mut known: Vec<(usize, &Cost)> = costs
        .iter()
        .filter(|cost| cost.kind == work.kind && differing_class(cost, work).is_none())
        .map(|cost| (distance(cost, work), cost))
        .collect();
    let Some(nearest) = known.iter().map(|(distance, _)| *distance).min() else {
        let latest = costs.iter().rfind(|cost| cost.kind == work.kind);
        return Err(latest
            .and_then(|cost| differing_class(cost, work))
            .unwrap_or(Unmeasured::Kind));
    };
    // Costs of stable stages do not predict those of unstable ones, unless they have the same parameters.
    if work.mostly_unstable && nearest > 0 {
        known.retain(|(_, cost)| was_unstable(cost));
    }
    let nearest = known
        .iter()
        .map(|(distance, _)| *distance)
        .min()
        .ok_or(Unmeasured::Unstable)?;
    known.retain(|(distance, _)| *distance == nearest);
    // Costs of unstable stages with other parameters do not predict those of stable ones.
    if nearest > 0 && !work.mostly_unstable && !known.iter().all(|(_, cost)| was_unstable(cost)) {
        known.retain(|(_, cost)| !was_unstable(cost));
    }
    let known = similar(known.into_iter().map(|(_, cost)| cost).collect(), work);
    let latest: Vec<&Cost> = known.iter().rev().take(LATEST).copied().collect();
    let by_input =
        latest.iter().all(|cost| cost.input_bytes > 0) && work.chunks.is_none() && work.time_scales_with_inputs;
    let by_input = work.input_bytes.filter(|_| by_input);
    let ratio = nearest_amount(&latest, work).map_or(1.0, |cost| work_ratio(cost, work));
    // A stage in one piece that goes once through its inputs: any part of its time may be fixed.
    let is_open = by_input.is_some() && !work.repeats_inputs;
    let extrapolated = if is_open { ratio.min(SIMILAR_RATIO) } else { ratio };
    let widening = widening(nearest, latest.len()) * extrapolated.powf(RATIO_EXPONENT);
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
    let mut seconds = Estimate::of_times(seconds.collect(), widening).ok_or(Unmeasured::Kind)?;
    if ratio > SIMILAR_RATIO
        && let Some(nearest) = nearest_amount(&latest, work)
    {
        let fixed = if is_open {
            1.0
        } else {
            (FIXED / nearest.seconds).min(1.0)
        };
        let range = seconds.partly_fixed(growth(nearest, work), fixed);
        // Of other stages most of the time grows with the work.
        let likely = if is_open { range.likely } else { seconds.likely };
        seconds = Estimate { likely, ..range };
    }
    let threads = work.chunks.map_or(1, |chunks| work.jobs.min(chunks)).max(1);
    let steps = work.steps as f64;
    let amount = match by_input {
        None => steps * work.weight / threads as f64,
        Some(bytes) if work.repeats_inputs => steps * work.weight * bytes as f64,
        Some(bytes) => work.weight * bytes as f64,
    };
    // The files of a chunked stage grow with the samples; those of other stages do not grow with the steps, but
    // possibly with a parameter.
    let bytes = latest.iter().map(|cost| match work.chunks {
        Some(_) => cost.bytes as f64 / cost.steps as f64 * steps,
        None => cost.bytes as f64 * size_ratio(cost, work),
    });
    let of_bytes = if nearest == 0 { 1.0 } else { widening };
    Ok(Price {
        seconds: seconds.scaled(amount).give_or_take(OVERHEAD),
        bytes: Estimate::of(bytes.collect(), of_bytes).ok_or(Unmeasured::Kind)?,
    })
}

/// Returns the parameter by which a cost belongs to another class.
fn differing_class(cost: &Cost, work: &CostQuery) -> Option<Unmeasured> {
    let differs = |path: &&&str| class_at(&cost.parameters, path) != class_at(&work.parameters, path);
    let path = work.separate_parameters.iter().find(differs)?;
    let name = path.rsplit('.').next().unwrap_or(path);
    Some(Unmeasured::Parameter {
        name: name.replace('_', " "),
        value: class_at(&work.parameters, path),
    })
}

/// Returns the class that a parameter defines: its value; for a mapping the keys, each with its `model`.
fn class_at(parameters: &Leaves, path: &str) -> String {
    let none = || "none".to_owned();
    if let Some(value) = parameters.get(path) {
        return if value == "{}" { none() } else { value.clone() };
    }
    let below = format!("{path}.");
    let within = parameters
        .range(below.clone()..)
        .map_while(|(key, value)| Some((key.strip_prefix(&below)?, value)));
    let mut classes: BTreeMap<&str, &str> = BTreeMap::new();
    for (key, value) in within {
        let (name, rest) = key.split_once('.').unwrap_or((key, ""));
        let model = classes.entry(name).or_default();
        if rest == "model" {
            *model = value;
        }
    }
    if classes.is_empty() {
        return none();
    }
    let words = classes
        .iter()
        .map(|(name, model)| format!("{} {model}", name.replace('_', " ")).trim_end().to_owned());
    words.collect::<Vec<_>>().join(", ")
}

/// Returns the ratio of file sizes of a stage in one piece, by the parameter to which they are proportional.
fn size_ratio(cost: &Cost, work: &CostQuery) -> f64 {
    let number = |leaves: &Leaves| leaves.get(work.size_parameter?)?.parse::<f64>().ok();
    let (then, now) = (number(&cost.parameters), number(&work.parameters));
    match then.zip(now) {
        Some((then, now)) if then > 0.0 => now / then,
        _ => 1.0,
    }
}

/// Whether most samples had no stable solution.
fn was_unstable(cost: &Cost) -> bool {
    2 * cost.unstable > cost.steps
}

/// Returns the costs with about the same amount of work; all if there are none.
fn similar<'a>(costs: Vec<&'a Cost>, work: &CostQuery) -> Vec<&'a Cost> {
    let similar: Vec<&Cost> = costs
        .iter()
        .filter(|cost| work_ratio(cost, work) <= SIMILAR_RATIO)
        .copied()
        .collect();
    if similar.is_empty() { costs } else { similar }
}

/// Returns the cost whose amount of work differs least.
fn nearest_amount<'a>(costs: &[&'a Cost], work: &CostQuery) -> Option<&'a Cost> {
    let by_ratio = |a: &&Cost, b: &&Cost| work_ratio(a, work).total_cmp(&work_ratio(b, work));
    costs.iter().copied().min_by(by_ratio)
}

/// Returns the ratio of the amounts of work, 1 or more.
fn work_ratio(cost: &Cost, work: &CostQuery) -> f64 {
    let growth = growth(cost, work);
    growth.max(1.0 / growth)
}

/// Returns how many times the earlier amount of work is to be done. Assembling existing chunks counts as 1.
fn growth(cost: &Cost, work: &CostQuery) -> f64 {
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
    match work.repeats_inputs || work.chunks.is_some() || !work.time_scales_with_inputs {
        true => of_steps * of_input,
        false => of_input * work.weight / cost.weight,
    }
}

/// Returns the number of differences.
fn distance(cost: &Cost, work: &CostQuery) -> usize {
    // A parameter on one side only is not a difference: chunks of equal length have it in common, others do not.
    let differing = work.parameters.iter().filter(|(path, value)| {
        let then = cost.parameters.get(*path);
        then.is_some_and(|then| then != *value)
    });
    let others = [
        cost.recipe != work.recipe,
        cost.host != work.host,
        // The speed-up of a stage in one piece by threads is not known.
        work.chunks.is_none() && cost.jobs != work.jobs,
    ];
    differing.count() + others.iter().filter(|other| **other).count()
}

/// Returns the factor that widens the range: larger for more differences and fewer measurements.
fn widening(distance: usize, measured: usize) -> f64 {
    match (distance, measured) {
        // A single time does not show how much times vary.
        (0 | 1, 0..=1) => 2.5,
        (0, 2) => 1.6,
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

    fn work(chunks: Option<u64>, steps: u64) -> CostQuery {
        CostQuery {
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
            separate_parameters: &["order"],
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
        let widening = 1.4 * 2.0_f64.powf(RATIO_EXPONENT);
        assert!((found.seconds.low - (200.0 * 0.02 / 2.0 / widening - OVERHEAD)).abs() < 1e-12);
        assert!((found.seconds.high - (200.0 * 0.04 / 2.0 * widening + OVERHEAD)).abs() < 1e-12);
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
        let unknown = CostQuery {
            input_bytes: None,
            ..work(None, 16)
        };
        assert!((price(&costs, &unknown).unwrap().seconds.likely - 8.0).abs() < 1e-12);
        // Steps that do not go through the inputs again are counted by these alone.
        let once = CostQuery {
            repeats_inputs: false,
            ..work(None, 16)
        };
        assert!((price(&costs, &once).unwrap().seconds.likely - 8.0).abs() < 1e-12);
    }

    #[test]
    fn the_time_of_much_more_work_is_partly_fixed() {
        let costs = [Cost {
            chunks: 1,
            ..cost(100, 4.0)
        }];
        let of = |bytes: u64| {
            let work = CostQuery {
                input_bytes: Some(bytes),
                repeats_inputs: false,
                ..work(None, 100)
            };
            price(&costs, &work).unwrap().seconds
        };
        // An audit of 600 times the input takes between as long and 600 times as long.
        let long = of(600_000);
        let widening = 2.5 * SIMILAR_RATIO.powf(RATIO_EXPONENT);
        assert!((long.low - (4.0 / widening - OVERHEAD)).abs() < 1e-9, "{long:?}");
        assert!(
            (long.high - (600.0 * 4.0 * widening + OVERHEAD)).abs() < 1e-6,
            "{long:?}"
        );
        assert!((long.likely - 600.0_f64.sqrt() * 4.0).abs() < 1e-9, "{long:?}");
        let short = of(10);
        assert!(short.low <= 0.04 && short.high >= 4.0, "{short:?}");
        // About as much grows in proportion.
        assert!((of(2000).likely - 8.0).abs() < 1e-12);
        // Samples take as long each as before, except for at most a second to begin.
        let begin = cost(100, 2.0);
        let many = price(std::slice::from_ref(&begin), &work(Some(10), 10_000))
            .unwrap()
            .seconds;
        let widening = 2.5 * 100.0_f64.powf(RATIO_EXPONENT);
        assert!((many.low - (101.0 / widening - OVERHEAD)).abs() < 1e-9, "{many:?}");
        assert!((many.likely - 200.0).abs() < 1e-9, "{many:?}");
        assert!((many.high - (200.0 * widening + OVERHEAD)).abs() < 1e-9, "{many:?}");
        let few = price(&[begin], &work(Some(1), 1)).unwrap().seconds;
        assert!(few.low == 0.0 && few.high > 1.01, "{few:?}");
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
            (0.0, 0.0, OVERHEAD)
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
            let here = CostQuery {
                parameters: now.clone(),
                separate_parameters: apart,
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
        let mut here = CostQuery {
            mostly_unstable: true,
            ..work(Some(10), 100)
        };
        here.parameters.insert("voltage".into(), "12".into());
        let why = price(&[at("5", 0, 1.0)], &here).unwrap_err();
        assert_eq!(why.to_string(), "unknown: unstable samples take many times longer");
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
        let verify = CostQuery {
            repeats_inputs: false,
            time_scales_with_inputs: false,
            ..work(None, 8)
        };
        assert!((price(&costs, &verify).unwrap().seconds.likely - 4.0).abs() < 1e-12);
        let twice = CostQuery { steps: 16, ..verify };
        assert!((price(&costs, &twice).unwrap().seconds.likely - 8.0).abs() < 1e-12);
        let mut balance = CostQuery {
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
        assert!((found.seconds.likely - 50.0).abs() < 1e-12 && (found.seconds.high - 125.0 - OVERHEAD).abs() < 1e-12);
        // Four times the elements, four times the time.
        let finer = CostQuery {
            weight: 4.0,
            ..work(Some(10), 100)
        };
        let found = price(&[cost(100, 1.0)], &finer).unwrap();
        assert!((found.seconds.likely - 4.0).abs() < 1e-12);
        let train = CostQuery {
            kind: "train".into(),
            ..work(None, 1)
        };
        assert_eq!(price(&[cost(1, 1.0)], &train), Err(Unmeasured::Kind));
    }
}
