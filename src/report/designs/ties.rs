//! Designs of a target whose values do not differ by more than the errors of their simulations, so that their order
//! says nothing.

use std::cmp::Ordering;

use deaflow_content::{DesignRank, best_design, is_met};
use deaflow_pattern::Role;

/// The place of a simulated design among those of its target.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub role: Role,
    pub rank: DesignRank,
    /// Whether it satisfies the constraints.
    pub is_met: bool,
    /// The simulated value, or its distance from a target.
    pub value: f64,
    /// The estimated error of the simulation, if it is known.
    pub error: Option<f64>,
}

impl Place {
    /// Returns the place of a design by its simulated value, or its distance from a target if there is one; `None` of
    /// patterns for comparison.
    pub fn of((role, status): (Role, &str), (value, distance): (f64, Option<f64>), error: Option<f64>) -> Option<Self> {
        role.is_found().then(|| Self {
            role,
            rank: DesignRank::simulated(role, status, distance, value),
            is_met: is_met(status),
            value: distance.unwrap_or(value),
            error,
        })
    }
}

/// Says how many of the best designs do not differ by more than their errors, among those with the role of the best;
/// `None` if the best one differs from all others, or errors are not known.
pub(crate) fn without_difference(places: &[Place]) -> Option<String> {
    let best = best_design(places.iter().map(|place| (place.rank, place)))?;
    let is_alike = |place: &&Place| (place.role, place.is_met) == (best.role, best.is_met);
    let mut alike: Vec<&Place> = places.iter().filter(is_alike).collect();
    alike.sort_by(|a, b| b.rank.partial_cmp(&a.rank).unwrap_or(Ordering::Equal));
    let is_equal = |place: &&&Place| {
        let errors = best.error.zip(place.error);
        errors.is_some_and(|(own, other)| (place.value - best.value).abs() <= own + other)
    };
    let equal = alike.iter().take_while(is_equal).count();
    (equal > 1).then(|| {
        let all = alike.len();
        format!("the best {equal} of {all} designs do not differ by more than their errors")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(role: Role, value: f64, error: Option<f64>) -> Place {
        Place {
            role,
            rank: DesignRank::simulated(role, "met", None, value),
            is_met: true,
            value,
            error,
        }
    }

    #[test]
    fn the_best_designs_within_their_errors_are_counted() {
        let refined = |value: f64| place(Role::Refined, value, Some(0.004));
        let told = "the best 3 of 4 designs do not differ by more than their errors";
        let some = [2.0, 1.9, 2.003, 1.996].map(refined);
        assert_eq!(without_difference(&some).as_deref(), Some(told));
        // Those of other roles are not alternatives.
        let others = [place(Role::Ga, 2.002, Some(0.1)), place(Role::Optimum, 3.0, Some(0.1))];
        assert_eq!(
            without_difference(&[&some[..], &others].concat()).as_deref(),
            Some(told)
        );
        let violating = Place {
            is_met: false,
            rank: DesignRank::simulated(Role::Refined, "2 islands", None, 2.001),
            ..refined(2.001)
        };
        assert_eq!(
            without_difference(&[&some[..], &[violating]].concat()).as_deref(),
            Some(told)
        );
        assert_eq!(without_difference(&[2.0, 1.9].map(refined)), None);
        assert_eq!(
            without_difference(&[2.0, 2.0].map(|value| place(Role::Ga, value, None))),
            None
        );
        assert_eq!(without_difference(&[]), None);
    }
}
