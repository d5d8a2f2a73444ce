//! Removes from a remote what no record names, and what is older than it is to be.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::bucket::Entry;
use super::error::RemoteError;
use super::key::{PublicKey, SigningKey};
use super::pack::{self, MOST_RECORDS, RECORDS};
use super::upstream::{OBJECTS, Remote, object_of};
use deaflow_base::{ArtifactId, Digest, side_by_side};

/// What stays.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// Objects that nothing names stay as long: a push sends them before it says what they are.
    pub grace: Duration,
    /// Records stay as long, and what they name; for ever without.
    pub age: Option<Duration>,
}

/// What was removed, or would be.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Swept {
    /// Objects.
    pub objects: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Files of records.
    pub packs: u64,
    /// Records in them.
    pub records: u64,
    /// Files of one's own records that were put together into fewer.
    pub merged: u64,
    /// Objects that stay.
    pub objects_left: u64,
    /// Their bytes.
    pub bytes_left: u64,
    /// Names that are none of ours: they are not touched.
    pub others: u64,
}

/// A pack, as far as it matters here.
struct Pack {
    entry: Entry,
    signer: PublicKey,
    digest: Digest,
    records: u64,
    names: Vec<ArtifactId>,
}

/// Few packs need not be put together.
const FEW: usize = 16;

/// Sweeps. All records hold what they name, whoever has signed them: who sweeps need not trust whom others trust. With a key, many small
/// files of its records become few.
///
/// # Errors
/// When the remote cannot be reached or refuses, or a file of records cannot be read, so that it is not known what it holds.
pub fn sweep(
    remote: &Remote,
    retention: Retention,
    key: Option<&SigningKey>,
    is_trial: bool,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<Swept, RemoteError> {
    let bucket = remote.bucket();
    let mut swept = Swept::default();
    // Records before objects: whatever is pushed meanwhile is younger than the grace or named by then.
    let listed = bucket.list(RECORDS)?;
    let now = bucket.now();
    let is_old = |entry: &Entry, age: Duration| now.duration_since(entry.modified).is_ok_and(|since| since > age);
    let (mut named, mut packs) = (Vec::new(), Vec::new());
    for entry in listed {
        match pack::parse_name(&entry.name) {
            Some(name) if entry.size <= pack::LONGEST => named.push((entry, name)),
            _ => swept.others += 1,
        }
    }
    let known: BTreeSet<String> = named.iter().map(|(entry, _)| entry.name.clone()).collect();
    for pack in side_by_side(&named, |(entry, name)| read(remote, entry, *name).map(Some))? {
        packs.extend(pack);
    }
    let (old, kept): (Vec<Pack>, Vec<Pack>) = packs
        .into_iter()
        .partition(|pack| retention.age.is_some_and(|age| is_old(&pack.entry, age)));
    swept.packs = old.len() as u64;
    swept.records = old.iter().map(|pack| pack.records).sum();
    let wanted: BTreeSet<ArtifactId> = kept.iter().flat_map(|pack| pack.names.iter().copied()).collect();
    let mut orphans = Vec::new();
    for entry in bucket.list(OBJECTS)? {
        match object_of(&entry.name) {
            None => swept.others += 1,
            Some(artifact) if wanted.contains(&artifact) || !is_old(&entry, retention.grace) => {
                swept.objects_left += 1;
                swept.bytes_left = swept.bytes_left.saturating_add(entry.size);
            }
            Some(_) => {
                swept.objects += 1;
                swept.bytes = swept.bytes.saturating_add(entry.size);
                orphans.push(entry.name);
            }
        }
    }
    if is_trial {
        return Ok(swept);
    }
    // Records first: none may name what is not there.
    let first: Vec<String> = old.into_iter().map(|pack| pack.entry.name).collect();
    let total = (first.len() + orphans.len()) as u64;
    let done = AtomicU64::new(0);
    let remove = |names: &[String]| {
        side_by_side(names, |name| {
            bucket.delete(name)?;
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok::<_, RemoteError>(None::<()>)
        })
    };
    remove(&first)?;
    // What has been recorded meanwhile stays.
    let mut late = BTreeSet::new();
    for entry in bucket.list(RECORDS)? {
        if let Some(name) = pack::parse_name(&entry.name).filter(|_| entry.size <= pack::LONGEST)
            && !known.contains(&entry.name)
        {
            late.extend(read(remote, &entry, name)?.into_iter().flat_map(|pack| pack.names));
        }
    }
    orphans.retain(|name| object_of(name).is_none_or(|artifact| !late.contains(&artifact)));
    remove(&orphans)?;
    // What is put together is younger than what it was made of.
    if let Some(key) = key.filter(|_| retention.age.is_none()) {
        swept.merged = merge(remote, &kept, key)?;
    }
    Ok(swept)
}

/// None where it has been removed meanwhile.
fn read(remote: &Remote, entry: &Entry, (signer, digest): (PublicKey, Digest)) -> Result<Option<Pack>, RemoteError> {
    let Some(file) = remote.bucket().get(&entry.name, pack::LONGEST)? else {
        return Ok(None);
    };
    // What is not signed names nothing, if no version of this program has written it; what another version wrote must not lose what it names.
    let (statements, is_signed) = match pack::read(&file, &signer, &digest) {
        Ok(statements) => (statements, true),
        Err(pack::NoPack::Altered | pack::NoPack::Unsigned) => (pack::read_unsigned(&file).unwrap_or_default(), false),
        Err(pack::NoPack::Unreadable) => (Vec::new(), false),
        Err(pack::NoPack::OtherVersion) => {
            return Err(unknown(
                remote,
                entry,
                "another version of this program has written them",
            ));
        }
    };
    if is_signed && statements.iter().any(|statement| statement.parts.is_none()) {
        return Err(unknown(
            remote,
            entry,
            "they name a manifest of so many chunks that these are not told",
        ));
    }
    let parts = statements.iter().flat_map(|statement| statement.parts.iter().flatten());
    let names = statements
        .iter()
        .map(|statement| statement.record.artifact)
        .chain(parts.copied());
    Ok(Some(Pack {
        names: names.collect(),
        records: statements.len() as u64,
        entry: entry.clone(),
        signer,
        digest,
    }))
}

/// What cannot be known stops the sweep.
fn unknown(remote: &Remote, entry: &Entry, why: &str) -> RemoteError {
    RemoteError::Answer {
        host: remote.place(),
        action: "read the records",
        name: entry.name.clone(),
        reason: format!("{why}: nothing is removed"),
    }
}

/// Puts many small packs of one signer together; gives how many there were.
fn merge(remote: &Remote, packs: &[Pack], key: &SigningKey) -> Result<u64, RemoteError> {
    let own = key.public();
    let small: BTreeSet<Digest> = packs
        .iter()
        .filter(|pack| pack.signer == own && pack.records < MOST_RECORDS as u64 / 2)
        .map(|pack| pack.digest)
        .collect();
    if small.len() < FEW {
        return Ok(0);
    }
    let (mut old, mut statements) = (Vec::new(), Vec::new());
    for digest in small {
        let file = remote.bucket().get(&pack::name(&own, &digest), pack::LONGEST)?;
        if let Some(Ok(said)) = file.map(|file| pack::read(&file, &own, &digest)) {
            old.push(digest);
            statements.extend(said);
        }
    }
    statements.sort_by_key(|statement| (statement.record.key, statement.record.artifact));
    statements.dedup_by_key(|statement| (statement.record.key, statement.record.artifact));
    let new = pack::divide(statements)?;
    if new.len() >= old.len() {
        return Ok(0);
    }
    for pack in &new {
        let digest = remote.state(pack, key)?;
        // One of them may say all that the others do.
        old.retain(|old| *old != digest);
    }
    for digest in &old {
        remote.bucket().delete(&pack::name(&own, digest))?;
    }
    remote.refresh()?;
    Ok(old.len() as u64)
}
