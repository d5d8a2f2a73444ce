//! A design of a report.

use std::sync::Arc;

use super::compare::OverIntuitive;
use super::front::{FrontPlace, OtherObjective};
use super::objective::{Objective, TargetPoint};
use super::small_islands::small_islands;
use super::ties::Place;
use crate::artifacts::StageArtifact;
use crate::drawing::{Background, DeformedMembrane};
use crate::intervals::NetworkInterval;
use deaflow_content::DesignRank;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::{Pattern, Role};
use deaflow_scene::Scene;

/// Below a micrometre, the ratio of displacements means nothing.
pub const LEAST_MM: f64 = 1e-3;

/// Area fractions that differ by less are equal: two cells of 50 × 50.
pub const SAME_AREA: f64 = 1e-3;

/// A design or another pattern of a report.
#[derive(Clone, Debug)]
pub struct Design {
    /// A unique name, valid as a file name.
    pub name: String,
    /// The stage that it is read from: the one that verified it, or else its search.
    pub made: StageArtifact,
    /// The case of the target; empty if the pipeline names none.
    pub case: String,
    /// The name of the target.
    pub target: String,
    /// Its role among the patterns of the target.
    pub role: Role,
    /// Its number among the different designs of the target, from 0.
    pub member: u64,
    /// Units along a side of the membrane that the search could switch.
    pub units: u64,
    /// The values of the axes of the sweep whose stage has it, as in the name of the stage; empty without a sweep.
    pub setting: String,
    /// The objective.
    pub objective: Objective,
    /// The requested area fraction, or `free`.
    pub area_target: String,
    /// Its area fraction.
    pub area: f64,
    /// Its constraints in YAML; `{}` if there are none.
    pub constraints: String,
    /// `met`, or the violated constraints; empty if nothing is known.
    pub status: String,
    /// The scene of the design or verify stage, without time and properties.
    pub scene: Arc<Scene>,
    /// The membrane that it is drawn on.
    pub background: Background,
    /// The electrode.
    pub pattern: Pattern,
    /// Predicted displacement in mm at the cell corners, `[y][x][component]`; `None` without a prediction.
    pub predicted: Option<Vec<f64>>,
    /// The simulated one; `None` without a stable solution.
    pub simulated: Option<Vec<f64>>,
    /// The simulated change of the heights of the cell corners in mm, in the first state, of a membrane that leaves its
    /// plane.
    pub heights: Option<Vec<f64>>,
    /// The displacement in each state of a device with several: simulated, or else predicted.
    pub states: Vec<StateField>,
    /// Predicted mean displacement along the target directions, mm; `None` if the evaluator has no field.
    pub predicted_mm: Option<f64>,
    /// The value of a robust objective as predicted by the search, mm; `None` of other objectives.
    pub robust_mm: Option<f64>,
    /// The simulated one.
    pub simulated_mm: Option<f64>,
    /// Estimated error of the simulation, mm.
    pub error_mm: Option<f64>,
    /// Distance from the target displacement or angle, mm, if there is one and it was simulated.
    pub distance_mm: Option<f64>,
    /// The prediction of a calibrated network, if there is one.
    pub interval: Option<NetworkInterval>,
    /// The outcome of the simulation; `None` without a simulation.
    pub outcome: Option<OutcomeKind>,
    /// Comparison with other designs.
    pub compared: Comparison,
    /// Its place in a front, if it is a point of one.
    pub front: Option<FrontPlace>,
}

/// Simulated displacements along the target directions in mm, for the same case and target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Of the intuitive design at its own area.
    pub intuitive_own: Option<f64>,
    /// Of the intuitive design at the area of this one; `None` if there is none with that area.
    pub intuitive_equal_area: Option<f64>,
    /// Gains over these two, with their areas; none if a given displacement is to be reached, as a larger one is not
    /// better then.
    pub(crate) over: [Option<OverIntuitive>; 2],
    /// Whether this design is compared with intuitive designs, but all of them violate the constraints.
    pub(crate) is_incomparable: bool,
    /// Of the optimum: the best one on the same units, or else the best of all.
    pub optimum: Option<f64>,
    /// The displacement of this design divided by that of the optimum; `None` if a given displacement is to be reached,
    /// as a larger one is not better then, or if the optimum hardly moves or one of both moves the other way.
    pub ratio: Option<f64>,
    /// The displacement of this design minus that of the optimum, if they move in opposite directions.
    pub difference_mm: Option<f64>,
    /// What the optimum is, if this design is compared with it.
    pub optimum_is: Option<&'static str>,
}

/// The displacement in one of several states.
#[derive(Clone, Debug, PartialEq)]
pub struct StateField {
    /// The name of the state.
    pub name: String,
    /// In mm at the corners of cells, `[y][x][component]`.
    pub field: Vec<f64>,
}

impl Design {
    /// Whether two designs may be compared: same case, target, objective, area and scene.
    #[must_use]
    pub fn has_same_target(&self, other: &Self) -> bool {
        let is_same_target = self.case == other.case && self.target == other.target;
        let is_for_the_same = || self.objective == other.objective && self.area_target == other.area_target;
        is_same_target && is_for_the_same() && (Arc::ptr_eq(&self.scene, &other.scene) || self.scene == other.scene)
    }

    /// Returns its rank among the designs of its target: simulated ones come before others.
    #[must_use]
    pub fn rank(&self) -> (bool, DesignRank) {
        let (role, status) = (self.role, &self.status);
        match self.simulated_mm {
            Some(value) => (true, DesignRank::simulated(role, status, self.distance_mm, value)),
            None => {
                let value = self.predicted_mm.unwrap_or(f64::NEG_INFINITY);
                (false, DesignRank::predicted(role, status, value))
            }
        }
    }

    /// Returns its place among the designs of its target; `None` of patterns for comparison, and without a simulation.
    pub(crate) fn place(&self) -> Option<Place> {
        let values = (self.simulated_mm?, self.distance_mm);
        Place::of((self.role, &self.status), values, self.error_mm)
    }

    /// Returns the simulated or else predicted membrane, in one of several states or in the only one; `None` without a
    /// finite field.
    #[must_use]
    pub fn membrane(&self, state: Option<&StateField>) -> Option<DeformedMembrane> {
        let field = match state {
            Some(state) => &state.field,
            None => self.simulated.as_ref().or(self.predicted.as_ref())?,
        };
        let membrane = self.deformed(field, state)?;
        Some(membrane.with_heights(self.heights.as_deref().filter(|_| state.is_none())))
    }

    /// Returns the membrane with another displacement in mm from the mount; `None` if that does not fit.
    #[must_use]
    pub fn with(&self, displacement: &Field) -> Option<DeformedMembrane> {
        self.deformed(displacement.values(), None)
    }

    fn deformed(&self, field: &[f64], state: Option<&StateField>) -> Option<DeformedMembrane> {
        let is_in = |target: &&TargetPoint| {
            target.has_point() && state.is_none_or(|state| target.state.as_ref() == Some(&state.name))
        };
        let points = self
            .objective
            .points()
            .iter()
            .filter(is_in)
            .map(|target| target.point)
            .collect();
        DeformedMembrane::new(self.pattern.cells(), field, self.background.clone(), points).ok()
    }

    /// Returns the objectives of its front after the first; none if it is no point of one.
    #[must_use]
    pub fn other_objectives(&self) -> &[OtherObjective] {
        self.front.as_ref().map_or(&[], |place| &place.others)
    }

    /// Returns the columns and rows that the search could switch: those of units, or of the cells.
    #[must_use]
    pub fn unit_sides(&self) -> [usize; 2] {
        self.pattern.raster().unit_sides(self.units)
    }

    /// Describes them: `20 × 20 units`, `10 × 10 cells`.
    #[must_use]
    pub fn units_text(&self) -> String {
        let [columns, rows] = self.unit_sides();
        let what = match [columns, rows] == self.pattern.raster().sides() {
            true => "cells",
            false => "units",
        };
        format!("{columns} × {rows} {what}")
    }

    /// Says how many of its electrodes are smaller than a unit of the genetic algorithm; `None` if none is.
    #[must_use]
    pub fn small_islands(&self) -> Option<String> {
        small_islands(&self.pattern)
    }

    /// Returns the electrode area on the prestretched membrane in mm².
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        self.area * self.scene.free_area_mm2()
    }

    /// Returns the membrane in all states, or in the only one.
    #[must_use]
    pub fn membranes(&self) -> Vec<DeformedMembrane> {
        match &self.states[..] {
            [] => self.membrane(None).into_iter().collect(),
            states => states.iter().filter_map(|state| self.membrane(Some(state))).collect(),
        }
    }

    /// Returns the difference between predicted and simulated as a fraction of the simulated one; `None` if that is
    /// less than a micrometre.
    #[must_use]
    pub fn prediction_error(&self) -> Option<f64> {
        let simulated = self.simulated_mm.filter(|mm| mm.abs() > LEAST_MM)?;
        Some((self.predicted_mm? - simulated) / simulated.abs())
    }

    /// Writes the gains over the intuitive design at its own area and at the area of this one, with their sign.
    #[must_use]
    pub fn gain_texts(&self) -> [Option<String>; 2] {
        self.compared.gains().map(|gain| Some(gain?.text(&self.objective)))
    }

    /// Says how much more it reaches than the intuitive designs, with their areas.
    #[must_use]
    pub fn over_intuitive(&self) -> Vec<String> {
        self.compared.over_intuitive(self.area, &self.objective)
    }

    /// Says how near it comes to the optimum; `None` of the optimum, or if they are not compared.
    #[must_use]
    pub fn to_optimum(&self) -> Option<String> {
        let text = self.compared.to_optimum(&self.objective);
        text.filter(|_| self.role != Role::Optimum)
    }

    /// Sets the value of a robust objective that the search has predicted; it is ignored if the objective is not
    /// robust, or there is no prediction.
    pub(super) fn set_robust(&mut self, value: Option<f64>) {
        let is_known = self.objective.robust.is_some() && self.predicted_mm.is_some();
        self.robust_mm = value.filter(|_| is_known);
    }

    /// Writes a value; one in another unit than mm with its unit, an arc length with its angle.
    #[must_use]
    pub fn number(&self, value: f64) -> String {
        self.number_measured(value, None)
    }

    /// Writes the same rounded by the estimated error, which follows if it is known.
    #[must_use]
    pub fn number_measured(&self, value: f64, error: Option<f64>) -> String {
        let objective = &self.objective;
        match objective.shown_unit() {
            "mm" => objective.number_measured(value, error) + &objective.converted(value),
            _ => objective.text_measured(value, error),
        }
    }

    /// Returns the file of its mask, relative to the folder of the table; `None` for patterns that were not searched.
    #[must_use]
    pub fn mask_file(&self) -> Option<String> {
        self.role.is_found().then(|| format!("masks/{}.dxf", self.name))
    }

    /// Returns the file of its pattern, relative to the folder of the table.
    #[must_use]
    pub fn pattern_file(&self) -> String {
        format!("patterns/{}.csv", self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::super::compare::tests::design;
    use deaflow_pattern::{Pattern, Raster, Role};

    #[test]
    fn the_cells_that_a_search_could_switch_are_counted() {
        for (units, [columns, rows], expected) in [
            (20, [50, 50], "20 × 20 units"),
            (50, [50, 50], "50 × 50 cells"),
            (20, [10, 10], "10 × 10 cells"),
            (20, [60, 8], "20 × 8 units"),
            (50, [60, 8], "60 × 8 cells"),
        ] {
            let raster = Raster::new(columns, rows).unwrap();
            let mut design = design(Role::Ga, units, None);
            design.pattern = Pattern::from_fn(raster, |_, _| true);
            assert_eq!(design.units_text(), expected);
        }
    }
}
