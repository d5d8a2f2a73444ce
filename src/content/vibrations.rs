//! The file of `deaflow solve --modes`. It is no artifact and may hold NaN.

use super::element::Packed;
use super::macros::arrays;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// How patterns vibrate about their equilibria. A pattern without a stable equilibrium has NaN.
    pub struct Vibrations, VibrationsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// How the search for the equilibrium ended.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Displacement of the equilibrium at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// Number of the mode, from 1.
        mode: Vec<u64> = array("mode", "1", [mode]),
        /// Natural frequencies, lowest first.
        frequencies: Packed<f64> = array("frequencies", "Hz", [sample, mode]),
        /// Modes at the cell corners; the corner that moves most moves by 1.
        modes: Packed<Field> = array("modes", "1", [sample, mode, corner_y, corner_x, xy]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// How it was solved.
        solver: String = attribute("solver"),
        /// The effects that were simulated.
        effects: Effects = attribute("effects"),
    }
}
