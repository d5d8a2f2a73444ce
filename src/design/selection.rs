//! Selects one design from an artifact.

use std::cmp::Ordering;
use std::fmt;

use deaflow_base::InputError;
use deaflow_pattern::{CELLS, Raster, Role};

/// Maximum number of designs that an error lists.
const LISTED: usize = 24;

/// Selects designs; `None` matches any.
#[derive(Clone, Copy, Debug, Default)]
pub struct DesignFilter<'a> {
    /// The name of the target.
    pub name: Option<&'a str>,
    /// The case.
    pub case: Option<&'a str>,
    /// The role.
    pub role: Option<&'a str>,
    /// The number among the different designs of a target, from 0.
    pub member: Option<u64>,
    /// Units along a side of the membrane.
    pub units: Option<u64>,
}

/// The simulated performance of a design. A smaller distance is better; for equal distances, a larger displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedScore {
    /// Distance from the target displacements in mm; 0 if the target is a direction.
    pub distance_mm: f64,
    /// Displacement along the target directions in mm.
    pub along_mm: f64,
}

/// The best first; designs without a score last.
fn by_score(a: Option<SimulatedScore>, b: Option<SimulatedScore>) -> Ordering {
    match (a, b) {
        (Some(a), Some(b)) => (a.distance_mm.total_cmp(&b.distance_mm)).then(b.along_mm.total_cmp(&a.along_mm)),
        (a, b) => a.is_none().cmp(&b.is_none()),
    }
}

/// The label of a design.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DesignLabel {
    /// The case; may be empty.
    pub case: String,
    /// The name of the target.
    pub name: String,
    /// The role.
    pub role: Role,
    /// The number among the different designs of a target, from 0.
    pub member: u64,
    /// Units along a side of the membrane.
    pub units: u64,
    /// The cells of the membrane.
    pub raster: Raster,
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
        write!(f, "{target} ({role}, number {}, ", self.member + 1)?;
        let is_coarse = self.raster.sides().into_iter().any(|cells| (cells as u64) < self.units);
        match self.units == CELLS as u64 {
            // The membrane may have other cells than 50 × 50.
            true => f.write_str("single cells)"),
            false if is_coarse => write!(f, "{} units on {} cells)", self.units, self.raster),
            false => write!(f, "{} units)", self.units),
        }
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

    /// The row of the selected design. Among the matching designs of one target, the first role of refined, ga,
    /// optimum, intuitive, own is used, and of this role the design with the best score; ties go to the lowest member.
    /// `scores` has one entry per row: `None` for a design without a simulation, which ranks last.
    ///
    /// # Errors
    /// If no design matches, or several targets or kinds of designs match; the error lists them.
    pub fn choose(&self, labels: &[DesignLabel], scores: &[Option<SimulatedScore>]) -> Result<usize, InputError> {
        let found: Vec<&DesignLabel> = labels.iter().filter(|label| self.matches(label)).collect();
        let Some(first) = found.first() else {
            let all = list(labels.iter().map(ToString::to_string));
            return Err(InputError::new("no design matches").help(format!("available: {all}")));
        };
        if found.iter().any(|label| label.target() != first.target()) {
            let targets = list(found.iter().map(|label| label.target_text()));
            return Err(InputError::new("designs of several targets match").help(format!(
                "use --design, and --case if two targets share a name: {targets}"
            )));
        }
        let key = |label: &DesignLabel| (label.role, label.member);
        let role = found.iter().map(|label| label.role).min();
        let of_role = labels.iter().zip(scores);
        let of_role = of_role.filter(|(label, _)| self.matches(label) && Some(label.role) == role);
        let best = of_role.min_by(|(a, score), (b, other)| by_score(**score, **other).then(a.member.cmp(&b.member)));
        let best = best.map(|(label, _)| key(label));
        let is_best = |label: &DesignLabel| self.matches(label) && Some(key(label)) == best;
        let mut rows = (0..labels.len()).filter(|&row| is_best(&labels[row]));
        match (rows.next(), rows.next()) {
            (Some(row), None) => Ok(row),
            _ => {
                let several = list(labels.iter().filter(|label| is_best(label)).map(ToString::to_string));
                Err(InputError::new("several designs match").help(format!(
                    "use --role, --member and --units ({CELLS}: single cells): {several}"
                )))
            }
        }
    }
}

/// Lists each text once.
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
            raster: Raster::PAPER,
        }
    }

    #[test]
    fn a_label_says_what_the_search_could_switch() {
        for (units, cells, expected) in [
            (20, [50, 50], "a (ga, number 1, 20 units)"),
            (50, [50, 50], "a (ga, number 1, single cells)"),
            (50, [8, 8], "a (ga, number 1, single cells)"),
            (20, [10, 10], "a (ga, number 1, 20 units on 10 × 10 cells)"),
            (20, [60, 8], "a (ga, number 1, 20 units on 60 × 8 cells)"),
            (20, [20, 20], "a (ga, number 1, 20 units)"),
        ] {
            let label = DesignLabel {
                raster: Raster::new(cells[0], cells[1]).unwrap(),
                ..label("", "a", "ga", 0, units)
            };
            assert_eq!(label.to_string(), expected);
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
    fn a_target_selects_its_first_refined_design() {
        let labels = labels();
        let chosen = |filter: &DesignFilter<'_>| filter.choose(&labels, &[None; 6]).unwrap();
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
    fn the_best_simulated_design_is_selected() {
        let labels: Vec<DesignLabel> = (0..4).map(|member| label("", "a", "refined", member, 20)).collect();
        let score = |distance_mm, along_mm| Some(SimulatedScore { distance_mm, along_mm });
        let chosen = |scores: &[Option<SimulatedScore>]| DesignFilter::default().choose(&labels, scores).unwrap();
        assert_eq!(
            chosen(&[score(0.006, 0.29), score(0.0006, 0.3), None, score(0.001, 0.31)]),
            1
        );
        assert_eq!(chosen(&[None, score(0.0, 2.1), score(0.0, 2.2), score(0.0, 2.2)]), 2);
        assert_eq!(chosen(&[None; 4]), 0);
    }

    #[test]
    fn missing_and_ambiguous_designs_are_refused_with_a_list() {
        let refused = |labels: &[DesignLabel], filter: DesignFilter<'_>| {
            let error = filter.choose(labels, &vec![None; labels.len()]).unwrap_err();
            format!("{error}: {}", miette::Diagnostic::help(&error).unwrap())
        };
        let all = refused(&labels(), DesignFilter::default());
        assert_eq!(
            all,
            "designs of several targets match: use --design, and --case if two targets share a name: case I, a; \
             case II, b"
        );
        let optimum = DesignFilter {
            role: Some("optimum"),
            ..DesignFilter::default()
        };
        let several = refused(&labels(), optimum);
        assert!(
            several.ends_with(
                "--units (50: single cells): case I, a (optimum, number 1, 20 units); case I, a (optimum, number 1, \
                 single cells)"
            ),
            "{several}"
        );
        let none = DesignFilter {
            name: Some("c"),
            ..DesignFilter::default()
        };
        let none = refused(&labels(), none);
        assert!(
            none.starts_with("no design matches: available: case I, a (ga"),
            "{none}"
        );
        assert!(refused(&[], DesignFilter::default()).ends_with("available: none"));
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
