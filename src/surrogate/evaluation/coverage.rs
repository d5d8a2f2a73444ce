//! Coverage: whether the intervals of a calibration contain the simulated fields.

use crate::{Calibration, ObjectiveIntervals};
use deaflow_field::Field;
use deaflow_pattern::Pattern;

/// Objectives whose intervals are tested: name, point in parts of the sides, and direction of the displacement.
pub const OBJECTIVES: [(&str, [f64; 2], [f64; 2]); 4] = [
    ("centre, 0 deg", [0.5, 0.5], [1.0, 0.0]),
    ("right quarter point, 0 deg", [0.75, 0.5], [1.0, 0.0]),
    ("left quarter point, 0 deg", [0.25, 0.5], [1.0, 0.0]),
    (
        "upper right quarter point, 45 deg",
        [0.75, 0.75],
        [std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2],
    ),
];

/// Returns the value of an objective in mm.
fn value(objective: usize, field: &Field) -> f64 {
    let (_, point, direction) = OBJECTIVES[objective];
    let sides = field.raster().sides();
    let [x, y] = field.at([0, 1].map(|axis| point[axis] * sides[axis] as f64));
    x * direction[0] + y * direction[1]
}

/// Returns the intervals of the objectives.
pub(super) fn intervals(calibration: &Calibration) -> Vec<ObjectiveIntervals<'_>> {
    let objective = |k| calibration.objective(&|field| value(k, field));
    (0..OBJECTIVES.len()).map(objective).collect()
}

/// Whether a simulated field lies within the intervals of its prediction.
#[derive(Clone, Copy, Debug)]
pub struct Coverage {
    /// Half-width of the band of the field, mm.
    pub radius_mm: f64,
    /// Whether the simulated field lies in the band.
    pub field: bool,
    /// Whether each simulated objective lies in its interval.
    pub objectives: [bool; OBJECTIVES.len()],
    /// Half-widths of these intervals, mm.
    pub half_widths_mm: [f64; OBJECTIVES.len()],
    /// Whether the pattern was flagged as out of distribution.
    pub out_of_distribution: bool,
}

impl Coverage {
    /// Compares a prediction and its intervals with a simulation.
    pub(super) fn of(
        calibration: &Calibration,
        intervals: &[ObjectiveIntervals<'_>],
        pattern: &Pattern,
        predicted: &Field,
        simulated: &Field,
    ) -> Self {
        let interval = calibration.interval(pattern, predicted);
        let mut pairs = predicted.values().iter().zip(simulated.values());
        let half_widths_mm = std::array::from_fn(|k| intervals[k].half_width(pattern, predicted));
        Self {
            radius_mm: interval.radius_mm,
            field: pairs.all(|(p, s)| (p - s).abs() <= interval.radius_mm),
            objectives: std::array::from_fn(|k| (value(k, predicted) - value(k, simulated)).abs() <= half_widths_mm[k]),
            half_widths_mm,
            out_of_distribution: interval.out_of_distribution,
        }
    }
}
