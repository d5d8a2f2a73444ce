//! What samples say: mean, deviation, quantiles, yield and which tolerance matters, each with an interval.

use deaflow_base::{four_digits, measured};
use serde::Serialize;
use statrs::distribution::{Binomial, DiscreteCDF};

use crate::device::Source;
use crate::regression::Fit;
use crate::study::{Device, Failure};

/// The deviation of a normal distribution within which 95 % lie.
const NORMAL_95: f64 = 1.959_963_984_540_054;
/// The quantiles that are told.
const PROBABILITIES: [f64; 3] = [0.05, 0.5, 0.95];
/// Number of reasons for which a device fails.
const FAILURES: usize = Failure::ALL.len();
/// Fewest devices from which shares of the variance are estimated.
const FEWEST: usize = 32;
/// Fewest devices for each control variate of a mean.
const DEVICES_PER_CONTROL: usize = 10;
/// A standard deviation relative to the mean that is rounding.
const NONE: f64 = 1e-9;
/// Powers of a deviation that a regression has, from the first.
const POWERS: usize = 3;

/// A number with its interval of 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its interval; except for means as if the samples were independent, which is too wide for a Sobol' sequence.
    pub interval: [f64; 2],
}

impl Estimate {
    /// Returns the number with half of its interval, if that is known.
    #[must_use]
    pub fn with_interval(&self) -> String {
        let half = 0.5 * (self.interval[1] - self.interval[0]);
        match half.is_finite() {
            true => measured(self.value, half),
            false => four_digits(self.value),
        }
    }
}

/// A displacement that a share of the devices does not reach. Devices that fail count as −∞, which is null in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantile {
    /// The share.
    pub probability: f64,
    /// The displacement in mm, with the order statistics that contain it; −∞ for devices that fail.
    #[serde(flatten)]
    pub value: Estimate,
}

/// What the devices of a pattern do.
#[derive(Clone, Debug, PartialEq)]
pub struct Yield {
    /// Number of devices.
    pub samples: usize,
    /// Number of devices that fail for each reason.
    pub failures: [(Failure, usize); FAILURES],
    /// The mean displacement in mm of the devices that do not fail, with control variates; `None` without any.
    pub mean: Option<Estimate>,
    /// The standard deviation in mm of these; `None` with fewer than two.
    pub deviation: Option<Estimate>,
    /// Quantiles of all devices.
    pub quantiles: Vec<Quantile>,
    /// The share of all devices that reach a displacement, if one is wanted.
    pub reached: Option<Estimate>,
    /// The share of the variance that each tolerance causes by itself, largest first.
    pub shares: Vec<(Source, f64)>,
}

impl Yield {
    /// Returns the number of devices that fail.
    #[must_use]
    pub fn failed(&self) -> usize {
        self.failures.iter().map(|(_, count)| count).sum()
    }

    /// Returns by what designs are ranked: the share that reaches the displacement, then the mean.
    #[must_use]
    pub fn rank(&self) -> [f64; 2] {
        [self.reached, self.mean].map(|known| known.map_or(f64::NEG_INFINITY, |known| known.value))
    }

    /// Returns the number of devices that fail for a reason.
    #[must_use]
    pub fn failed_by(&self, failure: Failure) -> usize {
        self.failures[failure as usize].1
    }

    /// Evaluates devices; `wanted` is the displacement that they have to reach, mm.
    #[must_use]
    pub fn of(devices: &[Device], varying: &[Source], wanted: Option<f64>) -> Self {
        let values: Vec<f64> = devices.iter().filter_map(|device| device.value.ok()).collect();
        let count = |failure: Failure| devices.iter().filter(|device| device.value == Err(failure)).count();
        let mut sorted: Vec<f64> = devices
            .iter()
            .map(|device| device.value.unwrap_or(f64::NEG_INFINITY))
            .collect();
        sorted.sort_by(f64::total_cmp);
        let reached = wanted.map(|wanted| {
            let number = values.iter().filter(|value| **value >= wanted).count();
            wilson(number, devices.len())
        });
        Self {
            samples: devices.len(),
            failures: Failure::ALL.map(|failure| (failure, count(failure))),
            mean: mean(devices, &values, varying),
            deviation: deviation(&values),
            quantiles: PROBABILITIES.map(|probability| quantile(&sorted, probability)).to_vec(),
            reached,
            shares: shares(devices, varying),
        }
    }
}

fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the mean, with the deviations and their products as control variates: their means are known, so that the
/// interval is that of what they do not explain. Without the devices that fail the means of the others are unknown, and
/// the interval is that of independent devices.
fn mean(devices: &[Device], values: &[f64], varying: &[Source]) -> Option<Estimate> {
    let deviation = deviation(values);
    let spread = deviation.map_or(f64::INFINITY, |deviation| deviation.value);
    let plain = (average(values), spread);
    let controlled = match values.len() == devices.len() {
        true => with_controls(devices, values, varying),
        false => None,
    };
    let (value, spread) = controlled.unwrap_or(plain);
    let half = NORMAL_95 * spread / (values.len() as f64).sqrt();
    (!values.is_empty()).then_some(Estimate {
        value,
        interval: [value - half, value + half],
    })
}

/// Returns the mean with control variates, and the standard deviation of what these do not explain; `None` with few
/// devices. Linear and quadratic functions of the deviations are controls, with fewer devices linear ones alone.
fn with_controls(devices: &[Device], values: &[f64], varying: &[Source]) -> Option<(f64, f64)> {
    let count = varying.len();
    let linear = |device: &Device| -> Vec<f64> { varying.iter().map(|source| device.deviation(*source)).collect() };
    let quadratic = |device: &Device| {
        let own = linear(device);
        let products = (0..count).flat_map(|i| (0..=i).map(move |k| [i, k]));
        let products: Vec<f64> = products.map(|[i, k]| own[i] * own[k]).collect();
        [own, products].concat()
    };
    // The mean of the square of a standard normal deviation is 1, that of all others is 0.
    let mut expected = vec![0.0; count];
    for i in 0..count {
        expected.extend((0..=i).map(|k| f64::from(u8::from(i == k))));
    }
    let suffice = |functions: usize| values.len() >= DEVICES_PER_CONTROL * (1 + functions);
    let functions: Vec<Vec<f64>> = if suffice(expected.len()) {
        devices.iter().map(quadratic).collect()
    } else if suffice(count) {
        devices.iter().map(linear).collect()
    } else {
        return None;
    };
    let used = functions.first().filter(|row| !row.is_empty())?.len();
    let fit = Fit::new(&functions, values)?;
    let free = (values.len() - 1 - used) as f64;
    let unexplained = (fit.total - fit.explained).max(0.0) / free;
    Some((fit.mean_at(&expected[..used]), unexplained.sqrt()))
}

/// Returns the standard deviation; its interval is that of a normal distribution of many values.
fn deviation(values: &[f64]) -> Option<Estimate> {
    if values.len() < 2 {
        return None;
    }
    let n = values.len() as f64;
    let mean = average(values);
    let value = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let half = NORMAL_95 * value / (2.0 * (n - 1.0)).sqrt();
    Some(Estimate {
        value,
        interval: [(value - half).max(0.0), value + half],
    })
}

/// Returns the interval of a share by Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
fn wilson(number: usize, samples: usize) -> Estimate {
    let (k, n) = (number as f64, samples as f64);
    let squared = NORMAL_95 * NORMAL_95;
    let share = k / n;
    let middle = (share + 0.5 * squared / n) / (1.0 + squared / n);
    let half = NORMAL_95 / (1.0 + squared / n) * (share * (1.0 - share) / n + 0.25 * squared / (n * n)).sqrt();
    Estimate {
        value: share,
        // Without rounding at the ends.
        interval: [
            if number == 0 { 0.0 } else { middle - half },
            if number == samples { 1.0 } else { middle + half },
        ],
    }
}

/// Returns a quantile of sorted values, with the order statistics between which it lies with 95 %: the number of values
/// below it has a binomial distribution.
fn quantile(sorted: &[f64], probability: f64) -> Quantile {
    let n = sorted.len();
    let ranks = Binomial::new(probability, n as u64).map_or([0, n as u64], |below| {
        [0.025, 0.975].map(|level| below.inverse_cdf(level))
    });
    let at = |rank: f64| {
        let (low, part) = (rank.floor(), rank.fract());
        let [first, second] = [low, low + 1.0].map(|index| sorted[(index as usize).min(n - 1)]);
        // −∞ minus −∞ is no number.
        if part == 0.0 || first == second {
            first
        } else {
            first + part * (second - first)
        }
    };
    Quantile {
        probability,
        value: Estimate {
            value: at(probability * (n - 1) as f64),
            interval: [
                at(ranks[0].saturating_sub(1) as f64),
                at(ranks[1].min(n as u64 - 1) as f64),
            ],
        },
    }
}

/// Returns half the interval of 95 % of a share R² of the variance from independent devices, for many of them: the
/// variance of the estimate is 4R²(1 − R²)²/n (Olkin and Finn, Psychological Bulletin 118 (1995) 155). Estimates of
/// several shares may sum to more than 1.
#[must_use]
pub fn share_within(share: f64, devices: usize) -> f64 {
    const NORMAL: f64 = 1.96;
    NORMAL * 2.0 * share.sqrt() * (1.0 - share) / (devices as f64).sqrt()
}

/// Returns the share of the variance that each deviation explains by itself, by a cubic regression.
fn shares(devices: &[Device], varying: &[Source]) -> Vec<(Source, f64)> {
    let known: Vec<(&Device, f64)> = devices
        .iter()
        .filter_map(|device| Some((device, device.value.ok()?)))
        .collect();
    let values: Vec<f64> = known.iter().map(|(_, value)| *value).collect();
    let mean = average(&values);
    let differs = deviation(&values).is_some_and(|total| total.value > NONE * mean.abs());
    if !differs || known.len() < FEWEST {
        return Vec::new();
    }
    let n = known.len() as f64;
    let share = |source: &Source| {
        let powers = known.iter().map(|(device, _)| {
            let deviation = device.deviation(*source);
            (1..=POWERS).map(|power| deviation.powi(power as i32)).collect()
        });
        let fit = Fit::new(&powers.collect::<Vec<_>>(), &values)?;
        // What a regression on anything would explain is left out.
        let unexplained = (1.0 - fit.explained / fit.total) * (n - 1.0) / (n - 1.0 - POWERS as f64);
        Some((*source, (1.0 - unexplained).max(0.0)))
    };
    let mut all: Vec<(Source, f64)> = varying.iter().filter_map(share).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}
