//! Whether a measured field would agree better if it were turned or mirrored: a frequent mistake with pictures.

use super::device::{Device, Load};
use deaflow_pattern::Pattern;

/// Correlations that differ by less do not tell orientations apart.
const CLEAR: f64 = 0.2;
/// The least correlation of an orientation that is proposed.
const GOOD: f64 = 0.7;

/// Correlations that differ by less are alike.
const ALIKE: f64 = 0.01;

/// A rotation or reflection of the plane, `[row][column]`.
type Matrix = [[f64; 2]; 2];

/// What a user would change, and the orientation of the data.
const ORIENTATIONS: [(&str, Matrix); 7] = [
    ("mirrored upside down", [[1.0, 0.0], [0.0, -1.0]]),
    ("turned by 90°", [[0.0, -1.0], [1.0, 0.0]]),
    ("turned by 180°", [[-1.0, 0.0], [0.0, -1.0]]),
    ("turned by 270°", [[0.0, 1.0], [-1.0, 0.0]]),
    ("mirrored from left to right", [[-1.0, 0.0], [0.0, 1.0]]),
    ("with its axes exchanged", [[0.0, 1.0], [1.0, 0.0]]),
    ("with its axes exchanged and turned by 180°", [[0.0, -1.0], [-1.0, 0.0]]),
];

/// Returns what would make a field agree better with the simulation at the first values of the parameters, if anything
/// does clearly. Correlations do not depend on the modulus, nor on a translation of the camera.
pub fn better(
    device: &Device,
    pattern: &Pattern,
    load: &Load,
    measured_mm: &[[f64; 2]],
    size_mm: [f64; 2],
) -> Option<String> {
    let own = correlation(device, pattern, load, measured_mm, None)?;
    let is_square = size_mm[0] == size_mm[1];
    let allowed = ORIENTATIONS
        .iter()
        .filter(|(_, matrix)| is_square || matrix[0][1] == 0.0);
    let found = allowed.filter_map(|(name, matrix)| {
        let found = correlation(device, pattern, load, measured_mm, Some((*matrix, size_mm)))?;
        Some((found, *name))
    });
    let found: Vec<(f64, &str)> = found.collect();
    let largest = found.iter().map(|(found, _)| *found).reduce(f64::max)?;
    // Of several that agree alike, as with symmetric electrodes, the first.
    let (best, name) = found.into_iter().find(|(found, _)| *found >= largest - ALIKE)?;
    (best >= GOOD && best >= own + CLEAR).then(|| {
        format!(
            "{name} the field would agree better (correlation {best:.2} instead of {own:.2}): check `turn`, `y` and \
             the pattern"
        )
    })
}

/// Returns the correlation of the measured displacements, mapped with their points by a matrix about the middle of the
/// membrane, with the simulated ones there; `None` without a state, or if a point leaves the membrane.
fn correlation(
    device: &Device,
    pattern: &Pattern,
    load: &Load,
    measured_mm: &[[f64; 2]],
    map: Option<(Matrix, [f64; 2])>,
) -> Option<f64> {
    let (matrix, size) = map.unwrap_or(([[1.0, 0.0], [0.0, 1.0]], [0.0; 2]));
    let turned = |v: [f64; 2]| matrix.map(|row| row[0] * v[0] + row[1] * v[1]);
    let middle = size.map(|side| 0.5 * side);
    let mapped = |point: &[f64; 2]| {
        let turned = turned([0, 1].map(|axis| point[axis] - middle[axis]));
        [0, 1].map(|axis| middle[axis] + turned[axis])
    };
    let load = Load {
        voltage_v: load.voltage_v,
        points_mm: load.points_mm.iter().map(mapped).collect(),
    };
    let simulated = device.first_displacements(pattern, &load)?;
    let measured: Vec<[f64; 2]> = measured_mm.iter().map(|u| turned(*u)).collect();
    let centred = |all: &[[f64; 2]]| -> Vec<f64> {
        let mean = [0, 1].map(|c: usize| all.iter().map(|u| u[c]).sum::<f64>() / all.len() as f64);
        all.iter().flat_map(|u| [u[0] - mean[0], u[1] - mean[1]]).collect()
    };
    let (a, b) = (centred(&measured), centred(&simulated));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let found = product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt();
    found.is_finite().then_some(found)
}
