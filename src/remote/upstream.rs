//! A remote as the upstream of a store: missing artifacts and records are read from it.

use std::collections::{BTreeSet, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError, RwLock};

use super::bucket::Bucket;
use super::config::RemoteConfiguration;
use super::error::RemoteError;
use super::key::{PublicKey, SigningKey, TrustedKey};
use super::objects::{ObjectState, Objects};
use super::pack::{self, PackError, RECORDS, Statement};
use super::s3::S3;
use super::trusted_records::{Disagreement, IgnoredRecords, TrustedRecords};
use deaflow_base::{ActionKey, ArtifactId, Digest, concurrently, read_own, write_output};
use deaflow_store::{Record, Store, StoreError, Upstream, UpstreamArtifact};

/// Name and content of the marker of a remote.
pub const MARKER: &str = "format";
const FORMAT: &str = "deaflow-remote 1";

/// Number of packs that are read in parallel.
const BATCH: usize = 32;

/// Bytes by which a file may exceed twice the recorded size.
const MARGIN: u64 = 16 << 20;

/// Maximum size in bytes of a file without recorded size.
const MAX_UNKNOWN: u64 = 64 << 30;

/// Why an artifact cannot be downloaded whose object is gone.
const REMOVED: &str = "it was removed";

/// Why an artifact cannot be downloaded that the remote lists, but does not find.
const NOT_FOUND: &str = "it is listed, but not found";

/// Prefix of object names.
pub const OBJECTS: &str = "objects/";

/// Returns the name of the object of an artifact.
pub fn object_name(digest: &ArtifactId) -> String {
    let name = digest.to_string();
    format!("{OBJECTS}{}/{name}.h5", &name[..2])
}

/// Returns the artifact of an object.
pub fn object_of(name: &str) -> Option<ArtifactId> {
    let digest = name.rsplit_once('/')?.1.strip_suffix(".h5")?.parse().ok()?;
    (object_name(&digest) == name).then_some(digest)
}

/// The statements of a pack, unless it is invalid.
type PackResult = Result<Vec<Statement>, PackError>;

/// What was downloaded from a remote.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Downloads {
    /// Number of artifacts.
    pub artifacts: u64,
    /// Size of their files in bytes.
    pub bytes: u64,
}

/// A remote and the records that were read from it.
pub struct Remote {
    name: String,
    bucket: Box<dyn Bucket>,
    trusted: Vec<TrustedKey>,
    /// Folder of cached packs and notes on uploads.
    folder: PathBuf,
    records: RwLock<TrustedRecords>,
    /// Artifacts that could not be downloaded.
    missing: Mutex<BTreeSet<ArtifactId>>,
    objects: Objects,
    warnings: Mutex<Vec<String>>,
    /// Whether requests have stopped because the remote cannot be reached.
    is_disabled: AtomicBool,
    /// Whether there was a warning that packs cannot be cached.
    has_warned_of_cache: AtomicBool,
    /// Actions with a warning that the results of this store and the remote differ.
    differing: Mutex<BTreeSet<ActionKey>>,
    place: String,
    artifacts: AtomicU64,
    bytes: AtomicU64,
}

impl Remote {
    /// Opens a configured remote for a store, and trusts the user's own key too. Sends no request.
    ///
    /// # Errors
    /// Returns an error if its address is invalid.
    pub fn open(
        configured: &RemoteConfiguration,
        own: Option<&SigningKey>,
        store: &Store,
    ) -> Result<Self, RemoteError> {
        let bucket = Box::new(S3::open(&configured.address)?);
        let mut trusted = configured.trusted.clone();
        let own = own.map(SigningKey::public);
        if let Some(key) = own.filter(|own| !trusted.iter().any(|trusted| trusted.key == *own)) {
            let owner = "you".to_owned();
            trusted.push(TrustedKey { key, owner });
        }
        let place = configured.address.digest();
        Ok(Self::new(&configured.name, bucket, trusted, &place, store))
    }

    /// Creates a remote on any storage. `place` identifies its location and names the folder of the cache.
    #[must_use]
    pub fn new(name: &str, bucket: Box<dyn Bucket>, trusted: Vec<TrustedKey>, place: &Digest, store: &Store) -> Self {
        Self {
            name: name.to_owned(),
            bucket,
            trusted,
            folder: store.remote_folder(place),
            records: RwLock::default(),
            missing: Mutex::default(),
            objects: Objects::new(store.remote_folder(place).join("invalid")),
            warnings: Mutex::default(),
            is_disabled: AtomicBool::new(false),
            has_warned_of_cache: AtomicBool::new(false),
            differing: Mutex::default(),
            place: place.to_string(),
            artifacts: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
        }
    }

    /// Returns the name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the location for messages.
    #[must_use]
    pub fn place(&self) -> String {
        self.bucket.place()
    }

    /// Returns the storage.
    #[must_use]
    pub fn bucket(&self) -> &dyn Bucket {
        &*self.bucket
    }

    /// Returns the owner of a key for messages.
    #[must_use]
    pub fn owner(&self, key: &PublicKey) -> String {
        let trusted = self.trusted.iter().find(|trusted| trusted.key == *key);
        match trusted.map(|trusted| trusted.owner.as_str()) {
            // The digits distinguish owners of the same name.
            Some(owner) if !owner.is_empty() => format!("{owner} ({})", key.short()),
            _ => key.short(),
        }
    }

    /// Reads the current records of the remote, and returns the files of records that are not used.
    ///
    /// # Errors
    /// Returns an error if the remote cannot be reached or the location is not a remote.
    pub fn refresh(&self) -> Result<IgnoredRecords, RemoteError> {
        self.check_marker()?;
        self.objects.refresh();
        let mut ignored = IgnoredRecords::default();
        let mut packs = Vec::new();
        for entry in self.bucket.list(RECORDS)? {
            match pack::parse_name(&entry.name) {
                Some((signer, _)) if !self.trusts(&signer) => *ignored.untrusted.entry(signer).or_default() += 1,
                Some(_) if entry.size > pack::MAX_PACK => {
                    ignored.rejected.push((entry.name, PackError::TooLong));
                }
                Some(pack) => packs.push(pack),
                None => ignored.rejected.push((entry.name, PackError::BadName)),
            }
        }
        // The result must not depend on the order of the list.
        packs.sort_unstable();
        let mut records = TrustedRecords::default();
        for batch in packs.chunks(BATCH) {
            let mut read = concurrently(batch, |pack| {
                Ok::<_, RemoteError>(self.read(pack)?.map(|content| (*pack, content)))
            })?;
            read.sort_unstable_by_key(|(pack, _)| *pack);
            for ((signer, digest), content) in read {
                match content {
                    Ok(statements) => statements
                        .into_iter()
                        .for_each(|statement| records.add(signer, statement)),
                    Err(why) => ignored.rejected.push((pack::name(&signer, &digest), why)),
                }
            }
        }
        ignored.rejected.sort_unstable();
        let there: BTreeSet<(PublicKey, Digest)> = packs.into_iter().collect();
        for (signer, digest) in self.cached_packs().difference(&there) {
            // A file that stays is removed the next time.
            let _ = fs::remove_file(self.path_of(signer, digest));
        }
        self.set_records(records);
        Ok(ignored)
    }

    /// Loads the records that were cached when the remote was last read.
    pub fn load_cached(&self) {
        let mut records = TrustedRecords::default();
        for (signer, digest) in self.cached_packs() {
            let statements = self
                .read_cached(&signer, &digest)
                .and_then(|file| pack::read(&file, &signer, &digest).ok());
            for statement in statements.unwrap_or_default() {
                records.add(signer, statement);
            }
        }
        self.set_records(records);
    }

    fn set_records(&self, records: TrustedRecords) {
        *self.records.write().unwrap_or_else(PoisonError::into_inner) = records;
    }

    fn trusts(&self, signer: &PublicKey) -> bool {
        self.trusted.iter().any(|trusted| trusted.key == *signer)
    }

    /// Checks the marker. An empty location is a remote to which nothing was pushed yet.
    fn check_marker(&self) -> Result<(), RemoteError> {
        let Some(found) = self.bucket.get(MARKER, 1 << 10)? else {
            return Ok(());
        };
        let found = String::from_utf8_lossy(&found).trim().to_owned();
        match found == FORMAT {
            true => Ok(()),
            false => Err(RemoteError::Format {
                place: format!("{}/{MARKER}", self.bucket.place()),
                found,
                known: FORMAT,
            }),
        }
    }

    /// Writes the marker, unless there is one.
    ///
    /// # Errors
    /// Returns an error if it cannot be written.
    pub fn write_marker(&self) -> Result<(), RemoteError> {
        match self.bucket.get(MARKER, 1 << 10)? {
            Some(_) => Ok(()),
            None => self.bucket.put(MARKER, format!("{FORMAT}\n").as_bytes()),
        }
    }

    fn path_of(&self, signer: &PublicKey, digest: &Digest) -> PathBuf {
        self.folder.join(signer.to_string()).join(digest.to_string())
    }

    fn read_cached(&self, signer: &PublicKey, digest: &Digest) -> Option<Vec<u8>> {
        read_own(&self.path_of(signer, digest), pack::MAX_PACK).ok()
    }

    /// Returns the cached packs of trusted signers.
    fn cached_packs(&self) -> BTreeSet<(PublicKey, Digest)> {
        let mut cached = BTreeSet::new();
        for TrustedKey { key, .. } in &self.trusted {
            let entries = fs::read_dir(self.folder.join(key.to_string())).into_iter().flatten();
            let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
            cached.extend(names.filter_map(|name| Some((*key, name.parse().ok()?))));
        }
        cached
    }

    /// Reads a pack from the cache or from the remote; `None` if it was removed meanwhile.
    fn read(&self, (signer, digest): &(PublicKey, Digest)) -> Result<Option<PackResult>, RemoteError> {
        let cached = self.read_cached(signer, digest);
        let cached = cached.map(|file| pack::read(&file, signer, digest));
        if cached.as_ref().is_some_and(Result::is_ok) {
            return Ok(cached);
        }
        let Some(file) = self.bucket.get(&pack::name(signer, digest), pack::MAX_PACK)? else {
            return Ok(None);
        };
        let read = pack::read(&file, signer, digest);
        if read.is_ok() {
            self.cache(signer, digest, &file);
        }
        Ok(Some(read))
    }

    /// Caches a pack. On failure it is read again the next time.
    fn cache(&self, signer: &PublicKey, digest: &Digest, file: &[u8]) {
        let path = self.path_of(signer, digest);
        let is_cached =
            fs::create_dir_all(path.parent().unwrap_or(&self.folder)).is_ok_and(|()| write_output(&path, file).is_ok());
        if !is_cached && !self.has_warned_of_cache.swap(true, Ordering::Relaxed) {
            self.warn(format!(
                "{}: cannot cache records in {}",
                self.name,
                self.folder.display()
            ));
        }
    }

    /// Signs statements, writes them to the remote, and returns the digest of the pack.
    ///
    /// # Errors
    /// Returns an error if the remote cannot be written.
    pub fn publish(&self, statements: &[Statement], key: &SigningKey) -> Result<Digest, RemoteError> {
        let (digest, file) = pack::write(statements, key)?;
        let signer = key.public();
        self.bucket.put(&pack::name(&signer, &digest), &file)?;
        self.cache(&signer, &digest, &file);
        Ok(digest)
    }

    /// Returns the path of the note on an interrupted upload. Without a note the upload starts anew.
    #[must_use]
    pub fn upload_note(&self, digest: &ArtifactId) -> PathBuf {
        let folder = self.folder.join("uploads");
        let _ = fs::create_dir_all(&folder);
        folder.join(digest.to_string())
    }

    /// Calls a function with the current records.
    pub fn with_records<T>(&self, look: impl FnOnce(&TrustedRecords) -> T) -> T {
        look(&self.records.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the number of undisputed records.
    #[must_use]
    pub fn count_records(&self) -> u64 {
        self.with_records(|known| known.records().count() as u64)
    }

    /// Returns the actions on which trusted signers disagree.
    #[must_use]
    pub fn disagreements(&self) -> Vec<Disagreement> {
        self.with_records(|known| known.disagreements().cloned().collect())
    }

    /// Describes a disagreement with the owners of the keys.
    #[must_use]
    pub fn describe_disagreement(&self, disagreement: &Disagreement) -> String {
        let results = disagreement.results.iter();
        let results: Vec<String> = results
            .map(|result| format!("{} by {}", result.artifact.short(), self.owner(&result.signer)))
            .collect();
        format!(
            "{}: signers recorded different results of action {} ({}): {}; none of them is used",
            self.name,
            disagreement.key.short(),
            disagreement.kind,
            results.join(", ")
        )
    }

    /// Returns whether requests have stopped because the remote cannot be reached.
    #[must_use]
    pub fn is_disabled(&self) -> bool {
        self.is_disabled.load(Ordering::Relaxed)
    }

    /// Stops all further requests.
    pub fn disable(&self, why: &RemoteError) {
        if !self.is_disabled.swap(true, Ordering::Relaxed) {
            self.warn(format!("{}: {why}; continuing without it", self.name));
        }
    }

    fn warn(&self, text: String) {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    /// Returns the warnings since the last call.
    #[must_use]
    pub fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut *self.warnings.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns what was downloaded so far.
    #[must_use]
    pub fn downloads(&self) -> Downloads {
        Downloads {
            artifacts: self.artifacts.load(Ordering::Relaxed),
            bytes: self.bytes.load(Ordering::Relaxed),
        }
    }

    /// Downloads objects again that were invalid, instead of taking them for missing.
    pub fn retry(&self) {
        self.objects.retry();
    }

    /// Whether the last download of an artifact, or of a chunk of it, was interrupted.
    #[must_use]
    pub fn is_interrupted(&self, artifact: &ArtifactId) -> bool {
        let parts = self.with_records(|records| records.artifact(artifact)?.parts.clone());
        let mut all = std::iter::once(artifact).chain(parts.iter().flatten());
        all.any(|artifact| self.objects.is_interrupted(artifact))
    }

    /// Lists the objects now, and returns the artifacts of those that were not found invalid.
    ///
    /// # Errors
    /// Returns an error if they cannot be listed.
    pub(super) fn valid_objects(&self) -> Result<HashSet<ArtifactId>, RemoteError> {
        self.objects.valid(&*self.bucket)
    }

    /// Notes that an object was replaced.
    pub(super) fn replaced(&self, artifact: &ArtifactId) {
        self.objects.forget(artifact);
    }

    /// Returns whether an object of an artifact can be downloaded, as far as is known; otherwise it is marked as
    /// missing.
    fn is_available(&self, artifact: &ArtifactId) -> bool {
        let is_missing = |missing: &Mutex<BTreeSet<ArtifactId>>| {
            missing
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .contains(artifact)
        };
        if is_missing(&self.missing) {
            return false;
        }
        if self.is_disabled() {
            // Its records were read before: nothing else is known.
            return true;
        }
        let failed = |error: &RemoteError| match error {
            RemoteError::Unreachable { .. } | RemoteError::Slow { .. } => self.disable(error),
            error => self.warn(format!("{}: cannot list the objects: {error}", self.name)),
        };
        let why = match self.objects.state(artifact, &*self.bucket, &failed) {
            ObjectState::Present | ObjectState::Unknown => return true,
            ObjectState::Absent => REMOVED.to_owned(),
            ObjectState::Invalid(why) => why,
        };
        self.mark_missing(artifact, Some(&why));
        false
    }

    /// Marks an artifact as missing, with a warning the first time if there is a reason.
    fn mark_missing(&self, artifact: &ArtifactId, why: Option<&str>) {
        let mut missing = self.missing.lock().unwrap_or_else(PoisonError::into_inner);
        if let (true, Some(why)) = (missing.insert(*artifact), why) {
            self.warn(format!(
                "{}: cannot download artifact {}: {why}",
                self.name,
                artifact.short()
            ));
        }
    }
}

impl Upstream for Remote {
    fn record(&self, key: &ActionKey) -> Option<Record> {
        self.with_records(|known| known.record(key).cloned())
    }

    fn records_of(&self, artifact: &ArtifactId) -> Vec<(Record, String)> {
        let origin = |signer: PublicKey| format!("{} {signer}", self.place);
        self.with_records(|known| {
            let records = known.records_of(artifact);
            records
                .map(|(signer, record)| (record.clone(), origin(signer)))
                .collect()
        })
    }

    fn is_trusted(&self, record: &Record, origin: &str) -> bool {
        let signer = origin.strip_prefix(&self.place).map(str::trim_start);
        let is_trusted = match signer.map(str::parse) {
            Some(Ok(signer)) => self.trusts(&signer),
            Some(Err(())) => false,
            // The keys of other remotes are not known here.
            None => true,
        };
        let agrees = |records: &TrustedRecords| {
            let known = records.record(&record.key);
            !records.is_disputed(&record.key) && known.is_none_or(|known| known.artifact == record.artifact)
        };
        is_trusted && self.with_records(agrees)
    }

    fn compare(&self, record: &Record) {
        let other = self.with_records(|records| {
            let known = records
                .record(&record.key)
                .filter(|known| known.artifact != record.artifact)?;
            Some((records.signer(&record.key)?, known.artifact))
        });
        let Some((signer, artifact)) = other else { return };
        let is_new = self
            .differing
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .insert(record.key);
        if is_new {
            self.warn(format!(
                "{}: the result of action {} ({}) is {} by {}, but {} in this store, which is kept",
                self.name,
                record.key.short(),
                record.action.kind,
                artifact.short(),
                self.owner(&signer),
                record.artifact.short()
            ));
        }
    }

    fn find_artifact(&self, artifact: &ArtifactId) -> Option<UpstreamArtifact> {
        let known = self.with_records(|records| records.artifact(artifact).cloned())?;
        if !self.is_available(artifact) {
            return None;
        }
        let lacking = known.parts.iter().flatten().find(|part| !self.is_available(part));
        if let Some(part) = lacking {
            let why = format!("its chunk {} cannot be downloaded", part.short());
            self.mark_missing(artifact, Some(why.as_str()).filter(|_| !self.is_disabled()));
            return None;
        }
        Some(known)
    }

    fn download(&self, artifact: &ArtifactId, target: &Path) -> Result<bool, StoreError> {
        if self.is_disabled() {
            self.mark_missing(artifact, None);
            return Ok(false);
        }
        let size = self.with_records(|records| records.artifact(artifact).map_or(0, |artifact| artifact.size));
        // Files of the same content differ by their provenance.
        let limit = match size {
            0 => MAX_UNKNOWN,
            size => size.saturating_mul(2).saturating_add(MARGIN),
        };
        match self.bucket.get_file(&object_name(artifact), target, limit) {
            Ok(Some(_)) => Ok(true),
            Ok(None) => {
                self.reject(artifact, NOT_FOUND);
                Ok(false)
            }
            Err(RemoteError::Io { action, path, source }) => Err(StoreError::Io { action, path, source }),
            Err(RemoteError::Store(error)) => Err(error),
            Err(error @ (RemoteError::Unreachable { .. } | RemoteError::Slow { .. })) => {
                self.objects.note_interrupted(artifact, &error.to_string());
                self.disable(&error);
                self.mark_missing(artifact, None);
                Ok(false)
            }
            Err(error) => {
                self.reject(artifact, &error.to_string());
                Ok(false)
            }
        }
    }

    fn accept(&self, artifact: &ArtifactId, size: u64) {
        self.objects.forget(artifact);
        self.artifacts.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(size, Ordering::Relaxed);
    }

    fn reject(&self, artifact: &ArtifactId, why: &str) {
        self.objects.note_invalid(artifact, why);
        self.mark_missing(artifact, Some(why));
    }
}
