//! Names of designs: told apart at a glance, the same in every report of the same pipeline, and fit for files.

use std::collections::{BTreeMap, BTreeSet};

use super::{Design, Role};

/// Names all designs: `I-centre-0-refined`, `IV-max-3-refined`, `I-centre-0-intuitive-equal-area`.
pub fn name(designs: &mut [Design]) {
    // A person's own patterns of a target are counted apart from its designs.
    let counted = |design: &Design| (design.case.clone(), design.target.clone(), design.role.is_found());
    let mut largest: BTreeMap<(String, String, bool), u64> = BTreeMap::new();
    for design in designs.iter() {
        let most = largest.entry(counted(design)).or_default();
        *most = design.member.max(*most);
    }
    let wanted: Vec<String> = designs
        .iter()
        .map(|design| {
            let members = largest.get(&counted(design));
            plain(design, members.is_some_and(|most| *most > 0))
        })
        .collect();
    let mut taken = BTreeSet::new();
    for (k, design) in designs.iter_mut().enumerate() {
        let same = wanted.iter().filter(|name| **name == wanted[k]).count();
        let mut name = wanted[k].clone();
        if same > 1 && design.role.is_found() {
            name = format!("{name}-{}", design.units);
        }
        let base = name.clone();
        let mut number = 2;
        // Letters that differ in case alone are the same to some file systems.
        while !taken.insert(name.to_lowercase()) {
            name = format!("{base}-{number}");
            number += 1;
        }
        design.name = name;
    }
}

/// Case, target, number among several and role. A target that the case ends with is not said twice.
fn plain(design: &Design, several: bool) -> String {
    let (case, target) = (safe(&design.case), safe(&design.target));
    let said = case == target || case.ends_with(&format!("-{target}"));
    let role = match design.role {
        Role::Intuitive => "intuitive-own-area",
        Role::IntuitiveEqualArea => "intuitive-equal-area",
        other => other.name(),
    };
    let number = (several && design.role.is_compared()).then(|| (design.member + 1).to_string());
    let parts = [
        (!case.is_empty()).then_some(case),
        (!target.is_empty() && !said).then_some(target),
        number,
        Some(role.to_owned()),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join("-")
}

/// Names are free in a pipeline; in the name of a file they must not lead elsewhere.
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
    fn names_say_case_target_number_and_role() {
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
    fn no_two_designs_have_the_same_name_and_none_leads_out_of_its_folder() {
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
