//! The status of a design: `met`, or the requirements that are not met. The text is part of artifact digests.

use super::constraint::Constraints;
use deaflow_pattern::{Pattern, largest_area};

/// Joins the requirements that are not met.
pub(super) fn status_of(unmet: &[String]) -> String {
    match unmet.is_empty() {
        true => "met".to_owned(),
        false => unmet.join("; "),
    }
}

/// The status of a user's own pattern for the area and the constraints of a target. `area` is a number, `at most` a
/// number, or `free`; margins are not checked.
#[must_use]
pub fn own_pattern_status(pattern: &Pattern, area: &str, constraints: &Constraints) -> String {
    let mut unmet = Vec::new();
    let found = constraints.area_fraction(pattern);
    let tolerance = 0.5 / constraints.free_count() as f64;
    let is_met = match largest_area(area) {
        Some(largest) => found <= largest + tolerance,
        None => area
            .parse::<f64>()
            .map_or(true, |wanted| (wanted - found).abs() <= tolerance),
    };
    if !is_met {
        unmet.push(format!("area {found:.4}, wanted {area}"));
    }
    unmet.extend(constraints.violations(pattern).lines());
    if constraints.limits().has_margins() {
        unmet.push("margins not looked at".to_owned());
    }
    status_of(&unmet)
}
