//! The derivative of an amplitude at a frequency with respect to the activity of cells.
//!
//! With the equilibrium R(u, S) = 0 and the response D(u, S) û = F(u, S), a real sum J = Re(e^(−iθ) w · û) with the
//! phase θ of w · û is its amplitude |w · û|, and changes with θ to second order. With Dλ = e^(−iθ) w, G(u, S) = Re(λ ·
//! (F − Dû)) at fixed λ and û, and Kμ = ∂G/∂u,
//!
//! ```text
//! dJ/dS = ∂G/∂S − μ · ∂R/∂S
//! ```
//!
//! Derivatives of tangents along a direction are second differences of residuals: v · K(u) v changes with u by the
//! second derivative of R along v, and forms of two directions are those of their sum and difference.

use super::frequency::{FrequencySolver, LOAD_DIFFERENCE, ResponseProblem};
use crate::adjoint::of_cells;
use crate::dynamic_stiffness::Solved;
use crate::effects::WithMaterial;
use crate::eigenvalue::{add, dot};
use crate::material::Material;
use crate::newton::largest;
use crate::operator::Operator;
use deaflow_field::Field;
use deaflow_pattern::Pattern;

/// The largest entry of a direction for differentiating a residual, in units of elements: its square is the truncation
/// error, and 10⁻¹⁶ over it the rounding.
const STEP: f64 = 1e-3;

/// A response in mm/V, and the derivative of the amplitude of a weighted sum of it.
pub struct Differentiated {
    /// The part in phase with the voltage, and the part a quarter of a period ahead.
    pub parts: [Field; 2],
    /// The derivative of the amplitude by the activity of each cell, `[y][x]`, per V.
    pub of_cells: Vec<f64>,
}

impl FrequencySolver {
    /// Returns the response at a frequency in Hz with the derivative of the amplitude of a weighted sum of
    /// displacements in mm; `None` without an equilibrium or an amplitude. Rigid bodies are not supported.
    pub(super) fn differentiate(&self, pattern: &Pattern, frequency: f64, weights: &Field) -> Option<Differentiated> {
        let Self { solver, .. } = self;
        let solution = solver.solve(pattern);
        if !solution.outcome.is_converged() {
            return None;
        }
        solver.model.with(Differentiate {
            about: ResponseProblem {
                solver: self,
                activity: &solver.model.activity(&solver.grid, pattern),
                u: &solution.displacement,
            },
            frequency,
            weights,
        })
    }
}

struct Differentiate<'a> {
    about: ResponseProblem<'a>,
    frequency: f64,
    weights: &'a Field,
}

impl WithMaterial for Differentiate<'_> {
    type Output = Option<Differentiated>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<Differentiated> {
        let ResponseProblem { solver, activity, u } = self.about;
        let equations = self.about.equations(&material)?;
        let (matrices, probe) = (&equations.matrices, &equations.probe);
        let grid = &solver.solver.grid;
        let parts = |solved: Solved| match solved {
            Solved::Response(parts) => Some(parts.map(|part| equations.unpack(&part))),
            Solved::Resonance => None,
        };
        let at = solver.at(self.frequency);
        let per_volt = solver.per_volt();
        let load = grid.spread(self.weights, u);
        let [response, adjoint] = matrices.solve_each(at, [&equations.forces, &equations.pack(&load)], probe)?;
        let (response, [real, imaginary]) = (parts(response)?, parts(adjoint)?);
        let (sine, cosine) = {
            let sums = response.each_ref().map(|part| dot(&load, part));
            sums[1].atan2(sums[0]).sin_cos()
        };
        let adjoint = [
            combined(cosine, &real, sine, &imaginary),
            combined(cosine, &imaginary, -sine, &real),
        ];
        let law = material(1.0);
        let static_operator = Operator::new(&law, activity);
        let mut forced = Forced {
            operator: &static_operator,
            u,
            at_rest: residual(&static_operator, u),
            sum: vec![0.0; u.len()],
        };
        // The derivative of F, which is linear in the load.
        for (share, sign) in [(1.0 - LOAD_DIFFERENCE, 1.0), (1.0 + LOAD_DIFFERENCE, -1.0)] {
            let material = &material(share);
            let operator = Operator::new(material, activity);
            let mut image = vec![0.0; u.len()];
            operator.tangent(u, &adjoint[0], &mut image);
            add(&mut forced.sum, sign * per_volt / (2.0 * LOAD_DIFFERENCE), &image);
        }
        let [lr, li] = adjoint.each_ref().map(Vec::as_slice);
        let [ur, ui] = response.each_ref().map(Vec::as_slice);
        forced.elastic(-1.0, lr, ur);
        forced.elastic(1.0, li, ui);
        let [slow, fast] = at.viscous;
        for (share, v, w) in [(-slow, lr, ur), (slow, li, ui), (fast, lr, ui), (fast, li, ur)] {
            forced.viscous(share, v, w);
        }
        let still = matrices.solve(solver.at(0.0), &equations.pack(&forced.sum), probe)?;
        let [mu, _] = parts(still)?;
        let mut of = of_cells(&static_operator, u, &mu);
        add(&mut of, per_volt, &of_cells(&static_operator, u, lr));
        for (sign, along, psi) in [(1.0, ur, lr), (-1.0, ui, li)] {
            let size = largest(along);
            if size == 0.0 {
                continue;
            }
            let step = STEP / size;
            for side in [1.0, -1.0] {
                let moved = combined(1.0, u, side * step, along);
                add(
                    &mut of,
                    side * sign / (2.0 * step),
                    &of_cells(&static_operator, &moved, psi),
                );
            }
        }
        Some(Differentiated {
            parts: response.map(|part| grid.sample(&part)),
            of_cells: of.iter().map(|value| value * grid.unit_mm()).collect(),
        })
    }
}

/// The derivative of G with respect to u.
struct Forced<'a, L> {
    operator: &'a Operator<'a, L>,
    u: &'a [f64],
    at_rest: Vec<f64>,
    sum: Vec<f64>,
}

impl<L: Material> Forced<'_, L> {
    /// Adds a multiple of the derivative of v · K w.
    fn elastic(&mut self, share: f64, v: &[f64], w: &[f64]) {
        let (operator, u, at_rest) = (self.operator, self.u, &self.at_rest);
        let second = |v: &[f64]| {
            let [more, less] = [STEP, -STEP].map(|step| residual(operator, &combined(1.0, u, step, v)));
            let both = combined(1.0, &more, 1.0, &less);
            combined(STEP.powi(-2), &both, -2.0 * STEP.powi(-2), at_rest)
        };
        of_two(&mut self.sum, share, (v, w), second);
    }

    /// Adds a multiple of the derivative of v · K_A w.
    fn viscous(&mut self, share: f64, v: &[f64], w: &[f64]) {
        if share == 0.0 {
            return;
        }
        let (operator, u) = (self.operator, self.u);
        let change = |v: &[f64]| {
            let mut change = vec![0.0; v.len()];
            operator.relaxed_tangent_derivative(u, v, &mut change);
            change
        };
        of_two(&mut self.sum, share, (v, w), change);
    }
}

/// Adds a multiple of a symmetric form of two vectors, from the quadratic form.
fn of_two(sum: &mut [f64], share: f64, (v, w): (&[f64], &[f64]), of: impl Fn(&[f64]) -> Vec<f64>) {
    let (first, second) = (largest(v), largest(w));
    if first == 0.0 || second == 0.0 {
        return;
    }
    let size = 0.25 * share * first * second;
    for sign in [1.0, -1.0] {
        let both = combined(first.recip(), v, sign * second.recip(), w);
        add(sum, sign * size, &of(&both));
    }
}

fn residual<L: Material>(operator: &Operator<'_, L>, u: &[f64]) -> Vec<f64> {
    let mut residual = vec![0.0; u.len()];
    operator.residual(u, &mut residual);
    residual
}

fn combined(p: f64, a: &[f64], q: f64, b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| p * a + q * b).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::continuation::LoadingEnd;
    use crate::operator::Activity;
    use crate::solver::SolveOptions;
    use crate::tests::square_of_ten;
    use crate::work::WorkLimit;
    use deaflow_base::Stream;
    use deaflow_field::Mesh;
    use deaflow_pattern::Raster;
    use deaflow_scene::Scene;

    fn scene(effects: &str) -> Scene {
        square_of_ten("voltage: 5 kV", effects, ", properties: { density: 960 }")
    }

    fn weights() -> Field {
        let mut values = vec![0.0; 2 * 11 * 11];
        values[2 * (5 * 11 + 5)] = 0.5;
        values[2 * (7 * 11 + 3) + 1] = -0.7;
        Field::from_values(Raster::new(10, 10).unwrap(), values).unwrap()
    }

    /// The amplitude with any activity of cells, solved to rounding, and its derivative.
    struct Amplitude<'a> {
        solver: &'a FrequencySolver,
        shares: &'a [f64],
        frequency: f64,
    }

    impl WithMaterial for Amplitude<'_> {
        type Output = (f64, Vec<f64>);

        fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> (f64, Vec<f64>) {
            let solver = &self.solver.solver;
            let activity = Activity::from_shares(&solver.grid, |x, y| self.shares[10 * y + x]);
            let mut u = vec![0.0; solver.grid.layout().vector_len()];
            let problem = solver.problem(&activity, &material);
            assert_eq!(problem.load(&mut u, &mut solver.workspace()).ending, LoadingEnd::Stable);
            let weights = weights();
            let found = Differentiate {
                about: ResponseProblem {
                    solver: self.solver,
                    activity: &activity,
                    u: &u,
                },
                frequency: self.frequency,
                weights: &weights,
            };
            let Differentiated { parts, of_cells } = found.run(&material).unwrap();
            let sums = parts.map(|part| dot(weights.values(), part.values()));
            (sums[0].hypot(sums[1]), of_cells)
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let branches =
            "viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }, { modulus: 20 kPa, time: 20 ms }] }";
        let both = format!("{branches}, inertia: {{}}");
        let stiff = format!("{branches}, strain_stiffening: {{ model: gent, jm: 120 }}");
        for (effects, frequency) in [(branches, 0.3), (&both, 150.0), ("inertia: {}", 400.0), (&stiff, 2.0)] {
            let options = SolveOptions {
                mesh: Mesh::bilinear(1),
                tolerance: 1e-12,
            };
            let solver = FrequencySolver::new(&scene(effects), options, WorkLimit::default()).unwrap();
            let mut stream = Stream::new(5, "amplitude test", 0);
            let shares: Vec<f64> = (0..100).map(|_| f64::from(u8::from(stream.chance(0.5)))).collect();
            let found = |shares: &[f64]| {
                solver.solver.model.with(Amplitude {
                    solver: &solver,
                    shares,
                    frequency,
                })
            };
            let (_, gradient) = found(&shares);
            let scale = largest(&gradient);
            for cell in [0, 9, 34, 55, 78] {
                let at = |by: f64| {
                    let mut moved = shares.clone();
                    moved[cell] += by;
                    found(&moved).0
                };
                let step = 1e-3;
                let slope = (8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step))) / (12.0 * step);
                assert!(
                    (gradient[cell] - slope).abs() < 1e-5 * scale,
                    "{effects} at {frequency} Hz, cell {cell}: {} {slope}, largest {scale}",
                    gradient[cell]
                );
            }
        }
    }
}
