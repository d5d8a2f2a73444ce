//! Reports in the status if a target has fewer designs than requested.

use super::found::FoundDesign;
use deaflow_field::NO_FIELD;
use deaflow_pattern::{Role, Shortage};

/// Adds a note to the status of the last design of each role that has fewer than `requested` designs with the minimum
/// distance.
pub(super) fn report_shortage(designs: &mut [FoundDesign], requested: usize, distance: f64) {
    for role in [Role::Ga, Role::Refined, Role::Optimum] {
        let found = designs.iter().filter(|design| design.role == role).count();
        let last = designs
            .iter_mut()
            .rfind(|design| design.role == role && design.status != NO_FIELD);
        let Some(design) = last.filter(|_| found < requested) else {
            continue;
        };
        let note = Shortage {
            found,
            requested,
            percent: 100.0 * distance,
        };
        design.status = match design.status.as_str() {
            "met" => note.to_string(),
            other => format!("{other}; {note}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::Field;
    use deaflow_pattern::{Pattern, Raster};

    fn design(role: Role, status: &str) -> FoundDesign {
        FoundDesign {
            role,
            member: 0,
            units: 20,
            pattern: Pattern::from_fn(Raster::PAPER, |_, _| false),
            predicted: vec![Field::zero(Raster::PAPER)],
            value_mm: 0.0,
            robust_value: None,
            fitness: 1.0,
            status: status.to_owned(),
        }
    }

    fn statuses(rows: &[(Role, &str)], requested: usize) -> Vec<String> {
        let mut rows: Vec<FoundDesign> = rows.iter().map(|&(role, status)| design(role, status)).collect();
        report_shortage(&mut rows, requested, 0.05);
        rows.into_iter().map(|row| row.status).collect()
    }

    #[test]
    fn fewer_designs_than_requested_are_reported() {
        let few = |found| format!("{found} of 3 designs: none beside differs from them in 5 % of the cells");
        let rows = [(Role::Ga, "met"), (Role::Ga, "area 0.4"), (Role::Intuitive, "met")];
        assert_eq!(
            statuses(&rows, 3),
            ["met".to_owned(), format!("area 0.4; {}", few(2)), "met".to_owned()]
        );
        assert_eq!(statuses(&rows, 2), ["met", "area 0.4", "met"]);
        let without_field = [(Role::Optimum, "met"), (Role::Optimum, NO_FIELD)];
        assert_eq!(statuses(&without_field, 3), [few(2), NO_FIELD.to_owned()]);
    }
}
