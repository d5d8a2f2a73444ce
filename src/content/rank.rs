//! The rank of a design among those of its target, and the best of them.

use deaflow_pattern::{Role, Shortage};

/// How much a design counts among those of its target: one that satisfies the constraints before others, one of a
/// search before a reference, then the one that comes nearest to a target displacement, or else has the largest value;
/// of equal ones a refined one.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct DesignRank {
    is_met: bool,
    is_searched: bool,
    /// Whether it is refined and was not simulated.
    is_refinement: bool,
    closeness: f64,
    value: f64,
    is_refined: bool,
}

impl DesignRank {
    /// Returns the rank of a design that was simulated: by its distance from a target displacement, if there is one (in
    /// mm), and by the simulated value.
    #[must_use]
    pub fn simulated(role: Role, status: &str, distance: Option<f64>, value: f64) -> Self {
        Self {
            is_met: is_met(status),
            is_searched: role.is_searched(),
            is_refinement: false,
            closeness: -distance.unwrap_or(0.0),
            value,
            is_refined: role == Role::Refined,
        }
    }

    /// Returns the rank of a design that was not simulated. A refined one comes before others, as different evaluators
    /// may have predicted them.
    #[must_use]
    pub fn predicted(role: Role, status: &str, value: f64) -> Self {
        Self {
            is_refinement: role == Role::Refined,
            ..Self::simulated(role, status, None, value)
        }
    }
}

/// Returns whether a design satisfies its constraints, by its status. That there are fewer designs than requested is no
/// violation.
#[must_use]
pub fn is_met(status: &str) -> bool {
    status == "met" || Shortage::read(status).is_some()
}

/// Returns the first of designs with the highest rank; `None` if there are none.
pub fn best_design<T, R: PartialOrd>(designs: impl IntoIterator<Item = (R, T)>) -> Option<T> {
    let of_one = designs.into_iter().map(|(rank, design)| ((), rank, design));
    best_of_targets(of_one).pop().map(|((), design)| design)
}

/// Returns for each target the first of its designs with the highest rank, in the order in which the targets appear.
/// `designs` are targets, ranks and anything else.
pub fn best_of_targets<K: PartialEq, T, R: PartialOrd>(designs: impl IntoIterator<Item = (K, R, T)>) -> Vec<(K, T)> {
    let mut best: Vec<(K, R, T)> = Vec::new();
    for design in designs {
        match best.iter_mut().find(|known| known.0 == design.0) {
            Some(known) if design.1 > known.1 => *known = design,
            Some(_) => {}
            None => best.push(design),
        }
    }
    best.into_iter().map(|(target, _, design)| (target, design)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_design_of_each_target_counts() {
        let few = Shortage {
            found: 1,
            requested: 3,
            percent: 5.0,
        };
        let few = few.to_string();
        let simulated = DesignRank::simulated;
        // One that satisfies the constraints, of a search, with the largest value.
        let ranks = [
            simulated(Role::Refined, "area 0.4, wanted 0.5 within 0.02", None, 9.0),
            simulated(Role::Optimum, "met", None, 8.0),
            simulated(Role::Ga, "met", None, 2.0),
            simulated(Role::Ga, &few, None, 3.0),
            simulated(Role::Refined, &format!("area 0.4; {few}"), None, 7.0),
        ];
        let designs = |count: usize| ranks[..count].iter().enumerate().map(|(at, rank)| ("a", *rank, at));
        for (count, best) in [(1, 0), (2, 1), (3, 2), (4, 3), (5, 3)] {
            assert_eq!(best_of_targets(designs(count)), [("a", best)]);
            assert_eq!(best_design(designs(count).map(|(_, rank, at)| (rank, at))), Some(best));
        }
        assert_eq!(best_design(designs(0).map(|(_, rank, at)| (rank, at))), None);
        // The nearest to a target displacement; the first of equal ones; each target has its own.
        let near = [0.2, 0.1, 0.1].map(|distance| simulated(Role::Ga, "met", Some(distance), 1.0));
        let designs = [
            ("b", near[0], 0),
            ("a", near[0], 1),
            ("b", near[1], 2),
            ("b", near[2], 3),
        ];
        assert_eq!(best_of_targets(designs), [("b", 2), ("a", 1)]);
        // Different evaluators may have predicted a design and its refinement.
        assert!(DesignRank::predicted(Role::Refined, "met", 1.0) > DesignRank::predicted(Role::Ga, "met", 2.0));
    }
}
