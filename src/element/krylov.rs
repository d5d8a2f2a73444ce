//! Preconditioned conjugate gradients (Hestenes and Stiefel, J. Res. NBS 49 (1952) 409) that detect negative curvature.
//!
//! They work in single precision for half the memory traffic: Newton's method corrects the error.

use crate::registers::dispatch_widest;

use deaflow_base::is_interrupted;

/// How the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KrylovEnd {
    /// The residual is small enough.
    Converged,
    /// The operator is not positive definite along a direction.
    NegativeCurvature,
    /// Too many iterations, or an interrupt.
    Limit,
}

/// The vectors of the iteration.
pub struct Scratch {
    /// The right-hand side on entry, the residual afterwards.
    pub residual: Vec<f32>,
    /// The solution.
    pub solution: Vec<f32>,
    /// Total number of iterations.
    pub iterations: u32,
    preconditioned: Vec<f32>,
    direction: Vec<f32>,
    image: Vec<f32>,
}

impl Scratch {
    /// Creates vectors of a length.
    #[must_use]
    pub fn new(len: usize) -> Self {
        Self {
            residual: vec![0.0; len],
            solution: vec![0.0; len],
            iterations: 0,
            preconditioned: vec![0.0; len],
            direction: vec![0.0; len],
            image: vec![0.0; len],
        }
    }
}

/// Maximum number of iterations; with the preconditioner the condition number is a few units except near a loss of
/// stability.
const LIMIT: usize = 100;
/// The same for vectors of more than [`LARGE`] numbers: fewer iterations take less time and memory than a factorisation.
const LARGE_LIMIT: usize = 1000;
/// Length of a vector for which a factorisation takes half a gigabyte.
pub const LARGE: usize = 1_000_000;

/// Solves `operator` · solution = residual from zero until the Euclidean norm of the residual, 1 on entry, is at most
/// `goal`.
pub fn conjugate_gradients(
    goal: f64,
    scratch: &mut Scratch,
    mut operator: impl FnMut(&[f32], &mut [f32]),
    mut precondition: impl FnMut(&[f32], &mut [f32]),
) -> KrylovEnd {
    let Scratch {
        residual: r,
        solution: x,
        iterations,
        preconditioned: z,
        direction: p,
        image,
    } = scratch;
    let mut rho = f64::NAN;
    let limit = if r.len() > LARGE { LARGE_LIMIT } else { LIMIT };
    for iteration in 0..limit {
        if is_interrupted() {
            break;
        }
        *iterations += 1;
        precondition(r, z);
        let previous = std::mem::replace(&mut rho, dot(r, z));
        if iteration == 0 {
            p.copy_from_slice(z);
        } else {
            extend(p, (rho / previous) as f32, z);
        }
        operator(p, image);
        let curvature = dot(p, image);
        if curvature <= 0.0 || !curvature.is_finite() {
            return KrylovEnd::NegativeCurvature;
        }
        let alpha = (rho / curvature) as f32;
        if iteration == 0 {
            x.iter_mut().zip(p.iter()).for_each(|(x, p)| *x = alpha * p);
        } else {
            add_scaled(x, alpha, p);
        }
        if retreat(r, alpha, image).sqrt() <= goal {
            return KrylovEnd::Converged;
        }
    }
    KrylovEnd::Limit
}

/// Number of products that are summed in single precision before the double-precision sum.
const SINGLE_SUMS: usize = 512;

/// Σ aᵢbᵢ, summed in an order that depends on the length alone.
#[must_use]
pub fn dot(a: &[f32], b: &[f32]) -> f64 {
    dispatch_widest(
        #[inline(always)]
        || {
            a.chunks(SINGLE_SUMS)
                .zip(b.chunks(SINGLE_SUMS))
                .map(|(a, b)| short_dot(a, b))
                .sum()
        },
    )
}

#[inline(always)]
fn short_dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f32; 64];
    let (a, b) = (a.chunks_exact(64), b.chunks_exact(64));
    let rest: f32 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    f64::from(sums.iter().sum::<f32>() + rest)
}

/// y ← y + αx.
pub fn add_scaled(y: &mut [f32], alpha: f32, x: &[f32]) {
    dispatch_widest(
        #[inline(always)]
        || y.iter_mut().zip(x).for_each(|(y, x)| *y += alpha * x),
    );
}

/// p ← z + βp.
fn extend(p: &mut [f32], beta: f32, z: &[f32]) {
    dispatch_widest(
        #[inline(always)]
        || p.iter_mut().zip(z).for_each(|(p, z)| *p = z + beta * *p),
    );
}

/// r ← r − αq; returns r·r.
fn retreat(r: &mut [f32], alpha: f32, q: &[f32]) -> f64 {
    dispatch_widest(
        #[inline(always)]
        || {
            let mut total = 0.0;
            for (r, q) in r.chunks_mut(SINGLE_SUMS).zip(q.chunks(SINGLE_SUMS)) {
                r.iter_mut().zip(q).for_each(|(r, q)| *r -= alpha * q);
                total += short_dot(r, r);
            }
            total
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scratch(rhs: &[f32]) -> Scratch {
        let mut scratch = Scratch::new(rhs.len());
        scratch.residual.copy_from_slice(rhs);
        scratch
    }

    #[test]
    fn solves_in_as_many_steps_as_there_are_eigenvalues() {
        let diagonal = [1.0, 2.0, 2.0, 5.0];
        let mut applications = 0;
        let mut scratch = scratch(&[0.5; 4]);
        let ending = conjugate_gradients(
            1e-6,
            &mut scratch,
            |p, out| {
                applications += 1;
                out.iter_mut()
                    .zip(p.iter().zip(diagonal))
                    .for_each(|(o, (p, d))| *o = p * d);
            },
            |r, z| z.copy_from_slice(r),
        );
        assert_eq!((ending, applications), (KrylovEnd::Converged, 3));
        assert!(
            scratch
                .solution
                .iter()
                .zip(diagonal)
                .all(|(x, d)| (x * d - 0.5).abs() < 1e-5)
        );
    }

    #[test]
    fn notices_an_indefinite_operator() {
        let ending = conjugate_gradients(
            1e-6,
            &mut scratch(&[0.6, 0.8]),
            |p, out| out.copy_from_slice(&[p[0], -2.0 * p[1]]),
            |r, z| z.copy_from_slice(r),
        );
        assert_eq!(ending, KrylovEnd::NegativeCurvature);
    }

    #[test]
    fn sums_are_right_for_every_length() {
        for len in [0, 3, 64, 511, 512, 1300] {
            let a: Vec<f32> = (0..len).map(|i| (i % 7) as f32).collect();
            let b: Vec<f32> = (0..len).map(|i| (i % 5) as f32).collect();
            let exact: usize = (0..len).map(|i| (i % 7) * (i % 5)).sum();
            assert_eq!(dot(&a, &b), exact as f64);
        }
    }
}
