//! A remote behind a store, for commands that read through it, and how they tell of it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Value, json};

use super::arguments::STORE;
use super::error::CliError;
use super::output::Output;
use super::table;
use deaflow_base::Background;
use deaflow_remote::{Brought, Configuration, Foreign, Remote, RemoteError, SigningKey};
use deaflow_store::Store;

/// What is brought is told of no more often than so.
const INTERVAL: Duration = Duration::from_secs(5);

/// How often it is looked at.
const TICK: Duration = Duration::from_millis(500);

/// What is passed over, or disagreed on, that is told one by one.
const MOST_TOLD: usize = 5;

#[derive(Clone, Debug, Default, Args)]
pub struct RemoteArguments {
    /// Take what this remote has instead of building it, and bring it when it is needed [default: $DEAFLOW_REMOTE, or none]
    #[arg(long, value_name = "NAME", help_heading = STORE)]
    pub remote: Option<String>,
}

impl RemoteArguments {
    /// The remote that is asked for.
    pub fn name(&self) -> Option<String> {
        named(self.remote.as_deref())
    }
}

/// A remote that is named here or in the environment.
pub fn named(name: Option<&str>) -> Option<String> {
    let set = || std::env::var("DEAFLOW_REMOTE").ok().filter(|value| !value.is_empty());
    name.map(str::to_owned).or_else(set)
}

/// Opens a remote by its name, or the only one there is.
fn open(name: Option<&str>, store: &Store) -> Result<Remote, CliError> {
    let configuration = Configuration::of_user()?;
    let names = configuration.names()?;
    let name = match (name, names.as_slice()) {
        (Some(name), _) => name,
        (None, [only]) => only,
        (None, []) => return Err(CliError::bad_input("there is no remote").help(HOW_TO_ADD)),
        (None, names) => {
            return Err(CliError::bad_input("which remote is not said").help(format!("--remote: {}", names.join(", "))));
        }
    };
    let configured = configuration.find(name)?.ok_or_else(|| {
        let help = match names.as_slice() {
            [] => HOW_TO_ADD.to_owned(),
            names => format!("there are: {}", names.join(", ")),
        };
        CliError::bad_input(format!("there is no remote `{name}`")).help(help)
    })?;
    let own = SigningKey::read(&configuration.signing_key())?;
    Ok(Remote::open(&configured, own.as_ref(), store)?)
}

/// How a remote is made known.
pub const HOW_TO_ADD: &str = "deaflow remote add NAME s3://BUCKET/PREFIX --key FILE.pub";

/// Opens a remote that is named here or in the environment, or the only one there is; asks it what there is, and says what does not count.
pub fn open_fresh(name: Option<&str>, store: &Store, output: &Output) -> Result<(Remote, Foreign), CliError> {
    let remote = open(named(name).as_deref(), store)?;
    let foreign = remote.refresh()?;
    complain(&remote, &foreign, output);
    Ok((remote, foreign))
}

/// A store, and the remote that is read through it.
pub struct Reading {
    store: Store,
    remote: Option<Arc<Remote>>,
}

impl Reading {
    /// A store as it is to be read. Where the remote cannot be reached, what was read of it before has to do.
    ///
    /// # Errors
    /// When there is no such remote, or it refuses.
    pub fn of(store: Store, arguments: &RemoteArguments, output: &Output) -> Result<Self, CliError> {
        let Some(name) = arguments.name() else {
            return Ok(Self { store, remote: None });
        };
        let remote = Arc::new(open(Some(&name), &store)?);
        match remote.refresh() {
            Ok(foreign) => complain(&remote, &foreign, output),
            Err(error) if error.is_transient() && !matches!(error, RemoteError::Store(_)) => {
                remote.learn();
                remote.turn_off(&error);
            }
            Err(error) => return Err(error.into()),
        }
        tell(&remote, output);
        Ok(Self {
            store: store.with_upstream(remote.clone()),
            remote: Some(remote),
        })
    }

    /// The store, with the remote behind it.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The remote.
    pub fn remote(&self) -> Option<&Remote> {
        self.remote.as_deref()
    }

    /// Tells of what is brought, as long as what this gives is held; nothing where nothing is read through.
    pub fn watch(&self, say: impl Fn(&str) + Send + 'static) -> Option<Background> {
        let remote = self.remote.clone()?;
        let watch = move |pauses: &deaflow_base::Pauses| {
            let (mut told, mut at) = (remote.brought(), Instant::now());
            while pauses.wait(TICK) {
                let brought = remote.brought();
                if brought != told && at.elapsed() >= INTERVAL {
                    say(&format!("{}: {}", remote.name(), words(&brought)));
                    (told, at) = (brought, Instant::now());
                }
            }
        };
        // Without the thread nothing is told on the way.
        Background::start("remote", watch).ok()
    }

    /// Says what went wrong, and what has been brought.
    pub fn end(&self, output: &Output, is_quiet: bool) {
        let Some(remote) = &self.remote else { return };
        tell(remote, output);
        let brought = remote.brought();
        if brought.artifacts > 0 && !is_quiet {
            output.complain(&format!("{}: {}", remote.name(), words(&brought)));
        }
    }

    /// What has been brought, for programs.
    pub fn document(&self) -> Value {
        self.remote.as_ref().map_or(Value::Null, |remote| {
            let brought = remote.brought();
            json!({ "name": remote.name(), "artifacts": brought.artifacts, "bytes": brought.bytes })
        })
    }
}

fn words(brought: &Brought) -> String {
    let plural = if brought.artifacts == 1 { "" } else { "s" };
    format!(
        "{} artifact{plural} ({}) brought",
        brought.artifacts,
        table::bytes(brought.bytes)
    )
}

/// Says what of a remote does not count.
pub fn complain(remote: &Remote, foreign: &Foreign, output: &Output) {
    for (key, count) in &foreign.untrusted {
        let plural = if *count == 1 { "" } else { "s" };
        output.complain(&format!(
            "warning: {}: {count} file{plural} of records passed over: key {} is not trusted",
            remote.name(),
            key.short()
        ));
    }
    for (name, why) in foreign.rejected.iter().take(MOST_TOLD) {
        output.complain(&format!("warning: {}: {name} passed over: {why}", remote.name()));
    }
    if foreign.rejected.len() > MOST_TOLD {
        output.complain(&format!(
            "warning: {}: {} names more passed over; `deaflow pull --records-only --json` lists them",
            remote.name(),
            foreign.rejected.len() - MOST_TOLD
        ));
    }
    let disagreements = remote.disagreements();
    for disagreement in disagreements.iter().take(MOST_TOLD) {
        output.complain(&format!("warning: {}", remote.words_of(disagreement)));
    }
    if disagreements.len() > MOST_TOLD {
        output.complain(&format!(
            "warning: {}: signers disagree on {} actions more; `deaflow pull --records-only --json` lists them",
            remote.name(),
            disagreements.len() - MOST_TOLD
        ));
    }
}

/// Says what went wrong since.
pub fn tell(remote: &Remote, output: &Output) {
    let told = remote.told();
    for text in told.iter().take(2 * MOST_TOLD) {
        output.complain(&format!("warning: {text}"));
    }
    if told.len() > 2 * MOST_TOLD {
        output.complain(&format!(
            "warning: {}: {} such more",
            remote.name(),
            told.len() - 2 * MOST_TOLD
        ));
    }
}

/// What of a remote does not count, for programs.
pub fn foreign_document(remote: &Remote, foreign: &Foreign) -> Value {
    let untrusted = foreign.untrusted.iter();
    let rejected = foreign.rejected.iter();
    let disagreements = remote.disagreements();
    let disagreements = disagreements.iter().map(|disagreement| {
        let said = disagreement.said.iter().map(|said| {
            json!({ "key": said.signer.to_string(), "whose": remote.whose(&said.signer), "artifact": said.artifact.to_string() })
        });
        json!({
            "action": disagreement.key.to_string(),
            "kind": disagreement.kind,
            "said": said.collect::<Vec<_>>(),
        })
    });
    json!({
        "untrusted": untrusted.map(|(key, files)| json!({ "key": key.to_string(), "files": files })).collect::<Vec<_>>(),
        "rejected": rejected.map(|(name, why)| json!({ "name": name, "why": why })).collect::<Vec<_>>(),
        "disagreements": disagreements.collect::<Vec<_>>(),
    })
}
