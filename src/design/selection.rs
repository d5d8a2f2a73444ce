//! Which of several designs is meant.

use std::cmp::Ordering;
use std::fmt;

use deaflow_base::InputError;
use deaflow_pattern::Role;

/// The most designs that an error lists.
const LISTED: usize = 24;

/// Which design is wanted; what is not said does not matter.
#[derive(Clone, Copy, Debug, Default)]
pub struct DesignFilter<'a> {
    /// The name of its target.
    pub name: Option<&'a str>,
    /// Its case.
    pub case: Option<&'a str>,
    /// Its role.
    pub role: Option<&'a str>,
    /// Its number among the different designs of a target.
    pub member: Option<u64>,
    /// Its units along a side of the membrane.
    pub units: Option<u64>,
}

/// How good a design is by simulation: the less, the better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Merit {
    /// How far it is from the wanted displacements, mm; 0 where nothing but a direction is wanted.
    pub distance_mm: f64,
    /// How far it moves along the wanted directions, mm.
    pub along_mm: f64,
}

fn by_merit(a: Option<Merit>, b: Option<Merit>) -> Ordering {
    match (a, b) {
        (Some(a), Some(b)) => (a.distance_mm.total_cmp(&b.distance_mm)).then(b.along_mm.total_cmp(&a.along_mm)),
        (a, b) => a.is_none().cmp(&b.is_none()),
    }
}

/// What a design is called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DesignLabel {
    /// Its case, which may be empty.
    pub case: String,
    /// The name of its target.
    pub name: String,
    /// Its role.
    pub role: Role,
    /// Its number among the different designs of a target.
    pub member: u64,
    /// Its units along a side of the membrane.
    pub units: u64,
}

impl DesignLabel {
    fn target(&self) -> (&str, &str) {
        (&self.case, &self.name)
    }

    fn target_text(&self) -> String {
        if self.case.is_empty() {
            self.name.clone()
        } else {
            format!("case {}, {}", self.case, self.name)
        }
    }
}

impl fmt::Display for DesignLabel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (target, role) = (self.target_text(), self.role.name());
        write!(f, "{target} ({role}, number {}, {} units)", self.member + 1, self.units)
    }
}

impl DesignFilter<'_> {
    fn matches(&self, label: &DesignLabel) -> bool {
        let is = |word: Option<&str>, found: &str| word.is_none_or(|word| word == found);
        is(self.name, &label.name)
            && is(self.case, &label.case)
            && is(self.role, label.role.name())
            && self.member.is_none_or(|member| member == label.member)
            && self.units.is_none_or(|units| units == label.units)
    }

    /// The row of the design that is wanted. Where only the target is known, that of the first role of refined, ga, optimum,
    /// intuitive, own that it has, and of that role the best: that of the least merit, of equal ones the first. `merits` are those of the
    /// rows; of designs that were not simulated none is known, and they come last.
    ///
    /// # Errors
    /// When none is as wanted, or several targets or kinds of designs are: with a list of them.
    pub fn choose(&self, labels: &[DesignLabel], merits: &[Option<Merit>]) -> Result<usize, InputError> {
        let found: Vec<&DesignLabel> = labels.iter().filter(|label| self.matches(label)).collect();
        let Some(first) = found.first() else {
            let all = list(labels.iter().map(ToString::to_string));
            return Err(InputError::new("no design is as wanted").help(format!("there are: {all}")));
        };
        if found.iter().any(|label| label.target() != first.target()) {
            let targets = list(found.iter().map(|label| label.target_text()));
            return Err(InputError::new("there are designs of several targets")
                .help(format!("give --design, and --case where two share a name: {targets}")));
        }
        let place = |label: &DesignLabel| (label.role, label.member);
        let role = found.iter().map(|label| label.role).min();
        let of_role = labels.iter().zip(merits);
        let of_role = of_role.filter(|(label, _)| self.matches(label) && Some(label.role) == role);
        let least = of_role.min_by(|(a, merit), (b, other)| by_merit(**merit, **other).then(a.member.cmp(&b.member)));
        let least = least.map(|(label, _)| place(label));
        let best = |label: &DesignLabel| self.matches(label) && Some(place(label)) == least;
        let mut rows = (0..labels.len()).filter(|&row| best(&labels[row]));
        match (rows.next(), rows.next()) {
            (Some(row), None) => Ok(row),
            _ => {
                let several = list(labels.iter().filter(|label| best(label)).map(ToString::to_string));
                Err(InputError::new("several designs are as wanted")
                    .help(format!("give --role, --member and --units: {several}")))
            }
        }
    }
}

/// Each once.
fn list(words: impl Iterator<Item = String>) -> String {
    let mut all: Vec<String> = Vec::new();
    for word in words {
        if !all.contains(&word) {
            all.push(word);
        }
    }
    match all.len() {
        0 => "none".to_owned(),
        n if n > LISTED => format!("{}; and {} more", all[..LISTED].join("; "), n - LISTED),
        _ => all.join("; "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(case: &str, name: &str, role: &str, member: u64, units: u64) -> DesignLabel {
        DesignLabel {
            case: case.into(),
            name: name.into(),
            role: Role::from_name(role).unwrap(),
            member,
            units,
        }
    }

    fn labels() -> Vec<DesignLabel> {
        vec![
            label("I", "a", "ga", 0, 20),
            label("I", "a", "refined", 1, 20),
            label("I", "a", "refined", 0, 20),
            label("I", "a", "optimum", 0, 20),
            label("I", "a", "optimum", 0, 50),
            label("II", "b", "ga", 0, 20),
        ]
    }

    #[test]
    fn a_target_alone_means_its_refined_design_and_the_first_of_them() {
        let labels = labels();
        let chosen = |wanted: &DesignFilter<'_>| wanted.choose(&labels, &[None; 6]).unwrap();
        let named = |name, role| DesignFilter {
            name: Some(name),
            role,
            ..DesignFilter::default()
        };
        assert_eq!(chosen(&named("a", None)), 2);
        assert_eq!(chosen(&named("b", None)), 5);
        assert_eq!(chosen(&named("a", Some("ga"))), 0);
        let member = DesignFilter {
            member: Some(1),
            ..DesignFilter::default()
        };
        assert_eq!(chosen(&member), 1);
        let fine = DesignFilter {
            units: Some(50),
            ..DesignFilter::default()
        };
        assert_eq!(chosen(&fine), 4);
    }

    #[test]
    fn of_several_designs_the_best_by_simulation_is_meant() {
        let labels: Vec<DesignLabel> = (0..4).map(|member| label("", "a", "refined", member, 20)).collect();
        let merit = |distance_mm, along_mm| Some(Merit { distance_mm, along_mm });
        let chosen = |merits: &[Option<Merit>]| DesignFilter::default().choose(&labels, merits).unwrap();
        assert_eq!(
            chosen(&[merit(0.006, 0.29), merit(0.0006, 0.3), None, merit(0.001, 0.31)]),
            1
        );
        assert_eq!(chosen(&[None, merit(0.0, 2.1), merit(0.0, 2.2), merit(0.0, 2.2)]), 2);
        assert_eq!(chosen(&[None; 4]), 0);
    }

    #[test]
    fn what_is_not_there_or_not_alone_is_refused_with_what_there_is() {
        let refused = |labels: &[DesignLabel], wanted: DesignFilter<'_>| {
            let error = wanted.choose(labels, &vec![None; labels.len()]).unwrap_err();
            format!("{error}: {}", miette::Diagnostic::help(&error).unwrap())
        };
        let all = refused(&labels(), DesignFilter::default());
        assert_eq!(
            all,
            "there are designs of several targets: give --design, and --case where two share a name: case I, a; case II, b"
        );
        let optimum = DesignFilter {
            role: Some("optimum"),
            ..DesignFilter::default()
        };
        let several = refused(&labels(), optimum);
        assert!(
            several.contains("--units: case I, a (optimum, number 1, 20 units); case I, a (optimum"),
            "{several}"
        );
        let none = DesignFilter {
            name: Some("c"),
            ..DesignFilter::default()
        };
        let none = refused(&labels(), none);
        assert!(
            none.starts_with("no design is as wanted: there are: case I, a (ga"),
            "{none}"
        );
        assert!(refused(&[], DesignFilter::default()).ends_with("there are: none"));
        let many: Vec<DesignLabel> = (0..40).map(|member| label("", "a", "ga", member, 20)).collect();
        assert!(
            refused(
                &many,
                DesignFilter {
                    units: Some(50),
                    ..DesignFilter::default()
                }
            )
            .ends_with("; and 16 more")
        );
    }
}
