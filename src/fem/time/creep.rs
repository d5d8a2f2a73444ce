//! Estimates creep from three equilibria instead of all time steps.
//!
//! A slow branch stiffens the membrane like an additional energy ½γ(A : c + A₃₃ j⁻²) with the A of rest. The equilibria
//! u(γ) under a step of voltage are well described by u(γ) = Σ Wⱼ/(1 + γθⱼ) with the same poles θⱼ for all patterns,
//! and each of these terms creeps like a scalar: u(t) = Σ Wⱼ eⱼ(t) with
//!
//! ```text
//! e + θ Σ gₖ (e − xₖ) = 1,   ẋₖ = (e − xₖ)/τₖ,   xₖ(0) = 0.
//! ```
//!
//! Three equilibria, at γ = 0, Γ/4 and Γ with the sum Γ of all g, give the three W, so u(t) is a weighted sum of them.

use deaflow_linalg::{Mat, solve};

use crate::error::SetupError;
use crate::evaluator::{Solver, SolverParameters};
use crate::gradient_evaluator::GradientEvaluator;
use deaflow_field::{Evaluator, Weighted};
use deaflow_scene::{Scene, ViscousLaw};

/// The poles θ. Of all sets of three they give the smallest root mean square error over random blocks, discs and half
/// planes at 3 to 6 kV with four sets of branches whose 4Γ is 0.4 to 3: docs/time.md.
const POLES: [f64; 3] = [1.0, 3.0, 6.7];
/// The values of γ of the equilibria, over Γ.
const SHARES: [f64; 3] = [0.0, 0.25, 1.0];
/// Weights below this count as zero.
const NOTHING: f64 = 1e-12;

/// The equilibria whose weighted sum is the state at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct ThreeSolves {
    /// γ of each, in units of μλp².
    pub stiffnesses: Vec<f64>,
    /// Their weights.
    pub weights: Vec<f64>,
}

impl ThreeSolves {
    /// Computes the weights for a time in s since the voltage was applied.
    ///
    /// # Errors
    /// When the voltage does not rise at once, the prestretch has not relaxed, or the scene has inertia, the finite
    /// viscous law, or stiff electrodes and sides that are not held.
    pub fn new(scene: &Scene, time_s: f64) -> Result<Self, SetupError> {
        let refused = |why: &'static str| Err(SetupError::ThreeSolves { why });
        if scene.drive.charge.is_some() {
            return refused("the drive is a `charge`; give a voltage");
        }
        if scene.waveform().step.is_none() {
            return refused("the drive has a `waveform`; give a constant voltage");
        }
        if scene.drive.source.is_some() {
            return refused("the drive has a `source`");
        }
        if scene.effects.electrode_resistance.is_some() {
            return refused("the scene has `electrode_resistance`");
        }
        if scene.drive.rest.is_some() {
            return refused("the drive has a `rest`; the prestretch must have relaxed");
        }
        if scene.effects.inertia.is_some() {
            return refused("the scene has `inertia`");
        }
        if scene.geometry.sides.is_some() && scene.effects.electrode_stiffness.is_some() {
            return refused("the scene has `electrode_stiffness`, and not all `sides` are held");
        }
        let Some(effect) = &scene.effects.viscoelasticity else {
            return refused("the scene has no `viscoelasticity`");
        };
        if effect.law != ViscousLaw::Linear {
            return refused("the viscous law must be linear");
        }
        let unit = scene.shear_modulus_pa() * scene.mean_prestretch().powi(2);
        let mut branches: Vec<Branch> = effect
            .branches
            .iter()
            .map(|branch| Branch {
                modulus: branch.modulus.value() / unit,
                time: branch.time.value(),
            })
            .filter(|branch| branch.modulus > 0.0)
            .collect();
        branches.sort_by(|a, b| a.time.total_cmp(&b.time));
        branches.dedup_by(|later, earlier| {
            let same = later.time == earlier.time;
            if same {
                earlier.modulus += later.modulus;
            }
            same
        });
        let sum: f64 = branches.iter().map(|branch| branch.modulus).sum();
        if sum == 0.0 {
            return Ok(Self {
                stiffnesses: vec![0.0],
                weights: vec![1.0],
            });
        }
        let matrix = Mat::from_fn(3, 3, |pole, share| 1.0 / (1.0 + sum * SHARES[share] * POLES[pole]));
        let creep = POLES.map(|pole| crept(pole, &branches, time_s));
        let weights = solve(&matrix, &creep);
        let (shares, weights) = (0..3)
            .map(|share| (sum * SHARES[share], weights[share]))
            .filter(|(_, weight)| weight.abs() > NOTHING)
            .unzip();
        Ok(Self {
            stiffnesses: shares,
            weights,
        })
    }

    /// Returns an evaluator of the fields at that time, with a solver of equilibria or an estimate of them.
    ///
    /// # Errors
    /// When an evaluator cannot be set up.
    pub fn evaluator(
        &self,
        scene: &Scene,
        parameters: &SolverParameters,
    ) -> Result<Weighted<Box<dyn Evaluator>>, SetupError> {
        let each = self.stiffnesses.iter().map(|&stiffness| {
            let solver = Solver::with_unrelaxed(scene, parameters, stiffness)?;
            Ok(Box::new(solver) as Box<dyn Evaluator>)
        });
        let each = each.collect::<Result<_, SetupError>>()?;
        Ok(Weighted::new(each, self.weights.clone(), settings(parameters)))
    }

    /// Returns the same evaluator with the derivative with respect to the pattern.
    ///
    /// # Errors
    /// When the scene cannot be simulated.
    pub fn gradient(&self, scene: &Scene) -> Result<Weighted<Box<GradientEvaluator>>, SetupError> {
        let each = self.stiffnesses.iter();
        let each = each.map(|&stiffness| GradientEvaluator::with_unrelaxed(scene, stiffness).map(Box::new));
        Ok(Weighted::new(
            each.collect::<Result<_, _>>()?,
            self.weights.clone(),
            "creep:3".to_owned(),
        ))
    }
}

/// Returns the settings of a solver with this rule as its method: `creep:3`, or with estimates `creep:3+chord:2`.
#[must_use]
pub fn settings(parameters: &SolverParameters) -> String {
    parameters.settings_in_time("creep:3")
}

/// A branch in the units of the membrane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Branch {
    /// g.
    modulus: f64,
    /// τ in s.
    time: f64,
}

/// Returns e(t) at a pole: 1 minus a decaying exponential for each branch, with one retardation time between two
/// relaxation times and one beyond the last. `branches` are sorted by their times, which are distinct.
fn crept(pole: f64, branches: &[Branch], time_s: f64) -> f64 {
    let each = branches.iter().enumerate().map(|(at, own)| {
        // ρ = (1 + d) τ: the d at which Σ θgτ/(ρ − τ) falls to 1.
        let next = branches.get(at + 1).map(|next| next.time / own.time - 1.0);
        let highest = next.unwrap_or_else(|| 2.0 * pole * branches.iter().map(|branch| branch.modulus).sum::<f64>());
        let others = |d: f64| -> f64 {
            let other = branches.iter().enumerate().filter(|(k, _)| *k != at);
            let terms = other.map(|(_, other)| {
                let gap = (1.0 + d) * own.time - other.time;
                pole * other.modulus * other.time / gap
            });
            terms.sum()
        };
        let (mut low, mut high) = (1e-30 * highest, highest);
        for _ in 0..200 {
            let middle = (low * high).sqrt();
            match pole * own.modulus / middle + others(middle) > 1.0 {
                true => low = middle,
                false => high = middle,
            }
        }
        let d = (low * high).sqrt();
        let retardation = (1.0 + d) * own.time;
        let slope: f64 = branches
            .iter()
            .enumerate()
            .map(|(k, branch)| {
                let off = if k == at {
                    d / (1.0 + d)
                } else {
                    1.0 - branch.time / retardation
                };
                pole * branch.modulus * branch.time / (off * off)
            })
            .sum();
        retardation / slope * (-time_s / retardation).exp()
    });
    1.0 - each.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::square_of_ten;
    use crate::time::{HistoryOptions, HistoryRequest, HistorySolver};
    use deaflow_field::{Differentiable, Field, Mesh, Predictor};
    use deaflow_pattern::{Pattern, Raster};

    fn branches(each: &[(f64, f64)]) -> Vec<Branch> {
        each.iter().map(|&(modulus, time)| Branch { modulus, time }).collect()
    }

    #[test]
    fn a_scalar_creeps_from_its_instant_to_its_equilibrium() {
        // One branch: e = 1 − θg/(1 + θg) e^(−t/(τ(1 + θg))).
        for (pole, g, tau, t) in [(2.9, 0.4, 3.0, 5.0), (1.0, 1e-6, 1.0, 0.2), (5.9, 10.0, 1e-9, 1e-8)] {
            let exact = 1.0 - pole * g / (1.0 + pole * g) * f64::exp(-t / (tau * (1.0 + pole * g)));
            let found = crept(pole, &branches(&[(g, tau)]), t);
            assert!((found - exact).abs() < 1e-12, "{found} {exact}");
        }
        // Many, over twelve decades: the instantaneous and the relaxed state, and time steps of the equations in
        // between.
        let many = branches(&[(0.2, 1e-6), (0.1, 1e-3), (0.3, 1.0), (0.05, 1e6)]);
        let sum: f64 = many.iter().map(|branch| branch.modulus).sum();
        assert!((crept(2.9, &many, 0.0) - 1.0 / (1.0 + 2.9 * sum)).abs() < 1e-12);
        assert!((crept(2.9, &many, 1e9) - 1.0).abs() < 1e-12);
        let two = branches(&[(0.3, 1.0), (0.2, 4.0)]);
        let (mut x, steps) = ([0.0; 2], 200_000);
        let e = |x: [f64; 2]| (1.0 + 2.9 * (0.3 * x[0] + 0.2 * x[1])) / (1.0 + 2.9 * 0.5);
        for _ in 0..steps {
            let h = 3.0 / f64::from(steps);
            let rate = |x: [f64; 2]| [e(x) - x[0], (e(x) - x[1]) / 4.0];
            let half = [0, 1].map(|k| x[k] + 0.5 * h * rate(x)[k]);
            x = [0, 1].map(|k| x[k] + h * rate(half)[k]);
        }
        assert!((crept(2.9, &two, 3.0) - e(x)).abs() < 1e-9);
    }

    fn scene(more: &str) -> Scene {
        let effects =
            "viscoelasticity: { branches: [{ modulus: 60 kPa, time: 1 s }, { modulus: 30 kPa, time: 10 s }] }";
        square_of_ten(&format!("voltage: 5 kV{more}"), effects, "")
    }

    fn odd() -> Pattern {
        Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| (x * 7 + y * 3) % 5 < 2)
    }

    #[test]
    fn three_solves_stand_for_all_steps() {
        let (scene, mesh) = (scene(""), Mesh::bilinear(1));
        let times = vec![0.0, 0.3, 2.0, 30.0, 1e5];
        let options = HistoryOptions {
            mesh: Some(mesh),
            tolerance: 1e-10,
        };
        let request = HistoryRequest::at(times.clone());
        let full = HistorySolver::new(&scene, &options, request).unwrap();
        let full = full.follow(&odd()).unwrap().history;
        let largest = full.fields.iter().map(Field::max_magnitude).fold(0.0, f64::max);
        let parameters = SolverParameters::new(crate::Method::Newton, mesh);
        for (time, field) in times.iter().zip(&full.fields) {
            let rule = ThreeSolves::new(&scene, *time).unwrap();
            let found = rule.evaluator(&scene, &parameters).unwrap();
            let found = found.predict(&[odd()]).unwrap().remove(0);
            let error = found.max_difference(field) / largest;
            // At the start and the end they are exact except for the time steps.
            let bound = if [0.0, 1e5].contains(time) { 5e-5 } else { 5e-3 };
            assert!(error < bound, "{time} s: {error:e}");
        }
    }

    #[test]
    fn the_derivative_by_the_pattern_is_that_of_the_sum() {
        let scene = scene("");
        let rule = ThreeSolves::new(&scene, 2.0).unwrap();
        assert_eq!(rule.weights.len(), 3);
        let physics = rule.gradient(&scene).unwrap();
        let sum = |field: &Field| {
            field
                .values()
                .iter()
                .enumerate()
                .map(|(k, u)| weight(k) * u)
                .sum::<f64>()
        };
        let slope = |field: &Field| {
            let values = (0..field.values().len()).map(weight).collect();
            Field::from_values(field.raster(), values).unwrap()
        };
        let (field, gradient) = physics.gradient(&odd(), &slope).unwrap().unwrap();
        assert_eq!(field, physics.predict(&[odd()]).unwrap()[0]);
        // For each cell by its own equilibria: the gradient is with respect to the activity of a cell, and exchanging
        // one is not a small change, but all agree in sign and size.
        let off: Vec<usize> = (0..100).filter(|at| !odd().is_active(at % 10, at / 10)).collect();
        let (mut along, mut sizes) = (0.0, [0.0, 0.0]);
        for at in off.into_iter().step_by(7) {
            let more = Pattern::from_fn(odd().raster(), |x, y| odd().is_active(x, y) || y * 10 + x == at);
            let gained = sum(&physics.predict(&[more]).unwrap()[0]) - sum(&field);
            along += gained * gradient[at];
            sizes = [sizes[0] + gained * gained, sizes[1] + gradient[at] * gradient[at]];
        }
        let likeness = along / (sizes[0] * sizes[1]).sqrt();
        assert!(likeness > 0.98, "{likeness}");
        let ratio = (sizes[0] / sizes[1]).sqrt();
        assert!(ratio > 0.5 && ratio < 2.0, "{ratio}");
    }

    fn weight(k: usize) -> f64 {
        ((k * 37 % 101) as f64 - 50.0) / 50.0
    }

    #[test]
    fn what_three_solves_cannot_tell_is_refused() {
        for (more, said) in [
            (", waveform: { ramp: { time: 1 s } }", "`waveform`"),
            (", rest: 1 h", "`rest`"),
        ] {
            let refused = ThreeSolves::new(&scene(more), 1.0).unwrap_err();
            assert!(refused.to_string().contains(said), "{refused}");
        }
        let plain = Scene::vhb4910();
        assert!(ThreeSolves::new(&plain, 1.0).is_err());
    }
}
