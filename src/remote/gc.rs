//! Garbage collection of a remote: removes objects that no record names, and old records.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::bucket::{Bucket, BucketObject};
use super::error::RemoteError;
use super::key::{PublicKey, SigningKey};
use super::pack::{self, MOST_RECORDS, PackError, RECORDS};
use super::upstream::{OBJECTS, Remote, object_of};
use deaflow_base::{ArtifactId, Digest, concurrently};

/// What a collection keeps.
#[derive(Clone, Copy, Debug)]
pub struct Retention {
    /// Age up to which unnamed objects are kept, because a push sends objects before records.
    pub grace: Duration,
    /// Age up to which records and the objects that they name are kept; `None` keeps all.
    pub age: Option<Duration>,
}

/// What a collection removed, or would remove.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GarbageReport {
    /// Number of removed objects.
    pub objects: u64,
    /// Size of the removed objects in bytes.
    pub bytes: u64,
    /// Number of removed files of records.
    pub packs: u64,
    /// Number of records in these files.
    pub records: u64,
    /// Number of files of own records that were merged.
    pub merged: u64,
    /// Number of objects that were kept.
    pub objects_kept: u64,
    /// Size of the kept objects in bytes.
    pub bytes_kept: u64,
    /// Number of names that deaflow did not write; they are not touched.
    pub foreign: u64,
}

/// A file of records and the artifacts that it names.
struct PackContents {
    entry: BucketObject,
    signer: PublicKey,
    digest: Digest,
    records: u64,
    names: Vec<ArtifactId>,
}

/// Minimum number of small packs that are merged.
const MIN_MERGED: usize = 16;

/// Collects garbage. Records of all signers keep the objects that they name, because other users may trust other keys.
/// With a key, small files of its records are merged.
///
/// # Errors
/// Returns an error if the remote cannot be reached or refuses, or a file of records cannot be read, so that its
/// objects are unknown.
pub fn collect_garbage(
    remote: &Remote,
    retention: Retention,
    key: Option<&SigningKey>,
    is_dry_run: bool,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<GarbageReport, RemoteError> {
    let bucket = remote.bucket();
    let mut report = GarbageReport::default();
    // Records are listed before objects, so that objects pushed meanwhile are named or within the grace period.
    let (listed, foreign) = list_packs(bucket)?;
    report.foreign = foreign;
    let now = bucket.now();
    let is_old =
        |entry: &BucketObject, age: Duration| now.duration_since(entry.modified).is_ok_and(|since| since > age);
    let known: BTreeSet<&str> = listed.iter().map(|(entry, _)| entry.name.as_str()).collect();
    let packs = concurrently(&listed, |(entry, name)| read(remote, entry, *name))?;
    let (old, kept): (Vec<PackContents>, Vec<PackContents>) = packs
        .into_iter()
        .partition(|pack| retention.age.is_some_and(|age| is_old(&pack.entry, age)));
    report.packs = old.len() as u64;
    report.records = old.iter().map(|pack| pack.records).sum();
    let named_artifacts: BTreeSet<ArtifactId> = kept.iter().flat_map(|pack| pack.names.iter().copied()).collect();
    let mut orphans = Vec::new();
    for entry in bucket.list(OBJECTS)? {
        match object_of(&entry.name) {
            None => report.foreign += 1,
            Some(artifact) if named_artifacts.contains(&artifact) || !is_old(&entry, retention.grace) => {
                report.objects_kept += 1;
                report.bytes_kept = report.bytes_kept.saturating_add(entry.size);
            }
            Some(_) => {
                report.objects += 1;
                report.bytes = report.bytes.saturating_add(entry.size);
                orphans.push(entry.name);
            }
        }
    }
    if is_dry_run {
        return Ok(report);
    }
    // Records are removed first, so that none names a missing object.
    let old_packs: Vec<String> = old.into_iter().map(|pack| pack.entry.name).collect();
    let total = (old_packs.len() + orphans.len()) as u64;
    let done = AtomicU64::new(0);
    let remove = |names: &[String]| {
        concurrently(names, |name| {
            bucket.delete(name)?;
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok::<_, RemoteError>(None::<()>)
        })
    };
    remove(&old_packs)?;
    // Objects that were recorded meanwhile are kept.
    let mut late = BTreeSet::new();
    for (entry, name) in list_packs(bucket)?.0 {
        if !known.contains(entry.name.as_str()) {
            late.extend(read(remote, &entry, name)?.into_iter().flat_map(|pack| pack.names));
        }
    }
    orphans.retain(|name| object_of(name).is_none_or(|artifact| !late.contains(&artifact)));
    remove(&orphans)?;
    // Merged files look new, so old records would be kept for too long.
    if let Some(key) = key.filter(|_| retention.age.is_none()) {
        report.merged = merge(remote, &kept, key)?;
    }
    Ok(report)
}

/// A pack in the list of a remote, with its parsed name.
type ListedPack = (BucketObject, (PublicKey, Digest));

/// Lists the packs of a remote, and counts other names.
fn list_packs(bucket: &dyn Bucket) -> Result<(Vec<ListedPack>, u64), RemoteError> {
    let mut packs = Vec::new();
    let mut foreign = 0;
    for entry in bucket.list(RECORDS)? {
        match pack::parse_name(&entry.name) {
            Some(name) if entry.size <= pack::MAX_PACK => packs.push((entry, name)),
            _ => foreign += 1,
        }
    }
    Ok((packs, foreign))
}

/// Reads a file of records; `None` if it was removed meanwhile.
fn read(
    remote: &Remote,
    entry: &BucketObject,
    (signer, digest): (PublicKey, Digest),
) -> Result<Option<PackContents>, RemoteError> {
    let Some(file) = remote.bucket().get(&entry.name, pack::MAX_PACK)? else {
        return Ok(None);
    };
    // An unsigned file that no version of deaflow wrote names nothing. A file of another version must keep its objects.
    let (statements, is_signed) = match pack::read(&file, &signer, &digest) {
        Ok(statements) => (statements, true),
        Err(PackError::Altered | PackError::Unsigned) => (pack::read_unsigned(&file).unwrap_or_default(), false),
        Err(error @ PackError::OtherVersion) => return Err(unknown_objects(remote, entry, &error.to_string())),
        Err(_) => (Vec::new(), false),
    };
    if is_signed && statements.iter().any(|statement| statement.parts.is_none()) {
        return Err(unknown_objects(
            remote,
            entry,
            "it names a manifest whose chunks are not listed",
        ));
    }
    let parts = statements.iter().flat_map(|statement| statement.parts.iter().flatten());
    let names = statements
        .iter()
        .map(|statement| statement.record.artifact)
        .chain(parts.copied());
    Ok(Some(PackContents {
        names: names.collect(),
        records: statements.len() as u64,
        entry: entry.clone(),
        signer,
        digest,
    }))
}

/// Returns the error that stops the collection if the objects of a file are unknown.
fn unknown_objects(remote: &Remote, entry: &BucketObject, why: &str) -> RemoteError {
    RemoteError::UnexpectedResponse {
        host: remote.place(),
        action: "read",
        name: entry.name.clone(),
        reason: format!("{why}; nothing was removed"),
    }
}

/// Merges small packs of one signer and returns the number of packs that were replaced.
fn merge(remote: &Remote, packs: &[PackContents], key: &SigningKey) -> Result<u64, RemoteError> {
    let own = key.public();
    let small: BTreeSet<Digest> = packs
        .iter()
        .filter(|pack| pack.signer == own && pack.records < MOST_RECORDS as u64 / 2)
        .map(|pack| pack.digest)
        .collect();
    if small.len() < MIN_MERGED {
        return Ok(0);
    }
    let (mut old, mut statements) = (Vec::new(), Vec::new());
    for digest in small {
        let file = remote.bucket().get(&pack::name(&own, &digest), pack::MAX_PACK)?;
        if let Some(Ok(read)) = file.map(|file| pack::read(&file, &own, &digest)) {
            old.push(digest);
            statements.extend(read);
        }
    }
    statements.sort_by_key(|statement| (statement.record.key, statement.record.artifact));
    statements.dedup_by_key(|statement| (statement.record.key, statement.record.artifact));
    let new = pack::divide(statements)?;
    if new.len() >= old.len() {
        return Ok(0);
    }
    for pack in &new {
        let digest = remote.publish(pack, key)?;
        // A new pack may equal an old one.
        old.retain(|old| *old != digest);
    }
    for digest in &old {
        remote.bucket().delete(&pack::name(&own, digest))?;
    }
    remote.refresh()?;
    Ok(old.len() as u64)
}
