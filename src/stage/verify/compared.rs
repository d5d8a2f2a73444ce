//! Whether the designs that a stage sets beside each other can be compared, as far as that is known before they are searched.

use std::collections::HashMap;

use crate::design::PlannedDesign;
use deaflow_base::{InputError, Node};
use deaflow_design::Method;

/// Refuses designs that stand under one case and name and are for different objectives or areas, or could not be told apart; `needs` is what
/// names their stages.
///
/// # Errors
/// Where there are such.
pub fn refuse(designs: &[PlannedDesign], needs: &Node) -> Result<(), InputError> {
    let help = "give them different `case` labels or target names";
    for group in groups(designs) {
        let (first, mut rows) = (group[0], Vec::<((Method, usize), &PlannedDesign)>::new());
        for design in group {
            let differences = first.differences(design);
            if !differences.is_empty() {
                let message = format!(
                    "{} are for different objectives or areas, which cannot be compared: {}",
                    both(first, design),
                    differences.join("; ")
                );
                return Err(needs.error(message).help(help));
            }
            match rows.iter().find(|(row, _)| *row == design.row()) {
                Some((_, known)) => {
                    let message = format!(
                        "{} have the same settings and cannot be distinguished",
                        both(known, design)
                    );
                    return Err(needs.error(message).help(help));
                }
                None => rows.push((design.row(), design)),
            }
        }
    }
    Ok(())
}

/// Warnings of designs that are compared although other constraints hold for them.
pub fn warnings(designs: &[PlannedDesign]) -> Vec<String> {
    let mut warnings: Vec<String> = Vec::new();
    let mut known: Vec<[&str; 2]> = Vec::new();
    for group in groups(designs) {
        let Some(other) = group.iter().find(|other| other.constraints != group[0].constraints) else {
            continue;
        };
        // Of several targets of the same two stages one is named.
        let stages = [group[0].stage.as_str(), other.stage.as_str()];
        if !known.contains(&stages) {
            known.push(stages);
            warnings.push(format!(
                "{} are compared, and their constraints differ: {} and {}",
                both(group[0], other),
                group[0].constraints,
                other.constraints
            ));
        }
    }
    warnings
}

/// The designs by case and target, in the order of the first of each.
fn groups(designs: &[PlannedDesign]) -> Vec<Vec<&PlannedDesign>> {
    let mut places: HashMap<(&str, &str), usize> = HashMap::new();
    let mut groups: Vec<Vec<&PlannedDesign>> = Vec::new();
    for design in designs {
        let place = *places.entry((&design.case, &design.target)).or_insert(groups.len());
        match groups.get_mut(place) {
            Some(group) => group.push(design),
            None => groups.push(vec![design]),
        }
    }
    groups
}

fn both(one: &PlannedDesign, other: &PlannedDesign) -> String {
    let case = match one.case.as_str() {
        "" => String::new(),
        case => format!(" of the case {case:?}"),
    };
    format!(
        "the designs `{}`{case} of the stages `{}` and `{}`",
        one.target, one.stage, other.stage
    )
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;
    use deaflow_design::Moment;

    fn design(stage: &str, target: &str, method: Method) -> PlannedDesign {
        PlannedDesign {
            stage: stage.into(),
            case: "I".into(),
            target: target.into(),
            objective: "{ point: [25, 25], direction: 0 }".into(),
            moment: Moment::Equilibrium,
            area: "0.5".into(),
            constraints: "{}".into(),
            method,
            units: 50,
        }
    }

    fn refusal(designs: &[PlannedDesign]) -> Option<String> {
        let document = Document::from_text(Path::new("p.yaml"), "needs: [a, b]").unwrap();
        refuse(designs, &document.root).err().map(|error| error.to_string())
    }

    #[test]
    fn what_is_compared_must_be_for_one_objective_and_area() {
        let (one, best) = (
            design("a", "centre", Method::Ga),
            design("b", "centre", Method::Adjoint),
        );
        assert_eq!(refusal(&[one.clone(), best.clone()]), None);
        let coarse = PlannedDesign {
            units: 20,
            ..best.clone()
        };
        assert_eq!(refusal(&[one.clone(), best.clone(), coarse]), None, "on other units");
        let elsewhere = PlannedDesign {
            objective: "{ point: [30, 25], direction: 0 }".into(),
            area: "0.4".into(),
            ..best.clone()
        };
        let why = refusal(&[one.clone(), elsewhere.clone()]).unwrap();
        assert!(
            why.contains("the designs `centre` of the case \"I\" of the stages `a` and `b`"),
            "{why}"
        );
        assert!(
            why.contains("[25, 25]") && why.contains("[30, 25]") && why.contains("area 0.5 and 0.4"),
            "{why}"
        );
        let apart = PlannedDesign {
            target: "right".into(),
            ..elsewhere
        };
        assert_eq!(refusal(&[one.clone(), apart]), None);
        let why = refusal(&[
            one.clone(),
            PlannedDesign {
                stage: "c".into(),
                ..one
            },
        ])
        .unwrap();
        assert!(
            why.contains("`a` and `c`") && why.contains("cannot be distinguished"),
            "{why}"
        );
    }

    #[test]
    fn other_constraints_are_warned_of_once_for_two_stages() {
        let made = |target| PlannedDesign {
            constraints: "{ min_feature: 3 }".into(),
            ..design("made", target, Method::Ga)
        };
        let best = |target| design("best", target, Method::Adjoint);
        assert_eq!(warnings(&[best("p"), best("q")]), Vec::<String>::new());
        let found = warnings(&[best("p"), best("q"), made("p"), made("q")]);
        assert_eq!(found.len(), 1);
        assert!(found[0].contains("{} and { min_feature: 3 }"), "{found:?}");
    }
}
