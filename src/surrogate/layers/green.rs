//! Green's function of the membrane: the displacement by forces at the corners of a clamped membrane, where each
//! component obeys the equation of a stretched sheet, λ₁²∂xx + λ₂²∂yy. The elastic tangent of a membrane with
//! prestretch λp differs by terms of relative size λp⁻⁶.
//!
//! On a rectangle it is diagonal in sine modes. Inside it, frame and bodies exert forces at the corners where they
//! touch the membrane, so that the frame does not move and the bodies move rigidly. These forces are linear in the
//! displacement that the corners would have without them (the capacitance-matrix method; Buzbee, Dorr, George and
//! Golub, SIAM J. Numer. Anal. 8 (1971) 722).

use std::f64::consts::PI;

use candle_core::{Device, Result, Tensor};
use deaflow_fem::registers::dispatch;
use deaflow_linalg::Accum;

use super::gemm::{Matrix, multiply};
use crate::corners::{inner_corners, inner_sides};
use deaflow_pattern::Raster;

/// Green's function of a membrane.
#[derive(Clone, Debug)]
pub(crate) struct Green {
    raster: Raster,
    /// Sine matrices along x and y: see [`sines`].
    sines: [Vec<f32>; 2],
    /// Inverse eigenvalue of each pair of sine modes, `[y][x]`.
    inverse: Vec<f32>,
    supports: Option<Supports>,
}

/// The corners at which the frame and the bodies touch the membrane, and their stiffness.
#[derive(Clone, Debug)]
pub(crate) struct Supports {
    /// Indices of inner corners.
    pub(crate) nodes: Vec<usize>,
    /// Forces that undo a displacement of these corners, `[component][node]` by `[component][node]`; symmetric.
    pub(crate) stiffness: Vec<f32>,
}

/// Memory for [`Green::apply`].
pub(crate) struct GreenScratch {
    plane: Vec<f32>,
    forces: Vec<f32>,
}

impl GreenScratch {
    /// Resizes the memory for another membrane with the same raster.
    pub(super) fn fit(&mut self, green: &Green) {
        let forces = green.supports.as_ref().map_or(0, |_| 2 * self.plane.len());
        self.forces.resize(forces, 0.0);
    }
}

/// Returns the sine matrix of n cells, √(2/n) sin(π (i+1)(k+1)/n), row by row. It is symmetric and its own inverse.
fn sines(cells: usize) -> Vec<f32> {
    let (inner, n) = (cells - 1, cells as f64);
    let sine = |i: f64, k: f64| ((2.0 / n).sqrt() * (PI * i * k / n).sin()) as f32;
    let indices = (0..inner * inner).map(|at| [at / inner + 1, at % inner + 1]);
    indices.map(|[i, k]| sine(i as f64, k as f64)).collect()
}

impl Green {
    /// Creates Green's function of a raster. `along` is the stiffness of a cell along x over the geometric mean of both
    /// directions: it multiplies second differences along x and divides those along y.
    pub(crate) fn new(raster: Raster, along: f64, supports: Option<Supports>) -> Self {
        let [columns, rows] = raster.sides();
        let eigenvalue = |k: usize, cells: usize| 2.0 - 2.0 * (PI * k as f64 / cells as f64).cos();
        let inverse = (1..rows).flat_map(|l| {
            (1..columns).map(move |k| (1.0 / (eigenvalue(l, rows) / along + along * eigenvalue(k, columns))) as f32)
        });
        Self {
            raster,
            sines: [columns, rows].map(sines),
            inverse: inverse.collect(),
            supports,
        }
    }

    /// Returns its raster.
    pub(crate) fn raster(&self) -> Raster {
        self.raster
    }

    /// Returns the corners at which the frame and the bodies touch the membrane.
    pub(crate) fn supports(&self) -> Option<&Supports> {
        self.supports.as_ref()
    }

    /// Returns the sine matrices along x and y and the inverse eigenvalues as tensors.
    pub(crate) fn tables(&self) -> Result<[Tensor; 3]> {
        let [columns, rows] = inner_sides(self.raster);
        let table = |values: &[f32], shape: (usize, usize)| Tensor::from_slice(values, shape, &Device::Cpu);
        let [along, up] = &self.sines;
        Ok([
            table(along, (columns, columns))?,
            table(up, (rows, rows))?,
            table(&self.inverse, (rows, columns))?,
        ])
    }

    /// Allocates memory for [`Green::apply`].
    pub(crate) fn scratch(&self) -> GreenScratch {
        let plane = inner_corners(self.raster);
        GreenScratch {
            plane: vec![0.0; plane],
            forces: vec![0.0; self.supports.as_ref().map_or(0, |_| 2 * plane)],
        }
    }

    /// Computes the displacements by forces, both (2, inner corners), with a cell as the unit of length. The map is
    /// symmetric.
    pub(crate) fn apply(&self, forces: &[f32], displacements: &mut [f32], scratch: &mut GreenScratch) {
        self.of_rectangle(forces, displacements, &mut scratch.plane);
        let Some(supports) = &self.supports else {
            return;
        };
        let plane = inner_corners(self.raster);
        let indices = || (0..2).flat_map(|k| supports.nodes.iter().map(move |node| k * plane + node));
        let moved: Vec<f32> = indices().map(|index| displacements[index]).collect();
        let mut reactions = vec![0.0; moved.len()];
        let stiffness = Matrix::new(&supports.stiffness, moved.len());
        multiply(&mut reactions, Accum::Replace, stiffness, Matrix::new(&moved, 1));
        scratch.forces.copy_from_slice(forces);
        for (index, reaction) in indices().zip(reactions) {
            scratch.forces[index] -= reaction;
        }
        self.of_rectangle(&scratch.forces, displacements, &mut scratch.plane);
    }

    /// Computes the displacements without frame and bodies, plane by plane.
    fn of_rectangle(&self, forces: &[f32], displacements: &mut [f32], scratch: &mut [f32]) {
        let (plane, [columns, rows]) = (inner_corners(self.raster), inner_sides(self.raster));
        let (along, up) = (Matrix::new(&self.sines[0], columns), Matrix::new(&self.sines[1], rows));
        for (f, u) in forces.chunks_exact(plane).zip(displacements.chunks_exact_mut(plane)) {
            multiply(scratch, Accum::Replace, Matrix::new(f, columns), along);
            multiply(u, Accum::Replace, up, Matrix::new(scratch, columns));
            dispatch(
                #[inline(always)]
                || u.iter_mut().zip(&self.inverse).for_each(|(u, inverse)| *u *= inverse),
            );
            multiply(scratch, Accum::Replace, Matrix::new(u, columns), along);
            multiply(u, Accum::Replace, up, Matrix::new(scratch, columns));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::plain::{self, numbers};

    fn rasters() -> [(Raster, f64); 3] {
        let raster = |columns, rows| Raster::new(columns, rows).unwrap();
        [(Raster::PAPER, 1.0), (raster(9, 14), 0.8), (raster(2, 5), 1.5)]
    }

    fn forces(raster: Raster, salt: usize) -> Tensor {
        let [columns, rows] = inner_sides(raster);
        numbers(&[1, 2, rows, columns], salt)
    }

    fn flat(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    fn applied(green: &Green, forces: &[f32]) -> Vec<f32> {
        let mut displacements = vec![0.0; forces.len()];
        green.apply(forces, &mut displacements, &mut green.scratch());
        displacements
    }

    #[test]
    fn the_five_point_operator_returns_the_forces() {
        for (raster, along) in rasters() {
            let f = flat(&forces(raster, 1));
            let u: Vec<f64> = applied(&Green::new(raster, along, None), &f)
                .into_iter()
                .map(f64::from)
                .collect();
            let [columns, rows] = raster.sides();
            let plane = inner_corners(raster);
            let at = |k: usize, y: usize, x: usize| {
                let inside = (1..columns).contains(&x) && (1..rows).contains(&y);
                if inside {
                    u[k * plane + (y - 1) * (columns - 1) + x - 1]
                } else {
                    0.0
                }
            };
            for (i, force) in f.iter().enumerate() {
                let (k, y, x) = (i / plane, i % plane / (columns - 1) + 1, i % (columns - 1) + 1);
                let second = |low: f64, high: f64| 2.0 * at(k, y, x) - low - high;
                let found =
                    along * second(at(k, y, x - 1), at(k, y, x + 1)) + second(at(k, y - 1, x), at(k, y + 1, x)) / along;
                assert!(
                    (found - f64::from(*force)).abs() < 1e-3,
                    "{raster} {i}: {found} {force}"
                );
            }
        }
    }

    #[test]
    fn it_equals_plain_operations_and_is_symmetric() {
        let dot = |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum() };
        for (raster, along) in rasters() {
            let green = Green::new(raster, along, None);
            let (a, b) = (flat(&forces(raster, 2)), flat(&forces(raster, 3)));
            let (found, expected) = (dot(&applied(&green, &a), &b), dot(&a, &applied(&green, &b)));
            assert!(
                (found - expected).abs() < 1e-4 * expected.abs().max(1.0),
                "{found} {expected}"
            );
            let plain = flat(&plain::green(&green, &forces(raster, 2)).unwrap());
            let largest = plain.iter().fold(0.0, |most: f32, u| most.max(u.abs()));
            let found = applied(&green, &a);
            assert!(found.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-5 * largest));
        }
    }
}
