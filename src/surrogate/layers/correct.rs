//! The layers of a correction one after another on one image, without gradients and without memory of their own: a
//! prediction then costs a fifth of what the layers apart do.

use faer::Accum;

use super::cell::{FEATURES, MODES, add_forces, write_strains, write_surroundings};
use super::gemm::{Matrix, multiply};
use super::green::green_planes;
use crate::field::CORNERS;
use crate::pattern::CELLS;

const AREA: usize = CELLS * CELLS;
const INNER: usize = CORNERS - 2;

/// A local law in all orientations, row by row.
pub(crate) struct Correction {
    /// The two factors of all products, first those of the one, then those of the other, (2 products, features).
    pub(crate) factors: Vec<f32>,
    /// From products to stresses, (modes, products).
    pub(crate) products: Vec<f32>,
    /// From features to stresses, (modes, features).
    pub(crate) linear: Vec<f32>,
}

/// Corrects displacements (n, 2, 49, 49) of patterns (n, 50, 50), ±½ per cell, by laws one after another, each adding `length`
/// times the displacement that Green's function makes of its forces.
pub(crate) fn correct(laws: &[Correction], patterns: &[f32], displacements: &mut [f32], strain: f32, length: f32) {
    let most = laws.iter().map(|law| law.factors.len() / FEATURES).max().unwrap_or(0);
    let mut features = vec![0.0; FEATURES * AREA];
    let mut factors = vec![0.0; most * AREA];
    let mut stresses = vec![0.0; MODES * AREA];
    let mut forces = vec![0.0; 2 * INNER * INNER];
    let (mut added, mut scratch) = (forces.clone(), vec![0.0; INNER * INNER]);
    let images = patterns
        .chunks_exact(AREA)
        .zip(displacements.chunks_exact_mut(2 * INNER * INNER));
    for (pattern, displacement) in images {
        write_surroundings(pattern, &mut features);
        for law in laws {
            write_strains(pattern, displacement, strain, &mut features);
            let seen = Matrix::new(&features, AREA);
            let factors = &mut factors[..law.factors.len() / FEATURES * AREA];
            multiply(factors, Accum::Replace, Matrix::new(&law.factors, FEATURES), seen);
            let (first, second) = factors.split_at_mut(factors.len() / 2);
            first.iter_mut().zip(second).for_each(|(a, b)| *a *= *b);
            let products = Matrix::new(&law.products, law.products.len() / MODES);
            multiply(&mut stresses, Accum::Replace, products, Matrix::new(first, AREA));
            multiply(&mut stresses, Accum::Add, Matrix::new(&law.linear, FEATURES), seen);
            forces.fill(0.0);
            add_forces(&stresses, &mut forces);
            green_planes(&forces, &mut added, &mut scratch);
            displacement
                .iter_mut()
                .zip(&added)
                .for_each(|(u, added)| *u += length * added);
        }
    }
}
