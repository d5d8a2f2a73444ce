//! Integration of stiff equations in time, with the derivatives of their solution with respect to parameters.
//!
//! A step is the collocation method of Radau with five stages, of order 9 and L-stable (Hairer, Wanner, Solving
//! Ordinary Differential Equations II, IV.5): the state is the polynomial of degree 5 whose rate agrees with the
//! equation at the nodes. Newton's matrix of the stages gives the derivatives with respect to parameters too, exactly
//! those of the discrete solution. The length of a step is chosen by the highest coefficient of the polynomial; the
//! error at the end of a step is far smaller.

use deaflow_linalg::{Mat, solve};

/// The number of stages.
const STAGES: usize = 5;
/// The nodes: the zeros of P₄ − P₅ of Legendre on (0, 1).
const NODES: [f64; STAGES] = [
    0.057_104_196_114_517_68,
    0.276_843_013_638_123_8,
    0.583_590_432_368_916_8,
    0.860_240_135_656_219_4,
    1.0,
];
/// The highest Chebyshev coefficient of a step, relative to 1 or to the state if that is larger.
const TAIL: f64 = 1e-9;
/// The last change of Newton's iteration, in the same measure.
const CONVERGED: f64 = 1e-12;
/// The most iterations of a step.
const ITERATIONS: usize = 12;
/// The most steps of one integration, refused ones included.
const STEPS: usize = 20_000;

/// The rate of a state, with its derivatives.
pub(crate) struct Slope {
    pub value: Vec<f64>,
    /// A row for each number of the state.
    pub by_state: Mat<f64>,
    pub by_parameter: Mat<f64>,
}

/// An equation ẏ = f(t, y, p).
pub(crate) trait Flow {
    /// Returns the rate; `None` where the equation has no value.
    fn slope(&self, time: f64, state: &[f64]) -> Option<Slope>;

    /// Takes note of a state at the end of a step, near which the next ones are.
    fn reached(&self, _state: &[f64]) {}
}

/// A state and its derivatives with respect to parameters.
#[derive(Clone, Debug)]
pub(crate) struct Moving {
    pub state: Vec<f64>,
    /// A row for each number of the state.
    pub by_parameter: Mat<f64>,
}

/// The method, and the length of the next step.
pub(crate) struct Integrator {
    /// ∫₀^cⱼ of the Lagrange polynomial of node l.
    weights: Mat<f64>,
    /// The Chebyshev coefficient of degree 5 as a sum of the state at the start and at the nodes.
    tail: [f64; STAGES + 1],
    step: f64,
    accuracy: f64,
}

impl Integrator {
    pub fn new() -> Self {
        Self::with_tail(TAIL)
    }

    /// Creates the method with another bound of the highest coefficient.
    pub fn with_tail(accuracy: f64) -> Self {
        let powers = Mat::from_fn(STAGES, STAGES, |q, l| NODES[l].powi(q as i32));
        let rows: Vec<Vec<f64>> = NODES
            .iter()
            .map(|node| {
                let integrals: Vec<f64> = (1..=STAGES).map(|q| node.powi(q as i32) / q as f64).collect();
                solve(&powers, &integrals)
            })
            .collect();
        let places: [f64; STAGES + 1] = std::array::from_fn(|j| if j == 0 { 0.0 } else { NODES[j - 1] });
        // T₅(2x − 1) begins with 2⁹x⁵.
        let tail = std::array::from_fn(|j| {
            let others = (0..=STAGES).filter(|m| *m != j);
            2.0_f64.powi(1 - 2 * STAGES as i32) / others.map(|m| places[j] - places[m]).product::<f64>()
        });
        Self {
            weights: Mat::from_fn(STAGES, STAGES, |j, l| rows[j][l]),
            tail,
            step: f64::INFINITY,
            accuracy,
        }
    }

    /// Integrates from one time to another; `None` if the equation has no value, or the steps become too short.
    pub fn advance(&mut self, flow: &dyn Flow, moving: &mut Moving, from: f64, to: f64) -> Option<()> {
        let mut time = from;
        for _ in 0..STEPS {
            let left = to - time;
            if left <= 0.0 {
                return Some(());
            }
            let last = self.step >= left;
            let step = if last { left } else { self.step };
            let tried = self.tried(flow, moving, time, step);
            let tail = tried.as_ref().map_or(f64::INFINITY, |(_, tail)| *tail);
            let change = 0.8 * (self.accuracy / tail).powf(1.0 / STAGES as f64);
            match tried {
                Some((next, tail)) if tail <= self.accuracy => {
                    *moving = next;
                    flow.reached(&moving.state);
                    time = if last { to } else { time + step };
                    // A step that only ends early says nothing about longer ones.
                    let longer = step * change.clamp(0.5, 4.0);
                    self.step = if last { self.step.max(longer) } else { longer };
                }
                _ => {
                    self.step = step * change.clamp(0.1, 0.5);
                    if time + self.step <= time {
                        return None;
                    }
                }
            }
        }
        None
    }

    /// Returns the end of a step and its highest coefficient; `None` if the stages are not found.
    fn tried(&self, flow: &dyn Flow, moving: &Moving, time: f64, step: f64) -> Option<(Moving, f64)> {
        let count = moving.state.len();
        let mut stages: Vec<Vec<f64>> = vec![moving.state.clone(); STAGES];
        for _ in 0..ITERATIONS {
            let slopes = NODES.iter().zip(&stages);
            let slopes: Option<Vec<Slope>> = slopes.map(|(c, state)| flow.slope(time + c * step, state)).collect();
            let slopes = slopes?;
            let system = self.system(&slopes, count, step);
            let residual = |row: usize| {
                let (j, a) = (row / count, row % count);
                let sum = (0..STAGES).map(|l| self.weights[(j, l)] * slopes[l].value[a]);
                moving.state[a] + step * sum.sum::<f64>() - stages[j][a]
            };
            let mut change: Vec<f64> = (0..STAGES * count).map(residual).collect();
            solve_all(&mut system.clone(), &mut change)?;
            let mut largest = 0.0_f64;
            for (number, change) in stages.iter_mut().flatten().zip(&change) {
                *number += change;
                largest = largest.max(change.abs() / number.abs().max(1.0));
            }
            if !largest.is_finite() {
                return None;
            }
            if largest <= CONVERGED {
                let by_parameter = self.by_parameter(system, &slopes, moving, step)?;
                let tail = self.tail(&moving.state, &stages);
                let state = stages.pop()?;
                return Some((Moving { state, by_parameter }, tail));
            }
        }
        None
    }

    /// Returns the derivative of the equations of the stages with respect to their states, row by row.
    fn system(&self, slopes: &[Slope], count: usize, step: f64) -> Vec<f64> {
        let size = STAGES * count;
        let entry = |at: usize| {
            let (row, column) = (at / size, at % size);
            let ((j, a), (l, b)) = ((row / count, row % count), (column / count, column % count));
            let one = f64::from(u8::from(row == column));
            one - step * self.weights[(j, l)] * slopes[l].by_state[(a, b)]
        };
        (0..size * size).map(entry).collect()
    }

    /// Returns the derivatives of the state at the end with respect to parameters.
    fn by_parameter(&self, mut system: Vec<f64>, slopes: &[Slope], moving: &Moving, step: f64) -> Option<Mat<f64>> {
        let (count, parameters) = (moving.state.len(), moving.by_parameter.ncols());
        let right = |at: usize| {
            let (row, p) = (at / parameters, at % parameters);
            let (j, a) = (row / count, row % count);
            let sum = (0..STAGES).map(|l| self.weights[(j, l)] * slopes[l].by_parameter[(a, p)]);
            moving.by_parameter[(a, p)] + step * sum.sum::<f64>()
        };
        let mut all: Vec<f64> = (0..STAGES * count * parameters).map(right).collect();
        solve_all(&mut system, &mut all)?;
        let last = (STAGES - 1) * count;
        Some(Mat::from_fn(count, parameters, |a, p| all[(last + a) * parameters + p]))
    }

    fn tail(&self, start: &[f64], stages: &[Vec<f64>]) -> f64 {
        let of = |a: usize| {
            let stages = self.tail[1..]
                .iter()
                .zip(stages)
                .map(|(factor, stage)| factor * stage[a]);
            let coefficient = self.tail[0] * start[a] + stages.sum::<f64>();
            coefficient.abs() / start[a].abs().max(1.0)
        };
        (0..start.len()).map(of).fold(0.0, f64::max)
    }
}

/// Replaces right sides by solutions for a small matrix, both row by row, by elimination with partial pivoting; `None`
/// if the matrix is singular.
fn solve_all(matrix: &mut [f64], right: &mut [f64]) -> Option<()> {
    let size = matrix.len().isqrt();
    let columns = right.len() / size;
    for k in 0..size {
        let pivot = (k..size).max_by(|a, b| matrix[a * size + k].abs().total_cmp(&matrix[b * size + k].abs()))?;
        if pivot != k {
            (k..size).for_each(|column| matrix.swap(k * size + column, pivot * size + column));
            (0..columns).for_each(|column| right.swap(k * columns + column, pivot * columns + column));
        }
        let (above, below) = matrix.split_at_mut((k + 1) * size);
        let (right_above, right_below) = right.split_at_mut((k + 1) * columns);
        let (above, right_above) = (&above[k * size..], &right_above[k * columns..]);
        if above[k] == 0.0 || !above[k].is_finite() {
            return None;
        }
        for (row, own) in below.chunks_exact_mut(size).zip(right_below.chunks_exact_mut(columns)) {
            let factor = row[k] / above[k];
            row[k..]
                .iter_mut()
                .zip(&above[k..])
                .for_each(|(number, by)| *number -= factor * by);
            own.iter_mut()
                .zip(right_above)
                .for_each(|(number, by)| *number -= factor * by);
        }
    }
    for k in (0..size).rev() {
        let (own, below) = right[k * columns..].split_at_mut(columns);
        for (column, own) in own.iter_mut().enumerate() {
            let known = below
                .chunks_exact(columns)
                .zip(&matrix[k * size + k + 1..(k + 1) * size]);
            let sum: f64 = known.map(|(row, factor)| factor * row[column]).sum();
            *own = (*own - sum) / matrix[k * size + k];
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::{Flow, Integrator, Moving, NODES, STAGES, Slope};
    use deaflow_linalg::Mat;

    /// The weights at the last node integrate polynomials up to degree 8.
    #[test]
    fn the_nodes_are_those_of_radau() {
        let integrator = Integrator::new();
        for q in 0..=8 {
            let sum: f64 = (0..STAGES)
                .map(|l| integrator.weights[(STAGES - 1, l)] * NODES[l].powi(q))
                .sum();
            assert!((sum * f64::from(q + 1) - 1.0).abs() < 1e-13, "{q}: {sum}");
        }
        let beyond: f64 = (0..STAGES)
            .map(|l| integrator.weights[(STAGES - 1, l)] * NODES[l].powi(9))
            .sum();
        assert!((10.0 * beyond - 1.0).abs() > 1e-6);
    }

    /// ẏ = (y_∞ − y³)/τ with a fast companion that follows y: ż = (y − z)/(10⁻⁶τ).
    struct Stiff {
        tau: f64,
    }

    impl Flow for Stiff {
        fn slope(&self, _: f64, state: &[f64]) -> Option<Slope> {
            let [y, z] = [state[0], state[1]];
            let rate = [-y * y * y / self.tau, (y - z) / (1e-6 * self.tau)];
            Some(Slope {
                value: rate.to_vec(),
                by_state: Mat::from_fn(2, 2, |i, j| {
                    [[-3.0 * y * y / self.tau, 0.0], [1e6 / self.tau, -1e6 / self.tau]][i][j]
                }),
                by_parameter: Mat::from_fn(2, 1, |i, _| -rate[i] / self.tau),
            })
        }
    }

    /// y = (1 + 2t/τ)^(−½), with its derivative.
    #[test]
    fn a_stiff_equation_is_followed_with_its_derivative() {
        let mut integrator = Integrator::new();
        let mut moving = Moving {
            state: vec![1.0, 0.0],
            by_parameter: Mat::zeros(2, 1),
        };
        let tau = 0.7;
        integrator.advance(&Stiff { tau }, &mut moving, 0.0, 5.0).unwrap();
        let known = (1.0_f64 + 10.0 / tau).powf(-0.5);
        let by_tau = 5.0 / (tau * tau) * (1.0_f64 + 10.0 / tau).powf(-1.5);
        assert!((moving.state[0] / known - 1.0).abs() < 1e-11, "{moving:?}");
        assert!((moving.by_parameter[(0, 0)] / by_tau - 1.0).abs() < 1e-10, "{moving:?}");
        assert!((moving.state[1] / known - 1.0).abs() < 1e-5);
    }
}
