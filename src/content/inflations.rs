//! The file of `deaflow solve` in space: with a pressure or a volume, or bodies that move out of the plane. It is not
//! an artifact and may contain NaN.

use super::element::{Packed, PerBody, PerCorner};
use super::macros::arrays;
use super::samples::{CoveredCells, DrawnElectrodes};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// Equilibria of patterns in space; NaN for a pattern without a stable one.
    pub struct Inflations, InflationsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes"),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered"),
        /// How the search for the equilibrium ended.
        outcome: Vec<String> = array("outcome", "", [sample]),
        /// Displacement at the cell corners, along x, y and out of the plane.
        displacement: Packed<PerCorner<[f64; 3]>> = array("displacement", "mm", [sample, corner_y, corner_x, xyz]),
        /// Pressure below the membrane less that above.
        pressure: Vec<f64> = array("pressure", "Pa", [sample]),
        /// Volume between the membrane and its plane.
        volume: Vec<f64> = array("volume", "ml", [sample]),
        /// Displacement of the centroid of each rigid body, along x, y and out of the plane.
        body_translation: Option<Packed<PerBody<[f64; 3]>>> = array("body_translation", "mm", [sample, body, xyz]),
        /// Rotation of each rigid body in the plane, from -180 to 180, counterclockwise.
        body_rotation: Option<Packed<PerBody<f64>>> = array("body_rotation", "deg", [sample, body]),
        /// The largest share of the loads of the scene with a stable equilibrium; 1 where it converged.
        last_stable: Vec<f64> = array("last_stable", "1", [sample]),
        /// The smallest share at which none was found; NaN where it converged.
        first_unstable: Vec<f64> = array("first_unstable", "1", [sample]),
        /// Share of the membrane that is compressed and would wrinkle.
        wrinkled_fraction: Vec<f64> = array("wrinkled_fraction", "1", [sample]),
        /// Largest electric field relative to the breakdown field, by Huang's law if the scene has none.
        breakdown_ratio: Vec<f64> = array("breakdown_ratio", "1", [sample]),
        /// Newton steps.
        newton_iterations: Vec<u32> = array("newton_iterations", "1", [sample]),
        /// Conjugate-gradient iterations.
        krylov_iterations: Vec<u32> = array("krylov_iterations", "1", [sample]),
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
