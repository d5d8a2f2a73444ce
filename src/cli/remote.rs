//! `deaflow remote`: where others' stores are, whose records count there, and one's own key.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::arguments::{StoreArguments, duration};
use super::progress::DelayedBar;
use super::text::Text;
use super::{CliError, Exit, Output, locate, table, upstream};
use deaflow_base::host_name;
use deaflow_remote::{Address, Configuration, GarbageReport, Retention, SigningKey, collect_garbage, read_public_keys};

/// Say where others' stores are and whose records count there
#[derive(Debug, Args)]
pub struct RemoteCommand {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Add a remote: a place in S3-compatible storage, and the keys that count there
    Add(AddArguments),
    /// List the remotes
    #[command(after_help = examples!("deaflow remote list"))]
    List,
    /// Forget a remote; nothing there is touched
    Remove(RemoveArguments),
    /// Print the line by which others trust you; your key is made where there is none
    #[command(after_help = examples!("deaflow remote key > me.pub"))]
    Key,
    /// Remove from a remote what no record names, and what is older than it is to be
    Gc(GcArguments),
}

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow remote add lab s3://bucket/prefix --key keys.pub"))]
struct AddArguments {
    /// Its name
    name: String,
    /// Where it is
    #[arg(value_name = "s3://BUCKET/PREFIX")]
    url: String,
    /// A file of public keys, a line for each, as `deaflow remote key` prints them; may be given more than once
    #[arg(long = "key", value_name = "FILE", required = true)]
    keys: Vec<PathBuf>,
    /// The server [default: $AWS_ENDPOINT_URL_S3, $AWS_ENDPOINT_URL, or that of Amazon]
    #[arg(long, value_name = "URL")]
    endpoint: Option<String>,
    /// The region [default: $AWS_REGION, that of ~/.aws/config, or us-east-1]
    #[arg(long)]
    region: Option<String>,
}

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow remote remove lab"))]
struct RemoveArguments {
    /// Its name
    name: String,
}

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow remote gc lab -n"))]
struct GcArguments {
    /// The remote [default: $DEAFLOW_REMOTE, or the only one]
    name: Option<String>,
    /// Say what would go; remove nothing
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// Keep objects that nothing names as long: a push may be at work
    #[arg(long, value_name = "TIME", default_value = "7days", value_parser = duration)]
    grace: Duration,
    /// Remove records that were pushed longer ago than this, and what nothing else names
    #[arg(long, value_name = "TIME", value_parser = duration)]
    older: Option<Duration>,
    #[command(flatten)]
    store: StoreArguments,
}

pub fn execute(command: &RemoteCommand, output: &Output) -> Result<Exit, CliError> {
    let configuration = Configuration::of_user()?;
    match &command.what {
        What::Add(arguments) => add(&configuration, arguments, output),
        What::List => list(&configuration, output),
        What::Remove(arguments) => remove(&configuration, &arguments.name, output),
        What::Key => key(&configuration, output),
        What::Gc(arguments) => gc(&configuration, arguments, output),
    }
}

fn add(configuration: &Configuration, arguments: &AddArguments, output: &Output) -> Result<Exit, CliError> {
    let address = Address::parse(
        &arguments.url,
        arguments.endpoint.as_deref(),
        arguments.region.as_deref(),
    )?;
    let mut trusted = Vec::new();
    for path in &arguments.keys {
        for named in read_public_keys(path)? {
            if !trusted
                .iter()
                .any(|known: &deaflow_remote::TrustedKey| known.key == named.key)
            {
                trusted.push(named);
            }
        }
    }
    configuration.add(&arguments.name, &address, &trusted)?;
    let keys: Vec<Value> = trusted
        .iter()
        .map(|named| json!({ "key": named.key.to_string(), "whose": named.owner }))
        .collect();
    if output.is_json() {
        output.document(&json!({ "name": arguments.name, "url": address.url(), "keys": keys }))?;
    } else {
        let whose: Vec<String> = trusted
            .iter()
            .map(|named| match named.owner.as_str() {
                "" => named.key.short(),
                whose => whose.to_owned(),
            })
            .collect();
        output.text(format!(
            "{}: {}, trusting {}\n{} and {} say so",
            arguments.name,
            address.url(),
            whose.join(", "),
            configuration.file(&arguments.name).display(),
            configuration.keys(&arguments.name).display(),
        ))?;
    }
    Ok(Exit::Done)
}

fn list(configuration: &Configuration, output: &Output) -> Result<Exit, CliError> {
    let (mut documents, mut is_sound) = (Vec::new(), true);
    let mut table = table::table(&["name", "place", "server", "keys"], &["keys"]).flowing(&["place", "server"]);
    for name in configuration.names()? {
        let remote = match configuration.find(&name) {
            Ok(Some(remote)) => remote,
            Ok(None) => continue,
            Err(error) => {
                output.report(&CliError::from(error));
                is_sound = false;
                continue;
            }
        };
        let keys = remote.trusted.iter();
        documents.push(json!({
            "name": name,
            "url": remote.address.url(),
            "endpoint": remote.address.endpoint,
            "region": remote.address.region,
            "keys": keys.map(|named| json!({ "key": named.key.to_string(), "whose": named.owner })).collect::<Vec<_>>(),
        }));
        table.add_row([
            name,
            remote.address.url(),
            remote.address.endpoint.unwrap_or_default(),
            remote.trusted.len().to_string(),
        ]);
    }
    if output.is_json() {
        output.document(&json!({ "remotes": documents }))?;
    } else if documents.is_empty() {
        output.text(format!("there is no remote; {}", upstream::HOW_TO_ADD))?;
    } else {
        output.text(Text::of(table))?;
    }
    Ok(match is_sound {
        true => Exit::Done,
        false => Exit::BadInput,
    })
}

fn remove(configuration: &Configuration, name: &str, output: &Output) -> Result<Exit, CliError> {
    if !configuration.remove(name)? {
        let names = configuration.names()?;
        return Err(
            CliError::bad_input(format!("there is no remote `{name}`")).help(format!(
                "there are: {}",
                if names.is_empty() {
                    "none".to_owned()
                } else {
                    names.join(", ")
                }
            )),
        );
    }
    if output.is_json() {
        output.document(&json!({ "removed": name }))?;
    } else {
        output.text(format!("{name} is forgotten; nothing there was touched"))?;
    }
    Ok(Exit::Done)
}

fn key(configuration: &Configuration, output: &Output) -> Result<Exit, CliError> {
    let path = configuration.signing_key();
    let key = match SigningKey::read(&path)? {
        Some(key) => key,
        None => {
            configuration.create_folder()?;
            let key = SigningKey::create(&path)?;
            output.note(&format!("made {}: keep it to yourself", path.display()));
            key
        }
    };
    let user = std::env::var("USER").unwrap_or_default();
    let whose = match user.is_empty() {
        true => host_name(),
        false => format!("{user}@{}", host_name()),
    };
    if output.is_json() {
        output.document(&json!({ "key": key.public().to_string(), "whose": whose, "file": path }))?;
    } else {
        output.plain(key.public().line(&whose).trim_end())?;
    }
    Ok(Exit::Done)
}

fn gc(configuration: &Configuration, arguments: &GcArguments, output: &Output) -> Result<Exit, CliError> {
    // What was read of the remote is kept in a store; without one, for as long as this takes.
    let folder = arguments.store.folder();
    let scratch = (!folder.exists()).then(tempfile::tempdir).transpose();
    let scratch = scratch.map_err(|error| CliError::failure(format!("cannot make a temporary folder: {error}")))?;
    let store = match &scratch {
        Some(scratch) => deaflow_store::Store::open(scratch.path())?,
        None => locate::existing_store(&folder)?,
    };
    let (remote, _) = upstream::open_fresh(arguments.name.as_deref(), &store, output)?;
    let key = SigningKey::read(&configuration.signing_key())?;
    let retention = Retention {
        grace: arguments.grace,
        age: arguments.older,
    };
    let bar = DelayedBar::new("gc", "objects");
    let done = collect_garbage(&remote, retention, key.as_ref(), arguments.dry_run, &|done, total| {
        bar.set(done, total);
    });
    bar.clear();
    let swept = done?;
    if output.is_json() {
        output.document(&json!({
            "remote": remote.name(),
            "dry_run": arguments.dry_run,
            "objects_removed": swept.objects,
            "bytes_removed": swept.bytes,
            "records_removed": swept.records,
            "files_of_records_removed": swept.packs,
            "files_of_records_merged": swept.merged,
            "objects_kept": swept.objects_kept,
            "bytes_kept": swept.bytes_kept,
            "not_ours": swept.foreign,
        }))?;
    } else {
        output.text(text(remote.name(), arguments.dry_run, &swept))?;
    }
    Ok(Exit::Done)
}

fn text(name: &str, dry_run: bool, swept: &GarbageReport) -> String {
    let mut text = format!(
        "{name}: {} {} artifacts ({}) and {} records; {} artifacts ({}) stay",
        if dry_run { "would remove" } else { "removed" },
        swept.objects,
        table::bytes(swept.bytes),
        swept.records,
        swept.objects_kept,
        table::bytes(swept.bytes_kept),
    );
    if swept.merged > 0 {
        text += &format!("\n{} files of your records were put together", swept.merged);
    }
    if swept.foreign > 0 {
        text += &format!(
            "\n{} objects there are none of deaflow's and were not touched",
            swept.foreign
        );
    }
    text
}
