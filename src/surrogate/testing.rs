//! Examples for the tests of this crate: the linear response of the membrane, which differs from the nonlinear
//! response by a few hundredths of a millimetre.

use super::example::{Example, Label};
use deaflow_base::Stream;
use deaflow_dataset::Split;
use deaflow_fem::LinearResponse;
use deaflow_field::{CORNERS, Field, Mesh};
use deaflow_pattern::{CELLS, Pattern, Raster};
use deaflow_scene::Scene;

const INNER: usize = CELLS - 1;

/// κ λp² at λp = 3 and κ = 0.0255, the default scene.
const LOAD: f64 = 0.2295;

/// Returns the linear response of the default scene at a voltage on the coarsest mesh.
pub fn response_at(volts: f64) -> LinearResponse {
    LinearResponse::new(&Scene::vhb4910().at_voltage(volts), Mesh::bilinear(1)).expect("the membrane is stable")
}

/// S Z S for the symmetric sine matrix S, which diagonalises the bilinear elements on a uniform grid.
fn sine_transform(values: &[f64]) -> Vec<f64> {
    let angle = std::f64::consts::PI / CELLS as f64;
    let sine = |i: usize, j: usize| (angle * ((i + 1) * (j + 1)) as f64).sin() * (2.0 / CELLS as f64).sqrt();
    let table: Vec<f64> = (0..INNER * INNER).map(|at| sine(at / INNER, at % INNER)).collect();
    let product = |a: &[f64], b: &[f64]| -> Vec<f64> {
        let entry = |at: usize| {
            (0..INNER)
                .map(|k| a[at / INNER * INNER + k] * b[k * INNER + at % INNER])
                .sum()
        };
        (0..INNER * INNER).map(entry).collect()
    };
    product(&product(&table, values), &table)
}

/// The solution of ∇²u = κ λp² ∇S with u = 0 on the frame, bilinear elements of one cell.
pub(super) fn linear_response(pattern: &Pattern) -> Field {
    let cell = |x: usize, y: usize| f64::from(u8::from(pattern.is_active(x, y)));
    let mut values = vec![0.0; CORNERS * CORNERS * 2];
    for component in 0..2 {
        let load = |at: usize| {
            let (x, y) = (at % INNER, at / INNER);
            let diagonal = cell(x, y) - cell(x + 1, y + 1);
            let other = cell(x, y + 1) - cell(x + 1, y);
            0.5 * LOAD * (diagonal + if component == 0 { other } else { -other })
        };
        let mut modes = sine_transform(&(0..INNER * INNER).map(load).collect::<Vec<_>>());
        for (at, mode) in modes.iter_mut().enumerate() {
            let cosine = |k: usize| (std::f64::consts::PI * (k + 1) as f64 / CELLS as f64).cos();
            let (a, b) = (cosine(at % INNER), cosine(at / INNER));
            *mode /= (2.0 - 2.0 * a) * (4.0 + 2.0 * b) / 6.0 + (2.0 - 2.0 * b) * (4.0 + 2.0 * a) / 6.0;
        }
        for (at, u) in sine_transform(&modes).into_iter().enumerate() {
            values[2 * ((at / INNER + 1) * CORNERS + at % INNER + 1) + component] = u;
        }
    }
    Field::from_values(Raster::PAPER, values).expect("finite")
}

/// Half planes at random angles through points near the centre, and 4 × 4 grids.
pub(super) fn examples(count: u64, split: Split) -> Vec<Example> {
    let example = |i| {
        let mut stream = Stream::new(11, split.name(), i);
        let (pattern, family) = if i % 2 == 0 {
            let (s, c) = stream.range(0.0, std::f64::consts::TAU).sin_cos();
            let shift = stream.range(-4.0, 4.0);
            let behind = |x: usize, y: usize| c * (x as f64 - 24.5) + s * (y as f64 - 24.5) < shift;
            (Pattern::from_fn(Raster::PAPER, behind), "half-plane")
        } else {
            let on = stream.choose(16, 8);
            (
                Pattern::from_fn(Raster::PAPER, |x, y| on.contains(&(x * 4 / CELLS + y * 4 / CELLS * 4))),
                "grid",
            )
        };
        Example {
            label: Label::from(&linear_response(&pattern)),
            pattern,
            family: family.to_owned(),
            split,
            repeats: 1,
        }
    };
    (0..count).map(example).collect()
}

#[test]
fn the_linear_response_of_the_half_plane_is_the_closed_form() {
    // The limit of large prestretch: u_x at the centre is 8.441431041 κ λp² mm for L = 50 mm; the mesh costs 1 %.
    let field = linear_response(&Pattern::from_fn(Raster::PAPER, |x, _| x < CELLS / 2));
    let [ux, uy] = field.at_corner(25, 25);
    assert!((ux / (8.441431041 * LOAD) - 1.0).abs() < 0.01, "{ux}");
    assert!(uy.abs() < 1e-12);
}
