//! The influence of an effect on the displacement: a solution with it against one without it.
//!
//! Both solutions are nonlinear, because an effect that is small at rest can be large near a loss of stability. If a
//! solution loses stability below the voltage of the scene, the two are compared just below that voltage.

use crate::effects::{DISPLACED, SMALL, Significance, Verdict};
use deaflow_field::{Field, Outcome};

/// The influence of an effect on one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Name of the pattern.
    pub pattern: String,
    /// Outcomes at the voltage of the scene without and with the effect.
    pub outcomes: [Outcome; 2],
    /// Difference of the displacements; `None` if no voltage has both solutions.
    pub displacement: Option<Displacement>,
}

/// Difference of two displacement fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Voltage of the comparison in V: that of the scene, or one just below a loss of stability.
    pub voltage: f64,
    /// Largest difference at a cell corner, relative to the largest displacement without the effect.
    pub difference: f64,
    /// Change of the largest displacement, relative to that without the effect.
    pub change: f64,
}

/// Displacements in mm below this are rounding errors.
const ROUNDING: f64 = 1e-12;
/// Elements that do not resolve the strips of a fringe field find at least this share of its influence.
const FOUND_WITHOUT_STRIPS: f64 = 0.5;
/// If the change of the largest displacement is at least this share of the difference, it is reported with its sign.
const REPRESENTATIVE: f64 = 0.7;

impl Displacement {
    /// Compares two fields in mm at a voltage in V.
    #[must_use]
    pub fn between(without: &Field, with: &Field, voltage: f64) -> Self {
        let [before, after] = [without, with].map(Field::max_magnitude);
        // Without motion in the first field, the second one is the scale.
        let scale = if before > ROUNDING { before } else { after.max(ROUNDING) };
        Self {
            voltage,
            difference: without.max_difference(with) / scale,
            change: (after - before) / scale,
        }
    }
}

impl Comparison {
    /// Returns whether the effect changes the stability at the voltage of the scene.
    #[must_use]
    pub fn is_decisive(&self) -> bool {
        let lost = |outcome: &Outcome| outcome.bracket().is_some();
        let [without, with] = &self.outcomes;
        (without.is_converged() && lost(with)) || (lost(without) && with.is_converged())
    }

    /// Returns whether a simulation ended before its stability was known.
    #[must_use]
    pub fn is_unknown(&self) -> bool {
        let ends = |outcome: &Outcome| outcome.is_converged() || outcome.bracket().is_some();
        !self.outcomes.iter().all(ends)
    }

    /// Returns which of the patterns may be the most influenced by a fringe field, or lose their stability by it, from
    /// comparisons on elements that do not resolve its strips.
    #[must_use]
    pub fn may_be_largest(found: &[Self]) -> Vec<usize> {
        let largest = found.iter().map(Self::difference).fold(0.0, f64::max);
        let may_be = |one: &Self| {
            let is_sure = one.outcomes.iter().all(Outcome::is_converged);
            !is_sure || one.difference() >= FOUND_WITHOUT_STRIPS * largest
        };
        (0..found.len()).filter(|at| may_be(&found[*at])).collect()
    }

    fn difference(&self) -> f64 {
        self.displacement.map_or(0.0, |d| d.difference)
    }
}

/// Judges an effect by the pattern whose stability it changes, or else by the one whose displacement it changes most.
pub fn assess(comparisons: &[Comparison]) -> Significance {
    let largest = comparisons
        .iter()
        .max_by(|a, b| a.difference().total_cmp(&b.difference()));
    let Some(largest) = largest else {
        return Significance::open(DISPLACED, Verdict::Unknown, SMALL, "no patterns");
    };
    let number = largest.displacement.map(|d| d.difference);
    let by_number = Significance {
        number,
        ..Significance::known(DISPLACED, largest.difference(), SMALL, describe(largest))
    };
    if let Some(decisive) = comparisons.iter().find(|one| one.is_decisive()) {
        // Without the voltages of this mesh: results on another mesh have others.
        let [without, with] = decisive.outcomes.map(|outcome| outcome.name());
        return Significance {
            verdict: Verdict::Significant,
            change: format!(
                "the stability of `{}` would change: {without} without it, {with} with it",
                decisive.pattern
            ),
            ..by_number
        };
    }
    match comparisons.iter().find(|one| one.is_unknown()) {
        Some(unknown) if by_number.verdict != Verdict::Significant => Significance {
            verdict: Verdict::WorkLimit,
            change: describe_unknown(unknown, largest),
            ..by_number
        },
        _ => by_number,
    }
}

/// Says that the influence on a pattern is not known, which is no sign that the pattern is unstable, and what is known
/// of the pattern that changes most.
fn describe_unknown(unknown: &Comparison, largest: &Comparison) -> String {
    let is_work_limit = unknown.outcomes.contains(&Outcome::WorkLimit);
    let reason = match is_work_limit {
        true => "a solution for the comparison reached its work limit; try `deaflow screen` with a longer time limit",
        false => "a solution for the comparison did not converge",
    };
    let known = match largest.displacement {
        None => String::new(),
        Some(_) if std::ptr::eq(largest, unknown) => format!("; {}", describe(largest)),
        Some(_) => format!("; for other patterns, {}", describe(largest)),
    };
    format!("the influence on `{}` is unknown: {reason}{known}", unknown.pattern)
}

/// Describes the change of displacement as a sentence.
fn describe(comparison: &Comparison) -> String {
    let pattern = &comparison.pattern;
    let Some(Displacement {
        voltage,
        difference,
        change,
    }) = comparison.displacement
    else {
        return format!("`{pattern}` would remain unstable at any voltage");
    };
    let near_loss = comparison.outcomes.iter().any(|outcome| !outcome.is_converged());
    let at_voltage = if near_loss {
        format!(" at {voltage:.0} V, just below the critical voltage")
    } else {
        String::new()
    };
    if difference < 5e-4 {
        return format!("the displacement would change by less than 0.1 %{at_voltage}");
    }
    // The number decides about the significance; a change on the other side of the threshold would contradict it.
    let is_representative =
        change.abs() >= REPRESENTATIVE * difference && (change.abs() > SMALL) == (difference > SMALL);
    let (verb, size) = match is_representative {
        true if change > 0.0 => ("rise", format!("about {:.1} %", 100.0 * change)),
        true => ("fall", format!("about {:.1} %", -100.0 * change)),
        false => ("change", format!("up to {:.1} %", 100.0 * difference)),
    };
    format!("the displacement of `{pattern}` would {verb} by {size}{at_voltage}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::CORNERS;
    use deaflow_pattern::Raster;

    fn field(largest: f64, other: f64) -> Field {
        let mut values = vec![0.0; CORNERS * CORNERS * 2];
        (values[200], values[300]) = (largest, other);
        Field::from_values(Raster::PAPER, values).unwrap()
    }

    fn lost() -> Outcome {
        Outcome::PullIn {
            last_stable: 990.0,
            first_unstable: 991.0,
        }
    }

    fn one(outcomes: [Outcome; 2], difference: Option<f64>) -> Comparison {
        Comparison {
            pattern: "p".to_owned(),
            outcomes,
            displacement: difference.map(|difference| Displacement {
                voltage: 1e3,
                difference,
                change: -difference,
            }),
        }
    }

    #[test]
    fn differences_are_shares_of_the_largest_displacement() {
        let found = Displacement::between(&field(2.0, 1.0), &field(2.1, 0.8), 5.0);
        assert!((found.difference - 0.1).abs() < 1e-12 && (found.change - 0.05).abs() < 1e-12);
        let zero = Field::zero(Raster::PAPER);
        assert_eq!(Displacement::between(&zero, &zero, 5.0).difference, 0.0);
        // A field that moves only with the effect has changed completely.
        let moved = Displacement::between(&zero, &field(1.0, 0.0), 5.0);
        assert_eq!((moved.difference, moved.change), (1.0, 1.0));
    }

    #[test]
    fn patterns_that_may_be_the_most_influenced_are_solved_again() {
        let converged = [Outcome::Converged; 2];
        let found = [
            one(converged, Some(0.04)),
            one(converged, Some(0.1)),
            one([Outcome::Converged, lost()], Some(0.01)),
            one(converged, Some(0.05)),
        ];
        assert_eq!(Comparison::may_be_largest(&found), [1, 2, 3]);
        assert!(Comparison::may_be_largest(&[]).is_empty());
    }

    #[test]
    fn a_verdict_is_that_of_the_pattern_that_changes_most() {
        let converged = [Outcome::Converged; 2];
        for (numbers, verdict) in [
            ([0.001, 0.019], Verdict::NotSignificant),
            ([0.001, 0.021], Verdict::Significant),
        ] {
            let all = numbers.map(|number| one(converged, Some(number)));
            let found = assess(&all);
            assert_eq!((found.number, found.verdict), (Some(numbers[1]), verdict));
        }
        assert_eq!(
            assess(&[one(converged, Some(0.0213))]).change,
            "the displacement of `p` would fall by about 2.1 %"
        );
        assert_eq!(assess(&[]).verdict, Verdict::Unknown);
    }

    #[test]
    fn an_effect_that_changes_the_stability_is_significant_whatever_its_number() {
        for outcomes in [[Outcome::Converged, lost()], [lost(), Outcome::Converged]] {
            let found = assess(&[one(outcomes, Some(0.001))]);
            assert_eq!(found.verdict, Verdict::Significant);
            assert!(found.change.starts_with("the stability of `p`"), "{}", found.change);
        }
        let found = assess(&[one([lost(), lost()], Some(0.01))]);
        assert_eq!(found.verdict, Verdict::NotSignificant);
        assert!(
            found.change.ends_with("just below the critical voltage"),
            "{}",
            found.change
        );
    }

    #[test]
    fn the_work_limit_leaves_the_verdict_open_unless_another_pattern_decides() {
        let stopped = one([Outcome::Converged, Outcome::WorkLimit], None);
        let found = assess(&[stopped.clone(), one([Outcome::Converged; 2], Some(0.01))]);
        assert_eq!((found.verdict, found.number), (Verdict::WorkLimit, Some(0.01)));
        assert!(
            found.change.contains("; for other patterns, the displacement"),
            "{}",
            found.change
        );
        assert_eq!(assess(std::slice::from_ref(&stopped)).number, None);
        let found = assess(&[stopped, one([Outcome::Converged; 2], Some(0.03))]);
        assert_eq!(found.verdict, Verdict::Significant);
    }

    #[test]
    fn a_comparison_without_a_result_says_nothing_about_stability_or_about_other_patterns() {
        let unknown = "the influence on `p` is unknown: a solution for the comparison ";
        let limited = "reached its work limit; try `deaflow screen` with a longer time limit";
        let stopped = one([Outcome::Converged, Outcome::WorkLimit], None);
        assert_eq!(assess(&[stopped]).change, format!("{unknown}{limited}"));
        let failed = one([Outcome::Converged, Outcome::IterationLimit], None);
        assert_eq!(assess(&[failed]).change, format!("{unknown}did not converge"));
        // The same pattern is compared at a lower voltage.
        let lower = one([lost(), Outcome::WorkLimit], Some(0.01));
        let lower = assess(&[lower]);
        assert_eq!(
            lower.change,
            format!(
                "{unknown}{limited}; the displacement of `p` would fall by about 1.0 % at 1000 V, just below the \
                 critical voltage"
            )
        );
        assert_eq!(lower.verdict, Verdict::WorkLimit);
    }

    #[test]
    fn a_described_change_is_on_the_same_side_of_the_threshold_as_the_number() {
        let compared = |difference, change| {
            let displacement = Some(Displacement {
                voltage: 1e3,
                difference,
                change,
            });
            let found = assess(&[Comparison {
                displacement,
                ..one([Outcome::Converged; 2], None)
            }]);
            (
                found.verdict,
                found.change.replace("the displacement of `p` would ", ""),
            )
        };
        let (significant, not) = (Verdict::Significant, Verdict::NotSignificant);
        let cases = [
            (0.022, -0.017, significant, "change by up to 2.2 %"),
            (0.022, -0.021, significant, "fall by about 2.1 %"),
            (0.019, 0.017, not, "rise by about 1.7 %"),
        ];
        for (difference, change, verdict, text) in cases {
            assert_eq!(compared(difference, change), (verdict, text.to_owned()));
        }
    }
}
