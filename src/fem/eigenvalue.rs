//! The smallest eigenvalue of the tangent relative to the Laplacian: K v = μ L v.
//!
//! It is dimensionless, independent of the mesh, close to 1 for a bare membrane at rest, and zero where stability is
//! lost. The iteration is LOBPCG with one vector (Knyazev, SIAM J. Sci. Comput. 23 (2001) 517), preconditioned by the
//! Laplacian itself: Rayleigh–Ritz in the span of the last vector, its preconditioned residual, and the last step.

use deaflow_linalg::{Mat, eigen};

use deaflow_base::{Stream, is_interrupted};

use super::material::Material;
use super::operator::Operator;
use super::precondition::{Laplacian, LaplacianScratch};
use super::rigid::Pose;

/// An eigenvalue and its vector with v · L v = 1.
#[derive(Clone, Debug)]
pub struct Eigenpair {
    /// μ.
    pub value: f64,
    /// v.
    pub vector: Vec<f64>,
}

/// Largest number of steps.
const LIMIT: usize = 300;
/// Number of steps over which the change of the value is compared with [`SETTLED`].
const WINDOW: usize = 8;
/// Largest change of a converged value, relative to the value or [`FLOOR`], whichever is larger.
const SETTLED: f64 = 1e-5;
const FLOOR: f64 = 1e-3;

/// A vector with its products by K and L.
#[derive(Clone)]
struct Direction {
    vector: Vec<f64>,
    /// K times the vector.
    stiff: Vec<f64>,
    /// L times the vector.
    harmonic: Vec<f64>,
}

impl Direction {
    fn new<L: Material>(operator: &Operator<'_, L>, u: &[f64], vector: Vec<f64>) -> Self {
        let mut stiff = vec![0.0; vector.len()];
        operator.tangent(u, &vector, &mut stiff);
        let mut harmonic = vec![0.0; vector.len()];
        operator.laplacian(u, &vector, &mut harmonic);
        Self {
            vector,
            stiff,
            harmonic,
        }
    }

    /// Adds a multiple of another direction.
    fn add(&mut self, factor: f64, other: &Self) {
        let parts = [
            (&mut self.vector, &other.vector),
            (&mut self.stiff, &other.stiff),
            (&mut self.harmonic, &other.harmonic),
        ];
        for (own, other) in parts {
            add(own, factor, other);
        }
    }

    fn scale(&mut self, factor: f64) {
        for part in [&mut self.vector, &mut self.stiff, &mut self.harmonic] {
            part.iter_mut().for_each(|a| *a *= factor);
        }
    }

    /// Makes it orthogonal to unit directions and of unit length; `false` if it vanishes.
    fn orthonormalise(&mut self, others: &[&Self]) -> bool {
        let before = dot(&self.vector, &self.harmonic);
        // Twice: the first pass leaves rounding of the size of what it subtracted.
        for _ in 0..2 {
            for other in others {
                self.add(-dot(&self.vector, &other.harmonic), other);
            }
        }
        let size = dot(&self.vector, &self.harmonic);
        if size.is_nan() || size <= 1e-20 * before.max(f64::MIN_POSITIVE) {
            return false;
        }
        self.scale(1.0 / size.sqrt());
        true
    }
}

/// Computes the smallest eigenvalue at `u`, starting from the vector of a neighbouring state if given.
///
/// The relative error is about 1e-5; close to zero the absolute error is 1e-8.
#[must_use]
pub fn smallest<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    u: &[f64],
    near: Option<&Eigenpair>,
) -> Option<Eigenpair> {
    let mut scratch = laplacian.scratch();
    let poses = operator.activity.grid().poses(u);
    let mut x = Direction::new(operator, u, start(operator, laplacian, u, &mut scratch));
    if !x.orthonormalise(&[]) {
        return None;
    }
    if let Some(near) = near {
        // A small random part remains; otherwise a vector of another symmetry could not be found.
        x.scale(0.1);
        x.add(1.0, &Direction::new(operator, u, near.vector.clone()));
        x.orthonormalise(&[]);
    }
    let mut last: Option<Direction> = None;
    let mut values = vec![dot(&x.vector, &x.stiff)];
    for step in 0..LIMIT {
        if is_interrupted() {
            return None;
        }
        let value = values[step];
        let residual: Vec<f64> = x.stiff.iter().zip(&x.harmonic).map(|(k, l)| k - value * l).collect();
        let Some(correction) = precondition(laplacian, &residual, &poses, &mut scratch) else {
            break;
        };
        let mut w = Direction::new(operator, u, correction);
        let known: Vec<&Direction> = std::iter::once(&x).chain(&last).collect();
        if !w.orthonormalise(&known) {
            break;
        }
        let (next, moved) = ritz(&x, w, last.take())?;
        last = moved;
        x = next;
        values.push(dot(&x.vector, &x.stiff));
        let now = values[step + 1];
        if step >= WINDOW && values[step + 1 - WINDOW] - now < SETTLED * now.abs().max(FLOOR) {
            break;
        }
    }
    Some(Eigenpair {
        value: dot(&x.vector, &x.stiff),
        vector: x.vector,
    })
}

/// Returns the Ritz vector of the smallest value in the span of orthonormal directions, and the step to it, orthogonal
/// to it.
fn ritz(x: &Direction, w: Direction, p: Option<Direction>) -> Option<(Direction, Option<Direction>)> {
    let span: Vec<&Direction> = [x, &w].into_iter().chain(&p).collect();
    let n = span.len();
    let matrix = Mat::from_fn(n, n, |i, k| {
        0.5 * (dot(&span[i].vector, &span[k].stiff) + dot(&span[k].vector, &span[i].stiff))
    });
    let vectors = eigen(&matrix)?.vectors;
    let weights: Vec<f64> = (0..n).map(|i| vectors[(i, 0)]).collect();
    let mut step = w.clone();
    step.scale(weights[1]);
    if let Some(p) = &p {
        step.add(weights[2], p);
    }
    let mut next = x.clone();
    next.scale(weights[0]);
    next.add(1.0, &step);
    if !next.orthonormalise(&[]) {
        return None;
    }
    let kept = step.orthonormalise(&[&next]);
    Some((next, kept.then_some(step)))
}

/// Returns a smooth start vector with a part along every mode.
fn start<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    u: &[f64],
    scratch: &mut LaplacianScratch,
) -> Vec<f64> {
    let mut stream = Stream::new(0, "smallest eigenvalue", 0);
    let grid = operator.activity.grid();
    let load = grid.random_load(&mut stream, u);
    precondition(laplacian, &load, &grid.poses(u), scratch).unwrap_or(load)
}

/// Applies the inverse Laplacian to a load of any magnitude; `None` for a zero load.
pub(super) fn precondition(
    laplacian: &Laplacian,
    load: &[f64],
    poses: &[Pose],
    scratch: &mut LaplacianScratch,
) -> Option<Vec<f64>> {
    let size = dot(load, load).sqrt();
    if size.is_nan() || size <= f64::MIN_POSITIVE {
        return None;
    }
    let narrow: Vec<f32> = load.iter().map(|r| (r / size) as f32).collect();
    let mut solution = vec![0.0; load.len()];
    laplacian.solve(&narrow, poses, &mut solution, scratch);
    Some(solution.into_iter().map(f64::from).collect())
}

/// sum ← sum + factor · vector.
pub fn add(sum: &mut [f64], factor: f64, vector: &[f64]) {
    sum.iter_mut()
        .zip(vector)
        .for_each(|(sum, value)| *sum += factor * value);
}

/// Returns a · b, summed in an order that depends only on the length.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a, b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        sums.iter_mut()
            .zip(a.iter().zip(b))
            .for_each(|(sum, (a, b))| *sum += a * b);
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direct::Factorisation;
    use crate::energy::NeoHookean;
    use crate::grid::Grid;
    use crate::material::AnyMaterial;
    use crate::operator::Activity;
    use deaflow_field::{Mesh, Order};

    fn at<R>(mesh: Mesh, pull: f64, work: impl FnOnce(&Operator<'_, AnyMaterial>, &Laplacian, &[f64]) -> R) -> R {
        let material = AnyMaterial::from(NeoHookean::of(1.0 / 729.0, pull));
        let grid = Grid::paper(mesh);
        let activity = Activity::from_shares(&grid, |x, y| if (x / 10 + y / 10) % 2 == 0 { 1.0 } else { 0.2 });
        let operator = Operator::new(&material, &activity);
        work(
            &operator,
            &Laplacian::new(&grid).unwrap(),
            &vec![0.0; grid.layout().vector_len()],
        )
    }

    #[test]
    fn a_membrane_at_rest_is_as_stiff_as_the_laplacian() {
        // At rest without voltage K = L + 3a (div)² up to a null Lagrangian, and some modes are free of divergence.
        for (per_cell, order) in [(1, Order::Bilinear), (1, Order::Biquadratic)] {
            let value = at(Mesh::new(per_cell, order), 0.0, |operator, laplacian, u| {
                smallest(operator, laplacian, u, None).unwrap().value
            });
            assert!((1.0..1.0001).contains(&value), "{value}");
        }
    }

    #[test]
    fn a_membrane_that_is_active_everywhere_has_the_closed_form_value() {
        // K = L + (3a − b)(div)² up to a null Lagrangian: the value is 1 + 3a − b where that is less than 1, because
        // some modes are free of rotation. Meshes converge from above.
        let grid = Grid::paper(Mesh::new(1, Order::Biquadratic));
        let activity = Activity::from_shares(&grid, |_, _| 1.0);
        let (laplacian, u) = (Laplacian::new(&grid).unwrap(), vec![0.0; grid.layout().vector_len()]);
        let thickness = 1.0 / 729.0;
        for (pull, exact) in [
            (2.0 * thickness, 1.0),
            (0.2, 0.8 + 3.0 * thickness),
            (0.9, 0.1 + 3.0 * thickness),
        ] {
            let material = AnyMaterial::from(NeoHookean::of(thickness, pull));
            let operator = Operator::new(&material, &activity);
            let value = smallest(&operator, &laplacian, &u, None).unwrap().value;
            assert!((-1e-6..2e-4).contains(&(value - exact)), "{pull}: {value} {exact}");
        }
    }

    #[test]
    fn it_equals_the_result_of_inverse_iteration() {
        for (per_cell, order) in [(1, Order::Bilinear), (1, Order::Biquadratic)] {
            at(Mesh::new(per_cell, order), 0.7, |operator, laplacian, u| {
                let found = smallest(operator, laplacian, u, None).unwrap().value;
                let factors = Factorisation::new(operator, u).unwrap();
                assert_eq!(factors.negative_pivots(), 0);
                let mut x = Direction::new(operator, u, start(operator, laplacian, u, &mut laplacian.scratch()));
                for _ in 0..60 {
                    x = Direction::new(operator, u, factors.solve(&x.harmonic));
                    assert!(x.orthonormalise(&[]));
                }
                let inverse = dot(&x.vector, &x.stiff);
                assert!((found / inverse - 1.0).abs() < 1e-4, "{found} {inverse}");
            });
        }
    }

    #[test]
    fn its_sign_agrees_with_the_inertia() {
        let mut near = None;
        let mut seen = [false, false];
        for pull in [0.6, 0.8, 1.0, 1.2, 1.4] {
            at(Mesh::bilinear(1), pull, |operator, laplacian, u| {
                let found = smallest(operator, laplacian, u, near.as_ref()).unwrap();
                let positive = Factorisation::new(operator, u).unwrap().negative_pivots() == 0;
                assert_eq!(found.value > 0.0, positive, "{pull}: {}", found.value);
                let fresh = smallest(operator, laplacian, u, None).unwrap();
                assert!((fresh.value - found.value).abs() < 1e-4 * found.value.abs());
                seen[usize::from(positive)] = true;
                near = Some(found);
            });
        }
        assert_eq!(seen, [true, true]);
    }
}
