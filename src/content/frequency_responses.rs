//! The file of `deaflow solve --response`. It is not an artifact and may contain NaN.

use super::attribute::Lines;
use super::element::Packed;
use super::macros::arrays;
use super::samples::DrawnElectrodes;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// Responses of patterns to a small alternating voltage about their equilibria; NaN for a pattern without a stable
    /// equilibrium and for a frequency without a response.
    pub struct FrequencyResponses, FrequencyResponsesView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes"),
        /// How the search for the equilibrium ended.
        outcome: Vec<OutcomeKind> = array("outcome", "", [sample]),
        /// Voltage of the equilibrium, about which the voltage alternates.
        bias: Vec<f64> = array("bias", "V", [sample]),
        /// Displacement of the equilibrium at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [sample, corner_y, corner_x, xy]),
        /// Its derivative with respect to the voltage: the response at 0 Hz.
        slope: Packed<Field> = array("slope", "mm/V", [sample, corner_y, corner_x, xy]),
        /// Frequency of the voltage.
        frequency: Vec<f64> = array("frequency", "Hz", [frequency]),
        /// Displacement at the cell corners per volt of amplitude, in phase with the voltage: the voltage V cos ωt
        /// gives the displacement V (response_real cos ωt − response_imaginary sin ωt).
        response_real: Packed<Field> = array("response_real", "mm/V", [sample, frequency, corner_y, corner_x, xy]),
        /// The same, a quarter of a period ahead of the voltage.
        response_imaginary: Packed<Field> =
            array("response_imaginary", "mm/V", [sample, frequency, corner_y, corner_x, xy]),
        /// Amplitude of the watched corner along the axis of its largest motion at the lowest frequency.
        amplitude: Packed<f64> = array("amplitude", "mm/V", [sample, frequency]),
        /// Its phase relative to the voltage, from -180 to below 180, positive ahead, in the direction of its static
        /// displacement.
        phase: Packed<f64> = array("phase", "deg", [sample, frequency]),
        /// Column and row of the corner that moves most at the lowest frequency.
        watched_corner: Vec<[u64; 2]> = array("watched_corner", "1", [sample, xy]),
        /// The result at each frequency: `converged`, `resonance` at an undamped natural frequency, `not-solved`, or
        /// the outcome of a pattern without an equilibrium.
        frequency_outcome: Packed<String> = array("frequency_outcome", "", [sample, frequency]),
        /// Processor time of the sample, the mean over its batch.
        solve_seconds: Vec<f64> = array("solve_seconds", "s", [sample]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// The solver.
        solver: String = attribute("solver"),
        /// The simulated effects.
        effects: Effects = attribute("effects"),
        /// What the response neglects, one per line.
        warnings: Lines = attribute("warnings"),
    }
}
