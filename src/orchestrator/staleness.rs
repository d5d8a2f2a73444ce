//! The reasons why a stage has to be built.

use std::borrow::Cow;
use std::fmt;

use super::kind::Kind;
use deaflow_base::{ArtifactId, Canonical, Digest, readable_time};
use deaflow_store::{Condition, Record, Run};

/// Why a stage is stale.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Staleness {
    /// It has not been built in this store, as far as the history shows.
    NoRecord,
    /// A parameter differs from the most similar of the last runs.
    ParameterChanged {
        /// Dotted path of the first parameter that differs, as `--set` takes it: after `stages.NAME.`, or from `scene.`
        /// on.
        which: String,
        /// Its earlier value.
        from: String,
        /// Its present value.
        to: String,
    },
    /// The content of a file differs from the most similar of the last runs.
    FileChanged {
        /// The files that may have changed, as the pipeline names them.
        which: Vec<String>,
    },
    /// An input differs from the most similar of the last runs, or is not built yet.
    InputChanged {
        /// Name of the first stage whose artifact differs.
        which: String,
    },
    /// The inputs are those of the most similar of the last runs, in another order.
    InputsReordered,
    /// An input of the most similar of the last runs is no input any more.
    InputGone {
        /// Name of the stage in that run, or the digits of its artifact.
        which: String,
    },
    /// The RECIPE of the kind has changed.
    RecipeChanged {
        /// Earlier number.
        from: u32,
        /// Present number.
        to: u32,
    },
    /// Its artifact was removed by a garbage collection.
    Removed {
        /// When, in UTC, RFC 3339.
        at: String,
    },
    /// Its artifact or a chunk of it is missing.
    ArtifactMissing,
    /// Its artifact or a chunk of it is damaged.
    ArtifactDamaged,
}

impl fmt::Display for Staleness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRecord => f.write_str("not built yet"),
            Self::ParameterChanged { which, from, to } => {
                write!(f, "parameter changed: {which} from {from} to {to}")
            }
            Self::FileChanged { which } => match which.as_slice() {
                [one] => write!(f, "file changed: {one}"),
                several => write!(f, "files changed: one or more of {}", several.join(", ")),
            },
            Self::InputChanged { which } => write!(f, "input changed: {which}"),
            Self::InputsReordered => f.write_str("order of needs changed"),
            Self::InputGone { which } => write!(f, "no longer needed: {which}"),
            Self::RecipeChanged { from, to } => write!(f, "recipe changed: from {from} to {to}"),
            Self::Removed { at } => write!(f, "removed by gc at {}", readable_time(at)),
            Self::ArtifactMissing => f.write_str("artifact missing"),
            Self::ArtifactDamaged => f.write_str("artifact damaged"),
        }
    }
}

/// The present state of a stage, to compare with an earlier one.
pub struct Current<'a> {
    /// RECIPE number of its results: that of its kind, and what follows from its parameters.
    pub recipe: u32,
    /// Its kind.
    pub kind: &'a dyn Kind,
    /// The parameters that it has from the scene.
    pub from_scene: &'a [String],
    /// The files that it names, relative to the file of the pipeline.
    pub files: &'a [String],
    /// Canonical parameters.
    pub parameters: &'a Canonical,
    /// Names of the stages that it needs, with their digests as far as known.
    pub inputs: &'a [(&'a str, Option<ArtifactId>)],
}

impl Staleness {
    /// Returns the first reason why a stage without a record is stale, compared with its record in an earlier run.
    #[must_use]
    pub fn since(current: &Current<'_>, previous: Option<&Record>, run: Option<&Run>) -> Self {
        Self::all_since(current, previous, run).remove(0)
    }

    /// Returns all reasons why a stage without a record is stale, parameters first; never empty.
    #[must_use]
    pub fn all_since(current: &Current<'_>, previous: Option<&Record>, run: Option<&Run>) -> Vec<Self> {
        let Some(previous) = previous else {
            return vec![Self::NoRecord];
        };
        let both = [current.parameters, &previous.action.parameters];
        let [now, then] = current.kind.as_written(both);
        let changed = |which: fn(&str) -> bool| parameters_changed([&now, &then], current.from_scene, which);
        let mut all = changed(is_of_users);
        if !current.files.is_empty() {
            let of_content = changed(|_| true).into_iter().filter(Self::is_of_content);
            let files = files_changed(of_content, current.files);
            all.retain(|one| !one.is_of_content());
            all.splice(0..0, files);
        }
        // What follows from changed parameters is no reason of its own. A smaller number is that of an older kind.
        let follows = !all.is_empty() && previous.action.recipe >= current.kind.recipe();
        all.extend(recipe_changed(current.recipe, previous.action.recipe).filter(|_| !follows));
        all.extend(inputs_changed(current.inputs, &previous.action.inputs, run));
        if all.is_empty() {
            all = changed(|_| true);
        }
        if all.is_empty() {
            all.push(Self::NoRecord);
        }
        all
    }

    /// Whether it is the change of a digest that a stage has of its files.
    fn is_of_content(&self) -> bool {
        match self {
            Self::ParameterChanged { which, from, to } => {
                !which.starts_with("scene.") && [from, to].into_iter().all(|value| is_short_digest(value))
            }
            _ => false,
        }
    }

    /// Returns why a stage with a record is stale, given the condition of its artifact or of one of its chunks.
    #[must_use]
    pub fn of_artifact(condition: &Condition) -> Option<Self> {
        artifact_missing(condition).or_else(|| artifact_damaged(condition))
    }
}

fn parameters_changed(both: [&Canonical; 2], from_scene: &[String], which: fn(&str) -> bool) -> Vec<Staleness> {
    let [now, then] = both.map(Canonical::leaves);
    let absent = || "none".to_owned();
    let value = |leaves: &[(String, &Canonical)], path: &str| {
        let found = leaves.iter().find(|(other, _)| other == path);
        found.map_or_else(absent, |(_, value)| with_short_digest(value))
    };
    let changed = now.iter().filter(|leaf| !then.contains(leaf));
    let changed = changed.filter(|(path, value)| !is_filled(path, value, then.iter().map(|(path, _)| path)));
    let dropped = then
        .iter()
        .filter(|(path, _)| !now.iter().any(|(other, _)| other == path));
    let dropped = dropped.filter(|(path, value)| !is_filled(path, value, now.iter().map(|(path, _)| path)));
    changed
        .chain(dropped)
        .filter(|(path, _)| which(path))
        .map(|(which, _)| Staleness::ParameterChanged {
            which: as_set(which, from_scene).into_owned(),
            from: value(&then, which),
            to: value(&now, which),
        })
        .collect()
}

/// What a digest of content starts with where people read it.
const DIGEST: &str = "digest ";

/// Whether a value is the digest of content, as of files that a stage reads.
#[must_use]
pub fn is_digest(value: &Canonical) -> bool {
    matches!(value, Canonical::Text(text) if text.parse::<Digest>().is_ok())
}

/// Formats a value for people; of a digest of content only the first digits, which suffice to tell two apart.
#[must_use]
pub fn with_short_digest(value: &Canonical) -> String {
    match value {
        Canonical::Text(text) => match text.parse::<Digest>() {
            Ok(digest) => format!("{DIGEST}{}", digest.short()),
            Err(_) => value.to_string(),
        },
        _ => value.to_string(),
    }
}

fn is_short_digest(text: &str) -> bool {
    text.starts_with(DIGEST)
}

/// Returns the change of files, given the changes of their digests: those files that the paths name, or all.
fn files_changed(changes: impl Iterator<Item = Staleness>, files: &[String]) -> Option<Staleness> {
    let paths: Vec<String> = changes
        .filter_map(|change| match change {
            Staleness::ParameterChanged { which, .. } => Some(which),
            _ => None,
        })
        .collect();
    let is_named = |file: &&String| paths.iter().any(|path| path.contains(file.as_str()));
    let named: Vec<String> = files.iter().filter(is_named).cloned().collect();
    (!paths.is_empty()).then(|| Staleness::FileChanged {
        which: if named.is_empty() { files.to_vec() } else { named },
    })
}

/// Parameters of stages that follow from others, and that users do not set: they separate results from those of earlier
/// versions, or come from a sweep.
const NOT_SET: [&str; 8] = [
    "area_scale",
    "devices",
    "intuitive",
    "known_elastomer",
    "leads",
    "pull_in_meshes",
    "rows",
    "units_of_cells",
];

/// Whether a canonical parameter of a stage is one that users set, by its path.
#[must_use]
pub fn is_of_users(path: &str) -> bool {
    !NOT_SET.contains(&of_stage(path))
}

/// Whether a value is an empty mapping that has entries on the other side, whose paths show the change.
pub fn is_filled<'a>(path: &str, value: &Canonical, mut others: impl Iterator<Item = &'a String>) -> bool {
    let is_within = |other: &String| other.strip_prefix(path).is_some_and(|rest| rest.starts_with('.'));
    matches!(value, Canonical::Map(map) if map.is_empty()) && others.any(is_within)
}

/// Returns the path of a canonical parameter in its stage: chunked stages have common parameters under `stage`.
fn of_stage(path: &str) -> &str {
    path.strip_prefix("stage.").unwrap_or(path)
}

/// Returns the path of a canonical parameter for `--set`: after `stages.NAME.`, or from `scene.` on. `from_scene` are
/// the parameters that the stage has from the scene, see [`Kind::scene_parameters`].
#[must_use]
pub fn as_set<'p>(path: &'p str, from_scene: &[impl AsRef<str>]) -> Cow<'p, str> {
    let path = of_stage(path);
    let in_scene = |one: &str| {
        let (own, scene) = one.split_once('=').unwrap_or((one, one));
        let rest = path.strip_prefix(own)?;
        (rest.is_empty() || rest.starts_with('.')).then(|| format!("scene.{scene}{rest}"))
    };
    let found = from_scene.iter().find_map(|one| in_scene(one.as_ref()));
    found.map_or(Cow::Borrowed(path), Cow::Owned)
}

fn recipe_changed(now: u32, then: u32) -> Option<Staleness> {
    (now != then).then_some(Staleness::RecipeChanged { from: then, to: now })
}

fn inputs_changed(now: &[(&str, Option<ArtifactId>)], then: &[ArtifactId], run: Option<&Run>) -> Vec<Staleness> {
    let mut left = then.to_vec();
    let mut changed = Vec::new();
    for (name, digest) in now {
        match digest.and_then(|digest| left.iter().position(|one| *one == digest)) {
            Some(place) => drop(left.remove(place)),
            None => changed.push(*name),
        }
    }
    if changed.is_empty() && left.is_empty() {
        let is_same = now.iter().map(|(_, digest)| *digest).eq(then.iter().copied().map(Some));
        return if is_same {
            Vec::new()
        } else {
            vec![Staleness::InputsReordered]
        };
    }
    // Only the run has the names of its inputs.
    let gone = left.into_iter().filter_map(|gone| {
        let stage = run.and_then(|run| run.stages.iter().find(|stage| stage.artifact == gone));
        match stage {
            Some(stage) if now.iter().any(|(name, _)| *name == stage.name) => None,
            Some(stage) => Some(stage.name.clone()),
            // It may be the former artifact of one that has changed.
            None => changed.is_empty().then(|| gone.short()),
        }
    });
    let gone: Vec<String> = gone.collect();
    let changed = changed.iter().map(|which| Staleness::InputChanged {
        which: (*which).to_owned(),
    });
    changed
        .chain(gone.into_iter().map(|which| Staleness::InputGone { which }))
        .collect()
}

fn artifact_missing(condition: &Condition) -> Option<Staleness> {
    matches!(condition, Condition::Missing).then_some(Staleness::ArtifactMissing)
}

fn artifact_damaged(condition: &Condition) -> Option<Staleness> {
    matches!(condition, Condition::Damaged(_)).then_some(Staleness::ArtifactDamaged)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU64;

    use super::*;
    use crate::tests::Count;
    use deaflow_base::{ActionKey, FileDigest};
    use deaflow_store::{Action, RunStage, StageOutcome};

    #[test]
    fn a_recipe_that_follows_from_a_parameter_is_no_reason() {
        static KIND: Count = Count {
            fails: AtomicU64::new(0),
            recipe: 5,
        };
        let parameters = |mesh: u64| Canonical::map([("elements_per_cell", mesh.into())]);
        let record = |recipe: u32| {
            let action = Action {
                kind: "verify".to_owned(),
                recipe,
                parameters: parameters(2),
                inputs: Vec::new(),
            };
            Record {
                key: action.key().unwrap(),
                action,
                artifact: ArtifactId::of(b"artifact"),
                file_digest: FileDigest::of(b"file"),
                size: 1,
                seconds: 1.0,
                unstable: 0,
                created: String::new(),
                version: String::new(),
                target: String::new(),
            }
        };
        let told = |mesh: u64, then: u32| {
            let parameters = parameters(mesh);
            let current = Current {
                recipe: 13,
                kind: &&KIND,
                from_scene: &["mask".to_owned()],
                files: &[],
                parameters: &parameters,
                inputs: &[],
            };
            let all = Staleness::all_since(&current, Some(&record(then)), None);
            all.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let parameter = "parameter changed: elements_per_cell from 2 to 8";
        assert_eq!(told(8, 5), [parameter]);
        assert_eq!(told(8, 4), [parameter, "recipe changed: from 4 to 13"]);
        assert_eq!(told(2, 5), ["recipe changed: from 5 to 13"]);
    }

    #[test]
    fn inputs_are_told_by_name_and_not_by_place() {
        let id = |text: &str| ArtifactId::of(text.as_bytes());
        let stage = |name: &str| RunStage {
            name: name.to_owned(),
            kind: "count".to_owned(),
            key: ActionKey::of(name.as_bytes()),
            artifact: id(name),
            outcome: StageOutcome::Built,
            from_scene: Vec::new(),
        };
        let run = Run {
            stages: ["a", "b", "c"].map(stage).into(),
            ..Run::default()
        };
        let told = |now: &[(&str, Option<ArtifactId>)], then: &[&str]| {
            let then: Vec<ArtifactId> = then.iter().map(|name| id(name)).collect();
            let all = inputs_changed(now, &then, Some(&run));
            all.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
        };
        let [a, b, c] = ["a", "b", "c"].map(|name| (name, Some(id(name))));
        assert_eq!(told(&[a, b], &["a", "b"]), "");
        assert_eq!(told(&[b, a], &["a", "b"]), "order of needs changed");
        assert_eq!(told(&[b, c], &["a", "b", "c"]), "no longer needed: a");
        assert_eq!(told(&[("a", Some(id("new"))), b], &["a", "b"]), "input changed: a");
        assert_eq!(
            told(&[("d", None), a], &["a", "b"]),
            "input changed: d; no longer needed: b"
        );
        assert_eq!(inputs_changed(&[a], &[id("a"), id("x")], None).len(), 1);
    }

    #[test]
    fn parameters_from_the_scene_have_its_paths() {
        let from_scene = ["tolerances", "targets.left.objective.robust.mask=tolerances.mask"];
        for (path, expected) in [
            ("tolerances.thickness", "scene.tolerances.thickness"),
            ("stage.tolerances", "scene.tolerances"),
            ("targets.left.objective.robust.mask", "scene.tolerances.mask"),
            (
                "targets.right.objective.robust.mask",
                "targets.right.objective.robust.mask",
            ),
            ("tolerances_of.mask", "tolerances_of.mask"),
        ] {
            assert_eq!(as_set(path, &from_scene), expected);
        }
    }

    #[test]
    fn what_is_written_into_an_empty_mapping_is_the_change() {
        let stage = |constraints: Canonical, more: Option<u64>| {
            let devices = more.map(|more| ("devices", more.into()));
            Canonical::map([(
                "stage",
                Canonical::map([("constraints", constraints)].into_iter().chain(devices)),
            )])
        };
        let (without, with) = (
            stage(Canonical::map::<&str>([]), None),
            stage(Canonical::map([("min_feature", 3_u64.into())]), Some(2)),
        );
        let told = |now: &Canonical, then: &Canonical| {
            let changes = parameters_changed([now, then], &[], is_of_users).into_iter();
            changes.map(|change| change.to_string()).collect::<Vec<_>>()
        };
        assert_eq!(
            told(&with, &without),
            ["parameter changed: constraints.min_feature from none to 3"]
        );
        assert_eq!(
            told(&without, &with),
            ["parameter changed: constraints.min_feature from 3 to none"]
        );
    }
}
