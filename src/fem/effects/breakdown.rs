//! Dielectric breakdown: the true electric field in each cell relative to the breakdown field of the elastomer.
//!
//! It is computed from a solution and does not change it.

use super::effect::{Effect, Examined, Significance, Solutions, Verdict};
use crate::CellState;
use deaflow_field::Outcome;
use deaflow_scene::effects::names;
use deaflow_scene::{Breakdown, Effects, HuangStrength, Scene};

/// Returns the largest E/E_B over the cells; `thickness` is the undeformed one in mm.
#[must_use]
pub fn breakdown_ratio(law: &Breakdown, thickness: f64, states: &[CellState]) -> f64 {
    let of_cell = |state: &CellState| [state.electric_field, state.stretches[0] * state.stretches[1]];
    largest_ratio(law, thickness, states.iter().map(of_cell))
}

/// Returns the largest E/E_B of cells with an electric field in V/m and an area stretch.
pub fn largest_ratio(law: &Breakdown, thickness: f64, cells: impl Iterator<Item = [f64; 2]>) -> f64 {
    cells
        .map(|[field, stretch]| field / law.strength(thickness, stretch))
        .fold(0.0, f64::max)
}

/// Returns E/E_B of an active cell at rest, a lower bound for an unstable membrane.
#[must_use]
pub fn breakdown_ratio_at_rest(law: &Breakdown, scene: &Scene) -> f64 {
    let area = scene.mean_prestretch().powi(2);
    let field = 1e3 * scene.voltage_v() * area / scene.thickness_mm();
    field / law.strength(scene.thickness_mm(), area)
}

/// Returns the breakdown strength of the effect of a scene, or that of its material data.
#[must_use]
pub fn breakdown_strength(scene: &Scene) -> Option<Breakdown> {
    scene.breakdown_strength().cloned()
}

/// Returns the breakdown strength of a scene, or that of the usual acrylic elastomer.
#[must_use]
pub fn breakdown_strength_or_default(scene: &Scene) -> Breakdown {
    breakdown_strength(scene).unwrap_or(Breakdown::Huang(HuangStrength {}))
}

/// The effect, as an entry of [`super::EFFECTS`].
pub struct DielectricBreakdown;

impl Effect for DielectricBreakdown {
    fn name(&self) -> &'static str {
        names::BREAKDOWN
    }

    fn cost(&self) -> &'static str {
        "a pass over the cells"
    }

    fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
        Some(effects.dielectric_breakdown.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.dielectric_breakdown = Some(breakdown_strength_or_default(scene));
    }

    fn assess_solutions(&self, scene: &Scene, solutions: &Solutions<'_>) -> Option<Significance> {
        let quantity = match breakdown_strength(scene) {
            Some(_) => "max E/E_B",
            None => "max E/E_B (Huang's law assumed)",
        };
        let open = |verdict, change| Some(Significance::open(quantity, verdict, Breakdown::NEAR, change));
        let Some(worst) = solutions.worst(|one| one.field) else {
            return open(Verdict::Unknown, "no patterns".to_owned());
        };
        let unstable = |one: &Examined| !one.outcome.is_converged();
        let state = if unstable(worst) { ", at rest," } else { "" };
        let reaches = match worst.field > 1.0 {
            true => "exceeds the breakdown field",
            false => "is close to the breakdown field",
        };
        let known = Significance::known(
            quantity,
            worst.field,
            Breakdown::NEAR,
            format!("the electric field of `{}`{state} {reaches}", worst.pattern),
        );
        // An unstable membrane gets thinner, so the field at rest is a lower bound.
        let Some(one) = solutions.examined.iter().find(|one| unstable(one)) else {
            return Some(known);
        };
        let (pattern, field) = (&one.pattern, one.field);
        match (known.verdict, one.outcome.bracket()) {
            (Verdict::Significant, _) => Some(known),
            (_, Some(_)) => open(
                Verdict::Unknown,
                format!(
                    "the field of `{pattern}` is unknown: the pattern is unstable; at rest E/E_B is {field:.2}, \
                     during pull-in it is larger"
                ),
            ),
            (_, None) => open(
                Verdict::WorkLimit,
                format!(
                    "the field of `{pattern}` is unknown: a solution for this check {}; at rest E/E_B is {field:.2}",
                    match one.outcome {
                        Outcome::WorkLimit => "reached its work limit",
                        _ => "did not converge",
                    }
                ),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MembraneSolver, SolveOptions};
    use deaflow_base::ElectricField;
    use deaflow_field::Simulator;
    use deaflow_pattern::{Pattern, Raster};
    use deaflow_scene::ConstantStrength;

    fn constant(megavolts_per_metre: f64) -> Breakdown {
        Breakdown::Constant(ConstantStrength {
            field: ElectricField::from_f64(1e6 * megavolts_per_metre).unwrap(),
        })
    }

    #[test]
    fn a_uniform_membrane_has_the_field_of_a_plate_capacitor() {
        // All active: u = 0, so E = V λp²/H = 5.25 kV · 9 / 1 mm.
        let scene = Scene::vhb4910();
        let all = Pattern::from_fn(Raster::PAPER, |_, _| true);
        let solver = MembraneSolver::new(&scene, SolveOptions::default()).unwrap();
        let states = solver.cell_states(&all, &solver.solve(&all));
        assert!((breakdown_ratio(&constant(47.25), 1.0, &states) - 1.0).abs() < 1e-12);
        // 51 · 3^0.63 MV/m
        let ratio = breakdown_ratio(&Breakdown::Huang(HuangStrength {}), 1.0, &states);
        assert!((ratio * 51.0 * 3.0_f64.powf(0.63) / 47.25 - 1.0).abs() < 1e-12);
        let bare = Pattern::from_fn(Raster::PAPER, |_, _| false);
        let states = solver.cell_states(&bare, &solver.solve(&bare));
        assert_eq!(breakdown_ratio(&constant(47.25), 1.0, &states), 0.0);
    }

    #[test]
    fn what_the_field_of_a_lost_state_is_is_not_known() {
        let lost = Outcome::PullIn {
            last_stable: 990.0,
            first_unstable: 991.0,
        };
        for (fields, outcome, verdict, number) in [
            ([0.5, 0.4], Outcome::Converged, Verdict::NotSignificant, Some(0.5)),
            ([0.5, 0.4], lost, Verdict::Unknown, None),
            ([0.5, 0.4], Outcome::WorkLimit, Verdict::WorkLimit, None),
            ([0.9, 0.4], lost, Verdict::Significant, Some(0.9)),
            ([0.5, 0.9], lost, Verdict::Significant, Some(0.9)),
        ] {
            let one = |pattern: &str, field, outcome| Examined {
                pattern: pattern.to_owned(),
                outcome,
                field,
                stability: None,
            };
            let examined = [one("a", fields[0], Outcome::Converged), one("b", fields[1], outcome)];
            let solutions = Solutions { examined: &examined };
            let found = DielectricBreakdown
                .assess_solutions(&Scene::vhb4910(), &solutions)
                .unwrap();
            assert_eq!((found.verdict, found.number), (verdict, number), "{found:?}");
            let doubted = matches!(verdict, Verdict::Unknown | Verdict::WorkLimit);
            assert_eq!(found.change.contains("of `b` is unknown"), doubted, "{found:?}");
        }
    }

    #[test]
    fn it_is_observed_where_the_scene_names_it_and_moves_nothing() {
        let base = Scene::vhb4910();
        let watched = base.with_effects(Effects {
            dielectric_breakdown: Some(constant(60.0)),
            ..Effects::default()
        });
        let half = [Pattern::from_fn(Raster::PAPER, |x, _| x < 25)];
        let simulate = |scene: &Scene| {
            let solver = MembraneSolver::new(scene, SolveOptions::default()).unwrap();
            solver.simulate(&half).remove(0)
        };
        let (plain, observed) = (simulate(&base), simulate(&watched));
        assert_eq!(plain.field, observed.field);
        assert!(plain.observation.is_empty());
        // The active half expands: the field is above that of the uniform membrane, 47.25 MV/m.
        assert!((47.25 / 60.0..1.0).contains(&observed.observation.breakdown_ratio.unwrap()));
    }
}
