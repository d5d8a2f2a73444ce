//! A device with an exact solution, and parts of documents, for the tests of this crate.

use std::path::Path;

use crate::search::{FiniteElements, SearchError};
use deaflow_base::{Document, Node};
use deaflow_field::{
    CORNERS, Differentiable, Evaluator, Feasibility, Field, InStates, PredictError, Predictor, StateFields,
    WithGradient,
};
use deaflow_pattern::{CELLS, Pattern, Raster};

/// A device of which all points move along x by Σ worth · load + ½ bend (Σ spread · load)² mm, summed over the active
/// cells, where `load` belongs to the group of a cell, and counts by the share that electrodes cover.
#[derive(Clone)]
pub struct TestDevice {
    pub worth: Vec<f64>,
    pub loads: Vec<f64>,
    pub spread: Vec<f64>,
    pub bend: f64,
    /// Patterns with more active cells have no field.
    pub max_cells: usize,
    /// Whether points move along y instead of x.
    pub moves_along_y: bool,
}

impl TestDevice {
    /// A linear device with one group.
    pub fn linear(worth: Vec<f64>) -> Self {
        Self {
            loads: vec![1.0],
            spread: vec![0.0; worth.len()],
            bend: 0.0,
            max_cells: CELLS * CELLS,
            moves_along_y: false,
            worth,
        }
    }

    fn sums(&self, pattern: &Pattern) -> (f64, f64) {
        if let Some(coverage) = pattern.coverage() {
            let shares = coverage.shares();
            let sum = |each: &[f64]| {
                each.iter()
                    .zip(&shares)
                    .map(|(value, share)| value * share)
                    .sum::<f64>()
            };
            return (self.loads[0] * sum(&self.worth), self.loads[0] * sum(&self.spread));
        }
        let active = pattern.cells().iter().enumerate().filter(|(_, group)| **group != 0);
        active.fold((0.0, 0.0), |(value, spread), (cell, &group)| {
            let load = self.loads[usize::from(group) - 1];
            (value + self.worth[cell] * load, spread + self.spread[cell] * load)
        })
    }

    pub fn value(&self, pattern: &Pattern) -> f64 {
        let (linear, spread) = self.sums(pattern);
        linear + 0.5 * self.bend * spread * spread
    }

    /// The largest value of any pattern of `count` cells, for a linear device with one group.
    pub fn best(&self, count: usize) -> f64 {
        let mut sorted = self.worth.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted[..count].iter().sum()
    }

    fn field(&self, pattern: &Pattern) -> Option<Field> {
        let mut displacement = [self.value(pattern), 0.0];
        if self.moves_along_y {
            displacement.reverse();
        }
        let field = || Field::from_values(Raster::PAPER, displacement.repeat(CORNERS * CORNERS)).unwrap();
        (pattern.active_cells() <= self.max_cells).then(field)
    }

    /// The derivative of Σ weights · u with respect to the activity of each cell at a sum of spreads.
    fn derivative(&self, weights: &Field, spread: f64) -> Vec<f64> {
        let components = weights.values().iter().skip(usize::from(self.moves_along_y));
        let along: f64 = components.step_by(2).sum();
        let cells = || self.worth.iter().zip(&self.spread);
        let of_group = |load: f64| cells().map(move |(worth, own)| along * load * (worth + self.bend * spread * own));
        self.loads.iter().flat_map(|&load| of_group(load)).collect()
    }
}

impl Predictor for TestDevice {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        Ok(patterns.iter().map(|pattern| self.field(pattern)).collect())
    }
}

impl Evaluator for TestDevice {
    fn settings(&self) -> String {
        "exact".to_owned()
    }
}

impl Differentiable for TestDevice {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        let (_, spread) = self.sums(pattern);
        let with_gradient = |field: Field| {
            let gradient = self.derivative(&slope(&field), spread);
            (field, gradient)
        };
        Ok(self.field(pattern).map(with_gradient))
    }

    fn linear_response(&self, weights: &[Field]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        let each = weights.iter().map(|weights| (0.0, self.derivative(weights, 0.0)));
        Ok(Some(each.collect()))
    }
}

/// The device in its states as the finite elements of a search.
pub struct Elements<'a>(pub InStates<&'a TestDevice>);

impl FiniteElements for Elements<'_> {
    fn gradient(&self) -> Result<&dyn Differentiable<StateFields>, SearchError> {
        Ok(&self.0)
    }

    fn settings(&self) -> String {
        "exact".to_owned()
    }

    fn feasibility(&self) -> Result<Option<&dyn Feasibility>, SearchError> {
        Ok(None)
    }
}

/// A part of a document.
pub fn node(text: &str) -> Node {
    Document::from_text(Path::new("f"), text).unwrap().root
}
