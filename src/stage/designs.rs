//! One design out of an artifact of a `design` or `verify` stage, or out of a file of one pattern.

use std::path::Path;

use super::direct::{self, read_scene};
use crate::base::InputError;
use crate::content::{DesignRows, StoredAttribute};
use crate::orchestrator::StageError;
use crate::pattern::{Pattern, Role};
use crate::scene::Scene;
use crate::store::Artifact;

/// The most designs that an error lists.
const LISTED: usize = 24;

/// Which design is wanted; what is not said does not matter.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted<'a> {
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

/// What a design is called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
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

impl Label {
    fn words(&self) -> String {
        let target = self.target_words();
        format!(
            "{target} ({}, member {}, {} units)",
            self.role.name(),
            self.member,
            self.units
        )
    }

    fn target(&self) -> (&str, &str) {
        (&self.case, &self.name)
    }

    fn target_words(&self) -> String {
        if self.case.is_empty() {
            self.name.clone()
        } else {
            format!("case {}, {}", self.case, self.name)
        }
    }
}

/// A design with all that is needed to make or simulate it.
#[derive(Clone, Debug)]
pub struct Design {
    /// What it is called, where it comes from an artifact.
    pub label: Option<Label>,
    /// The same as a title.
    pub title: String,
    /// Where it comes from.
    pub source: String,
    /// Its electrode.
    pub pattern: Pattern,
    /// The scene that it was made for.
    pub scene: Scene,
}

impl Design {
    /// Its cells `[y][x]`, 1 = electrode, and how many there are along a side.
    #[must_use]
    pub fn cells(&self) -> (&[u8], usize) {
        (self.pattern.cells(), crate::pattern::CELLS)
    }
}

/// The designs of an artifact.
pub struct Designs {
    labels: Vec<Label>,
    patterns: Vec<Pattern>,
    scene: Scene,
    source: String,
}

impl Designs {
    /// Reads all of them; `None` where the artifact is not one of a stage of kind `design` or `verify`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn read(artifact: &Artifact) -> Result<Option<Self>, StageError> {
        if !matches!(artifact.kind(), "design" | "verify") {
            return Ok(None);
        }
        let rows = DesignRows::open(artifact)?;
        let (case, name, role) = (rows.case().read()?, rows.name().read()?, rows.role().read()?);
        let (member, units) = (rows.member().read()?, rows.units().read()?);
        let label = |i: usize| Label {
            case: case[i].clone(),
            name: name[i].clone(),
            role: role[i],
            member: member[i],
            units: units[i],
        };
        Ok(Some(Self {
            labels: (0..case.len()).map(label).collect(),
            patterns: rows.patterns().read()?,
            scene: StoredAttribute::new(artifact, "scene").read()?,
            source: format!("artifact {}", artifact.digest()),
        }))
    }

    /// The one that is wanted. Where only the target is known, that of the first role of refined, ga, optimum, intuitive
    /// that it has, and of that role the first.
    ///
    /// # Errors
    /// When none is as wanted, or several targets or kinds of designs are: with a list of them.
    pub fn choose(&self, wanted: &Wanted<'_>) -> Result<Design, InputError> {
        let row = choose(&self.labels, wanted)?;
        Ok(Design {
            title: self.labels[row].words(),
            label: Some(self.labels[row].clone()),
            source: self.source.clone(),
            pattern: self.patterns[row].clone(),
            scene: self.scene.clone(),
        })
    }
}

/// The one pattern of a file, for the scene in another.
///
/// # Errors
/// When one cannot be read, or the file holds several patterns.
pub fn of_file(file: &str, scene: &Path) -> Result<Design, InputError> {
    let patterns = direct::patterns(&[file.to_owned()])?;
    let [pattern] = patterns.as_slice() else {
        let message = format!(
            "{file} holds {} patterns, and one is exported at a time",
            patterns.len()
        );
        return Err(InputError::new(message).help("write the one that is meant into a file of its own"));
    };
    let title = Path::new(file).file_stem().unwrap_or_default().to_string_lossy();
    Ok(Design {
        label: None,
        title: title.into_owned(),
        source: format!("file {file}"),
        pattern: pattern.clone(),
        scene: read_scene(scene)?,
    })
}

/// The row that is wanted, or why there is not one.
fn choose(labels: &[Label], wanted: &Wanted<'_>) -> Result<usize, InputError> {
    let is = |word: Option<&str>, found: &str| word.is_none_or(|word| word == found);
    let as_wanted = |label: &&Label| {
        is(wanted.name, &label.name)
            && is(wanted.case, &label.case)
            && is(wanted.role, label.role.name())
            && wanted.member.is_none_or(|member| member == label.member)
            && wanted.units.is_none_or(|units| units == label.units)
    };
    let found: Vec<&Label> = labels.iter().filter(as_wanted).collect();
    let Some(first) = found.first() else {
        let all = list(labels.iter().map(Label::words));
        return Err(InputError::new("no design is as wanted").help(format!("there are: {all}")));
    };
    if found.iter().any(|label| label.target() != first.target()) {
        let targets = list(found.iter().map(|label| label.target_words()));
        return Err(InputError::new("there are designs of several targets")
            .help(format!("give --design, and --case where two share a name: {targets}")));
    }
    let place = |label: &Label| (label.role, label.member);
    let least = found.iter().map(|label| place(label)).min();
    let best = |label: &Label| as_wanted(&label) && Some(place(label)) == least;
    let mut rows = (0..labels.len()).filter(|&row| best(&labels[row]));
    match (rows.next(), rows.next()) {
        (Some(row), None) => Ok(row),
        _ => {
            let several = list(labels.iter().filter(|label| best(label)).map(Label::words));
            Err(InputError::new("several designs are as wanted")
                .help(format!("give --role, --member and --units: {several}")))
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

    fn label(case: &str, name: &str, role: Role, member: u64, units: u64) -> Label {
        Label {
            case: case.into(),
            name: name.into(),
            role,
            member,
            units,
        }
    }

    fn labels() -> Vec<Label> {
        vec![
            label("I", "a", Role::Ga, 0, 20),
            label("I", "a", Role::Refined, 1, 20),
            label("I", "a", Role::Refined, 0, 20),
            label("I", "a", Role::Optimum, 0, 20),
            label("I", "a", Role::Optimum, 0, 50),
            label("II", "b", Role::Ga, 0, 20),
        ]
    }

    #[test]
    fn a_target_alone_means_its_refined_design_and_the_first_of_them() {
        let labels = labels();
        let chosen = |wanted: &Wanted<'_>| choose(&labels, wanted).unwrap();
        let named = |name, role| Wanted {
            name: Some(name),
            role,
            ..Wanted::default()
        };
        assert_eq!(chosen(&named("a", None)), 2);
        assert_eq!(chosen(&named("b", None)), 5);
        assert_eq!(chosen(&named("a", Some("ga"))), 0);
        let member = Wanted {
            member: Some(1),
            ..Wanted::default()
        };
        assert_eq!(chosen(&member), 1);
        let fine = Wanted {
            units: Some(50),
            ..Wanted::default()
        };
        assert_eq!(chosen(&fine), 4);
    }

    #[test]
    fn what_is_not_there_or_not_alone_is_refused_with_what_there_is() {
        let refused = |labels: &[Label], wanted: Wanted<'_>| {
            let error = choose(labels, &wanted).unwrap_err();
            format!("{error}: {}", miette::Diagnostic::help(&error).unwrap())
        };
        let all = refused(&labels(), Wanted::default());
        assert_eq!(
            all,
            "there are designs of several targets: give --design, and --case where two share a name: case I, a; case II, b"
        );
        let optimum = Wanted {
            role: Some("optimum"),
            ..Wanted::default()
        };
        let several = refused(&labels(), optimum);
        assert!(
            several.contains("--units: case I, a (optimum, member 0, 20 units); case I, a (optimum"),
            "{several}"
        );
        let none = Wanted {
            name: Some("c"),
            ..Wanted::default()
        };
        let none = refused(&labels(), none);
        assert!(
            none.starts_with("no design is as wanted: there are: case I, a (ga"),
            "{none}"
        );
        assert!(refused(&[], Wanted::default()).ends_with("there are: none"));
        let many: Vec<Label> = (0..40).map(|member| label("", "a", Role::Ga, member, 20)).collect();
        assert!(
            refused(
                &many,
                Wanted {
                    units: Some(50),
                    ..Wanted::default()
                }
            )
            .ends_with("; and 16 more")
        );
    }
}
