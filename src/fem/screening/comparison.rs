//! What an effect does to the displacement: a solution with it against one without it.
//!
//! Both are solved for, with all that is not linear about them, because an effect that is small at rest need not be so near a loss of
//! stability. Where a solution is lost below the voltage of the scene, the two are compared a little below the loss.

use crate::effects::{DISPLACED, SMALL, Significance, Verdict};
use deaflow_field::{Field, Outcome};

/// What an effect does to one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Name of the pattern.
    pub pattern: String,
    /// How its simulation ends at the voltage of the scene without the effect and with it.
    pub outcomes: [Outcome; 2],
    /// What the effect does to its displacement; `None` where there is no voltage at which both solutions are known.
    pub displacement: Option<Displacement>,
}

/// How two displacements differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// The voltage in V at which they are compared: that of the scene, or one just below a loss of stability.
    pub voltage: f64,
    /// The largest difference over the cell corners, over the largest displacement without the effect.
    pub difference: f64,
    /// The change of the largest displacement, over that without the effect.
    pub change: f64,
}

/// Displacements in mm that are rounding.
const NOTHING: f64 = 1e-12;
/// The share of the difference from which the change of the largest displacement stands for all of it.
const TELLING: f64 = 0.7;

impl Displacement {
    /// How two fields in mm at a voltage in V differ.
    #[must_use]
    pub fn between(without: &Field, with: &Field, voltage: f64) -> Self {
        let [before, after] = [without, with].map(Field::max_magnitude);
        // Where nothing moves without the effect, all that moves is its doing.
        let scale = if before > NOTHING { before } else { after.max(NOTHING) };
        Self {
            voltage,
            difference: without.max_difference(with) / scale,
            change: (after - before) / scale,
        }
    }
}

impl Comparison {
    /// Whether the effect decides about stability at the voltage of the scene.
    #[must_use]
    pub fn is_decisive(&self) -> bool {
        let lost = |outcome: &Outcome| outcome.bracket().is_some();
        let [without, with] = &self.outcomes;
        (without.is_converged() && lost(with)) || (lost(without) && with.is_converged())
    }

    /// Whether the comparison was given up.
    #[must_use]
    pub fn is_unknown(&self) -> bool {
        let ends = |outcome: &Outcome| outcome.is_converged() || outcome.bracket().is_some();
        !self.outcomes.iter().all(ends)
    }

    fn difference(&self) -> f64 {
        self.displacement.map_or(0.0, |d| d.difference)
    }
}

/// How much an effect matters by what it does to some patterns: to the one that it changes most, or whose stability it decides about.
pub fn assess(comparisons: &[Comparison]) -> Significance {
    let largest = comparisons
        .iter()
        .max_by(|a, b| a.difference().total_cmp(&b.difference()));
    let Some(largest) = largest else {
        return Significance::open(DISPLACED, Verdict::Unknown, SMALL, "no patterns".to_owned());
    };
    let number = largest.displacement.map(|d| d.difference);
    let by_number = Significance {
        number,
        ..Significance::known(DISPLACED, largest.difference(), SMALL, in_words(largest))
    };
    if let Some(decisive) = comparisons.iter().find(|one| one.is_decisive()) {
        let [without, with] = decisive.outcomes;
        return Significance {
            verdict: Verdict::CalledFor,
            change: format!(
                "decides whether `{}` is stable: {without} without it, {with} with it",
                decisive.pattern
            ),
            ..by_number
        };
    }
    match comparisons.iter().find(|one| one.is_unknown()) {
        Some(unknown) if by_number.verdict != Verdict::CalledFor => Significance {
            verdict: Verdict::GivenUp,
            change: format!(
                "could not be judged by `{}` with the work that is allowed, as is often so where a pattern is lost: `deaflow screen` with \
                 a longer time limit may tell more{}",
                unknown.pattern,
                number.map_or_else(String::new, |_| format!("; by the others it {}", by_number.change))
            ),
            ..by_number
        },
        _ => by_number,
    }
}

fn in_words(comparison: &Comparison) -> String {
    let pattern = &comparison.pattern;
    let Some(Displacement {
        voltage,
        difference,
        change,
    }) = comparison.displacement
    else {
        return format!("leaves `{pattern}` without a stable state at any voltage, as it is without it");
    };
    let near_loss = comparison.outcomes.iter().any(|outcome| !outcome.is_converged());
    let place = if near_loss {
        format!(" at {voltage:.0} V, just below its loss of stability")
    } else {
        String::new()
    };
    if difference < 5e-4 {
        return format!("changes the displacement by less than 0.1 %{place}");
    }
    let telling = change.abs() >= TELLING * difference;
    let (verb, size) = match telling {
        true if change > 0.0 => ("raises", format!("about {:.1} %", 100.0 * change)),
        true => ("lowers", format!("about {:.1} %", -100.0 * change)),
        false => ("changes", format!("up to {:.1} %", 100.0 * difference)),
    };
    format!("{verb} the displacement of `{pattern}` by {size}{place}")
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
        // What moves only with the effect has changed by all of it.
        let moved = Displacement::between(&zero, &field(1.0, 0.0), 5.0);
        assert_eq!((moved.difference, moved.change), (1.0, 1.0));
    }

    #[test]
    fn a_verdict_is_that_of_the_pattern_that_changes_most() {
        let converged = [Outcome::Converged; 2];
        for (numbers, verdict) in [
            ([0.001, 0.019], Verdict::NotCalledFor),
            ([0.001, 0.021], Verdict::CalledFor),
        ] {
            let all = numbers.map(|number| one(converged, Some(number)));
            let found = assess(&all);
            assert_eq!((found.number, found.verdict), (Some(numbers[1]), verdict));
        }
        assert_eq!(
            assess(&[one(converged, Some(0.0213))]).change,
            "lowers the displacement of `p` by about 2.1 %"
        );
        assert_eq!(assess(&[]).verdict, Verdict::Unknown);
    }

    #[test]
    fn an_effect_that_decides_about_stability_is_called_for_whatever_its_number() {
        for outcomes in [[Outcome::Converged, lost()], [lost(), Outcome::Converged]] {
            let found = assess(&[one(outcomes, Some(0.001))]);
            assert_eq!(found.verdict, Verdict::CalledFor);
            assert!(
                found.change.starts_with("decides whether `p` is stable"),
                "{}",
                found.change
            );
        }
        let found = assess(&[one([lost(), lost()], Some(0.01))]);
        assert_eq!(found.verdict, Verdict::NotCalledFor);
        assert!(
            found.change.ends_with("just below its loss of stability"),
            "{}",
            found.change
        );
    }

    #[test]
    fn what_was_given_up_is_not_known_unless_another_pattern_says_so() {
        let given_up = one([Outcome::Converged, Outcome::WorkLimit], None);
        let found = assess(&[given_up.clone(), one([Outcome::Converged; 2], Some(0.01))]);
        assert_eq!((found.verdict, found.number), (Verdict::GivenUp, Some(0.01)));
        assert!(
            found
                .change
                .contains("a longer time limit may tell more; by the others it lowers"),
            "{}",
            found.change
        );
        assert_eq!(assess(std::slice::from_ref(&given_up)).number, None);
        let found = assess(&[given_up, one([Outcome::Converged; 2], Some(0.03))]);
        assert_eq!(found.verdict, Verdict::CalledFor);
    }
}
