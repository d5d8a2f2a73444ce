//! Finds the artifact that somebody means: by a stage of the last run, by `PIPELINE.yaml:STAGE`, or by its digest.

use std::path::Path;

use super::error::CliError;
use super::run;
use deaflow_base::{ArtifactId, nearest, readable_time};
use deaflow_orchestrator::{Environment, StageReport, Staleness, plan};
use deaflow_store::{Artifact, Command, Lookup, RemovedArtifact, Run, Store, StoreError};

/// The fewest digits that name a digest.
pub const LEAST: usize = 4;

/// Opens a store that must be there already: looking into one must not make one.
pub fn existing_store(path: &Path) -> Result<Store, CliError> {
    of_folder(Store::open_existing(path).map(Store::guarded))
}

/// What was looked for in the folder of a store, or what to do where there is none.
pub fn of_folder<T>(opened: Result<T, StoreError>) -> Result<T, CliError> {
    opened.map_err(|error| match error {
        StoreError::NoStore { path } => {
            // Which folder a relative path means depends on where the command is given.
            let path = std::path::absolute(&path).unwrap_or(path);
            CliError::bad_input(format!("there is no artifact store at {}", path.display()))
                .help("`deaflow run PIPELINE.yaml` makes one; --store or DEAFLOW_STORE names another")
        }
        other => other.into(),
    })
}

/// The artifact that `reference` names.
///
/// # Errors
/// When there is none, or several, or it is damaged.
pub fn artifact(store: &Store, reference: &str) -> Result<Artifact, CliError> {
    check_stage_is_named(reference, None)?;
    let digest = match split(reference) {
        Some((pipeline, stage)) => of_pipeline(store, Path::new(pipeline), stage)?,
        None => match of_last_run(store, reference)? {
            Some(digest) => digest,
            None => of_digits(store, reference)?,
        },
    };
    open(store, &digest)
}

/// Refuses a pipeline without a stage, and says which stages there are: those of a kind, or all.
///
/// # Errors
/// When it is one.
pub fn check_stage_is_named(reference: &str, kind: Option<&str>) -> Result<(), CliError> {
    let path = Path::new(reference);
    let is_yaml = path.extension().is_some_and(|e| e == "yaml" || e == "yml");
    if !is_yaml || !path.is_file() {
        return Ok(());
    }
    let pipeline = run::load_plain(path)?;
    let stages = pipeline.stages.iter();
    let named = stages.filter(|spec| kind.is_none_or(|kind| spec.kind.name() == kind));
    let names: Vec<String> = named.map(|spec| format!("{reference}:{}", spec.name)).collect();
    let error = CliError::bad_input(format!("{reference} is a pipeline, and one of its stages is wanted"));
    Err(match (names.as_slice(), kind) {
        ([], Some(kind)) => error.help(format!("it has no stage of kind `{kind}`")),
        ([], None) => error,
        (names, _) => error.help(format!("name one: {}", names.join(", "))),
    })
}

/// Opens an artifact; of one that a collection has removed it is said when.
fn open(store: &Store, digest: &ArtifactId) -> Result<Artifact, CliError> {
    match store.artifact(digest) {
        Err(error @ StoreError::Missing { .. }) => Err(match store.removal_of(digest)? {
            Some(removed) => collected(&removed),
            None => error.into(),
        }),
        opened => Ok(opened?),
    }
}

/// A refusal of an artifact that a collection has removed.
fn collected(removed: &RemovedArtifact) -> CliError {
    let kind = match removed.kind.as_str() {
        "" => String::new(),
        kind => format!(" ({kind})"),
    };
    let (digest, at) = (removed.digest.short(), readable_time(&removed.at));
    CliError::bad_input(format!("artifact {digest}{kind} was removed by gc at {at}"))
        .help("`deaflow run` of its pipeline builds it again; `deaflow pin` keeps an artifact through every gc")
}

/// `PIPELINE.yaml:STAGE`; the path may hold colons too.
pub fn split(reference: &str) -> Option<(&str, &str)> {
    let (pipeline, stage) = reference.rsplit_once(':')?;
    let extension = Path::new(pipeline).extension()?;
    (extension == "yaml" || extension == "yml").then_some((pipeline, stage))
}

fn of_pipeline(store: &Store, path: &Path, name: &str) -> Result<ArtifactId, CliError> {
    let pipeline = run::load_plain(path)?;
    if let Some(sweep) = pipeline.sweep(name) {
        return Err(several(path, &sweep.name, &sweep.stages));
    }
    let stages = plan(&pipeline, store, Some(name), &Environment::system())?;
    let found = stages.iter().find(|stage| stage.name == name);
    if let Some(StageReport {
        staleness: Some(Staleness::ArtifactDamaged),
        digest: Some(digest),
        ..
    }) = found
    {
        // Opening it says what is wrong, unless a chunk of it is damaged.
        store.artifact(digest)?.chunks()?;
    }
    let built = found.filter(|stage| stage.why.is_none());
    built.and_then(|stage| stage.digest).ok_or_else(|| {
        let why = match found.and_then(|stage| stage.staleness.as_ref()) {
            Some(why @ Staleness::Removed { .. }) => format!(": {why}"),
            _ => String::new(),
        };
        CliError::bad_input(format!("stage `{name}` of {} is not built{why}", path.display()))
            .help(format!("build it: deaflow run {} --until {name}", path.display()))
    })
}

/// A refusal of a name that means several stages.
pub fn several(path: &Path, name: &str, stages: &[String]) -> CliError {
    const SHOWN: usize = 8;
    let mut list: Vec<&str> = stages.iter().take(SHOWN).map(String::as_str).collect();
    if stages.len() > SHOWN {
        list.push("…");
    }
    let message = format!("`{name}` of {} stands for {} stages", path.display(), stages.len());
    CliError::bad_input(message).help(format!("name one of them: {}", list.join(", ")))
}

/// What the newest run that has a stage of that name made there, if no record contradicts it.
fn of_last_run(store: &Store, name: &str) -> Result<Option<ArtifactId>, CliError> {
    let Some(stage) = store.last_made(name, None)? else {
        return Ok(None);
    };
    let is_so = match store.record(&stage.key)? {
        Lookup::Found(record, _) => record.artifact == stage.artifact,
        Lookup::Absent => true,
        Lookup::Damaged(_) => false,
    };
    match is_so {
        true => Ok(Some(stage.artifact)),
        false => Err(CliError::bad_input(format!(
            "the last run that had `{name}` says that it made {}, and the record of that does not",
            stage.artifact.short()
        ))
        .help("check the store: deaflow fsck")),
    }
}

fn of_digits(store: &Store, digits: &str) -> Result<ArtifactId, CliError> {
    let hexadecimal = !digits.is_empty() && digits.chars().all(|c| c.is_ascii_hexdigit());
    if !hexadecimal {
        return Err(unknown(store, digits)?);
    }
    if digits.len() < LEAST {
        return Err(CliError::bad_input(format!("{digits:?} is too short for a digest"))
            .help(format!("give at least its first {LEAST} digits")));
    }
    match store.find(&digits.to_ascii_lowercase())?.as_slice() {
        [one] => Ok(*one),
        [] => Err(gone(store, &digits.to_ascii_lowercase())?.map_or_else(|| unknown(store, digits), Ok)?),
        several => {
            let list: Vec<String> = several.iter().map(ArtifactId::to_string).collect();
            Err(CliError::bad_input(format!("{} artifacts begin with {digits}", several.len())).help(list.join(", ")))
        }
    }
}

/// What is said of digits with which an artifact begins that a collection has removed; of several the last.
fn gone(store: &Store, digits: &str) -> Result<Option<CliError>, CliError> {
    let begins = |removed: &RemovedArtifact| removed.digest.to_string().starts_with(digits);
    let Some(last) = store.removed().into_iter().rfind(begins) else {
        return Ok(None);
    };
    Ok(store.removal_of(&last.digest)?.map(|removed| collected(&removed)))
}

fn unknown(store: &Store, reference: &str) -> Result<CliError, CliError> {
    // An audit goes as far as the stage that it looks at.
    let is_whole = |run: &Result<Run, StoreError>| !run.as_ref().is_ok_and(|run| run.command == Command::Audit);
    let last = store.runs()?.find(is_whole).transpose()?.unwrap_or_default();
    let names: Vec<&str> = last.stages.iter().map(|s| s.name.as_str()).collect();
    let root = store.root().display();
    let error = CliError::bad_input(format!(
        "no stage of a run in {root} is named {reference:?}, and no digest begins so"
    ));
    Ok(match nearest(reference, &names) {
        Some(near) => error.help(format!(
            "did you mean `{near}`? stages of the last run: {}",
            names.join(", ")
        )),
        None if names.is_empty() => error.help("no pipeline has been run in this store"),
        None => error.help(format!("stages of the last run: {}", names.join(", "))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipeline_and_a_stage_are_told_from_a_name() {
        assert_eq!(split("a:b/p.yaml:solved"), Some(("a:b/p.yaml", "solved")));
        assert_eq!(split("p.yml:x"), Some(("p.yml", "x")));
        for other in ["solved", "abcd1234", "out.h5:/patterns", "p.yaml"] {
            assert_eq!(split(other), None, "{other}");
        }
    }
}
