//! The stress of a viscoelastic elastomer along a history of stretch.
//!
//! ```text
//! P(t) = P_law(λ(t)) + Σ Gᵢ p(λ(t), state of branch i)
//! ```
//!
//! Each branch starts relaxed at the first stretch. While a stretch is held, the linear law has a solution in closed
//! form, on a ramp one as an integral. The finite law is integrated in steps ([`crate::collocation`]). A sudden step is
//! two rows at one time.

use crate::branch::{STATES, State, ViscousLaw};
use crate::collocation::{Flow, Integrator, Moving, Slope};
use crate::curve::{FitError, Sigma};
use crate::deformation::Test;
use crate::elastomer::{Elastomer, Need, Number, Response};
use deaflow_linalg::Mat;

/// The places on (0, 1) and the weights of Gauss's rule with ten points.
const GAUSS: [(f64, f64); 5] = [
    (0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_3),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_1),
];
/// The largest part of the stretch that changes over the width of a rule.
const PART: f64 = 0.25;
/// The largest width of a rule in relaxation times.
const DECAY: f64 = 2.0;
/// Relaxation times after which nothing is left of a state.
const FORGOTTEN: f64 = 45.0;

/// The stress that a specimen has along a given history of stretch.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryCurve {
    /// The name, such as the file.
    pub name: String,
    /// The elastomer.
    pub elastomer: Elastomer,
    /// How the specimen is stretched.
    pub test: Test,
    /// Times in s and stretches; linear between them, held after the last. Two rows at one time are a sudden step. The
    /// elastomer is relaxed at the first stretch.
    pub history: Vec<(f64, f64)>,
    /// The times in s at which the stress is recorded, in any order; just after a step at its time.
    pub time_s: Vec<f64>,
    /// The nominal stresses in Pa.
    pub stress_pa: Vec<f64>,
    /// The noise.
    pub sigma: Sigma,
}

impl HistoryCurve {
    /// Checks the history and the times.
    ///
    /// # Errors
    /// When a number is not finite, a stretch is not positive, or times do not fit.
    pub(crate) fn response(&self) -> Result<Stressed<'_>, FitError> {
        let set = || self.name.clone();
        let Some(first) = self.history.first() else {
            return Err(FitError::NoHistory { set: set() });
        };
        let mut before = f64::NEG_INFINITY;
        for (at, (time, stretch)) in self.history.iter().enumerate() {
            let row = at + 1;
            if !(time.is_finite() && *time >= before && stretch.is_finite()) {
                return Err(FitError::History { set: set(), row });
            }
            if *stretch <= 0.0 {
                let (curve, stretch) = (set(), *stretch);
                return Err(FitError::Stretch { curve, row, stretch });
            }
            before = *time;
        }
        check_times(&self.name, &self.time_s, (self.stress_pa.len(), "stresses"), first.0)?;
        let mut order: Vec<usize> = (0..self.time_s.len()).collect();
        order.sort_by(|a, b| self.time_s[*a].total_cmp(&self.time_s[*b]));
        Ok(Stressed { curve: self, order })
    }
}

/// Checks the times of a set of data.
///
/// # Errors
/// When their number differs, or one is not finite or too early.
pub(crate) fn check_times(
    set: &str,
    times: &[f64],
    data: (usize, &'static str),
    earliest: f64,
) -> Result<(), FitError> {
    let set = set.to_owned();
    if times.len() != data.0 {
        return Err(FitError::Lengths {
            curve: set,
            first: data,
            second: (times.len(), "times"),
        });
    }
    if let Some(at) = times.iter().position(|time| !time.is_finite()) {
        let (row, column) = (at + 1, "time");
        return Err(FitError::NotFinite {
            curve: set,
            row,
            column,
        });
    }
    match times.iter().position(|time| *time < earliest) {
        Some(at) => Err(FitError::BeforeHistory { set, row: at + 1 }),
        None => Ok(()),
    }
}

/// A history that has been checked.
pub(crate) struct Stressed<'a> {
    curve: &'a HistoryCurve,
    /// The rows in the order of their times.
    order: Vec<usize>,
}

/// A line of the history.
#[derive(Clone, Copy, Debug)]
struct Line {
    start: (f64, f64),
    /// The rate of the stretch in 1/s.
    rate: f64,
}

impl Line {
    fn at(self, time: f64) -> f64 {
        self.start.1 + self.rate * (time - self.start.0)
    }
}

/// A branch on a line, whose only parameter is its time.
struct OnLine {
    law: ViscousLaw,
    test: Test,
    tau: f64,
    line: Line,
}

impl Flow for OnLine {
    fn slope(&self, time: f64, state: &[f64]) -> Option<Slope> {
        let rate = self.law.rate(self.test, self.line.at(time), [state[0], state[1]]);
        let value = rate.value.map(|rate| rate / self.tau);
        Some(Slope {
            by_state: Mat::from_fn(STATES, STATES, |i, j| rate.by_state[i][j] / self.tau),
            by_parameter: Mat::from_fn(STATES, 1, |i, _| -value[i] / self.tau),
            value: value.to_vec(),
        })
    }
}

impl Stressed<'_> {
    /// Returns the line that begins with a row of the history; the last row is held.
    fn line(&self, row: usize) -> Line {
        let history = &self.curve.history;
        let start = history[row];
        let rate = history.get(row + 1).map_or(0.0, |end| {
            let length = end.0 - start.0;
            if length > 0.0 { (end.1 - start.1) / length } else { 0.0 }
        });
        Line { start, rate }
    }

    /// Returns the row of the history at or before a time; the last one of several at that time.
    fn row(&self, time: f64) -> usize {
        self.curve
            .history
            .partition_point(|row| row.0 <= time)
            .saturating_sub(1)
    }

    /// Returns the stretch at a time.
    pub fn stretch(&self, time: f64) -> f64 {
        self.line(self.row(time)).at(time)
    }

    /// Returns the states of a branch at the recorded times, and their derivatives with respect to its time.
    fn states(&self, tau: f64) -> Option<Vec<(State, State)>> {
        let HistoryCurve {
            elastomer,
            test,
            history,
            time_s,
            ..
        } = self.curve;
        let mut branch = Moving {
            state: elastomer.viscous.relaxed(*test, history[0].1).to_vec(),
            by_parameter: Mat::zeros(STATES, 1),
        };
        let mut integrator = Integrator::new();
        let (mut row, mut time) = (0, history[0].0);
        let mut found = vec![([0.0; STATES], [0.0; STATES]); time_s.len()];
        for &at in &self.order {
            let last = self.row(time_s[at]);
            while row < last {
                let end = history[row + 1].0;
                self.advance(&mut integrator, &mut branch, self.line(row), tau, time, end)?;
                (row, time) = (row + 1, end);
            }
            self.advance(&mut integrator, &mut branch, self.line(row), tau, time, time_s[at])?;
            time = time_s[at];
            let by_time = std::array::from_fn(|i| branch.by_parameter[(i, 0)]);
            found[at] = ([branch.state[0], branch.state[1]], by_time);
        }
        Some(found)
    }

    /// Advances a branch on a line from one time to another.
    fn advance(
        &self,
        integrator: &mut Integrator,
        branch: &mut Moving,
        line: Line,
        tau: f64,
        from: f64,
        to: f64,
    ) -> Option<()> {
        let (law, test) = (self.curve.elastomer.viscous, self.curve.test);
        if to <= from {
            return Some(());
        }
        if law != ViscousLaw::Linear {
            return integrator.advance(&OnLine { law, test, tau, line }, branch, from, to);
        }
        if line.rate != 0.0 {
            self.follow(branch, line, tau, from, to);
            return Some(());
        }
        let (relaxed, elapsed) = (law.relaxed(test, line.start.1), (to - from) / tau);
        let kept = (-elapsed).exp();
        for (i, relaxed) in relaxed.into_iter().enumerate() {
            let above = branch.state[i] - relaxed;
            branch.state[i] = relaxed + kept * above;
            branch.by_parameter[(i, 0)] = kept * (branch.by_parameter[(i, 0)] + above * elapsed / tau);
        }
        Some(())
    }

    /// Advances a branch of the linear law on a ramp: what is left of A, and the integral of e^(−(t − s)/τ) C⁻¹(s)/τ by
    /// Gauss's rule on intervals over which neither factor changes by much.
    fn follow(&self, branch: &mut Moving, line: Line, tau: f64, from: f64, to: f64) {
        let (law, test) = (self.curve.elastomer.viscous, self.curve.test);
        let elapsed = (to - from) / tau;
        let kept = (-elapsed).exp();
        for i in 0..STATES {
            let old = branch.state[i];
            branch.state[i] = kept * old;
            branch.by_parameter[(i, 0)] = kept * (branch.by_parameter[(i, 0)] + old * elapsed / tau);
        }
        let first = from.max(to - FORGOTTEN * tau);
        let mut end = to;
        while end > first {
            let width = (PART * line.at(end) / line.rate.abs())
                .min(DECAY * tau)
                .min(end - first);
            let half = 0.5 * width;
            for (place, weight) in GAUSS
                .into_iter()
                .flat_map(|(place, weight)| [(place, weight), (-place, weight)])
            {
                let time = end - half + half * place;
                let age = (to - time) / tau;
                let factor = weight * half * (-age).exp() / tau;
                for (i, relaxed) in law.relaxed(test, line.at(time)).into_iter().enumerate() {
                    branch.state[i] += factor * relaxed;
                    branch.by_parameter[(i, 0)] += factor * (age - 1.0) / tau * relaxed;
                }
            }
            end = if end - width > first { end - width } else { first };
        }
    }

    /// Returns the stresses of a branch with the modulus 1 at the recorded times, and their derivatives with respect to
    /// its time.
    pub fn branch(&self, tau: f64) -> Option<Vec<(f64, f64)>> {
        let states = self.states(tau)?.into_iter().zip(&self.curve.time_s);
        let stress = |((state, by_time), time): ((State, State), &f64)| {
            let stress = self
                .curve
                .elastomer
                .viscous
                .stress(self.curve.test, self.stretch(*time), state);
            let slope = stress.by_state.iter().zip(by_time).map(|(s, t)| s * t).sum();
            (stress.value, slope)
        };
        Some(states.map(stress).collect())
    }
}

impl Response for Stressed<'_> {
    fn needs(&self) -> Vec<Need> {
        Need::all(self.curve.elastomer.parameters())
    }

    fn respond(&self, values: &[f64]) -> Option<Vec<Number>> {
        let (law, branches) = self.curve.elastomer.with(values)?;
        let times = self.curve.time_s.iter();
        let mut numbers: Vec<Number> = times
            .map(|time| law.stress_and_gradient(self.curve.test, self.stretch(*time)))
            .collect::<Option<_>>()?;
        for branch in branches {
            for (number, (stress, by_time)) in numbers.iter_mut().zip(self.branch(branch.time)?) {
                number.0 += branch.modulus * stress;
                number.1.extend([stress, branch.modulus * by_time]);
            }
        }
        Some(numbers)
    }
}
