//! The artifact of a solve or an import stage.
//!
//! Samples with a field are at the root, the others under `unstable/` with the reason, so that no row has invalid
//! numbers.

use std::ops::Range;

use super::element::{Packed, PerBody};
use super::macros::arrays;
use super::observations::{Meshes, Observations};
use super::samples::SampleRows;
use deaflow_field::{Field, MESH_OVERESTIMATE, OutcomeKind};
use deaflow_scene::{Effects, Scene};
use deaflow_store::StoreError;

/// The kinds of stages with this artifact.
pub const SOLVED: [&str; 2] = ["solve", "import"];

arrays! {
    /// Simulated or imported samples.
    pub struct Solutions, SolutionsView {
        /// The patterns with a field.
        rows: SampleRows = group(""),
        /// How the simulation ended; `converged` for imported samples.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Displacement at the cell corners.
        displacement: Vec<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// Largest displacement magnitude over the corners.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [sample]),
        /// Newton steps over all load steps, or steps of an estimate.
        newton_iterations: Option<Vec<u32>> = array("newton_iterations", "1", [sample]),
        /// Relative residual of the equilibrium.
        residual: Option<Vec<f64>> = array("residual", "1", [sample]),
        /// Results of effects.
        observations: Observations = group(""),
        /// If an accuracy was requested, the meshes that reach it.
        meshes: Option<Meshes> = group(""),
        /// If times were requested, the motion in time; `displacement` is that at the last time.
        history: Option<SolvedHistories> = group("history"),
        /// The patterns without a field.
        unstable: Unstable = group("unstable", [
            (sample, unstable_sample),
            (polygon, unstable_polygon),
            (vertex, unstable_vertex)
        ]),
        /// The scene of the pipeline.
        scene: Scene = attribute("scene"),
        /// The solver in the keys of a solve stage; missing for imported samples.
        solver: Option<String> = attribute("solver"),
        /// The simulated effects; missing for imported samples.
        effects: Option<Effects> = attribute("effects"),
    }
}

impl SolutionsView<'_> {
    /// Reads the concatenated values of some displacements in mm, of an artifact that is not a manifest, from the state
    /// without voltage if not all sides are held.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn from_rest(&self, samples: Range<usize>) -> Result<Vec<f64>, StoreError> {
        let mut values = self.displacement().numbers(samples.clone())?;
        let rest = self.observations().rest();
        if rest.is_there()? {
            let at_rest = rest.numbers(samples)?;
            values.iter_mut().zip(at_rest).for_each(|(value, rest)| *value -= rest);
        }
        Ok(values)
    }

    /// Returns for each sample whether a finer mesh could reject its solution: the critical voltage on the mesh of the
    /// solution is above that of the scene by less than it may be too high. Without critical voltages no sample is.
    ///
    /// # Errors
    /// If the artifact cannot be read.
    pub fn near_limit(&self) -> Result<Vec<bool>, StoreError> {
        let outcomes = self.outcome().read()?;
        let critical = self.observations().critical_voltage().read()?;
        let voltage = self.scene().read()?.voltage_v();
        let is_near = |(outcome, [stable, lost]): (&OutcomeKind, [f64; 2])| {
            // Both are 0 if stability is not lost.
            *outcome == OutcomeKind::Converged && lost > 0.0 && (1.0 - MESH_OVERESTIMATE) * stable <= voltage
        };
        let critical = critical.unwrap_or_else(|| vec![[0.0; 2]; outcomes.len()]);
        Ok(outcomes.iter().zip(critical).map(is_near).collect())
    }
}

arrays! {
    /// Samples without a field.
    #[derive(Default)]
    pub struct Unstable, UnstableView {
        /// The patterns.
        rows: SampleRows = group(""),
        /// How the simulation ended.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Highest voltage with a stable equilibrium and lowest without; 0, 0 if the outcome is `iteration-limit`,
        /// `work-limit` or `no-estimate`.
        voltage_bracket: Vec<[f64; 2]> = array("voltage_bracket", "V", [sample, bound]),
        /// If times were requested, the last time with a stable state and the first without; 0, 0 if stability is not
        /// lost in time.
        time_bracket: Option<Vec<[f64; 2]>> = array("time_bracket", "s", [sample, bound]),
    }
}

arrays! {
    /// Samples at several times.
    pub struct SolvedHistories, SolvedHistoriesView {
        /// Time since the start of the drive; 0 is just after the start.
        time: Packed<f64> = array("time", "s", [sample, time]),
        /// Displacement at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, time, corner_y, corner_x, xy]),
        /// Charge on all electrodes.
        charge: Packed<f64> = array("charge", "C", [sample, time]),
        /// Displacement of the centroid of each rigid body.
        body_translation: Option<Packed<PerBody<[f64; 2]>>> = array("body_translation", "mm", [sample, time, body, xy]),
        /// Rotation of each rigid body, from -180 to 180, counterclockwise.
        body_rotation: Option<Packed<PerBody<f64>>> = array("body_rotation", "deg", [sample, time, body]),
        /// Displacement of the middle of each bar, in the order left, right, bottom, top.
        bar_translation: Option<Packed<PerBody<[f64; 2]>>> = array("bar_translation", "mm", [sample, time, bar, xy]),
        /// Rotation of each bar, from -180 to 180, counterclockwise.
        bar_rotation: Option<Packed<PerBody<f64>>> = array("bar_rotation", "deg", [sample, time, bar]),
        /// Estimated largest error of the displacement due to time steps.
        error_in_time: Vec<f64> = array("error_in_time", "mm", [sample]),
    }
}
