//! The stretch of a viscoelastic elastomer over time at a constant load, with or without a voltage.
//!
//! At each time the stretch balances the forces ([`crate::balance`]) and the branches flow ([`crate::branch`]). A time
//! at which no stretch balances them is a delayed loss of stability: there is no state from there on.

use crate::balance::{Electric, Load, first_balance, squeeze};
use crate::branch::{STATES, State};
use crate::collocation::{Flow, Integrator, Moving, Slope};
use crate::curve::{FitError, Sigma};
use crate::deformation::Test;
use crate::elastomer::{Branch, Elastomer, Need, Number, Response};
use crate::history::check_times;
use crate::law::Law;
use crate::sheet::{check_sheet, check_stretches, electric_needs};
use deaflow_linalg::Mat;
use std::cell::Cell;

/// The stretch over time after a load and a voltage have acted suddenly at time 0 on a relaxed specimen.
#[derive(Clone, Debug, PartialEq)]
pub struct CreepCurve {
    /// The name, such as the file.
    pub name: String,
    /// The elastomer.
    pub elastomer: Elastomer,
    /// How it stretches; with a voltage not [`Test::Uniaxial`].
    pub test: Test,
    /// The load. With [`Load::Prestretch`] the elastomer has relaxed there, and the voltage alone acts at time 0.
    pub load: Load,
    /// The voltage in V; at 0 the parameters of electricity are not needed.
    pub voltage_v: f64,
    /// The undeformed thickness in m.
    pub thickness_m: f64,
    /// The times in s, in any order; 0 is just after loading.
    pub time_s: Vec<f64>,
    /// The stretches.
    pub stretch: Vec<f64>,
    /// The noise of the stretches; standard deviations are numbers without a unit.
    pub sigma: Sigma,
}

impl CreepCurve {
    /// Checks the curve.
    ///
    /// # Errors
    /// When a column or a setting is not valid.
    pub(crate) fn response(&self) -> Result<Creeping<'_>, FitError> {
        check_sheet(
            &self.name,
            self.thickness_m,
            self.load,
            self.test,
            self.voltage_v != 0.0,
        )?;
        if !self.voltage_v.is_finite() {
            let (set, what, value) = (self.name.clone(), "voltage", self.voltage_v);
            return Err(FitError::Setting { set, what, value });
        }
        check_stretches(&self.name, &self.stretch)?;
        check_times(&self.name, &self.time_s, (self.stretch.len(), "stretches"), 0.0)?;
        let mut order: Vec<usize> = (0..self.time_s.len()).collect();
        order.sort_by(|a, b| self.time_s[*a].total_cmp(&self.time_s[*b]));
        Ok(Creeping { curve: self, order })
    }
}

/// A curve that has been checked.
pub(crate) struct Creeping<'a> {
    curve: &'a CreepCurve,
    /// The rows in the order of their times.
    order: Vec<usize>,
}

/// The balance of forces at values of the parameters.
struct Balance<'a> {
    curve: &'a CreepCurve,
    law: Law,
    branches: Vec<Branch>,
    electric: Electric,
    load: (f64, Vec<f64>),
    /// The last stretch, from which the search for the next one starts.
    before: Cell<f64>,
}

/// A stretch, and its derivatives.
struct Balanced {
    stretch: f64,
    /// For each branch.
    by_state: Vec<State>,
    by_parameter: Vec<f64>,
}

fn state_of(states: &[f64], branch: usize) -> State {
    std::array::from_fn(|i| states[STATES * branch + i])
}

impl Balance<'_> {
    /// Returns the left side of the balance less the load, and its derivative with respect to the stretch.
    fn excess(&self, stretch: f64, states: &[f64]) -> Option<(f64, f64)> {
        let CreepCurve { test, elastomer, .. } = self.curve;
        let (squeeze, squeeze_slope) = squeeze(*test, stretch);
        let mut excess = self.law.nominal_stress(*test, stretch)? - self.electric.kappa * squeeze - self.load.0;
        let mut slope = self.law.slope(*test, stretch)? - self.electric.kappa * squeeze_slope;
        for (index, branch) in self.branches.iter().enumerate() {
            let stress = elastomer.viscous.stress(*test, stretch, state_of(states, index));
            excess += branch.modulus * stress.value;
            slope += branch.modulus * stress.by_stretch;
        }
        Some((excess, slope))
    }

    /// Returns the stretch that balances forces.
    fn balanced(&self, states: &[f64]) -> Option<Balanced> {
        let CreepCurve {
            test,
            elastomer,
            voltage_v,
            ..
        } = self.curve;
        let excess = |stretch: f64| self.excess(stretch, states);
        let stretch = first_balance(&excess, self.before.get())?;
        let slope = excess(stretch)?.1;
        if slope <= 0.0 {
            return None;
        }
        let own = self.law.stress_and_gradient(*test, stretch)?.1.into_iter();
        let mut by_parameter: Vec<f64> = own.zip(&self.load.1).map(|(stress, load)| stress - load).collect();
        let mut by_state = Vec::with_capacity(self.branches.len());
        for (index, branch) in self.branches.iter().enumerate() {
            let stress = elastomer.viscous.stress(*test, stretch, state_of(states, index));
            by_parameter.extend([stress.value, 0.0]);
            by_state.push(stress.by_state.map(|by| -branch.modulus * by / slope));
        }
        if *voltage_v != 0.0 {
            let squeeze = squeeze(*test, stretch).0;
            by_parameter.extend([self.electric.by_permittivity, self.electric.by_voltage].map(|by| -by * squeeze));
        }
        by_parameter.iter_mut().for_each(|by| *by /= -slope);
        Some(Balanced {
            stretch,
            by_state,
            by_parameter,
        })
    }

    /// Returns the stretch with its derivatives where the states depend on the parameters.
    fn number(&self, moving: &Moving) -> Option<Number> {
        let balanced = self.balanced(&moving.state)?;
        self.before.set(balanced.stretch);
        let by_state = balanced.by_state.concat();
        let total = |(p, direct): (usize, &f64)| {
            let through = by_state
                .iter()
                .enumerate()
                .map(|(a, by)| by * moving.by_parameter[(a, p)]);
            direct + through.sum::<f64>()
        };
        let gradient = balanced.by_parameter.iter().enumerate().map(total).collect();
        Some((balanced.stretch, gradient))
    }
}

impl Flow for Balance<'_> {
    fn slope(&self, _: f64, states: &[f64]) -> Option<Slope> {
        let balanced = self.balanced(states)?;
        let CreepCurve { test, elastomer, .. } = self.curve;
        let rates: Vec<_> = (0..self.branches.len())
            .map(|index| elastomer.viscous.rate(*test, balanced.stretch, state_of(states, index)))
            .collect();
        let tau = |row: usize| self.branches[row / STATES].time;
        let stretch_by_state = balanced.by_state.concat();
        let value = |row: usize| rates[row / STATES].value[row % STATES] / tau(row);
        let by_stretch = |row: usize| rates[row / STATES].by_stretch[row % STATES] / tau(row);
        let by_state = |row: usize, column: usize| {
            let own = rates[row / STATES].by_state[row % STATES][column % STATES] / tau(row);
            let same = row / STATES == column / STATES;
            by_stretch(row) * stretch_by_state[column] + if same { own } else { 0.0 }
        };
        let first = self.law.kind().parameters().len();
        let by_parameter = |row: usize, p: usize| {
            let own_time = p == first + 2 * (row / STATES) + 1;
            let direct = if own_time { -value(row) / tau(row) } else { 0.0 };
            direct + by_stretch(row) * balanced.by_parameter[p]
        };
        let count = states.len();
        Some(Slope {
            value: (0..count).map(value).collect(),
            by_state: Mat::from_fn(count, count, by_state),
            by_parameter: Mat::from_fn(count, balanced.by_parameter.len(), by_parameter),
        })
    }

    fn reached(&self, states: &[f64]) {
        if let Some(balanced) = self.balanced(states) {
            self.before.set(balanced.stretch);
        }
    }
}

impl Response for Creeping<'_> {
    fn needs(&self) -> Vec<Need> {
        let mut needs = Need::all(self.curve.elastomer.parameters());
        if self.curve.voltage_v != 0.0 {
            needs.extend(electric_needs());
        }
        needs
    }

    fn respond(&self, values: &[f64]) -> Option<Vec<Number>> {
        let CreepCurve {
            elastomer,
            test,
            load,
            voltage_v,
            thickness_m,
            ref time_s,
            ..
        } = *self.curve;
        let (law, branches) = elastomer.with(values)?;
        let electric = match *values {
            [.., permittivity, offset] if voltage_v != 0.0 => {
                Electric::new(permittivity, voltage_v + offset, thickness_m)
            }
            _ => Electric::NONE,
        };
        let rest = load.rest();
        let state = elastomer.viscous.relaxed(test, rest);
        let mut moving = Moving {
            state: state.repeat(branches.len()),
            by_parameter: Mat::zeros(STATES * branches.len(), values.len()),
        };
        let balance = Balance {
            curve: self.curve,
            load: load.stress(&law, test, thickness_m)?,
            law,
            branches,
            electric,
            before: Cell::new(rest),
        };
        let mut numbers = vec![(0.0, Vec::new()); time_s.len()];
        let (mut integrator, mut time) = (Integrator::new(), 0.0);
        balance.number(&moving)?;
        for &at in &self.order {
            if !balance.branches.is_empty() {
                integrator.advance(&balance, &mut moving, time, time_s[at])?;
            }
            time = time_s[at];
            numbers[at] = balance.number(&moving)?;
        }
        Some(numbers)
    }
}
