//! The half-active strip in closed form, to first order: the values above which missing material data would be
//! significant.
//!
//! Half of a membrane is active and moves along one direction only, from the state at rest with the stretches λ₁ along
//! it, λ₂ across and λ₃ = 1/λ₁λ₂. In units of μλ₁² per undeformed volume each half has the stiffness C = 1 + 3λ₃²/λ₁²,
//! and the voltage subtracts b = κλ₂² from that of the active one: the displacement is proportional to b/(2C − b). Of
//! both directions that one counts in which the effect matters more.

use super::effect::SMALL;
use crate::solver::{MembraneSolver, SolveOptions};
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// The strips of a scene along both directions.
pub struct Strips([Strip; 2]);

/// A strip.
struct Strip {
    /// λ₁.
    along: f64,
    /// λ₃.
    thickness: f64,
    /// λ₂.
    across: f64,
    /// λ₁² over λp².
    growth: f64,
    /// C.
    stiffness: f64,
    /// b.
    load: f64,
}

impl Strips {
    pub fn new(scene: &Scene) -> Self {
        let mount = scene.mean_prestretch();
        let [one, other] = stretches_at_rest(scene).unwrap_or([mount; 2]);
        Self([[one, other], [other, one]].map(|stretches| Strip::new(scene, stretches)))
    }

    /// Returns Jm of Gent's law below which strain stiffening is significant.
    pub fn significant_jm(&self) -> f64 {
        self.0.iter().map(Strip::significant_jm).fold(0.0, f64::max)
    }

    /// Returns χ above which stiff electrodes are significant.
    pub fn significant_electrode(&self) -> f64 {
        self.0
            .iter()
            .map(Strip::significant_electrode)
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns s above which a decreasing permittivity is significant, if it was measured on the prestretched membrane.
    pub fn significant_decay(&self) -> f64 {
        self.0
            .iter()
            .map(Strip::significant_decay)
            .fold(f64::INFINITY, f64::min)
    }
}

/// Returns the mean stretches without voltage where not all sides are held, the larger one first; `None` where all are,
/// or without a stable state.
fn stretches_at_rest(scene: &Scene) -> Option<[f64; 2]> {
    scene.geometry.sides.as_ref()?;
    let at_rest = scene.at_voltage(0.0).with_effects(scene.effects.clone());
    let solver = MembraneSolver::new(&at_rest, SolveOptions::on(Mesh::bilinear(1))).ok()?;
    let bare = Pattern::from_fn(at_rest.membrane().raster, |_, _| false);
    let solution = solver.solve(&bare);
    let states = solver.cell_states(&bare, &solution);
    let mean = |at: usize| states.iter().map(|state| state.stretches[at]).sum::<f64>() / states.len() as f64;
    let is_known = solution.outcome.is_converged() && !states.is_empty();
    is_known.then(|| [mean(0), mean(1)])
}

impl Strip {
    fn new(scene: &Scene, [along, across]: [f64; 2]) -> Self {
        let thickness = 1.0 / (along * across);
        Self {
            along,
            thickness,
            across,
            growth: (along / scene.mean_prestretch()).powi(2),
            stiffness: 1.0 + 3.0 * (thickness / along).powi(2),
            load: scene.kappa() * across.powi(2),
        }
    }

    /// Returns 2C − b, with a lower bound where the strip is unstable.
    fn remaining(&self) -> f64 {
        let both = 2.0 * self.stiffness;
        (both - self.load).max(0.1 * both)
    }

    /// With I₁ along the strip, I′ = 2λ₁² − 2λ₃² and I″ = 2λ₁² + 6λ₃², both halves are stiffer by C (I₁ − 3 +
    /// I′²/I″)/Jm.
    fn significant_jm(&self) -> f64 {
        let [along, across, thickness] = [self.along, self.across, self.thickness].map(|stretch| stretch.powi(2));
        let invariant = along + across + thickness - 3.0;
        let (first, second) = (2.0 * (along - thickness), 2.0 * along + 6.0 * thickness);
        let rise = 2.0 * self.stiffness * (invariant + first * first / second);
        rise / (SMALL * self.remaining())
    }

    /// The active half is stiffer by 4χ, per mounted area.
    fn significant_electrode(&self) -> f64 {
        SMALL * self.remaining() * self.growth / 4.0
    }

    /// b decreases by s/2, and what it subtracts from the stiffness by 3s/2.
    fn significant_decay(&self) -> f64 {
        SMALL / (0.5 + 1.5 * self.load / self.remaining())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jm(geometry: &str) -> f64 {
        let scene = Scene::from_text(&format!(
            "geometry: {{ size: [40 mm, 10 mm], thickness: 1 mm, cells: [20, 5], {geometry} }}\nmaterial: {{ model: \
             neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}\ndrive: {{ voltage: 4 kV }}\neffects: {{}}"
        ));
        Strips::new(&scene.unwrap()).significant_jm()
    }

    #[test]
    fn a_strip_under_a_dead_load_is_judged_by_its_state_at_rest() {
        // The stretch under 0.5 N on 10 mm², by Newton's method: λ − λ⁻² = 0.5/(0.045·10).
        let stress: f64 = 0.5 / (0.045 * 10.0);
        let mut along: f64 = 1.5;
        for _ in 0..50 {
            along -= (along - along.powi(-2) - stress) / (1.0 + 2.0 * along.powi(-3));
        }
        let square = along * along;
        let third = 1.0 / along;
        let stiffness = 1.0 + 3.0 * third / square;
        let kappa = 4.7 * 8.854_187_812_8e-12 * 16e6 / (45e3 * 1e-6);
        let first = 2.0 * (square - third);
        let rise = square + 2.0 * third - 3.0 + first * first / (2.0 * square + 6.0 * third);
        let expected = 2.0 * stiffness * rise / (0.02 * (2.0 * stiffness - kappa * third));
        let loaded = "prestretch: 1, sides: { left: roller, bottom: roller, right: { load: [0.5 N, 0 N] }, top: free }";
        let found = jm(loaded);
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        // A membrane that is held on all sides is at rest on its mount: nothing is stretched.
        assert!(jm("prestretch: 1").abs() < 1e-9);
        assert!(jm("prestretch: 3") > 1000.0);
    }
}
