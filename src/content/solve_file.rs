//! The file that `deaflow solve` and `deaflow predict` write. It is not an artifact and may contain NaN.

use super::attribute::Lines;
use super::element::{Packed, PerCell};
use super::intervals::PredictionIntervals;
use super::macros::arrays;
use super::observations::{Meshes, Observations};
use super::samples::{CoveredCells, DrawnElectrodes};
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::Effects;
use deaflow_store::{Data, Dataset, Object};

arrays! {
    /// Patterns with their displacements, a row for each even without a field. If the scene has `states`, all arrays
    /// except those of the patterns have an axis `state` after `sample`, and `states` has the names.
    #[derive(Default)]
    pub struct SolveFile, SolveFileView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes"),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered"),
        /// Displacement at the cell corners; NaN unless the outcome is `converged`, `estimated` or `predicted`.
        displacement: Packed<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// How the simulation ended: `converged`, `pull-in`, `not-elliptic`, `slack`, `iteration-limit` or
        /// `work-limit`; for estimates `estimated` or `no-estimate`; `predicted` for predictions, whose stability is
        /// unknown.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Largest displacement magnitude over the corners; NaN without a displacement.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [sample]),
        /// Displacement of the requested point along the requested direction, or its magnitude without a direction; NaN
        /// without a displacement.
        at_point: Option<Vec<f64>> = array("at_point", "mm", [sample]),
        /// Relative residual of the non-linear equilibrium.
        residual: Option<Vec<f64>> = array("residual", "1", [sample]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// Results of effects.
        observations: Observations = group(""),
        /// If an accuracy was requested, the meshes that reach it.
        meshes: Option<Meshes> = group(""),
        /// The states of the cells, if requested.
        cells: Option<CellFields> = group("cells"),
        /// Prediction intervals, if the model has a calibration.
        intervals: Option<PredictionIntervals> = group("interval"),
        /// The scene; for a prediction that of the training.
        scene: String = attribute("scene"),
        /// The solver in the keys of a solve stage.
        solver: Option<String> = attribute("solver"),
        /// The simulated effects.
        effects: Option<Effects> = attribute("effects"),
        /// Significant effects that were neglected, one per line.
        warnings: Option<Lines> = attribute("warnings"),
        /// The requested point, from the lower left corner, and its direction.
        point: Option<String> = attribute("point"),
        /// The network of a prediction.
        network: Option<String> = attribute("network"),
        /// Coverage probability of the intervals, for patterns like those of the calibration.
        coverage: Option<String> = attribute("coverage"),
        /// The artifact of the calibration.
        calibration: Option<String> = attribute("calibration"),
        /// The families of the calibration patterns.
        basis: Option<String> = attribute("calibrated_on"),
    }
}

impl SolveFile {
    /// Converts it to an object. With states, in which each pattern is repeated once per state, the states get an axis
    /// of their own and each pattern is stored once.
    #[must_use]
    pub fn in_states(self, states: &[String]) -> Object {
        if states.is_empty() {
            return self.object();
        }
        let patterns: Vec<Pattern> = self.patterns.iter().step_by(states.len()).cloned().collect();
        let once = Self {
            electrodes: DrawnElectrodes::of(&patterns),
            covered: CoveredCells::of(&patterns),
            patterns,
            ..Self::default()
        };
        let groups = ["electrodes/", "covered/"];
        let is_of_patterns = |path: &str| path == "patterns" || groups.iter().any(|group| path.starts_with(group));
        let mut object = self.object();
        for (path, dataset) in &mut object.datasets {
            if !is_of_patterns(path) && dataset.axes.first().is_some_and(|axis| axis == "sample") {
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
        let once = once.object().datasets.into_iter();
        object.datasets.extend(once.filter(|(path, _)| is_of_patterns(path)));
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
    /// Means over each cell; NaN without a stable solution.
    #[derive(Default)]
    pub struct CellFields, CellFieldsView {
        /// In-plane principal stretches from the undeformed state, larger first, mean over each cell; NaN without a
        /// stable solution.
        stretches: Packed<PerCell<[f64; 2]>> = array("stretches", "1", [sample, y, x, principal]),
        /// True electric field, mean over each cell; NaN without a stable solution.
        electric_field: Packed<PerCell<f64>> = array("electric_field", "V/m", [sample, y, x]),
        /// First Piola-Kirchhoff stress, mean over each cell; NaN without a stable solution.
        first_piola_stress: Packed<PerCell<[[f64; 2]; 2]>> =
            array("first_piola_stress", "Pa", [sample, y, x, stress_direction, material_direction]),
        /// In-plane principal Cauchy stresses, larger first, mean over each cell; NaN without a stable solution.
        principal_stresses: Packed<PerCell<[f64; 2]>> = array("principal_stresses", "Pa", [sample, y, x, principal]),
        /// 0 taut, 1 wrinkled (tension in one direction only), 2 slack, 255 no stable solution.
        state: Packed<PerCell<u8>> = array("state", "1", [sample, y, x]),
    }
}
