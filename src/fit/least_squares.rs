//! Nonlinear least squares within bounds: the method of Levenberg and Marquardt.
//!
//! Each step solves (JᵀJ + νD)δ = −Jᵀr, where D is the largest diagonal of JᵀJ so far (Marquardt, SIAM J. Appl. Math.
//! 11 (1963) 431; Moré, Lect. Notes Math. 630 (1978) 105), so the units of the parameters do not matter. A step that
//! increases the sum of squares, or leads to parameters for which the model has no value, is refused. ν grows after a
//! step that gains less than a quarter of what the linear model predicts, and falls where it gains three quarters.
//! Parameters at a bound that would leave it do not take part in a step.

use deaflow_linalg::{Mat, solve_definite};

/// The most steps of one search.
const STEPS: usize = 500;
/// A step is negligible if it changes the residuals by less than this, relative to the parameters in the norm of D. The
/// step itself may stay larger along directions that the residuals do not determine.
const NEGLIGIBLE: f64 = 1e-12;
/// Damping that leaves a step as it is unless directions have no effect.
const SLIGHT: f64 = 1e-12;
/// A minimum is none if the linear model still promises a decrease by more than this, relative to the sum of squares.
const PROMISED: f64 = 1e-6;
/// Nor does a decrease matter that moves the parameters by less than this, in standard errors. Derivatives that are
/// differences of simulations promise such decreases without end.
const SHIFT: f64 = 0.03;
/// Relative differences of the sum of squares up to this are rounding: then the gradient tells which point is better.
const ROUNDING: f64 = 1e-13;

/// Residuals, and their derivatives in a matrix with a column for each parameter.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The residuals r.
    pub residual: Vec<f64>,
    /// J = ∂r/∂q.
    pub jacobian: Mat<f64>,
}

impl Evaluation {
    /// Returns rᵀr.
    #[must_use]
    pub fn sum_of_squares(&self) -> f64 {
        self.residual.iter().map(|r| r * r).sum()
    }

    /// Returns JᵀJ.
    #[must_use]
    pub fn gram(&self) -> Mat<f64> {
        let count = self.jacobian.ncols();
        Mat::from_fn(count, count, |i, j| {
            let products = (0..self.residual.len()).map(|row| self.jacobian[(row, i)] * self.jacobian[(row, j)]);
            products.sum()
        })
    }

    /// Returns Jᵀr.
    #[must_use]
    pub fn gradient(&self) -> Vec<f64> {
        let entry = |i: usize| {
            self.residual
                .iter()
                .enumerate()
                .map(|(row, r)| self.jacobian[(row, i)] * r)
                .sum()
        };
        (0..self.jacobian.ncols()).map(entry).collect()
    }
}

/// The smallest and largest value of each parameter.
#[derive(Clone, Debug)]
pub struct Bounds {
    /// The smallest values.
    pub lower: Vec<f64>,
    /// The largest values.
    pub upper: Vec<f64>,
}

impl Bounds {
    /// Returns the nearest point within the bounds.
    #[must_use]
    pub fn project(&self, point: &[f64]) -> Vec<f64> {
        let limits = self.lower.iter().zip(&self.upper);
        point
            .iter()
            .zip(limits)
            .map(|(q, (low, high))| q.max(*low).min(*high))
            .collect()
    }

    /// Returns whether parameter `i` is at a bound that a move in the direction of the sign of `by` would leave.
    fn blocks(&self, point: &[f64], i: usize, by: f64) -> bool {
        (point[i] <= self.lower[i] && by <= 0.0) || (point[i] >= self.upper[i] && by >= 0.0)
    }
}

/// The end of a search.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The parameters.
    pub point: Vec<f64>,
    /// The residuals there.
    pub evaluation: Evaluation,
    /// rᵀr.
    pub sum_of_squares: f64,
    /// The number of steps, refused ones included.
    pub iterations: usize,
    /// Whether the last two steps were negligible.
    settled: bool,
    /// The decrease of rᵀr that the linear model still promises.
    promised: f64,
}

impl Minimum {
    /// Returns whether the last two steps were negligible, and not because parameters without residuals are in the
    /// way. `variance` is that of the noise in the residuals.
    #[must_use]
    pub fn converged(&self, variance: f64) -> bool {
        self.settled && self.promised <= f64::max(PROMISED * self.sum_of_squares, SHIFT * SHIFT * variance)
    }
}

/// A model whose residuals have no value for some parameters.
pub type Residuals<'a> = dyn Fn(&[f64]) -> Option<Evaluation> + 'a;

/// A point of a search.
struct State {
    point: Vec<f64>,
    evaluation: Evaluation,
    sum_of_squares: f64,
    gram: Mat<f64>,
    gradient: Vec<f64>,
}

impl State {
    /// Evaluates the residuals; `None` if they have no value, or are not finite.
    fn new(residuals: &Residuals<'_>, point: Vec<f64>) -> Option<Self> {
        let evaluation = residuals(&point)?;
        let sum_of_squares = evaluation.sum_of_squares();
        sum_of_squares.is_finite().then(|| Self {
            point,
            sum_of_squares,
            gram: evaluation.gram(),
            gradient: evaluation.gradient(),
            evaluation,
        })
    }

    /// Returns |Jδ|², the change of the residuals by a step.
    fn effect(&self, step: &[f64]) -> f64 {
        let row = |i: usize| step.iter().enumerate().map(|(j, d)| self.gram[(i, j)] * d).sum::<f64>();
        step.iter().enumerate().map(|(i, d)| d * row(i)).sum()
    }

    /// Returns the squared length of the gradient in the norm of D⁻¹, without parameters that cannot move.
    fn steepness(&self, scale: &[f64], bounds: &Bounds) -> f64 {
        let terms = self.gradient.iter().zip(scale).enumerate();
        let free = terms.filter(|(i, (g, s))| **s > 0.0 && !bounds.blocks(&self.point, *i, -**g));
        free.map(|(_, (g, s))| g * g / s).sum()
    }

    /// Returns the decrease of the sum of squares by a step, divided by that of the linear model. Where the decrease is
    /// not more than rounding, the decrease of the gradient takes its place.
    fn gain(&self, step: &[f64], next: &Self, scale: &[f64], bounds: &Bounds) -> f64 {
        let decrease = self.sum_of_squares - next.sum_of_squares;
        if decrease.abs() <= ROUNDING * self.sum_of_squares {
            return 1.0 - (next.steepness(scale, bounds) / self.steepness(scale, bounds)).sqrt();
        }
        let slope: f64 = self.gradient.iter().zip(step).map(|(g, d)| g * d).sum();
        decrease / (2.0 * slope + self.effect(step)).abs()
    }
}

/// Returns the local minimum of rᵀr that a search from `start` ends at; `None` if there are no residuals at the start.
#[must_use]
pub fn minimise(residuals: &Residuals<'_>, start: &[f64], bounds: &Bounds) -> Option<Minimum> {
    let mut state = State::new(residuals, bounds.project(start))?;
    let mut scale = vec![0.0_f64; start.len()];
    let mut damping = 1e-3;
    let (mut iterations, mut negligible) = (0, 0);
    while iterations < STEPS && negligible < 2 {
        iterations += 1;
        for (i, largest) in scale.iter_mut().enumerate() {
            *largest = largest.max(state.gram[(i, i)]);
        }
        let Some(step) = damped_step(&state, &scale, damping, bounds) else {
            damping *= 4.0;
            continue;
        };
        let moved: Vec<f64> = state.point.iter().zip(&step).map(|(q, d)| q + d).collect();
        let moved = bounds.project(&moved);
        let step: Vec<f64> = moved.iter().zip(&state.point).map(|(new, old)| new - old).collect();
        let extent: f64 = scale.iter().zip(&state.point).map(|(s, q)| s * q * q).sum();
        let small = state.effect(&step) <= NEGLIGIBLE * NEGLIGIBLE * extent;
        negligible = if small { negligible + 1 } else { 0 };
        let next = State::new(residuals, moved);
        let gain = next
            .as_ref()
            .map_or(-1.0, |next| state.gain(&step, next, &scale, bounds));
        if gain > 0.75 {
            damping = f64::max(damping / 9.0, 1e-15);
        } else if gain.is_nan() || gain < 0.25 {
            damping *= 4.0;
        }
        if let Some(next) = next.filter(|_| gain > 0.0) {
            state = next;
        }
    }
    Some(Minimum {
        settled: negligible >= 2,
        promised: promised(&state, &scale, bounds),
        point: state.point,
        evaluation: state.evaluation,
        sum_of_squares: state.sum_of_squares,
        iterations,
    })
}

/// Returns the decrease of the sum of squares that the linear model promises to a search which has ended.
fn promised(state: &State, scale: &[f64], bounds: &Bounds) -> f64 {
    let Some(step) = damped_step(state, scale, SLIGHT, bounds) else {
        return 0.0;
    };
    let moved: Vec<f64> = state.point.iter().zip(&step).map(|(q, d)| q + d).collect();
    let moved = bounds.project(&moved);
    let step: Vec<f64> = moved.iter().zip(&state.point).map(|(new, old)| new - old).collect();
    let slope: f64 = state.gradient.iter().zip(&step).map(|(g, d)| g * d).sum();
    -(2.0 * slope + state.effect(&step))
}

/// Returns the step of the parameters that can move; `None` if the system is singular to working precision.
fn damped_step(state: &State, scale: &[f64], damping: f64, bounds: &Bounds) -> Option<Vec<f64>> {
    let State {
        point, gram, gradient, ..
    } = state;
    let count = point.len();
    let free: Vec<usize> = (0..count)
        .filter(|&i| scale[i] > 0.0 && !bounds.blocks(point, i, -gradient[i]))
        .collect();
    let mut step = vec![0.0; count];
    if free.is_empty() {
        return Some(step);
    }
    let system = Mat::from_fn(free.len(), free.len(), |a, b| {
        let (i, j) = (free[a], free[b]);
        let entry = gram[(i, j)] / (scale[i] * scale[j]).sqrt();
        if a == b { entry + damping } else { entry }
    });
    let right: Vec<f64> = free.iter().map(|&i| -gradient[i] / scale[i].sqrt()).collect();
    let solution = solve_definite(&system, &right)?;
    for (&i, value) in free.iter().zip(solution) {
        step[i] = value / scale[i].sqrt();
    }
    step.iter().all(|d| d.is_finite()).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::{Bounds, Evaluation, minimise};
    use deaflow_linalg::Mat;

    /// Rosenbrock's function, with no value beyond a circle.
    fn rosenbrock(q: &[f64]) -> Option<Evaluation> {
        (q[0].hypot(q[1]) < 3.0).then(|| Evaluation {
            residual: vec![10.0 * (q[1] - q[0] * q[0]), 1.0 - q[0]],
            jacobian: Mat::from_fn(2, 2, |i, j| [[-20.0 * q[0], 10.0], [-1.0, 0.0]][i][j]),
        })
    }

    fn within(lower: [f64; 2], upper: [f64; 2]) -> Bounds {
        Bounds {
            lower: lower.to_vec(),
            upper: upper.to_vec(),
        }
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_end() {
        let end = minimise(&rosenbrock, &[-1.2, 1.0], &within([-9.0; 2], [9.0; 2])).unwrap();
        assert!(end.converged(0.0) && end.iterations < 60, "{end:?}");
        assert!(
            (end.point[0] - 1.0).abs() < 1e-12 && (end.point[1] - 1.0).abs() < 1e-12,
            "{end:?}"
        );
        assert!(minimise(&rosenbrock, &[4.0, 4.0], &within([-9.0; 2], [9.0; 2])).is_none());
    }

    /// The sum of squares falls up to the edge of q ≤ 1, beyond which there are no residuals.
    #[test]
    fn an_edge_is_no_minimum() {
        let edge = |q: &[f64]| {
            (q[0] <= 1.0).then(|| Evaluation {
                residual: vec![2.0 - q[0]],
                jacobian: Mat::from_fn(1, 1, |_, _| -1.0),
            })
        };
        let bounds = Bounds {
            lower: vec![-9.0],
            upper: vec![9.0],
        };
        let end = minimise(&edge, &[0.0], &bounds).unwrap();
        assert!(!end.converged(0.1) && (end.point[0] - 1.0).abs() < 1e-6, "{end:?}");
    }

    /// On the edge q₀ = ½ the minimum is at q₁ = ¼.
    #[test]
    fn a_bound_holds() {
        let end = minimise(&rosenbrock, &[-1.2, 1.0], &within([-9.0; 2], [0.5, 9.0])).unwrap();
        assert!(
            end.converged(0.0) && end.point[0] == 0.5 && (end.point[1] - 0.25).abs() < 1e-12,
            "{end:?}"
        );
    }
}
