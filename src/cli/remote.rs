//! `deaflow remote`: manages remotes, trusted keys and the signing key.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::arguments::{StoreArguments, age};
use super::progress::DelayedBar;
use super::text::Text;
use super::{CliError, Exit, Output, pipeline, table, upstream};
use deaflow_base::host_name;
use deaflow_remote::{Address, Configuration, GarbageReport, Retention, SigningKey, collect_garbage, read_public_keys};

/// Manage remotes and trusted keys
#[derive(Debug, Args)]
pub struct RemoteCommand {
    #[command(subcommand)]
    action: RemoteAction,
}

#[derive(Debug, Subcommand)]
enum RemoteAction {
    /// Add a remote: an S3-compatible bucket, and its trusted keys
    Add(AddArguments),
    /// List the remotes
    #[command(after_help = examples!("deaflow remote list"))]
    List,
    /// Remove a remote from the configuration; its contents stay
    Remove(RemoveArguments),
    /// Print your public key for others to trust; the key is created if missing
    #[command(after_help = examples!("deaflow remote key > me.pub"))]
    Key,
    /// Remove unreferenced and expired objects from a remote
    Gc(GcArguments),
}

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow remote add lab s3://bucket/prefix --key keys.pub"))]
struct AddArguments {
    /// Its name
    name: String,
    /// Its URL
    #[arg(value_name = "s3://BUCKET/PREFIX")]
    url: String,
    /// A file of trusted public keys, one per line, as printed by `deaflow remote key`; can be repeated
    #[arg(long = "key", value_name = "FILE", required = true)]
    keys: Vec<PathBuf>,
    /// The server [default: $AWS_ENDPOINT_URL_S3, $AWS_ENDPOINT_URL, or Amazon]
    #[arg(long, value_name = "URL")]
    endpoint: Option<String>,
    /// The region [default: $AWS_REGION, from ~/.aws/config, or us-east-1]
    #[arg(long)]
    region: Option<String>,
    /// Replace a remote of this name that has another address or other trusted keys
    #[arg(long)]
    replace: bool,
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
    /// Print what would be removed; remove nothing
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// Keep unreferenced objects for this time: a push may be running
    #[arg(long, value_name = "TIME", default_value = "7days", value_parser = age)]
    grace: Duration,
    /// Also remove records that were pushed longer ago than this, and their objects
    #[arg(long, value_name = "TIME", value_parser = age)]
    older: Option<Duration>,
    #[command(flatten)]
    store: StoreArguments,
}

pub fn execute(command: &RemoteCommand, output: &Output) -> Result<Exit, CliError> {
    let configuration = Configuration::of_user()?;
    match &command.action {
        RemoteAction::Add(arguments) => add(&configuration, arguments, output),
        RemoteAction::List => list(&configuration, output),
        RemoteAction::Remove(arguments) => remove(&configuration, &arguments.name, output),
        RemoteAction::Key => key(&configuration, output),
        RemoteAction::Gc(arguments) => gc(&configuration, arguments, output),
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
    configuration.add(&arguments.name, &address, &trusted, arguments.replace)?;
    let keys: Vec<Value> = trusted
        .iter()
        .map(|named| json!({ "key": named.key.to_string(), "whose": named.owner }))
        .collect();
    let text = || {
        let whose: Vec<String> = trusted
            .iter()
            .map(|named| match named.owner.as_str() {
                "" => named.key.short(),
                whose => whose.to_owned(),
            })
            .collect();
        format!(
            "{}: {}, trusted keys: {}\nwrote {} and {}",
            arguments.name,
            address.url(),
            whose.join(", "),
            configuration.file(&arguments.name).display(),
            configuration.keys(&arguments.name).display(),
        )
    };
    let document = || json!({ "name": arguments.name, "url": address.url(), "keys": keys });
    output.result(document, text)
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
        output.text(format!("no remotes; add one with: {}", upstream::HOW_TO_ADD))?;
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
            CliError::bad_input(format!("there is no remote `{name}`")).help(if names.is_empty() {
                "no remotes are configured".to_owned()
            } else {
                format!("there are: {}", names.join(", "))
            }),
        );
    }
    output.result(
        || json!({ "removed": name }),
        || format!("removed {name} from the configuration; its contents stay"),
    )
}

fn key(configuration: &Configuration, output: &Output) -> Result<Exit, CliError> {
    let path = configuration.signing_key();
    let key = match SigningKey::read(&path)? {
        Some(key) => key,
        None => {
            configuration.create_folder()?;
            let key = SigningKey::create(&path)?;
            output.note(&format!("created {}: keep it secret", path.display()));
            key
        }
    };
    let user = std::env::var("USER").unwrap_or_default();
    let whose = match user.is_empty() {
        true => host_name(),
        false => format!("{user}@{}", host_name()),
    };
    match output.is_json() {
        true => output.document(&json!({ "key": key.public().to_string(), "whose": whose, "file": path }))?,
        false => output.plain(key.public().line(&whose).trim_end())?,
    }
    Ok(Exit::Done)
}

fn gc(configuration: &Configuration, arguments: &GcArguments, output: &Output) -> Result<Exit, CliError> {
    let (_scratch, store) = pipeline::store_to_read(&arguments.store.folder())?;
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
    let document = || {
        json!({
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
        })
    };
    output.result(document, || text(remote.name(), arguments.dry_run, &swept))
}

fn text(name: &str, dry_run: bool, swept: &GarbageReport) -> String {
    let mut text = format!(
        "{name}: {} {} ({}) and {}; kept: {} ({})",
        if dry_run { "would remove" } else { "removed" },
        table::counted(swept.objects, "artifacts"),
        table::bytes(swept.bytes),
        table::counted(swept.records, "records"),
        table::counted(swept.objects_kept, "artifacts"),
        table::bytes(swept.bytes_kept),
    );
    if swept.merged > 0 {
        text += &format!("\nmerged {} of your records", table::counted(swept.merged, "files"));
    }
    if swept.foreign > 0 {
        text += &format!(
            "\nnot touched: {} of other programs",
            table::counted(swept.foreign, "objects")
        );
    }
    text
}
