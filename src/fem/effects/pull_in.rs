//! Electromechanical stability: how far the voltage is from the one at which stability is lost. [`crate::fem`] computes it in
//! its modules stability, continuation and margin.

use super::effect::{Assessment, Effect, Solutions, Verdict};
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
        let Some((pattern, limit)) = limits.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            let reach = solutions.reach;
            let change = format!("below {reach}: stable at {:.1} times the voltage", reach.sqrt().recip());
            return Some(Assessment::open(quantity, Verdict::NotCalledFor, NEAR, change));
        };
        let change = format!("ends the stability of `{pattern}` at {}", voltage(limit));
        let ratio = (scene.voltage_v() / limit).powi(2);
        Some(Assessment::known(quantity, ratio, NEAR, change))
    }
}

/// A voltage as people say it.
fn voltage(volts: f64) -> String {
    if volts < 1e3 {
        format!("{volts:.1} V")
    } else {
        format!("{:.2} kV", 1e-3 * volts)
    }
}
