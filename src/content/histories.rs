//! The file of `deaflow solve --history`. It is no artifact and may hold NaN.

use super::attribute::Lines;
use super::element::{Packed, PerBody};
use super::macros::arrays;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// How patterns move in time. What is asked for beyond the time at which a pattern loses its last stable state is NaN.
    pub struct Histories, HistoriesView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// Time since the drive began; 0 is just after that.
        time: Vec<f64> = array("time", "s", [time]),
        /// Voltage of the drive.
        voltage: Vec<f64> = array("voltage", "V", [time]),
        /// Where the drive has a source, the voltage of the electrodes behind it.
        electrode_voltage: Option<Packed<f64>> = array("electrode_voltage", "V", [sample, time]),
        /// Displacement at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, time, corner_y, corner_x, xy]),
        /// Largest displacement magnitude over the corners.
        max_displacement: Packed<f64> = array("max_displacement", "mm", [sample, time]),
        /// Charge on all electrodes.
        charge: Packed<f64> = array("charge", "C", [sample, time]),
        /// Current into the electrodes.
        current: Packed<f64> = array("current", "A", [sample, time]),
        /// Elastic energy beyond that before the drive.
        stored: Packed<f64> = array("stored", "J", [sample, time]),
        /// Energy of the electric field.
        electric: Packed<f64> = array("electric", "J", [sample, time]),
        /// Kinetic energy.
        kinetic: Packed<f64> = array("kinetic", "J", [sample, time]),
        /// Energy that viscosity and the resistance of the source have turned into heat.
        dissipated: Packed<f64> = array("dissipated", "J", [sample, time]),
        /// Energy that the source has supplied.
        supplied: Packed<f64> = array("supplied", "J", [sample, time]),
        /// How far the centroid of each rigid body has moved.
        body_translation: Option<Packed<PerBody<[f64; 2]>>> = array("body_translation", "mm", [sample, time, body, xy]),
        /// How far each rigid body has turned, from -180 to 180, counter-clockwise.
        body_rotation: Option<Packed<PerBody<f64>>> = array("body_rotation", "deg", [sample, time, body]),
        /// How the simulation ended: `converged`, `pull-in`, `not-elliptic` or `slack` at once, `delayed-pull-in` or `delayed-slack` later,
        /// `iteration-limit` or `work-limit`.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// The last time with a stable state and the first without; 0, 0 where that is not so.
        time_bracket: Vec<[f64; 2]> = array("time_bracket", "s", [sample, bound]),
        /// Where the drive begins with more than the membrane bears, the highest voltage that it bears at once and the lowest that it does not; 0, 0
        /// elsewhere.
        voltage_bracket: Vec<[f64; 2]> = array("voltage_bracket", "V", [sample, bound]),
        /// Column and row of the corner that moves most at the end.
        watched_corner: Vec<[u64; 2]> = array("watched_corner", "1", [sample, xy]),
        /// Estimate of the largest error that steps in time leave in the displacement.
        error_in_time: Vec<f64> = array("error_in_time", "mm", [sample]),
        /// Where an accuracy was asked for, estimate of the largest error that the mesh leaves in the displacement; NaN where there is none.
        error_in_space: Option<Vec<f64>> = array("error_in_space", "mm", [sample]),
        /// Where an accuracy was asked for, elements along one side of a cell.
        elements_per_cell: Option<Vec<u64>> = array("elements_per_cell", "1", [sample]),
        /// Where an accuracy was asked for, polynomial order of the elements.
        order: Option<Vec<u64>> = array("order", "1", [sample]),
        /// Steps in time.
        steps: Vec<u64> = array("steps", "1", [sample]),
        /// Relative residual of the last equilibrium.
        residual: Vec<f64> = array("residual", "1", [sample]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// How it was solved.
        solver: String = attribute("solver"),
        /// The effects that were simulated.
        effects: Effects = attribute("effects"),
        /// Effects that matter and were left out, one to a line.
        warnings: Lines = attribute("warnings"),
    }
}
