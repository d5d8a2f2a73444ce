//! What is said where a target has fewer designs than were asked for.

use super::found::FoundDesign;
use deaflow_field::NO_FIELD;
use deaflow_pattern::Role;

/// Adds to the status of the last design of each role that there are fewer than `wanted` which differ in a share of the cells.
pub(super) fn report_shortage(designs: &mut [FoundDesign], wanted: usize, distance: f64) {
    for role in [Role::Ga, Role::Refined, Role::Optimum] {
        let found = designs.iter().filter(|design| design.role == role).count();
        let last = designs
            .iter_mut()
            .rfind(|design| design.role == role && design.status != NO_FIELD);
        let Some(design) = last.filter(|_| found < wanted) else {
            continue;
        };
        let percent = 100.0 * distance;
        let words = format!("{found} of {wanted} designs: none beside differs from them in {percent} % of the cells");
        design.status = match design.status.as_str() {
            "met" => words,
            other => format!("{other}; {words}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::Field;
    use deaflow_pattern::Pattern;
    use deaflow_pattern::Raster;

    fn design(role: Role, status: &str) -> FoundDesign {
        FoundDesign {
            role,
            member: 0,
            units: 20,
            pattern: Pattern::from_fn(Raster::PAPER, |_, _| false),
            predicted: vec![Field::zero(Raster::PAPER)],
            value_mm: 0.0,
            fitness: 1.0,
            status: status.to_owned(),
        }
    }

    fn told(rows: &[(Role, &str)], wanted: usize) -> Vec<String> {
        let mut rows: Vec<FoundDesign> = rows.iter().map(|&(role, status)| design(role, status)).collect();
        report_shortage(&mut rows, wanted, 0.05);
        rows.into_iter().map(|row| row.status).collect()
    }

    #[test]
    fn fewer_designs_than_asked_for_are_told_of() {
        let few = |found| format!("{found} of 3 designs: none beside differs from them in 5 % of the cells");
        let rows = [(Role::Ga, "met"), (Role::Ga, "area 0.4"), (Role::Intuitive, "met")];
        assert_eq!(
            told(&rows, 3),
            ["met".to_owned(), format!("area 0.4; {}", few(2)), "met".to_owned()]
        );
        assert_eq!(told(&rows, 2), ["met", "area 0.4", "met"]);
        let without_field = [(Role::Optimum, "met"), (Role::Optimum, NO_FIELD)];
        assert_eq!(told(&without_field, 3), [few(2), NO_FIELD.to_owned()]);
    }
}
