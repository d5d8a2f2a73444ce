//! Finds the artifact of a reference: a stage of the last run, or of the last run of a pipeline by its name,
//! `PIPELINE.yaml:STAGE`, or a digest.

use std::path::{Path, PathBuf};

use super::arguments::pipeline_in;
use super::{CliError, pipeline, upstream};
use deaflow_base::{ArtifactId, Override, nearest, readable_time};
use deaflow_orchestrator::{Environment, StageReport, Staleness, plan};
use deaflow_report::set_options;
use deaflow_store::{Artifact, Command, Lookup, RemovedArtifact, Run, Store, StoreError};

/// The smallest number of digits that identify a digest.
pub const MIN_DIGITS: usize = 4;

/// Opens an existing store; never creates one.
///
/// # Errors
/// When there is none, or it cannot be opened.
pub fn existing_store(path: &Path) -> Result<Store, CliError> {
    of_folder(Store::open_existing(path).map(Store::guarded))
}

/// Adds advice to the error that there is no store.
///
/// # Errors
/// That of `opened`.
pub fn of_folder<T>(opened: Result<T, StoreError>) -> Result<T, CliError> {
    opened.map_err(|error| match error {
        StoreError::NoStore { path } => {
            // Absolute, since a relative path depends on the current folder.
            let path = std::path::absolute(&path).unwrap_or(path);
            CliError::bad_input(format!("no artifact store at {}", path.display()))
                .help("create one with `deaflow run PIPELINE.yaml`, or name another with --store or DEAFLOW_STORE")
        }
        other => other.into(),
    })
}

/// Names a store for a command that finds it by the folder: absolute, since a relative path depends on that folder.
pub fn named(store: &Store) -> String {
    let root = std::path::absolute(store.root()).unwrap_or_else(|_| store.root().to_owned());
    format!("store: {}", root.display())
}

/// Finds the artifact of a reference.
///
/// # Errors
/// When there is none, or several, or it is damaged.
pub fn artifact(store: &Store, reference: &str) -> Result<Artifact, CliError> {
    artifact_with(store, reference, &[])
}

/// Like [`artifact`], with the overrides of the pipeline of `PIPELINE.yaml:STAGE`.
///
/// # Errors
/// As [`artifact`], and when an override is invalid.
pub fn artifact_with(store: &Store, reference: &str, sets: &[String]) -> Result<Artifact, CliError> {
    check_stage_is_named(reference, None)?;
    let digest = match split(reference) {
        Some((pipeline, stage)) => of_pipeline(store, Path::new(pipeline), stage, sets)?,
        None => match (of_last_run(store, reference)?, split_folder(reference)) {
            (Some(digest), _) => digest,
            (None, Some((pipeline, stage))) => of_pipeline(store, &pipeline, stage, sets)?,
            (None, None) => of_digits(store, reference)?,
        },
    };
    open(store, &digest)
}

/// Refuses a pipeline without a stage, and lists its stages, or those of a kind.
///
/// # Errors
/// When the reference is a pipeline.
pub fn check_stage_is_named(reference: &str, kind: Option<&str>) -> Result<(), CliError> {
    let path = Path::new(reference);
    if !is_pipeline(path) || !path.is_file() {
        return Ok(());
    }
    let pipeline = pipeline::load_plain(path)?;
    let stages = pipeline.stages.iter();
    let named = stages.filter(|spec| kind.is_none_or(|kind| spec.kind.name() == kind));
    let names: Vec<String> = named.map(|spec| format!("{reference}:{}", spec.name)).collect();
    let error = CliError::bad_input(format!("{reference} is a pipeline; name one of its stages"));
    Err(match (names.as_slice(), kind) {
        ([], Some(kind)) => error.help(format!("the pipeline has no stage of kind `{kind}`")),
        ([], None) => error,
        (names, _) => error.help(format!("stages: {}", names.join(", "))),
    })
}

/// Opens an artifact; the error tells when `gc` has removed it.
fn open(store: &Store, digest: &ArtifactId) -> Result<Artifact, CliError> {
    match store.artifact(digest) {
        Err(error @ StoreError::Missing { .. }) => Err(match store.removal_of(digest)? {
            Some(removed) => removed_error(&removed),
            None => match upstream::pull_command("PIPELINE.yaml") {
                Some(pull) => CliError::from(error).help(format!(
                    "a run with --remote leaves results on the remote: fetch them with `{pull}`"
                )),
                None => error.into(),
            },
        }),
        opened => Ok(opened?),
    }
}

/// The error about an artifact that `gc` has removed.
fn removed_error(removed: &RemovedArtifact) -> CliError {
    let kind = match removed.kind.as_str() {
        "" => String::new(),
        kind => format!(" ({kind})"),
    };
    let (digest, at) = (removed.digest.short(), readable_time(&removed.at));
    CliError::bad_input(format!("artifact {digest}{kind} was removed by gc at {at}"))
        .help("build it again with `deaflow run`; `deaflow pin` protects artifacts from gc")
}

/// Whether a path is that of a pipeline, by its ending.
pub fn is_pipeline(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension == "yaml" || extension == "yml")
}

/// Splits `PIPELINE.yaml:STAGE`; the path may contain colons.
pub fn split(reference: &str) -> Option<(&str, &str)> {
    let (pipeline, stage) = reference.rsplit_once(':')?;
    is_pipeline(Path::new(pipeline)).then_some((pipeline, stage))
}

/// Splits `FOLDER:STAGE`, where the folder has exactly one pipeline, into the pipeline and the stage.
pub fn split_folder(reference: &str) -> Option<(PathBuf, &str)> {
    let (folder, stage) = reference.rsplit_once(':')?;
    let folder = Path::new(folder);
    let pipeline = folder.is_dir().then(|| pipeline_in(folder.to_owned()).ok()).flatten()?;
    Some((pipeline, stage))
}

/// Returns the only pipeline of a folder that an argument names, before `@` if it has one; other arguments unchanged.
pub fn pipeline_of_folder(argument: &str) -> String {
    let (folder, rest) = argument.split_at(argument.rfind('@').unwrap_or(argument.len()));
    let folder = Path::new(folder);
    match folder.is_dir().then(|| pipeline_in(folder.to_owned())) {
        Some(Ok(pipeline)) => format!("{}{rest}", pipeline.display()),
        _ => argument.to_owned(),
    }
}

fn of_pipeline(store: &Store, path: &Path, name: &str, sets: &[String]) -> Result<ArtifactId, CliError> {
    let overrides: Vec<Override> = sets.iter().map(|set| Override::parse(set)).collect::<Result<_, _>>()?;
    let pipeline = pipeline::load_file(path, &overrides, true)?;
    let name = match pipeline.sweep(name) {
        None => name,
        Some(sweep) => only(path, &sweep.name, &sweep.stages)?,
    };
    let stages = plan(&pipeline, store, Some(name), &Environment::system())?;
    let found = stages.iter().find(|stage| stage.name == name);
    if let Some(StageReport {
        staleness: Some(Staleness::ArtifactDamaged),
        digest: Some(digest),
        ..
    }) = found
    {
        // Opening it or its chunks returns the error.
        store.artifact(digest)?.chunks()?;
    }
    let built = found.filter(|stage| stage.why.is_none());
    built.and_then(|stage| stage.digest).ok_or_else(|| {
        let why = match found.and_then(|stage| stage.staleness.as_ref()) {
            Some(why @ Staleness::Removed { .. }) => format!(": {why}"),
            _ => String::new(),
        };
        CliError::bad_input(format!("stage `{name}` of {} is not built{why}", path.display())).help(format!(
            "build it with: deaflow run {} --until {name}{}",
            path.display(),
            set_options(&pipeline.overrides)
        ))
    })
}

/// Returns the only stage of a sweep.
///
/// # Errors
/// When it has several stages.
pub fn only<'a>(path: &Path, name: &str, stages: &'a [String]) -> Result<&'a str, CliError> {
    const SHOWN: usize = 8;
    if let [only] = stages {
        return Ok(only);
    }
    let mut list: Vec<&str> = stages.iter().take(SHOWN).map(String::as_str).collect();
    if stages.len() > SHOWN {
        list.push("…");
    }
    let message = format!("`{name}` of {} is a sweep of {} stages", path.display(), stages.len());
    Err(CliError::bad_input(message).help(format!("name one of them: {}", list.join(", "))))
}

/// Returns the artifact of a stage in the newest run that has it, if no record contradicts it; of `NAME:STAGE` in the
/// newest run of the pipeline of this name.
fn of_last_run(store: &Store, name: &str) -> Result<Option<ArtifactId>, CliError> {
    let of_pipeline = name.rsplit_once(':').map(|(pipeline, stage)| (stage, Some(pipeline)));
    let (stage, pipeline) = of_pipeline.unwrap_or((name, None));
    let Some(stage) = store.last_made(stage, pipeline)? else {
        return Ok(None);
    };
    let is_consistent = match store.record(&stage.key)? {
        Lookup::Found(record, _) => record.artifact == stage.artifact,
        Lookup::Absent => true,
        Lookup::Damaged(_) => false,
    };
    match is_consistent {
        true => Ok(Some(stage.artifact)),
        false => Err(CliError::bad_input(format!(
            "the last run with `{name}` and its record disagree: the run made {}",
            stage.artifact.short()
        ))
        .help("check the store with `deaflow fsck`")),
    }
}

fn of_digits(store: &Store, digits: &str) -> Result<ArtifactId, CliError> {
    let hexadecimal = !digits.is_empty() && digits.chars().all(|c| c.is_ascii_hexdigit());
    if !hexadecimal {
        return Err(unknown(store, digits, false)?);
    }
    if digits.len() < MIN_DIGITS {
        return Err(CliError::bad_input(format!("{digits:?} is too short for a digest"))
            .help(format!("use at least {MIN_DIGITS} digits")));
    }
    match store.find(&digits.to_ascii_lowercase())?.as_slice() {
        [one] => Ok(*one),
        [] => Err(find_removed(store, &digits.to_ascii_lowercase())?.map_or_else(|| unknown(store, digits, true), Ok)?),
        several => {
            let list: Vec<String> = several.iter().map(ArtifactId::to_string).collect();
            Err(CliError::bad_input(format!("{} artifacts begin with {digits}", several.len())).help(list.join(", ")))
        }
    }
}

/// The error about the last removed artifact with these first digits, if there is one.
fn find_removed(store: &Store, digits: &str) -> Result<Option<CliError>, CliError> {
    let begins = |removed: &RemovedArtifact| removed.digest.to_string().starts_with(digits);
    let Some(last) = store.removed().into_iter().rfind(begins) else {
        return Ok(None);
    };
    Ok(store.removal_of(&last.digest)?.map(|removed| removed_error(&removed)))
}

/// The error about a name of no stage, or the first digits of no artifact.
fn unknown(store: &Store, reference: &str, is_digest: bool) -> Result<CliError, CliError> {
    // Audits have only the stages up to the audited one.
    let is_complete = |run: &Result<Run, StoreError>| !run.as_ref().is_ok_and(|run| run.command == Command::Audit);
    let last = store.runs()?.find(is_complete).transpose()?.unwrap_or_default();
    let names: Vec<&str> = last.stages.iter().map(|s| s.name.as_str()).collect();
    let root = store.root().display();
    let error = CliError::bad_input(match is_digest {
        true => format!("no artifact in {root} has a digest that begins with {reference}"),
        false => format!("no run in {root} has a stage named {reference:?}, and it is no digest"),
    });
    Ok(match nearest(reference, &names) {
        Some(near) => error.help(format!(
            "did you mean `{near}`? stages of the last run: {}",
            names.join(", ")
        )),
        None if names.is_empty() => error.help("this store has no runs"),
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
