//! Statistics of all designs together.

use serde::Serialize;

use super::compare::prediction_error;
use super::design::Design;
use deaflow_pattern::Role;

/// Statistics of all designs. Fractions are of the simulated displacement; `None` if nothing is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DesignStatistics {
    /// Targets of all cases.
    pub targets: usize,
    /// Patterns, including the intuitive ones.
    pub designs: usize,
    /// Those that were simulated and have a stable solution.
    pub simulated: usize,
    /// Designs that violate constraints.
    pub not_met: usize,
    /// The smallest ratio of a refined design to the optimum.
    pub refined_to_optimum: Option<Extreme>,
    /// The smallest ratio of a design of the genetic algorithm to the optimum.
    pub ga_to_optimum: Option<Extreme>,
    /// The largest difference between predicted and simulated of all patterns, including the intuitive ones, as a
    /// fraction of the simulated displacement, or of a tenth of the largest one of the target.
    pub prediction_error: Option<Extreme>,
    /// Median gain of the best found design of a target over the intuitive one at its own area, of the targets where
    /// that is a fraction.
    pub gain_own_area: Option<f64>,
    /// The number of these targets.
    pub gain_own_area_targets: usize,
    /// The median gain at equal area.
    pub gain_equal_area: Option<f64>,
    /// The number of its targets.
    pub gain_equal_area_targets: usize,
}

/// A fraction, and the design that has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Extreme {
    /// The fraction.
    pub value: f64,
    /// Name of the design.
    pub design: String,
    /// What it is a ratio to, if it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<&'static str>,
    /// The number of designs that have none, as they and the optimum move in opposite directions.
    #[serde(skip_serializing_if = "is_zero")]
    pub opposite: usize,
}

/// Whether a number is zero.
fn is_zero(number: &usize) -> bool {
    *number == 0
}

impl DesignStatistics {
    /// Computes the statistics.
    #[must_use]
    pub fn of(designs: &[Design]) -> Self {
        let targets = targets(designs);
        let found = || designs.iter().filter(|design| design.role.is_found());
        let ratio = |role: Role| {
            let own = found().filter(move |d| d.role == role);
            let is_opposite = |d: &&Design| d.compared.difference_mm.is_some();
            let opposite = own.clone().filter(is_opposite).count();
            let least = own.filter_map(|d| Some((d.compared.ratio?, d)));
            let (value, design) = least.min_by(|a, b| a.0.total_cmp(&b.0))?;
            Some(Extreme {
                value,
                design: design.name.clone(),
                of: design.compared.optimum_is,
                opposite,
            })
        };
        let error = targets.iter().flat_map(|target| {
            let sizes = target.iter().filter_map(|design| Some(design.simulated_mm?.abs()));
            let largest_mm = sizes.fold(0.0, f64::max);
            target.iter().filter_map(move |design| {
                let simulated_mm = design.simulated_mm?;
                let error = prediction_error(design.predicted_mm? - simulated_mm, simulated_mm, largest_mm)?;
                Some((error, *design))
            })
        });
        let [own_area, equal_area] = [0, 1].map(|over| -> Vec<f64> {
            let gains = targets.iter().filter_map(|own| gain(own, over));
            gains.collect()
        });
        Self {
            designs: designs.len(),
            simulated: designs.iter().filter(|design| design.simulated_mm.is_some()).count(),
            not_met: found().filter(|d| !matches!(d.status.as_str(), "" | "met")).count(),
            refined_to_optimum: ratio(Role::Refined),
            ga_to_optimum: ratio(Role::Ga),
            prediction_error: extreme(error, |value| -value),
            gain_own_area_targets: own_area.len(),
            gain_own_area: median(own_area),
            gain_equal_area_targets: equal_area.len(),
            gain_equal_area: median(equal_area),
            targets: targets.len(),
        }
    }
}

/// Groups designs that may be compared, in the order of the first of each group.
fn targets(designs: &[Design]) -> Vec<Vec<&Design>> {
    let mut targets: Vec<Vec<&Design>> = Vec::new();
    for design in designs {
        match targets.iter_mut().find(|target| target[0].has_same_target(design)) {
            Some(target) => target.push(design),
            None => targets.push(vec![design]),
        }
    }
    targets
}

/// Returns the smallest by a measure.
fn extreme<'d>(values: impl Iterator<Item = (f64, &'d Design)>, by: impl Fn(f64) -> f64) -> Option<Extreme> {
    let least = values.min_by(|a, b| by(a.0).total_cmp(&by(b.0)));
    least.map(|(value, design)| Extreme {
        value,
        design: design.name.clone(),
        of: None,
        opposite: 0,
    })
}

/// Returns the gain of the best found design of a target over the intuitive design at its own area (`over` is 0) or at
/// equal area (1), if it is a fraction; refined designs come first.
fn gain(target: &[&Design], over: usize) -> Option<f64> {
    let of = |role: Role| {
        let own = target.iter().filter(move |design| design.role == role);
        own.filter_map(|design| design.compared.gains()[over]?.fraction())
            .max_by(f64::total_cmp)
    };
    of(Role::Refined).or_else(|| of(Role::Ga)).or_else(|| of(Role::Optimum))
}

/// Returns the median.
fn median(mut values: Vec<f64>) -> Option<f64> {
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
    fn the_worst_value_is_reported_with_its_design() {
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
        let found = DesignStatistics::of(&designs);
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
        assert_eq!((found.gain_own_area_targets, found.gain_equal_area_targets), (1, 0));
        // The error of a pattern that hardly moves is relative to a tenth of the largest displacement of its target.
        designs[3].simulated_mm = Some(-0.01);
        designs[3].predicted_mm = Some(-0.004);
        let error = DesignStatistics::of(&designs).prediction_error.unwrap();
        assert!(
            close(error.value, 0.03) && error.design == "I-centre-intuitive",
            "{error:?}"
        );
        assert_eq!(found.gain_equal_area, None);
        // The gain over a pattern that moves the other way is no fraction, and counts in no median; a design that moves
        // the other way has no ratio to the optimum.
        designs[0].simulated_mm = Some(-0.5);
        compare(&mut designs);
        let found = DesignStatistics::of(&designs);
        assert_eq!((found.gain_own_area, found.gain_own_area_targets), (None, 0));
        assert_eq!(
            (found.ga_to_optimum, found.refined_to_optimum.unwrap().opposite),
            (None, 0)
        );
        designs[0].role = Role::Refined;
        assert_eq!(DesignStatistics::of(&designs).refined_to_optimum.unwrap().opposite, 1);
        assert_eq!(DesignStatistics::of(&[]), DesignStatistics::default());
        assert_eq!(median(vec![3.0, 1.0, 2.0, 10.0]), Some(2.5));
    }
}
