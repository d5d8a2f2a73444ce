//! Designs before they are searched, and whether they can be compared with each other.

use std::collections::HashMap;

use super::objective::{ResponseKind, value_unit};
use super::options::Method;
use deaflow_base::{InputError, Node};

/// A design that a stage will search.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedDesign {
    /// The stage.
    pub stage: String,
    /// The label of the stage; may be empty.
    pub case: String,
    /// The target.
    pub target: String,
    /// The objective in YAML, as in artifacts.
    pub objective: String,
    /// The response that the objective measures.
    pub response: ResponseKind,
    /// Whether its values are forces of sides.
    pub is_reaction: bool,
    /// The target area fraction, or `free`.
    pub area: String,
    /// The constraints in YAML, as in artifacts.
    pub constraints: String,
    /// The search method.
    pub method: Method,
    /// Units along a side in the gradient search.
    pub units: usize,
}

impl PlannedDesign {
    /// The differences between objectives and areas, such as `area 0.5 and 0.4`.
    fn differences(&self, other: &Self) -> Vec<String> {
        let differs = |name: &str, one: &str, two: &str| (one != two).then(|| format!("{name} {one} and {two}"));
        let objective = differs("objective", &self.objective, &other.objective);
        let area = differs("area", &self.area, &other.area);
        objective.into_iter().chain(area).collect()
    }

    /// Distinguishes the rows of one target in a verification. Designs of the genetic algorithm always have the same
    /// units.
    fn row_key(&self) -> (Method, usize) {
        match self.method {
            Method::Ga => (Method::Ga, 0),
            Method::Adjoint => (Method::Adjoint, self.units),
        }
    }

    /// Refuses designs with the same case and target but different objectives or areas, or with equal settings. Errors
    /// are located at `needs`.
    ///
    /// # Errors
    /// If there are such designs.
    pub fn check_comparable(designs: &[Self], needs: &Node) -> Result<(), InputError> {
        let refused = |message| {
            Err(needs
                .error(message)
                .help("give them different `case` labels or target names"))
        };
        if let Some((force, motion)) = designs
            .iter()
            .find(|design| design.is_reaction)
            .zip(designs.iter().find(|design| !design.is_reaction))
        {
            return Err(needs
                .error(format!(
                    "{} have values in {} and in mm, which are not in one artifact",
                    both(force, motion),
                    value_unit(true)
                ))
                .help("verify them in two stages"));
        }
        for group in groups(designs) {
            let (first, mut known) = (group[0], Vec::<&Self>::new());
            for design in group {
                let differences = first.differences(design);
                if !differences.is_empty() {
                    return refused(format!(
                        "{} have different objectives or areas and cannot be compared: {}",
                        both(first, design),
                        differences.join("; ")
                    ));
                }
                if let Some(same) = known.iter().find(|other| other.row_key() == design.row_key()) {
                    let both = both(same, design);
                    return refused(format!("{both} have the same settings and cannot be distinguished"));
                }
                known.push(design);
            }
        }
        Ok(())
    }

    /// One warning for each pair of stages whose designs have the same case and target but different constraints.
    #[must_use]
    pub fn constraint_warnings(designs: &[Self]) -> Vec<String> {
        let mut warnings: Vec<String> = Vec::new();
        let mut known: Vec<[&str; 2]> = Vec::new();
        for group in groups(designs) {
            let Some(other) = group.iter().find(|other| other.constraints != group[0].constraints) else {
                continue;
            };
            let stages = [group[0].stage.as_str(), other.stage.as_str()];
            if !known.contains(&stages) {
                known.push(stages);
                warnings.push(format!(
                    "{} are compared but have different constraints: {} and {}",
                    both(group[0], other),
                    group[0].constraints,
                    other.constraints
                ));
            }
        }
        warnings
    }
}

/// Groups designs by case and target, in the order of the first design of each group.
fn groups(designs: &[PlannedDesign]) -> Vec<Vec<&PlannedDesign>> {
    let mut indices: HashMap<(&str, &str), usize> = HashMap::new();
    let mut groups: Vec<Vec<&PlannedDesign>> = Vec::new();
    for design in designs {
        let index = *indices.entry((&design.case, &design.target)).or_insert(groups.len());
        match groups.get_mut(index) {
            Some(group) => group.push(design),
            None => groups.push(vec![design]),
        }
    }
    groups
}

fn both(one: &PlannedDesign, other: &PlannedDesign) -> String {
    let case = match one.case.as_str() {
        "" => String::new(),
        case => format!(" of case {case:?}"),
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

    fn design(stage: &str, target: &str, method: Method) -> PlannedDesign {
        PlannedDesign {
            stage: stage.into(),
            case: "I".into(),
            target: target.into(),
            objective: "{ point: [25, 25], direction: 0 }".into(),
            response: ResponseKind::Equilibrium,
            is_reaction: false,
            area: "0.5".into(),
            constraints: "{}".into(),
            method,
            units: 50,
        }
    }

    fn refusal(designs: &[PlannedDesign]) -> Option<String> {
        let document = Document::from_text(Path::new("p.yaml"), "needs: [a, b]").unwrap();
        PlannedDesign::check_comparable(designs, &document.root)
            .err()
            .map(|error| error.to_string())
    }

    #[test]
    fn compared_designs_must_have_the_same_objective_and_area() {
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
            why.contains("the designs `centre` of case \"I\" of the stages `a` and `b`"),
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
    fn different_constraints_give_one_warning_for_two_stages() {
        let made = |target| PlannedDesign {
            constraints: "{ min_feature: 3 }".into(),
            ..design("made", target, Method::Ga)
        };
        let best = |target| design("best", target, Method::Adjoint);
        assert!(PlannedDesign::constraint_warnings(&[best("p"), best("q")]).is_empty());
        let found = PlannedDesign::constraint_warnings(&[best("p"), best("q"), made("p"), made("q")]);
        assert_eq!(found.len(), 1);
        assert!(found[0].contains("{} and { min_feature: 3 }"), "{found:?}");
    }
}
