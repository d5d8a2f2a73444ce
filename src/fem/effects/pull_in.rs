//! Electromechanical stability: the distance of the voltage from the critical voltage, which the modules `stability`,
//! `continuation` and `margin` compute.

use super::effect::{Effect, Significance, Solutions, StableRange, Verdict};
use crate::critical::CriticalVoltage;
use deaflow_base::measured;
use deaflow_field::MESH_OVERESTIMATE;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, On, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct ElectromechanicalStability;

/// Threshold of κ/κ(critical).
pub const NEAR: f64 = 0.6;
const QUANTITY: &str = "κ/κ(critical)";

impl Effect for ElectromechanicalStability {
    fn name(&self) -> &'static str {
        names::STABILITY
    }

    fn cost(&self) -> &'static str {
        "20 to 100 solves"
    }

    fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
        Some(effects.electromechanical_stability.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, _scene: &Scene) {
        effects.electromechanical_stability = Some(On {});
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        if scene.drive.charge.is_some() {
            return Some(Significance::not_applicable("the drive is a charge"));
        }
        (scene.voltage_v() <= 0.0).then(|| Significance::not_applicable("there is no voltage"))
    }

    fn assess_solutions(&self, scene: &Scene, solutions: &Solutions<'_>) -> Option<Significance> {
        let open = |verdict, change| Some(Significance::open(QUANTITY, verdict, NEAR, change));
        let ratio = |voltage: f64| load_ratio(scene, voltage);
        let known = || {
            solutions
                .examined
                .iter()
                .filter_map(|one| Some((&one.pattern, one.stability?)))
        };
        if let Some((pattern, _)) = known().find(|(_, stability)| *stability == StableRange::Nowhere) {
            let change = format!("`{pattern}` is unstable at any voltage: it has no tension");
            return open(Verdict::Significant, change);
        }
        let lost = known().filter_map(|(pattern, stability)| match stability {
            StableRange::Lost(limit) => Some((pattern, limit)),
            _ => None,
        });
        let first = lost.min_by(|a, b| a.1.voltage.total_cmp(&b.1.voltage));
        let searched = known().filter_map(|(pattern, stability)| match stability {
            StableRange::UpTo(voltage) => Some((pattern, voltage)),
            _ => None,
        });
        let least = searched.min_by(|a, b| a.1.total_cmp(&b.1));
        let by_first = first.map(|(pattern, limit)| by_critical_voltage(scene, pattern, &limit));
        // A finer mesh may be unstable at a lower voltage than a coarse one.
        let certain = |reached: f64| (1.0 - MESH_OVERESTIMATE) * reached;
        match (by_first, least) {
            (Some(found), _) if found.verdict == Verdict::Significant => Some(found),
            (_, Some((pattern, reached))) if ratio(certain(reached)) > NEAR => {
                let known = match reached > 0.0 {
                    true => format!(
                        ": it is stable up to {:.1} times the voltage",
                        reached / scene.voltage_v()
                    ),
                    false => String::new(),
                };
                let change = format!("the critical voltage of `{pattern}` was not found within the work limit{known}");
                open(Verdict::WorkLimit, change)
            }
            (Some(found), _) => Some(found),
            (None, Some((_, reached))) => {
                let below = (100.0 * ratio(certain(reached)) - 1e-6).ceil() / 100.0;
                let change = format!(
                    "below {below}: stable at {:.1} times the voltage on a coarse mesh",
                    reached / scene.voltage_v()
                );
                open(Verdict::NotSignificant, change)
            }
            (None, None) => open(Verdict::Unknown, "no patterns".to_owned()),
        }
    }
}

/// Returns κ at the voltage of a scene over κ at another voltage in V.
fn load_ratio(scene: &Scene, voltage: f64) -> f64 {
    (scene.voltage_v() / voltage).powi(2)
}

/// Judges a scene by the lowest critical voltage.
fn by_critical_voltage(scene: &Scene, pattern: &str, limit: &CriticalVoltage) -> Significance {
    let number = load_ratio(scene, limit.voltage);
    let distance = 100.0 * (limit.voltage / scene.voltage_v() - 1.0);
    let side = if distance < 0.0 { "below" } else { "above" };
    let [low, high] = limit.interval();
    let is_open = low <= scene.voltage_v() && scene.voltage_v() <= high;
    let doubt = match (is_open, limit.error) {
        (false, _) => "",
        (true, Some(_)) => ", less than its error",
        (true, None) => "; a finer mesh could decide otherwise",
    };
    let change = format!(
        "`{pattern}` becomes unstable at {}, {:.0} % {side} the voltage of the drive{doubt}",
        format_voltage(limit),
        distance.abs()
    );
    let known = Significance::known(QUANTITY, number, NEAR, change.clone());
    match limit.error {
        Some(error) => Significance {
            error: Some(2.0 * number * error / limit.voltage),
            ..known
        },
        // A finer mesh, which the work limit did not allow, could decide otherwise.
        None if known.verdict == Verdict::NotSignificant && load_ratio(scene, low) > NEAR => {
            let more = "; a finer mesh exceeds the work limit";
            Significance::open(QUANTITY, Verdict::WorkLimit, NEAR, change + more)
        }
        None => known,
    }
}

/// Formats a critical voltage with its error.
fn format_voltage(limit: &CriticalVoltage) -> String {
    let (unit, scale) = if limit.voltage < 1e3 { ("V", 1.0) } else { ("kV", 1e-3) };
    let volts = scale * limit.voltage;
    match limit.error {
        Some(error) => format!("{} {unit}", measured(volts, scale * error)),
        None => format!("{volts:.2} {unit} on a coarse mesh"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::critical::MeshLimit;
    use crate::effects::Examined;
    use deaflow_field::{Mesh, Outcome};

    fn assess(found: &[StableRange]) -> Significance {
        let one = |(i, stability): (usize, &StableRange)| Examined {
            pattern: format!("p{i}"),
            outcome: Outcome::Converged,
            field: 0.5,
            stability: Some(*stability),
        };
        let examined: Vec<Examined> = found.iter().enumerate().map(one).collect();
        let solutions = Solutions { examined: &examined };
        let scene = Scene::vhb4910().at_voltage(1000.0);
        ElectromechanicalStability.assess_solutions(&scene, &solutions).unwrap()
    }

    fn found_at(voltage: f64) -> StableRange {
        let mesh = Mesh::biquadratic(1);
        StableRange::Lost(CriticalVoltage::new(MeshLimit { mesh, voltage }, None))
    }

    #[test]
    fn a_search_that_reached_the_work_limit_leaves_the_verdict_open() {
        // √(1/0.6) = 1.291, and 1.291/0.88 = 1.467: stable up to there on a coarse mesh is far enough from a loss.
        for (found, verdict, number) in [
            (
                vec![found_at(2000.0), StableRange::UpTo(1460.0)],
                Verdict::WorkLimit,
                None,
            ),
            (
                vec![StableRange::UpTo(0.0), StableRange::UpTo(3000.0)],
                Verdict::WorkLimit,
                None,
            ),
            (
                vec![found_at(2000.0), StableRange::UpTo(1470.0)],
                Verdict::NotSignificant,
                Some(0.25),
            ),
            (
                vec![found_at(1250.0), StableRange::UpTo(500.0)],
                Verdict::Significant,
                Some(0.64),
            ),
            (
                vec![StableRange::UpTo(1470.0), StableRange::UpTo(3000.0)],
                Verdict::NotSignificant,
                None,
            ),
            (
                vec![StableRange::UpTo(3000.0), StableRange::Nowhere],
                Verdict::Significant,
                None,
            ),
            // On a coarse mesh only: with a finer one the critical voltage could be 0.88 times as high.
            (vec![found_at(1460.0)], Verdict::WorkLimit, None),
            (vec![found_at(1600.0)], Verdict::NotSignificant, Some(0.390_625)),
        ] {
            let assessment = assess(&found);
            let rounded = assessment.number.map(|number| (1e9 * number).round() / 1e9);
            assert_eq!(
                (assessment.verdict, rounded),
                (verdict, number),
                "{found:?}: {assessment:?}"
            );
        }
        let near = assess(&[found_at(1250.0)]).change;
        assert!(
            near.ends_with("1.25 kV on a coarse mesh, 25 % above the voltage of the drive"),
            "{near}"
        );
        let open = assess(&[found_at(1050.0)]).change;
        assert!(
            open.ends_with("5 % above the voltage of the drive; a finer mesh could decide otherwise"),
            "{open}"
        );
        let far = assess(&[StableRange::UpTo(3_162.277_660_168)]);
        assert_eq!(
            far.change,
            "below 0.13: stable at 3.2 times the voltage on a coarse mesh"
        );
        let given_up = assess(&[found_at(2000.0), StableRange::UpTo(1230.0)]).change;
        assert!(
            given_up.contains("`p1` was not found") && given_up.ends_with("1.2 times the voltage"),
            "{given_up}"
        );
        let nothing = assess(&[StableRange::UpTo(0.0)]).change;
        assert!(nothing.ends_with("within the work limit"), "{nothing}");
        let never = assess(&[StableRange::Nowhere]).change;
        assert!(never.contains("`p0` is unstable at any voltage"), "{never}");
    }

    #[test]
    fn without_a_voltage_stability_does_not_apply() {
        let scene = Scene::vhb4910().at_voltage(0.0);
        assert_eq!(
            ElectromechanicalStability.assess(&scene).unwrap().change,
            "there is no voltage"
        );
        assert_eq!(ElectromechanicalStability.assess(&Scene::vhb4910()), None);
    }
}
