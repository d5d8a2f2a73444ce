//! Names of designs: readable, the same in every report of a pipeline, and valid as file names.

use std::collections::{BTreeMap, BTreeSet};

use super::design::Design;
use deaflow_pattern::Role;

/// Names all designs: `I-centre-0-refined`, `IV-max-3-refined`, `I-centre-0-intuitive-equal-area`.
pub fn name(designs: &mut [Design]) {
    // Own patterns of a target are numbered apart from its designs.
    let counted = |design: &Design| (design.case.clone(), design.target.clone(), design.role.is_found());
    let mut largest: BTreeMap<(String, String, bool), u64> = BTreeMap::new();
    for design in designs.iter() {
        let most = largest.entry(counted(design)).or_default();
        *most = design.member.max(*most);
    }
    let names: Vec<String> = designs
        .iter()
        .map(|design| {
            let members = largest.get(&counted(design));
            plain(design, members.is_some_and(|most| *most > 0), is_swept(designs, design))
        })
        .collect();
    let mut taken = BTreeSet::new();
    for (k, design) in designs.iter_mut().enumerate() {
        let same = names.iter().filter(|name| **name == names[k]).count();
        let mut name = names[k].clone();
        if same > 1 && design.role.is_found() {
            name = format!("{name}-{}", design.units);
        }
        let base = name.clone();
        let mut number = 2;
        // Some file systems do not distinguish upper and lower case.
        while !taken.insert(name.to_lowercase()) {
            name = format!("{base}-{number}");
            number += 1;
        }
        design.name = name;
    }
}

/// Returns case, target, values of a sweep if targets differ in these, number and role. A target that is the end of the
/// case is left out.
fn plain(design: &Design, several: bool, is_swept: bool) -> String {
    let (case, target) = (safe(&design.case), safe(&design.target));
    let is_in_case = case == target || case.ends_with(&format!("-{target}"));
    let role = match design.role {
        Role::Intuitive => "intuitive-own-area",
        Role::IntuitiveEqualArea => "intuitive-equal-area",
        other => other.name(),
    };
    let number = (several && design.role.is_compared()).then(|| (design.member + 1).to_string());
    let parts = [
        (!case.is_empty()).then_some(case),
        (!target.is_empty() && !is_in_case).then_some(target),
        is_swept
            .then(|| safe(&design.setting))
            .filter(|values| !values.is_empty()),
        number,
        Some(role.to_owned()),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join("-")
}

/// Whether the same target belongs to stages with different values of the axes of a sweep.
pub fn is_swept(designs: &[Design], design: &Design) -> bool {
    let same = |other: &&Design| (&other.case, &other.target) == (&design.case, &design.target);
    designs.iter().filter(same).any(|other| other.setting != design.setting)
}

/// Replaces characters that a file name must not have.
fn safe(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '-'
        }
    };
    let name: String = name.chars().take(60).map(safe).collect();
    name.trim_matches(['.', '-']).to_owned()
}

#[cfg(test)]
mod tests {
    use super::super::compare::tests::design;
    use super::*;

    fn named(designs: Vec<Design>) -> Vec<String> {
        let mut designs = designs;
        name(&mut designs);
        designs.into_iter().map(|design| design.name).collect()
    }

    fn of(case: &str, target: &str, role: Role, member: u64) -> Design {
        Design {
            case: case.into(),
            target: target.into(),
            member,
            ..design(role, 50, None)
        }
    }

    #[test]
    fn names_have_case_target_number_and_role() {
        let names = named(vec![
            of("I", "centre-0", Role::Refined, 0),
            of("I", "centre-0", Role::Intuitive, 0),
            of("I", "centre-0", Role::IntuitiveEqualArea, 0),
            of("IV-max", "max", Role::Refined, 0),
            of("IV-max", "max", Role::Refined, 2),
            of("", "design", Role::Ga, 0),
        ]);
        assert_eq!(
            names,
            [
                "I-centre-0-refined",
                "I-centre-0-intuitive-own-area",
                "I-centre-0-intuitive-equal-area",
                "IV-max-1-refined",
                "IV-max-3-refined",
                "design-ga"
            ]
        );
    }

    #[test]
    fn names_have_the_values_of_a_sweep_where_they_differ() {
        let at = |setting: &str| Design {
            setting: setting.into(),
            ..of("", "design", Role::Optimum, 0)
        };
        let names = named(vec![at("load=0.3N"), at("load=0.5N")]);
        assert_eq!(names, ["design-load-0.3N-optimum", "design-load-0.5N-optimum"]);
        assert_eq!(named(vec![at("load=0.3N")]), ["design-optimum"]);
    }

    #[test]
    fn names_are_unique_and_stay_in_their_folder() {
        let mut other = of("I", "a", Role::Optimum, 0);
        other.units = 20;
        let names = named(vec![
            of("I", "a", Role::Optimum, 0),
            other,
            of("I", "a", Role::Intuitive, 0),
            of("I", "A", Role::Intuitive, 0),
            of("../..", "/etc", Role::Ga, 0),
        ]);
        assert_eq!(
            names,
            [
                "I-a-optimum-50",
                "I-a-optimum-20",
                "I-a-intuitive-own-area",
                "I-A-intuitive-own-area-2",
                "etc-ga"
            ]
        );
    }
}
