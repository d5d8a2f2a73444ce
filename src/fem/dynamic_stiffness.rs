//! The dynamic stiffness K + ΓK_A − ω²M of a membrane, assembled and factorised.
//!
//! It is symmetric, complex if Γ is, and indefinite above the first natural frequency. A complex matrix A + iB is
//! factorised as the real symmetric one of twice the size with [A −B; −B −A] in place of each entry, with pivoting
//! within dense blocks (Bunch and Kaufman, Math. Comp. 31 (1977) 163); iterative refinement corrects the error of small
//! pivots.

use std::sync::{Arc, OnceLock};

use deaflow_linalg::{Indefinite, IndefiniteOrder, SparseColMat, SymbolicSparseColMat, add_symmetric_product};

use super::eigenvalue::dot;
use super::newton::norm;

/// A response with a smaller ratio of forces to inertia is a free vibration: about the rounding of natural frequencies.
const FREE: f64 = 1e-10;
/// Relative residual at which refinement ends, and the largest accepted one.
const REFINED: f64 = 1e-13;
const ACCEPTED: f64 = 1e-8;
/// Maximum number of refinement steps.
const MOST_STEPS: usize = 8;

/// The matrices on and below the diagonal, with a common structure.
pub struct DynamicStiffness {
    symbolic: SymbolicSparseColMat<usize>,
    stiff: Vec<f64>,
    viscous: Option<Vec<f64>>,
    heavy: Option<Vec<f64>>,
    orders: Arc<Orders>,
}

/// Elimination orders of the matrix and of the one of twice the size, for all matrices of one structure.
#[derive(Default)]
pub struct Orders([OnceLock<Option<IndefiniteOrder>>; 2]);

/// A frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct At {
    /// Γ: real and imaginary part.
    pub viscous: [f64; 2],
    /// ω² in units of the membrane.
    pub square: f64,
}

/// The result of a solution.
pub enum Solved {
    /// The response: real and imaginary part.
    Response([Vec<f64>; 2]),
    /// The frequency is a natural one within rounding.
    Resonance,
}

impl DynamicStiffness {
    /// Combines the tangent, the tangent with the instantaneous stiffness of relaxed branches of modulus 1, and the
    /// mass; matrices that share orders must have one structure.
    #[must_use]
    pub fn new(
        tangent: SparseColMat<usize, f64>,
        with_branches: Option<&SparseColMat<usize, f64>>,
        mass: Option<&SparseColMat<usize, f64>>,
        orders: Arc<Orders>,
    ) -> Self {
        let viscous = with_branches.map(|with| {
            let pairs = with.val().iter().zip(tangent.val());
            pairs.map(|(with, without)| with - without).collect()
        });
        let (symbolic, stiff) = tangent.into_parts();
        Self {
            symbolic,
            stiff,
            viscous,
            heavy: mass.map(|mass| mass.val().to_vec()),
            orders,
        }
    }

    /// Returns the response to real forces at a frequency; `None` if memory is short or rounding too large.
    #[must_use]
    pub fn solve(&self, at: At, forces: &[f64], probe: &[f64]) -> Option<Solved> {
        let [response] = self.solve_each(at, [forces], probe)?;
        Some(response)
    }

    /// Returns the responses to several forces, with one factorisation.
    #[must_use]
    pub fn solve_each<const N: usize>(&self, at: At, each: [&[f64]; N], probe: &[f64]) -> Option<[Solved; N]> {
        let real = self.real(at);
        let imaginary = self.viscous.as_ref().filter(|_| at.viscous[1] != 0.0);
        let imaginary = imaginary.map(|viscous| viscous.iter().map(|value| at.viscous[1] * value).collect::<Vec<_>>());
        let order = |which: usize| {
            let make = || match which {
                0 => IndefiniteOrder::new(self.symbolic.clone()),
                _ => IndefiniteOrder::new(self.doubled()),
            };
            self.orders.0[which].get_or_init(make).as_ref()
        };
        let factors = match &imaginary {
            None => Indefinite::new(order(0)?, real.clone())?,
            Some(imaginary) => Indefinite::new(order(1)?, self.interleaved(&real, imaginary))?,
        };
        let solve = |forces: &[f64], steps| self.refined(&factors, (&real, imaginary.as_deref()), forces, steps);
        // A mode that the forces do not excite would also disturb the response.
        if self.heavy.is_some() && at.square > 0.0 && self.is_free(at, &solve(probe, 1).0, probe) {
            return Some(each.map(|_| Solved::Resonance));
        }
        let found = each.into_iter().map(|forces| {
            let (response, residual) = solve(forces, MOST_STEPS);
            match self.is_free(at, &response, forces) {
                true => Some(Solved::Resonance),
                false => (residual <= ACCEPTED).then_some(Solved::Response(response)),
            }
        });
        found.collect::<Option<Vec<_>>>()?.try_into().ok()
    }

    /// Returns whether the forces are so small relative to the inertia of the response that it is a free vibration.
    fn is_free(&self, at: At, response: &[Vec<f64>; 2], forces: &[f64]) -> bool {
        let Some(heavy) = &self.heavy else {
            return false;
        };
        let inertia = response.each_ref().map(|part| {
            let mut image = vec![0.0; part.len()];
            self.add_image(heavy, 1.0, part, &mut image);
            norm(&image)
        });
        let inertia = at.square * inertia[0].hypot(inertia[1]);
        inertia > 0.0 && norm(forces) <= FREE * inertia || inertia.is_nan()
    }

    /// Returns the real part.
    fn real(&self, at: At) -> Vec<f64> {
        let mut sum = self.stiff.clone();
        let parts = [(&self.viscous, at.viscous[0]), (&self.heavy, -at.square)];
        for (part, factor) in parts {
            for (sum, value) in sum.iter_mut().zip(part.iter().flatten()) {
                *sum += factor * value;
            }
        }
        sum
    }

    /// Returns a solution with at most this number of refinement steps, including the first solution, and its relative
    /// residual.
    fn refined(
        &self,
        factors: &Indefinite<'_>,
        (real, imaginary): (&[f64], Option<&[f64]>),
        forces: &[f64],
        steps: usize,
    ) -> ([Vec<f64>; 2], f64) {
        let count = forces.len();
        let zero = || [vec![0.0; count], vec![0.0; count]];
        let size = norm(forces);
        let mut response = zero();
        let mut best = (zero(), 1.0);
        if size == 0.0 {
            return (response, 0.0);
        }
        let mut left = [forces.to_vec(), vec![0.0; count]];
        for _ in 0..steps {
            let step = match imaginary {
                None => {
                    let mut step = left[0].clone();
                    factors.solve(&mut step);
                    [step, vec![0.0; count]]
                }
                Some(_) => {
                    let mut pairs: Vec<f64> = left[0].iter().zip(&left[1]).flat_map(|(a, b)| [*a, -b]).collect();
                    factors.solve(&mut pairs);
                    [0, 1].map(|part| pairs.iter().skip(part).step_by(2).copied().collect())
                }
            };
            for (response, step) in response.iter_mut().zip(&step) {
                response.iter_mut().zip(step).for_each(|(a, b)| *a += b);
            }
            left = [forces.to_vec(), vec![0.0; count]];
            let [x, y] = &response;
            let [of_real, of_imaginary] = &mut left;
            self.add_image(real, -1.0, x, of_real);
            self.add_image(real, -1.0, y, of_imaginary);
            if let Some(imaginary) = imaginary {
                self.add_image(imaginary, 1.0, y, of_real);
                self.add_image(imaginary, -1.0, x, of_imaginary);
            }
            let residual = (dot(&left[0], &left[0]) + dot(&left[1], &left[1])).sqrt() / size;
            let is_better = residual < 0.5 * best.1;
            if residual < best.1 || residual.is_nan() {
                best = (response.clone(), residual);
            }
            if residual <= REFINED || !is_better {
                break;
            }
        }
        best
    }

    /// Adds the product of a matrix and a vector, times a factor.
    fn add_image(&self, values: &[f64], factor: f64, vector: &[f64], out: &mut [f64]) {
        let places = [self.symbolic.col_ptr(), self.symbolic.row_idx()];
        add_symmetric_product(places, values, factor, vector, out);
    }

    /// Returns the structure of the matrix of twice the size.
    fn doubled(&self) -> SymbolicSparseColMat<usize> {
        let count = 2 * self.symbolic.ncols();
        let (mut starts, mut places) = (vec![0], Vec::with_capacity(4 * self.stiff.len()));
        let rows = self.symbolic.row_idx();
        for (column, range) in self.symbolic.col_ptr().windows(2).enumerate() {
            for part in 0..2 {
                for row in &rows[range[0]..range[1]] {
                    places.extend(
                        [2 * row, 2 * row + 1]
                            .into_iter()
                            .filter(|row| *row >= 2 * column + part),
                    );
                }
                starts.push(places.len());
            }
        }
        SymbolicSparseColMat::new_checked(count, count, starts, None, places)
    }

    /// Returns its entries.
    fn interleaved(&self, real: &[f64], imaginary: &[f64]) -> Vec<f64> {
        let mut entries = Vec::with_capacity(4 * self.stiff.len());
        let rows = self.symbolic.row_idx();
        for (column, range) in self.symbolic.col_ptr().windows(2).enumerate() {
            for part in 0..2 {
                for at in range[0]..range[1] {
                    let both = [[real[at], -imaginary[at]], [-imaginary[at], -real[at]]][part];
                    let kept = if rows[at] == column { part } else { 0 };
                    entries.extend_from_slice(&both[kept..]);
                }
            }
        }
        entries
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [2 1; 1 3] with the viscous part [1 0; 0 2] and unit mass.
    fn small() -> DynamicStiffness {
        let symbolic = SymbolicSparseColMat::new_checked(2, 2, vec![0, 2, 3], None, vec![0, 1, 1]);
        let matrix = |entries: [f64; 3]| SparseColMat::new(symbolic.clone(), entries.to_vec());
        let (with, mass) = (matrix([3.0, 1.0, 5.0]), matrix([1.0, 0.0, 1.0]));
        DynamicStiffness::new(matrix([2.0, 1.0, 3.0]), Some(&with), Some(&mass), Arc::default())
    }

    fn response(at: At) -> Option<[Vec<f64>; 2]> {
        match small().solve(at, &[1.0, 0.0], &[0.3, 0.4])? {
            Solved::Response(response) => Some(response),
            Solved::Resonance => None,
        }
    }

    #[test]
    fn responses_solve_the_complex_system() {
        // [1.5 + 2i, 1; 1, 3 + 4i] û = [1; 0]: û = [3 + 4i; −1]/d with d = (1.5 + 2i)(3 + 4i) − 1 = −4.5 + 12i.
        let at = At {
            viscous: [0.5, 2.0],
            square: 1.0,
        };
        let [real, imaginary] = response(at).unwrap();
        let size = 4.5_f64.powi(2) + 144.0;
        let known = [
            [(-13.5 + 48.0) / size, 4.5 / size],
            [(-36.0 - 18.0) / size, 12.0 / size],
        ];
        for k in 0..2 {
            assert!((real[k] - known[0][k]).abs() < 1e-15 && (imaginary[k] - known[1][k]).abs() < 1e-15);
        }
        let [real, imaginary] = response(At {
            viscous: [0.0; 2],
            square: 0.0,
        })
        .unwrap();
        assert!((real[0] - 0.6).abs() < 1e-15 && (real[1] + 0.2).abs() < 1e-15 && imaginary == [0.0; 2]);
    }

    #[test]
    fn natural_frequencies_are_told_and_responses_near_them_are_large() {
        let first = 2.5 - 1.25_f64.sqrt();
        let undamped = |square: f64| {
            response(At {
                viscous: [0.0; 2],
                square,
            })
        };
        assert_eq!(undamped(first), None);
        // û ≈ v (v·f)/(λ − ω²) with v ∝ [1, λ − 2].
        let away = 1e-6 * first;
        let [real, _] = undamped(first - away).unwrap();
        let share = 1.0 / (1.0 + (first - 2.0).powi(2));
        assert!(
            (real[0] * away / share - 1.0).abs() < 1e-5,
            "{}",
            real[0] * away / share
        );
    }
}
