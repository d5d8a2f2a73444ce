//! The file of `deaflow solve --history`. It is not an artifact and may contain NaN.

use super::attribute::Lines;
use super::element::{Packed, PerBody};
use super::macros::arrays;
use super::samples::DrawnElectrodes;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// The motion of patterns in time. Values after a pattern loses its last stable state are NaN.
    pub struct Histories, HistoriesView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes"),
        /// Time since the start of the drive; 0 is just after the start.
        time: Vec<f64> = array("time", "s", [time]),
        /// Voltage of the drive.
        voltage: Vec<f64> = array("voltage", "V", [time]),
        /// If the drive has a source, the voltage of the electrodes behind it.
        electrode_voltage: Option<Packed<f64>> = array("electrode_voltage", "V", [sample, time]),
        /// Displacement at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, time, corner_y, corner_x, xy]),
        /// Largest displacement magnitude over the corners; from `rest` if there is one.
        max_displacement: Packed<f64> = array("max_displacement", "mm", [sample, time]),
        /// Displacement of the requested point along the requested direction, or its magnitude without a direction;
        /// from `rest` if there is one.
        at_point: Option<Packed<f64>> = array("at_point", "mm", [sample, time]),
        /// Charge on all electrodes.
        charge: Packed<f64> = array("charge", "C", [sample, time]),
        /// Current into the electrodes.
        current: Packed<f64> = array("current", "A", [sample, time]),
        /// Elastic energy minus that before the drive.
        stored: Packed<f64> = array("stored", "J", [sample, time]),
        /// Energy of the electric field.
        electric: Packed<f64> = array("electric", "J", [sample, time]),
        /// Kinetic energy.
        kinetic: Packed<f64> = array("kinetic", "J", [sample, time]),
        /// Energy dissipated by viscosity and by the resistance of the source.
        dissipated: Packed<f64> = array("dissipated", "J", [sample, time]),
        /// Energy that the source has supplied.
        supplied: Packed<f64> = array("supplied", "J", [sample, time]),
        /// Displacement of the centroid of each rigid body.
        body_translation: Option<Packed<PerBody<[f64; 2]>>> = array("body_translation", "mm", [sample, time, body, xy]),
        /// Rotation of each rigid body, from -180 to 180, counterclockwise.
        body_rotation: Option<Packed<PerBody<f64>>> = array("body_rotation", "deg", [sample, time, body]),
        /// Displacement of the middle of each bar, in the order left, right, bottom, top.
        bar_translation: Option<Packed<PerBody<[f64; 2]>>> = array("bar_translation", "mm", [sample, time, bar, xy]),
        /// Rotation of each bar, from -180 to 180, counterclockwise.
        bar_rotation: Option<Packed<PerBody<f64>>> = array("bar_rotation", "deg", [sample, time, bar]),
        /// If a side is not held, the displacement at the cell corners before the drive, at 0 V with all loads; NaN if
        /// there is no stable state.
        rest: Option<Packed<Field>> = array("rest", "mm", [sample, corner_y, corner_x, xy]),
        /// How the simulation ended: `converged`; `pull-in`, `not-elliptic` or `slack` at the start; `delayed-pull-in`
        /// or `delayed-slack` later; `iteration-limit` or `work-limit`.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// The last time with a stable state and the first without; 0, 0 if stability is not lost in time.
        time_bracket: Vec<[f64; 2]> = array("time_bracket", "s", [sample, bound]),
        /// If the membrane is unstable at the start of the drive, the highest voltage with a stable state at the start
        /// and the lowest without; 0, 0 otherwise.
        voltage_bracket: Vec<[f64; 2]> = array("voltage_bracket", "V", [sample, bound]),
        /// Column and row of the corner that moves most at the end.
        watched_corner: Vec<[u64; 2]> = array("watched_corner", "1", [sample, xy]),
        /// Estimated largest error of the displacement due to time steps.
        error_in_time: Vec<f64> = array("error_in_time", "mm", [sample]),
        /// If an accuracy was requested, the estimated largest error of the displacement due to the mesh; NaN if
        /// unknown.
        error_in_space: Option<Vec<f64>> = array("error_in_space", "mm", [sample]),
        /// If an accuracy was requested, elements along one side of a cell.
        elements_per_cell: Option<Vec<u64>> = array("elements_per_cell", "1", [sample]),
        /// If an accuracy was requested, polynomial order of the elements.
        order: Option<Vec<u64>> = array("order", "1", [sample]),
        /// Number of time steps.
        steps: Vec<u64> = array("steps", "1", [sample]),
        /// Relative residual of the last equilibrium.
        residual: Vec<f64> = array("residual", "1", [sample]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// The requested point, from the lower left corner, and its direction.
        point: Option<String> = attribute("point"),
        /// The solver.
        solver: String = attribute("solver"),
        /// The simulated effects.
        effects: Effects = attribute("effects"),
        /// Significant effects that were neglected, one per line.
        warnings: Lines = attribute("warnings"),
    }
}
