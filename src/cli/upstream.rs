//! A remote that is read through a store, and the reports about it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::arguments::{PipelineArguments, remote_name};
use super::{CliError, Exit, Output, table};
use deaflow_base::Background;
use deaflow_remote::{Configuration, Downloads, IgnoredRecords, Remote, RemoteError, SigningKey};
use deaflow_report::StageArtifact;
use deaflow_store::{Condition, Effort, Store};

/// The time between two reports of fetched artifacts.
const INTERVAL: Duration = Duration::from_secs(5);

/// The time between two checks for them.
const TICK: Duration = Duration::from_millis(500);

/// The most problems that are listed.
const MAX_LISTED: usize = 5;

/// Opens a remote by its name, or the only one there is.
fn open(name: Option<&str>, store: &Store) -> Result<Remote, CliError> {
    let configuration = Configuration::of_user()?;
    let names = configuration.names()?;
    let name = match (name, names.as_slice()) {
        (Some(name), _) => name,
        (None, [only]) => only,
        (None, []) => return Err(CliError::bad_input("no remote is configured").help(HOW_TO_ADD)),
        (None, names) => {
            return Err(CliError::bad_input("several remotes are configured")
                .help(format!("choose one with --remote: {}", names.join(", "))));
        }
    };
    let configured = configuration.find(name)?.ok_or_else(|| {
        let help = match names.as_slice() {
            [] => HOW_TO_ADD.to_owned(),
            names => format!("configured: {}", names.join(", ")),
        };
        CliError::bad_input(format!("there is no remote `{name}`")).help(help)
    })?;
    let own = SigningKey::read(&configuration.signing_key())?;
    Ok(Remote::open(&configured, own.as_ref(), store)?)
}

/// The command that adds a remote.
pub const HOW_TO_ADD: &str = "deaflow remote add NAME s3://BUCKET/PREFIX --key FILE.pub";

/// Returns the command that fetches the results of a pipeline, whose words are quoted for a shell, if there is a
/// remote.
pub fn pull_command(pipeline: &str) -> Option<String> {
    let names = Configuration::of_user().ok()?.names().ok()?;
    match names.as_slice() {
        [] => None,
        [only] => Some(format!("deaflow pull {pipeline} --remote {only}")),
        [_, ..] => Some(format!("deaflow pull {pipeline} --remote NAME ({})", names.join(", "))),
    }
}

/// Opens a remote (the named one, that of the environment, or the only one), reads its index and reports what is
/// ignored.
pub fn open_fresh(name: Option<&str>, store: &Store, output: &Output) -> Result<(Remote, IgnoredRecords), CliError> {
    let remote = open(remote_name(name).as_deref(), store)?;
    let foreign = remote.refresh()?;
    report_ignored(&remote, &foreign, output);
    Ok((remote, foreign))
}

/// A store, and the remote that is read through it, if any.
pub struct StoreAccess {
    store: Store,
    remote: Option<Arc<Remote>>,
}

impl StoreAccess {
    /// Connects a store with the remote that the arguments name. If it cannot be reached, its last known index is used.
    ///
    /// # Errors
    /// When there is no such remote, or it refuses.
    pub fn open(store: Store, arguments: &PipelineArguments, output: &Output) -> Result<Self, CliError> {
        let store = if arguments.verify { store.without_index() } else { store };
        let Some(name) = arguments.remote.name() else {
            return Ok(Self { store, remote: None });
        };
        let remote = Arc::new(open(Some(&name), &store)?);
        match remote.refresh() {
            Ok(foreign) => report_ignored(&remote, &foreign, output),
            Err(error) if error.is_transient() && !matches!(error, RemoteError::Store(_)) => {
                remote.load_cached();
                remote.disable(&error);
            }
            Err(error) => return Err(error.into()),
        }
        report_problems(&remote, output);
        let store = store.with_upstream(remote.clone());
        Ok(Self {
            store: if arguments.verify { store.fetching() } else { store },
            remote: Some(remote),
        })
    }

    /// Returns the store.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Returns the remote.
    pub fn remote(&self) -> Option<&Remote> {
        self.remote.as_deref()
    }

    /// Reports fetched artifacts from a thread, until the returned guard is dropped; none without a remote.
    pub fn watch(&self, report: impl Fn(&str) + Send + 'static) -> Option<Background> {
        let remote = self.remote.clone()?;
        let watch = move |pauses: &deaflow_base::Pauses| {
            let (mut reported, mut at) = (remote.downloads(), Instant::now());
            while pauses.wait(TICK) {
                let brought = remote.downloads();
                if brought != reported && at.elapsed() >= INTERVAL {
                    report(&format!("{}: {}", remote.name(), describe(&brought)));
                    (reported, at) = (brought, Instant::now());
                }
            }
        };
        // Without the thread there are no reports before the end.
        Background::start("remote", watch).ok()
    }

    /// Reports problems, and what has been fetched.
    pub fn end(&self, output: &Output, is_quiet: bool) {
        let Some(remote) = &self.remote else { return };
        report_problems(remote, output);
        let brought = remote.downloads();
        if brought.artifacts > 0 && !is_quiet {
            output.note(&format!("{}: {}", remote.name(), describe(&brought)));
        }
    }

    /// Returns why the results of stages that are on the remote only may not be there, and the exit code; `None` if
    /// they are, as far as the list of its objects and the last downloads say.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn doubt(&self, elsewhere: &[StageArtifact]) -> Result<Option<(String, Exit)>, CliError> {
        let (Some(remote), false) = (&self.remote, elsewhere.is_empty()) else {
            return Ok(None);
        };
        let name = remote.name();
        let mut missing = Vec::new();
        for made in elsewhere {
            let condition = self.store.inspect(&made.digest, Effort::Quick)?;
            if !matches!(condition, Condition::Elsewhere { .. } | Condition::Intact { .. }) {
                missing.push(made.stage.as_str());
            }
        }
        if !missing.is_empty() {
            let why = format!(
                "the results of {} are neither here nor on {name}; the same command builds them",
                missing.join(", ")
            );
            return Ok(Some((why, Exit::Failure)));
        }
        let (doubted, why) = match remote.is_disabled() {
            true => (
                elsewhere.iter().collect(),
                format!("{name} cannot be reached; try again later"),
            ),
            false => {
                let interrupted = elsewhere.iter().filter(|made| remote.is_interrupted(&made.digest));
                let why = format!("their last download from {name} was interrupted; fetch them with `deaflow pull`");
                (interrupted.collect::<Vec<_>>(), why)
            }
        };
        let doubted: Vec<&str> = doubted.iter().map(|made| made.stage.as_str()).collect();
        Ok((!doubted.is_empty()).then(|| {
            let why = format!("the results of {} are not here, and {why}", doubted.join(", "));
            (why, Exit::TryAgain)
        }))
    }

    /// Describes what has been fetched, for programs.
    pub fn document(&self) -> Value {
        self.remote.as_ref().map_or(Value::Null, |remote| {
            let brought = remote.downloads();
            json!({ "name": remote.name(), "artifacts": brought.artifacts, "bytes": brought.bytes })
        })
    }
}

fn describe(brought: &Downloads) -> String {
    let artifacts = table::counted(brought.artifacts, "artifacts");
    format!("fetched {artifacts} ({})", table::bytes(brought.bytes))
}

/// Warns of what is ignored of a remote: untrusted, rejected and contradictory records.
pub fn report_ignored(remote: &Remote, foreign: &IgnoredRecords, output: &Output) {
    let name = remote.name();
    for (key, count) in &foreign.untrusted {
        let files = table::counted(*count, "files");
        output.warn(format_args!(
            "{name}: {files} of records ignored: key {} is not trusted",
            key.short()
        ));
    }
    for (file, why) in foreign.rejected.iter().take(MAX_LISTED) {
        output.warn(format_args!("{name}: {file} ignored: {why}"));
    }
    let disagreements = remote.disagreements();
    for disagreement in disagreements.iter().take(MAX_LISTED) {
        output.warn(remote.describe_disagreement(disagreement));
    }
    let counts = [
        (foreign.rejected.len(), "more files ignored"),
        (disagreements.len(), "more actions on which signers disagree"),
    ];
    for (count, what) in counts.into_iter().filter(|(count, _)| *count > MAX_LISTED) {
        let more = count - MAX_LISTED;
        output.warn(format_args!(
            "{name}: {more} {what}; list them with `deaflow pull --records-only --json`"
        ));
    }
}

/// Warns of problems with a remote since the last call.
pub fn report_problems(remote: &Remote, output: &Output) {
    let problems = remote.take_warnings();
    for text in problems.iter().take(2 * MAX_LISTED) {
        output.warn(text);
    }
    if problems.len() > 2 * MAX_LISTED {
        output.warn(format_args!(
            "{}: {} more problems",
            remote.name(),
            problems.len() - 2 * MAX_LISTED
        ));
    }
}

/// Describes what is ignored of a remote, for programs.
pub fn ignored_document(remote: &Remote, foreign: &IgnoredRecords) -> Value {
    let untrusted = foreign.untrusted.iter();
    let rejected = foreign.rejected.iter();
    let disagreements = remote.disagreements();
    let disagreements = disagreements.iter().map(|disagreement| {
        let said = disagreement.results.iter().map(|said| {
            json!({
                "key": said.signer.to_string(),
                "whose": remote.owner(&said.signer),
                "artifact": said.artifact.to_string(),
            })
        });
        json!({
            "action": disagreement.key.to_string(),
            "kind": disagreement.kind,
            "said": said.collect::<Vec<_>>(),
        })
    });
    json!({
        "untrusted": untrusted
            .map(|(key, files)| json!({ "key": key.to_string(), "files": files }))
            .collect::<Vec<_>>(),
        "rejected": rejected.map(|(name, why)| json!({ "name": name, "why": why.to_string() })).collect::<Vec<_>>(),
        "disagreements": disagreements.collect::<Vec<_>>(),
    })
}
