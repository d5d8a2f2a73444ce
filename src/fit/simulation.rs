//! A model that the caller gives, such as a finite-element simulation.

use crate::curve::{FitError, Sigma};
use crate::elastomer::{Need, Number, Response};
use std::cell::RefCell;

/// The numbers of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simulated {
    /// One for each number of the data.
    pub values: Vec<f64>,
    /// The derivatives of all numbers with respect to each parameter of [`Simulation::parameters`]. Those of a
    /// parameter that is not free may be left empty.
    pub by_parameter: Vec<Vec<f64>>,
}

/// Simulates at values in the order of [`Simulation::parameters`]. `Ok(None)` says that there is no state at these
/// values: the search looks elsewhere. An error ends the fit.
pub type Evaluate<'a> = dyn Fn(&[f64]) -> Result<Option<Simulated>, String> + 'a;

/// A model given by the caller.
#[derive(Clone)]
pub struct Simulation<'a> {
    /// The names of the parameters on which it depends.
    pub parameters: Vec<String>,
    /// The simulation.
    pub evaluate: &'a Evaluate<'a>,
}

/// Measured numbers of any kind with a model of the caller, such as displacements of a point at several voltages.
#[derive(Clone)]
pub struct NumberData<'a> {
    /// The name, such as the file.
    pub name: String,
    /// The measured numbers.
    pub measured: Vec<f64>,
    /// The noise, in the unit of the numbers.
    pub sigma: Sigma,
    /// The model.
    pub simulation: Simulation<'a>,
}

/// A simulation in a fit; it keeps the first error.
pub(crate) struct Simulator<'a> {
    set: &'a str,
    simulation: &'a Simulation<'a>,
    expected: usize,
    /// Which parameters are free.
    free: Vec<bool>,
    failure: RefCell<Option<FitError>>,
}

impl<'a> Simulator<'a> {
    /// Prepares a simulation of a number of numbers.
    pub fn new(set: &'a str, simulation: &'a Simulation<'a>, expected: usize, is_free: &dyn Fn(&str) -> bool) -> Self {
        Self {
            set,
            simulation,
            expected,
            free: simulation.parameters.iter().map(|name| is_free(name)).collect(),
            failure: RefCell::new(None),
        }
    }

    /// Returns the first error.
    pub fn failure(&self) -> Option<FitError> {
        self.failure.borrow().clone()
    }

    /// Returns the numbers with complete derivatives; `None` without a state, and after an error.
    pub fn simulate(&self, values: &[f64]) -> Option<Simulated> {
        if self.failure.borrow().is_some() {
            return None;
        }
        let set = || self.set.to_owned();
        let simulated =
            (self.simulation.evaluate)(values).map_err(|message| FitError::Simulation { set: set(), message });
        let checked = simulated.and_then(|simulated| simulated.map(|simulated| self.checked(simulated)).transpose());
        match checked {
            Ok(simulated) => simulated,
            Err(error) => {
                *self.failure.borrow_mut() = Some(error);
                None
            }
        }
    }

    /// Checks how many numbers there are.
    fn checked(&self, mut simulated: Simulated) -> Result<Simulated, FitError> {
        let count = |what, found, expected| {
            let set = self.set.to_owned();
            match found == expected {
                true => Ok(()),
                false => Err(FitError::SimulationCount {
                    set,
                    what,
                    found,
                    expected,
                }),
            }
        };
        count("numbers", simulated.values.len(), self.expected)?;
        count("columns of derivatives", simulated.by_parameter.len(), self.free.len())?;
        for (column, free) in simulated.by_parameter.iter_mut().zip(&self.free) {
            if !free && column.is_empty() {
                *column = vec![0.0; self.expected];
            }
            count("derivatives", column.len(), self.expected)?;
        }
        Ok(simulated)
    }
}

impl Response for Simulator<'_> {
    fn needs(&self) -> Vec<Need> {
        Need::all(self.simulation.parameters.clone())
    }

    fn respond(&self, values: &[f64]) -> Option<Vec<Number>> {
        let Simulated { values, by_parameter } = self.simulate(values)?;
        let number = |(row, value): (usize, f64)| (value, by_parameter.iter().map(|column| column[row]).collect());
        Some(values.into_iter().enumerate().map(number).collect())
    }

    fn failure(&self) -> Option<FitError> {
        Simulator::failure(self)
    }
}
