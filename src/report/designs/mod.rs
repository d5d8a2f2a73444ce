//! The designs of a pipeline: their predictions and simulations, and what they are compared with.

mod compare;
mod design;
mod front;
mod membranes;
mod names;
mod objective;
mod read;
mod small_islands;
mod statistics;
mod ties;

#[cfg(test)]
pub(super) use {compare::tests, front::FrontPlace};

pub(super) use compare::{Compared, Gain, comparison, exceeds, prediction_error};
pub use deaflow_pattern::Role;
pub(super) use design::Comparison;
pub use design::{Design, LEAST_MM, StateField};
pub use front::OtherObjective;
pub(super) use front::{in_nano, is_cost, ml_per_mm, objective_words, point_words};
pub(super) use membranes::membranes;
pub(super) use names::is_swept;
pub use objective::{Objective, TargetMotion, TargetPoint, VOLUME_UNIT, quantity};
pub use read::designs;
pub(super) use small_islands::{separate_electrodes, small_islands};
pub use statistics::{DesignStatistics, Extreme};
pub(super) use ties::{Place, without_difference};

/// Returns the role as in tables and files: both intuitive designs have the same word.
pub(super) fn role_word(role: Role) -> &'static str {
    match role {
        Role::IntuitiveEqualArea => Role::Intuitive.name(),
        other => other.name(),
    }
}

/// Returns the role as a title.
pub(super) fn role_title(role: Role) -> &'static str {
    match role {
        Role::Refined => "Refined",
        Role::Ga => "Genetic algorithm",
        Role::Optimum => "Gradient search",
        Role::Intuitive => "Intuitive, own area",
        Role::IntuitiveEqualArea => "Intuitive, equal area",
        Role::Own => "Own pattern",
    }
}
