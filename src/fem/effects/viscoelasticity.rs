//! Finite viscoelasticity: screened by the branches of a generalised Maxwell model, not simulated yet.

use super::effect::{Assessment, Effect, SMALL, Verdict};
use crate::scene::Scene;
use crate::scene::effects::names;

/// The effect.
pub struct Viscoelasticity;

impl Effect for Viscoelasticity {
    fn name(&self) -> &'static str {
        names::VISCOELASTICITY
    }

    fn cost(&self) -> &'static str {
        "a solve for each time step"
    }

    fn assess(&self, scene: &Scene) -> Option<Assessment> {
        let quantity = "4G/(μ λp²), t/τ in 0.01 … 100";
        let open = |verdict, why: &str| Some(Assessment::open(quantity, verdict, SMALL, why.to_owned()));
        let Some(time) = scene.drive.time_s() else {
            return open(Verdict::NotCalledFor, "the drive has no time");
        };
        let branches = scene.properties.viscoelasticity.as_deref().unwrap_or_default();
        if branches.is_empty() {
            return open(Verdict::Unknown, "no data");
        }
        let stiffness = scene.shear_modulus_pa() * scene.mean_prestretch().powi(2);
        let active = branches
            .iter()
            .filter(|branch| (0.01..=100.0).contains(&(time / branch.time.value())));
        let sum = |modulus: f64| 4.0 * modulus / stiffness;
        let number: f64 = active.map(|branch| sum(branch.modulus.value())).sum();
        let frozen: f64 = branches
            .iter()
            .filter(|branch| time / branch.time.value() < 0.01)
            .map(|branch| branch.modulus.value())
            .sum();
        let mut change = "lets the displacement creep over the time of the drive".to_owned();
        if frozen > 0.0 {
            change = format!(
                "has branches of {:.0} % of μ that are too slow to relax: is `shear_modulus` that of the drive?",
                100.0 * frozen / scene.shear_modulus_pa()
            );
        } else if number == 0.0 {
            change = "has relaxed in all branches".to_owned();
        }
        Some(Assessment::known(quantity, number, SMALL, change))
    }
}
