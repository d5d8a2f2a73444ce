//! The file of `deaflow solve --modes`. It is not an artifact and may contain NaN.

use super::element::{Packed, PerCorner};
use super::macros::arrays;
use super::samples::{CoveredCells, DrawnElectrodes};
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// Vibrations of patterns about their equilibria; NaN for a pattern without a stable equilibrium.
    pub struct Vibrations, VibrationsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes"),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered"),
        /// How the search for the equilibrium ended.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Displacement of the equilibrium at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// Number of the mode, from 1.
        mode: Vec<u64> = array("mode", "1", [mode]),
        /// Natural frequencies, lowest first.
        frequencies: Packed<f64> = array("frequencies", "Hz", [sample, mode]),
        /// Modes at the cell corners, scaled so that the largest displacement is 1.
        modes: Packed<Field> = array("modes", "1", [sample, mode, corner_y, corner_x, xy]),
        /// Natural frequencies out of the plane, lowest first; 0 for motions in which the flat state is unstable.
        out_of_plane_frequencies: Packed<f64> = array("out_of_plane_frequencies", "Hz", [sample, mode]),
        /// Their displacements out of the plane at the cell corners, scaled so that the largest is 1.
        out_of_plane_modes: Packed<PerCorner<f64>> =
            array("out_of_plane_modes", "1", [sample, mode, corner_y, corner_x]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// The solver.
        solver: String = attribute("solver"),
        /// The simulated effects.
        effects: Effects = attribute("effects"),
    }
}
