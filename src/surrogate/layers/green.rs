//! The displacement that forces on the corners cause in a membrane held at its frame, if each component obeyed the equation of a
//! stretched sheet, λ₁²∂xx + λ₂²∂yy: what the elastic tangent of a highly prestretched membrane is but for terms λp⁻⁶ as large.
//!
//! On a rectangle it is diagonal in sine waves. Frames and bodies within it take forces on the corners where they meet the membrane, such that
//! frames stand still and bodies move as one: forces that are linear in the displacement that the corners would have without (the
//! capacitance-matrix method; Buzbee, Dorr, George and Golub, SIAM J. Numer. Anal. 8 (1971) 722).

use std::f64::consts::PI;

use candle_core::{Device, Result, Tensor};
use deaflow_fem::registers::dispatch;
use deaflow_linalg::Accum;

use super::cell::inner_corners;
use super::gemm::{Matrix, multiply};
use deaflow_pattern::Raster;

/// Green's function of a membrane.
#[derive(Clone, Debug)]
pub(crate) struct Green {
    raster: Raster,
    /// Of x and of y, on so many cells n: sin(π (i+1)(k+1)/n) times √(2/n), symmetric and its own inverse.
    sines: [Vec<f32>; 2],
    /// One over the eigenvalue of each pair of waves, `[along y][along x]`.
    inverse: Vec<f32>,
    supports: Option<Supports>,
}

/// Where frames and bodies meet the membrane, and how stiffly they resist.
#[derive(Clone, Debug)]
pub(crate) struct Supports {
    /// Places among the inner corners.
    pub(crate) nodes: Vec<usize>,
    /// The forces that take a displacement of these corners back, `[component][node]` by `[component][node]`: symmetric.
    pub(crate) stiffness: Vec<f32>,
}

/// Room for [`Green::apply`].
pub(crate) struct GreenScratch {
    plane: Vec<f32>,
    forces: Vec<f32>,
}

impl GreenScratch {
    /// Makes it that of a membrane of the same raster.
    pub(super) fn fit(&mut self, green: &Green) {
        let forces = green.supports.as_ref().map_or(0, |_| 2 * self.plane.len());
        self.forces.resize(forces, 0.0);
    }
}

/// sin(π (i+1)(k+1)/n) times √(2/n), row by row.
fn sines(cells: usize) -> Vec<f32> {
    let (inner, n) = (cells - 1, cells as f64);
    let sine = |i: f64, k: f64| ((2.0 / n).sqrt() * (PI * i * k / n).sin()) as f32;
    let places = (0..inner * inner).map(|at| [at / inner + 1, at % inner + 1]);
    places.map(|[i, k]| sine(i as f64, k as f64)).collect()
}

impl Green {
    /// On a raster whose second differences along x count `along` times, and those along y as much less: the stiffness of a cell along x over
    /// the geometric mean of both.
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

    /// Its raster.
    pub(crate) fn raster(&self) -> Raster {
        self.raster
    }

    /// Where frames and bodies meet the membrane.
    pub(crate) fn supports(&self) -> Option<&Supports> {
        self.supports.as_ref()
    }

    /// The tables of the transform as tensors: the sines along x and along y, and one over the eigenvalues.
    pub(crate) fn tables(&self) -> Result<[Tensor; 3]> {
        let [columns, rows] = self.raster.sides().map(|side| side - 1);
        let table = |values: &[f32], shape: (usize, usize)| Tensor::from_slice(values, shape, &Device::Cpu);
        let [along, up] = &self.sines;
        Ok([
            table(along, (columns, columns))?,
            table(up, (rows, rows))?,
            table(&self.inverse, (rows, columns))?,
        ])
    }

    /// Room for work.
    pub(crate) fn scratch(&self) -> GreenScratch {
        let plane = inner_corners(self.raster);
        GreenScratch {
            plane: vec![0.0; plane],
            forces: vec![0.0; self.supports.as_ref().map_or(0, |_| 2 * plane)],
        }
    }

    /// Displacements of forces, both (2, inner corners), a cell being the unit of length. The map is its own transpose.
    pub(crate) fn apply(&self, forces: &[f32], displacements: &mut [f32], scratch: &mut GreenScratch) {
        self.of_rectangle(forces, displacements, &mut scratch.plane);
        let Some(supports) = &self.supports else {
            return;
        };
        let plane = inner_corners(self.raster);
        let places = || (0..2).flat_map(|k| supports.nodes.iter().map(move |node| k * plane + node));
        let moved: Vec<f32> = places().map(|place| displacements[place]).collect();
        let mut held = vec![0.0; moved.len()];
        let stiffness = Matrix::new(&supports.stiffness, moved.len());
        multiply(&mut held, Accum::Replace, stiffness, Matrix::new(&moved, 1));
        scratch.forces.copy_from_slice(forces);
        for (place, force) in places().zip(held) {
            scratch.forces[place] -= force;
        }
        self.of_rectangle(&scratch.forces, displacements, &mut scratch.plane);
    }

    /// The same without frames and bodies, plane by plane.
    fn of_rectangle(&self, forces: &[f32], displacements: &mut [f32], scratch: &mut [f32]) {
        let plane = inner_corners(self.raster);
        let [columns, rows] = self.raster.sides().map(|side| side - 1);
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
        let [columns, rows] = raster.sides().map(|side| side - 1);
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
    fn the_five_point_operator_gives_the_forces_back() {
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
    fn it_is_that_of_plain_operations_and_its_own_transpose() {
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
