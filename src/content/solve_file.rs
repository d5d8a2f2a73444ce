//! The file that `deaflow solve` and `deaflow predict` write. It is no artifact and may hold NaN.

use super::attribute::Lines;
use super::element::{Packed, PerCell};
use super::intervals::PredictionIntervals;
use super::macros::arrays;
use super::observations::{Meshes, Observations};
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::Effects;
use deaflow_store::{Data, Dataset, Object};

arrays! {
    /// Patterns with their displacements, one row for each whether it has a field or not. Where the scene has `states`, these are an axis `state` after
    /// `sample` of all arrays but `patterns`, and `states` has their names.
    #[derive(Default)]
    pub struct SolveFile, SolveFileView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// Displacement at the cell corners; NaN where the outcome is none of `converged`, `estimated` and `predicted`.
        displacement: Packed<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// How the simulation ended: `converged`, `pull-in`, `not-elliptic`, `slack`, `iteration-limit` or `work-limit`; of estimates `estimated` or
        /// `no-estimate`; `predicted` where nothing was simulated, so that nothing is known of stability.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Largest displacement magnitude over the corners; NaN where there is none.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [sample]),
        /// Where a point was asked about, how far it moves along the direction that was asked for, or in all without one; NaN where there is no
        /// displacement.
        at_point: Option<Vec<f64>> = array("at_point", "mm", [sample]),
        /// Relative residual of the non-linear equilibrium.
        residual: Option<Vec<f64>> = array("residual", "1", [sample]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// What effects say.
        observations: Observations = group(""),
        /// Where an accuracy was asked for, the meshes that reach it.
        meshes: Option<Meshes> = group(""),
        /// Where they were asked for, the states of the cells.
        cells: Option<CellFields> = group("cells"),
        /// Of predictions, where the model has a calibration, how far they may be off.
        intervals: Option<PredictionIntervals> = group("interval"),
        /// The scene; of a prediction the one that the model was trained in.
        scene: String = attribute("scene"),
        /// How it was solved, in the keys of a solve stage.
        solver: Option<String> = attribute("solver"),
        /// The effects that were simulated.
        effects: Option<Effects> = attribute("effects"),
        /// Effects that matter and were left out, one to a line.
        warnings: Option<Lines> = attribute("warnings"),
        /// The point that was asked about, from the lower left corner, and its direction.
        point: Option<String> = attribute("point"),
        /// The network that predicted.
        network: Option<String> = attribute("network"),
        /// Probability that the intervals cover, for patterns like those of the calibration.
        coverage: Option<String> = attribute("coverage"),
        /// The artifact of the calibration.
        calibration: Option<String> = attribute("calibration"),
        /// The families that the calibration was made from.
        basis: Option<String> = attribute("calibrated_on"),
    }
}

impl SolveFile {
    /// The same as an object, where each pattern stands there as often as there are states, one after the other: the states get an axis of their
    /// own, and each pattern stands there once. Without states it is the object.
    #[must_use]
    pub fn in_states(self, states: &[String]) -> Object {
        if states.is_empty() {
            return self.object();
        }
        let once = Self {
            patterns: self.patterns.iter().step_by(states.len()).cloned().collect(),
            ..Self::default()
        };
        let mut object = self.object();
        for (path, dataset) in &mut object.datasets {
            if path != "patterns" && dataset.axes.first().is_some_and(|axis| axis == "sample") {
                dataset.axes.insert(1, "state".to_owned());
                dataset.shape[0] /= states.len();
                dataset.shape.insert(1, states.len());
            }
        }
        let names = Dataset::new(
            "",
            "The states of the scene.",
            &[states.len()],
            Data::Text(states.to_vec()),
        );
        object.datasets.extend(once.object().datasets.remove_entry("patterns"));
        object.datasets.insert(
            "states".to_owned(),
            Dataset {
                axes: vec!["state".to_owned()],
                ..names
            },
        );
        object
    }
}

arrays! {
    /// Means over each cell; NaN where there is no stable solution.
    #[derive(Default)]
    pub struct CellFields, CellFieldsView {
        /// In-plane principal stretches from the undeformed state, larger first, mean over each cell; NaN where there is no stable solution.
        stretches: Packed<PerCell<[f64; 2]>> = array("stretches", "1", [sample, y, x, principal]),
        /// True electric field, mean over each cell; NaN where there is no stable solution.
        electric_field: Packed<PerCell<f64>> = array("electric_field", "V/m", [sample, y, x]),
        /// First Piola-Kirchhoff stress, mean over each cell; NaN where there is no stable solution.
        first_piola_stress: Packed<PerCell<[[f64; 2]; 2]>> =
            array("first_piola_stress", "Pa", [sample, y, x, stress_direction, material_direction]),
        /// In-plane principal Cauchy stresses, larger first, mean over each cell; NaN where there is no stable solution.
        principal_stresses: Packed<PerCell<[f64; 2]>> = array("principal_stresses", "Pa", [sample, y, x, principal]),
        /// 0 taut, 1 wrinkled (tension in one direction only), 2 slack, 255 no stable solution.
        state: Packed<PerCell<u8>> = array("state", "1", [sample, y, x]),
    }
}
