//! Electromechanical stability: how far the voltage is from the one at which stability is lost. [`crate::fem`] computes it in
//! its modules stability, continuation and margin.

use super::effect::{Assessment, Effect, Solutions, Verdict};
use crate::fem::critical::CriticalVoltage;
use crate::scene::effects::names;
use crate::scene::{Effects, On, Scene};

/// The effect.
pub struct ElectromechanicalStability;

/// Above this share of the critical κ it is called for.
pub const NEAR: f64 = 0.6;

impl Effect for ElectromechanicalStability {
    fn name(&self) -> &'static str {
        names::STABILITY
    }

    fn cost(&self) -> &'static str {
        "20 to 100 solves"
    }

    fn is_on(&self, effects: &Effects) -> Option<bool> {
        Some(effects.electromechanical_stability.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, _scene: &Scene) {
        effects.electromechanical_stability = Some(On {});
    }

    fn assess_solutions(&self, scene: &Scene, solutions: &Solutions<'_>) -> Option<Assessment> {
        let quantity = "κ/κ(critical)";
        let limits = solutions
            .examined
            .iter()
            .filter_map(|one| Some((&one.pattern, one.limit?)));
        let Some((pattern, limit)) = limits.min_by(|a, b| a.1.voltage.total_cmp(&b.1.voltage)) else {
            if let Some(one) = solutions.examined.iter().find(|one| one.given_up) {
                let change = format!("was not found for `{}` with the work that is allowed", one.pattern);
                return Some(Assessment::open(quantity, Verdict::Unknown, NEAR, change));
            }
            let reach = solutions.reach;
            let change = format!("below {reach}: stable at {:.1} times the voltage", reach.sqrt().recip());
            return Some(Assessment::open(quantity, Verdict::NotCalledFor, NEAR, change));
        };
        let change = format!("ends the stability of `{pattern}` at {}", voltage(&limit));
        let ratio = (scene.voltage_v() / limit.voltage).powi(2);
        Some(Assessment {
            error: limit.error.map(|error| 2.0 * ratio * error / limit.voltage),
            ..Assessment::known(quantity, ratio, NEAR, change)
        })
    }
}

/// A voltage with its error as people say it.
fn voltage(limit: &CriticalVoltage) -> String {
    let (unit, scale) = if limit.voltage < 1e3 { ("V", 1.0) } else { ("kV", 1e-3) };
    let volts = scale * limit.voltage;
    match limit.error {
        Some(error) => format!("{volts:.2} ± {:.2} {unit}", scale * error),
        None => format!("{volts:.2} {unit} on a coarse mesh"),
    }
}
