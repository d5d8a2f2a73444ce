//! Viscoelasticity: Maxwell branches in parallel with the equilibrium law, judged by their remaining influence at the
//! end of the drive.

use super::effect::{Effect, SMALL, Significance, Verdict};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene, Viscoelasticity as Branches};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct Viscoelasticity;

/// Returns the branches of the effect of a scene, or those of its material data.
fn branches(scene: &Scene) -> Option<&Branches> {
    let simulated = scene.effects.viscoelasticity.as_ref();
    simulated.or(scene.properties.viscoelasticity.as_ref())
}

/// The time of interest.
enum TimeSpan {
    /// All times.
    History,
    /// The state at this time in s.
    Hold(f64),
    /// An oscillation with this angular frequency of the force in rad/s.
    Period(f64),
}

impl TimeSpan {
    fn of(scene: &Scene) -> Option<Self> {
        let drive = &scene.drive;
        if drive.oscillates() {
            return drive
                .force_frequency_hz()
                .map(|frequency| Self::Period(std::f64::consts::TAU * frequency));
        }
        match (&drive.waveform, &drive.duration) {
            (Some(_), _) => Some(Self::History),
            (None, Some(duration)) => Some(Self::Hold(duration.value())),
            (None, None) => None,
        }
    }

    /// Returns the share of a branch that has not relaxed, from its relaxation time in s and its weight 4g.
    fn share(&self, time: f64, weight: f64) -> f64 {
        match self {
            Self::History => 1.0,
            Self::Hold(held) => (-held / (time * (1.0 + weight))).exp(),
            Self::Period(omega) => omega * time / (1.0 + (omega * time).powi(2)).sqrt(),
        }
    }
}

impl Effect for Viscoelasticity {
    fn name(&self) -> &'static str {
        names::VISCOELASTICITY
    }

    fn cost(&self) -> &'static str {
        "a solve for each time step"
    }

    fn needs_time(&self) -> bool {
        true
    }

    fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
        Some(effects.viscoelasticity.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.viscoelasticity = branches(scene).cloned();
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let quantity = "Σ 4Gφ/(μ λp²)";
        let open = |verdict, why: &str| Some(Significance::open(quantity, verdict, SMALL, why));
        let span = TimeSpan::of(scene);
        if span.is_none() && scene.drive.rest.is_none() {
            return open(Verdict::NotSignificant, "the drive is static");
        }
        let Some(known) = branches(scene) else {
            return open(Verdict::NoData, "no data");
        };
        let stiffness = scene.shear_modulus_pa() * scene.mean_prestretch().powi(2);
        let weight = |modulus: f64| 4.0 * modulus / stiffness;
        let each = || {
            known
                .branches
                .iter()
                .map(|branch| (branch.modulus.value(), branch.time.value()))
        };
        let creep: f64 = span.as_ref().map_or(0.0, |span| {
            each()
                .map(|(modulus, time)| weight(modulus) * span.share(time, weight(modulus)))
                .sum()
        });
        // A prestretch that has not relaxed adds a stress to that of the law.
        let left: f64 = scene.drive.rest.as_ref().map_or(0.0, |rest| {
            let share = |(modulus, time): (f64, f64)| modulus / scene.shear_modulus_pa() * (-rest.value() / time).exp();
            each().map(share).sum()
        });
        if left > creep {
            return Some(Significance::known(
                "Σ (G/μ) e^(−rest/τ)",
                left,
                SMALL,
                format!("{:.0} % of the prestress would still relax", 100.0 * left),
            ));
        }
        let change = match span {
            Some(TimeSpan::History) => "the displacement would creep while the voltage changes",
            Some(TimeSpan::Hold(_)) if creep > SMALL => "the membrane would not be relaxed when the drive ends",
            Some(TimeSpan::Hold(_)) => "the membrane would be relaxed when the drive ends",
            Some(TimeSpan::Period(_)) | None => "the membrane would resist the oscillation",
        };
        Some(Significance::known(quantity, creep, SMALL, change))
    }
}
