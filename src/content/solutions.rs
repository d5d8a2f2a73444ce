//! The artifact of a solve or an import stage.
//!
//! Samples with a field stand at the root, the others under `unstable/` with the reason: no row holds numbers that only look
//! valid.

use super::element::{Packed, PerBody};
use super::macros::arrays;
use super::observations::{Meshes, Observations};
use super::samples::SampleRows;
use deaflow_field::{Field, OutcomeKind};
use deaflow_scene::{Effects, Scene};

/// The kinds of stages whose artifacts these are.
pub const SOLVED: [&str; 2] = ["solve", "import"];

arrays! {
    /// Simulated samples, or such as were imported.
    pub struct Solutions, SolutionsView {
        /// The patterns that have a field.
        rows: SampleRows = group(""),
        /// How the simulation ended; `converged` of what was imported.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Displacement at the cell corners.
        displacement: Vec<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// Largest displacement magnitude over the corners.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [sample]),
        /// Newton steps over all load steps, or steps of an estimate.
        newton_iterations: Option<Vec<u32>> = array("newton_iterations", "1", [sample]),
        /// Relative residual of the equilibrium.
        residual: Option<Vec<f64>> = array("residual", "1", [sample]),
        /// What effects say.
        observations: Observations = group(""),
        /// Where an accuracy was asked for, the meshes that reach it.
        meshes: Option<Meshes> = group(""),
        /// Where times were asked for, how the patterns move in time; `displacement` is that at the last of them.
        history: Option<SolvedHistories> = group("history"),
        /// The patterns that have no field.
        unstable: Unstable = group("unstable", [(sample, unstable_sample)]),
        /// The scene as the pipeline states it.
        scene: Scene = attribute("scene"),
        /// How it was solved, in the keys of a solve stage; not known of what was imported.
        solver: Option<String> = attribute("solver"),
        /// The effects that were simulated; not known of what was imported.
        effects: Option<Effects> = attribute("effects"),
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
        /// Highest voltage with a stable equilibrium and lowest without; 0, 0 where the outcome is `iteration-limit`, `work-limit` or `no-estimate`.
        voltage_bracket: Vec<[f64; 2]> = array("voltage_bracket", "V", [sample, bound]),
        /// Where times were asked for, the last time with a stable state and the first without; 0, 0 where it is not lost in time.
        time_bracket: Option<Vec<[f64; 2]>> = array("time_bracket", "s", [sample, bound]),
    }
}

arrays! {
    /// Samples at several times.
    pub struct SolvedHistories, SolvedHistoriesView {
        /// Time since the drive began; 0 is just after that.
        time: Packed<f64> = array("time", "s", [sample, time]),
        /// Displacement at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, time, corner_y, corner_x, xy]),
        /// Charge on all electrodes.
        charge: Packed<f64> = array("charge", "C", [sample, time]),
        /// How far the centroid of each rigid body has moved.
        body_translation: Option<Packed<PerBody<[f64; 2]>>> = array("body_translation", "mm", [sample, time, body, xy]),
        /// How far each rigid body has turned, from -180 to 180, counter-clockwise.
        body_rotation: Option<Packed<PerBody<f64>>> = array("body_rotation", "deg", [sample, time, body]),
        /// Estimate of the largest error that steps in time leave in the displacement.
        error_in_time: Vec<f64> = array("error_in_time", "mm", [sample]),
    }
}
