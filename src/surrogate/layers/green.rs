//! The displacement that forces on the corners cause in a membrane held at its frame, if each component obeyed Laplace's
//! equation: what the elastic tangent of a highly prestretched membrane is but for terms λp⁻⁶ as large.

use std::f64::consts::PI;
use std::sync::LazyLock;

use candle_core::{Device, Result, Tensor};
use faer::Accum;
use pulp::Arch;

use super::gemm::{Matrix, multiply};
use crate::pattern::CELLS;

/// Corners along a side without the frame, and sine waves.
const INNER: usize = CELLS - 1;
const PLANE: usize = INNER * INNER;

/// The tables of the transform as tensors (49, 49): the sines, and one over the eigenvalues.
pub(crate) fn green_tables() -> Result<(Tensor, Tensor)> {
    let table = |values: &[f32]| Tensor::from_slice(values, (INNER, INNER), &Device::Cpu);
    Ok((table(&TABLES.sines)?, table(&TABLES.inverse)?))
}

/// The tables of the transform, row by row.
pub(crate) struct Tables {
    /// sin(π (i+1)(k+1)/50) times √(2/50): symmetric and its own inverse.
    pub(crate) sines: Vec<f32>,
    /// One over the eigenvalue of each pair of waves.
    pub(crate) inverse: Vec<f32>,
}

/// The tables.
pub(crate) static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let each = |value: &dyn Fn(f64, f64) -> f64| -> Vec<f32> {
        let wave = |at: usize| value((at / INNER + 1) as f64, (at % INNER + 1) as f64) as f32;
        (0..PLANE).map(wave).collect()
    };
    let cells = CELLS as f64;
    let eigenvalue = |k: f64| 2.0 - 2.0 * (PI * k / cells).cos();
    Tables {
        sines: each(&|i, k| (2.0 / cells).sqrt() * (PI * i * k / cells).sin()),
        inverse: each(&|k, l| 1.0 / (eigenvalue(k) + eigenvalue(l))),
    }
});

/// Displacements of forces, plane by plane (49, 49): the five-point Laplacian on the corners, a cell being the unit of length, is
/// inverted in its sine waves. The map is its own transpose. `scratch` is one plane.
pub(super) fn green_planes(forces: &[f32], displacements: &mut [f32], scratch: &mut [f32]) {
    let sines = Matrix::new(&TABLES.sines, INNER);
    for (f, u) in forces.chunks_exact(PLANE).zip(displacements.chunks_exact_mut(PLANE)) {
        multiply(scratch, Accum::Replace, Matrix::new(f, INNER), sines);
        multiply(u, Accum::Replace, sines, Matrix::new(scratch, INNER));
        Arch::new().dispatch(
            #[inline(always)]
            || u.iter_mut().zip(&TABLES.inverse).for_each(|(u, inverse)| *u *= inverse),
        );
        multiply(scratch, Accum::Replace, Matrix::new(u, INNER), sines);
        multiply(u, Accum::Replace, sines, Matrix::new(scratch, INNER));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::layers::plain::{self, numbers};

    fn forces(salt: usize) -> Tensor {
        numbers(&[1, 2, INNER, INNER], salt)
    }

    fn flat(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    fn green(forces: &[f32]) -> Vec<f32> {
        let (mut displacements, mut scratch) = (vec![0.0; forces.len()], vec![0.0; PLANE]);
        green_planes(forces, &mut displacements, &mut scratch);
        displacements
    }

    #[test]
    fn the_five_point_laplacian_gives_the_forces_back() {
        let f = flat(&forces(1));
        let u: Vec<f64> = green(&f).into_iter().map(f64::from).collect();
        let at = |plane: usize, y: usize, x: usize| {
            let inside = |i: usize| (1..=INNER).contains(&i);
            if inside(x) && inside(y) {
                u[plane * PLANE + (y - 1) * INNER + x - 1]
            } else {
                0.0
            }
        };
        for (i, force) in f.iter().enumerate() {
            let (plane, y, x) = (i / PLANE, i % PLANE / INNER + 1, i % INNER + 1);
            let around = at(plane, y - 1, x) + at(plane, y + 1, x) + at(plane, y, x - 1) + at(plane, y, x + 1);
            let found = 4.0 * at(plane, y, x) - around;
            assert!((found - f64::from(*force)).abs() < 1e-3, "{i}: {found} {force}");
        }
    }

    #[test]
    fn it_is_that_of_plain_operations_and_its_own_transpose() {
        let dot = |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum() };
        let (a, b) = (flat(&forces(2)), flat(&forces(3)));
        let (found, expected) = (dot(&green(&a), &b), dot(&a, &green(&b)));
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
        let plain = flat(&plain::green(&forces(2)).unwrap());
        let largest = plain.iter().fold(0.0, |most: f32, u| most.max(u.abs()));
        assert!(
            green(&a)
                .iter()
                .zip(&plain)
                .all(|(a, b)| (a - b).abs() < 1e-5 * largest)
        );
    }
}
