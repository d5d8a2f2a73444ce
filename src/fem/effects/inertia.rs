//! Inertia, judged by the frequency of the force relative to the first natural frequency.

use super::effect::{Effect, Significance, Verdict};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct Inertia;

const THRESHOLD: f64 = 0.1;
/// Density of elastomers in kg/m³, accurate enough for a frequency if the scene gives none.
const DEFAULT_DENSITY: f64 = 1000.0;

impl Effect for Inertia {
    fn name(&self) -> &'static str {
        names::INERTIA
    }

    fn cost(&self) -> &'static str {
        "a solve for each time step"
    }

    fn needs_time(&self) -> bool {
        true
    }

    fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
        Some(effects.inertia.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.inertia = scene
            .properties
            .density
            .map(|density| deaflow_scene::Inertia { density });
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let Some(frequency) = scene.drive.force_frequency_hz() else {
            let change = "the drive is static";
            return Some(Significance::open("f/f1", Verdict::NotSignificant, THRESHOLD, change));
        };
        let density = scene.density().unwrap_or(DEFAULT_DENSITY);
        // f₁₁ = ½ √(μ/ρ) √((λ₁/Lx)² + (λ₂/Ly)²), for large prestretch.
        let speed = (scene.shear_modulus_pa() / density).sqrt();
        let (prestretch, size) = (scene.prestretch(), scene.membrane().size_mm);
        let [along, across] = [0, 1].map(|axis| prestretch[axis] / (2e-3 * size[axis]));
        let first = along.hypot(across) * speed;
        let change = format!("the response would grow towards the first mode at {first:.0} Hz");
        Some(Significance::known("f/f1", frequency / first, THRESHOLD, change))
    }
}
