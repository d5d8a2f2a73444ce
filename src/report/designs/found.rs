//! The few numbers that matter of all designs together.

use serde::Serialize;

use super::{Design, LEAST_MM, Role};

/// What all designs together amount to. Shares are of the simulated displacement; none where nothing is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Found {
    /// Targets of all cases.
    pub targets: usize,
    /// Patterns, the intuitive ones too.
    pub designs: usize,
    /// Those that were simulated and have a stable solution.
    pub simulated: usize,
    /// Designs whose constraints are not met.
    pub not_met: usize,
    /// The least ratio of a refined design to the optimum.
    pub refined_to_optimum: Option<Extreme>,
    /// The least ratio of a design of the genetic algorithm to the optimum.
    pub ga_to_optimum: Option<Extreme>,
    /// The largest difference between predicted and simulated of all patterns, the intuitive ones too.
    pub prediction_error: Option<Extreme>,
    /// Middle gain of the best found design of a target over the intuitive one at its own area.
    pub gain_own_area: Option<f64>,
    /// The same at equal area.
    pub gain_equal_area: Option<f64>,
}

/// A share, and the design that has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Extreme {
    /// The share.
    pub value: f64,
    /// Name of the design.
    pub design: String,
}

impl Found {
    /// From all designs.
    #[must_use]
    pub fn of(designs: &[Design]) -> Self {
        let targets = targets(designs);
        let found = || designs.iter().filter(|design| design.role.is_found());
        let ratio = |role: Role| {
            let own = found().filter(move |d| d.role == role);
            extreme(own.filter_map(|d| Some((d.compared.ratio?, d))), |value| value)
        };
        let error = designs
            .iter()
            .filter_map(|design| Some((design.prediction_error()?.abs(), design)));
        let gains = |of: &dyn Fn(&Design) -> Option<f64>| {
            let gains = targets.iter().filter_map(|own| gain(own, of));
            middle(gains.collect())
        };
        Self {
            designs: designs.len(),
            simulated: designs.iter().filter(|design| design.simulated_mm.is_some()).count(),
            not_met: found().filter(|d| !matches!(d.status.as_str(), "" | "met")).count(),
            refined_to_optimum: ratio(Role::Refined),
            ga_to_optimum: ratio(Role::Ga),
            prediction_error: extreme(error, |value| -value),
            gain_own_area: gains(&|design| design.compared.intuitive_own),
            gain_equal_area: gains(&|design| design.compared.intuitive_equal_area),
            targets: targets.len(),
        }
    }
}

/// Designs that may be compared together, in the order of the first of each.
fn targets(designs: &[Design]) -> Vec<Vec<&Design>> {
    let mut targets: Vec<Vec<&Design>> = Vec::new();
    for design in designs {
        match targets.iter_mut().find(|target| target[0].is_beside(design)) {
            Some(target) => target.push(design),
            None => targets.push(vec![design]),
        }
    }
    targets
}

/// The least by a measure.
fn extreme<'d>(values: impl Iterator<Item = (f64, &'d Design)>, by: impl Fn(f64) -> f64) -> Option<Extreme> {
    let least = values.min_by(|a, b| by(a.0).total_cmp(&by(b.0)));
    least.map(|(value, design)| Extreme {
        value,
        design: design.name.clone(),
    })
}

/// Gain of what the search of a target found over an intuitive design: of the refined ones where there are some.
fn gain(target: &[&Design], intuitive: &dyn Fn(&Design) -> Option<f64>) -> Option<f64> {
    let gain = |design: &&Design| {
        let other = intuitive(design).filter(|mm| mm.abs() > LEAST_MM)?;
        Some((design.simulated_mm? - other) / other.abs())
    };
    let of = |role: Role| {
        // Where a displacement is to be met, more of it is no gain.
        let own = target.iter().filter(move |d| d.role == role && !d.objective.is_met);
        own.filter_map(gain).max_by(f64::total_cmp)
    };
    of(Role::Refined).or_else(|| of(Role::Ga)).or_else(|| of(Role::Optimum))
}

/// The median.
fn middle(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        n if n % 2 == 1 => Some(values[n / 2]),
        n => Some(0.5 * (values[n / 2 - 1] + values[n / 2])),
    }
}

#[cfg(test)]
mod tests {
    use super::super::compare::{compare, tests::design};
    use super::*;

    #[test]
    fn the_worst_is_told_and_by_whom() {
        let mut designs = vec![
            design(Role::Ga, 50, Some(1.8)),
            design(Role::Refined, 50, Some(1.96)),
            design(Role::Optimum, 50, Some(2.0)),
            design(Role::Intuitive, 50, Some(1.6)),
        ];
        designs[0].predicted_mm = Some(1.8);
        designs[1].predicted_mm = Some(1.95);
        designs[2].predicted_mm = Some(2.02);
        designs[3].predicted_mm = Some(1.568);
        designs[1].status = "2 islands".into();
        compare(&mut designs);
        let found = Found::of(&designs);
        assert_eq!(
            (found.targets, found.designs, found.simulated, found.not_met),
            (1, 4, 4, 1)
        );
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(close(found.refined_to_optimum.unwrap().value, 0.98));
        assert!(close(found.ga_to_optimum.unwrap().value, 0.9));
        let error = found.prediction_error.unwrap();
        assert!(close(error.value, 0.02) && error.design == "I-centre-intuitive");
        assert!(close(found.gain_own_area.unwrap(), 0.225));
        assert_eq!(found.gain_equal_area, None);
        assert_eq!(Found::of(&[]), Found::default());
        assert_eq!(middle(vec![3.0, 1.0, 2.0, 10.0]), Some(2.5));
    }
}
