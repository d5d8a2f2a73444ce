//! A remote as a store behind a store: what is not here is read through it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError, RwLock};

use super::bucket::Bucket;
use super::config::Configured;
use super::error::RemoteError;
use super::key::{PublicKey, SigningKey};
use super::known::{Disagreement, Foreign, Known};
use super::pack::{self, NoPack, RECORDS, Statement};
use super::s3::S3;
use deaflow_base::{ActionKey, ArtifactId, Digest, read_own, side_by_side, write_output};
use deaflow_store::{Record, Store, StoreError, Upstream, UpstreamArtifact};

/// The marker, and what it says.
pub const MARKER: &str = "format";
const FORMAT: &str = "deaflow-remote 1";

/// Files of records that are read before what they say is taken in.
const AT_ONCE: usize = 32;

/// Bytes by which a file may be longer than twice as its signer has it.
const ROOM: u64 = 16 << 20;

/// The longest file of which nobody has said how long it is, bytes.
const LARGEST: u64 = 64 << 30;

/// The folder of objects.
pub const OBJECTS: &str = "objects/";

/// The name of an object.
pub fn object_name(digest: &ArtifactId) -> String {
    let name = digest.to_string();
    format!("{OBJECTS}{}/{name}.h5", &name[..2])
}

/// The artifact that an object of this name is.
pub fn object_of(name: &str) -> Option<ArtifactId> {
    let digest = name.rsplit_once('/')?.1.strip_suffix(".h5")?.parse().ok()?;
    (object_name(&digest) == name).then_some(digest)
}

/// What became of a file of records.
enum Pack {
    Statements(Vec<Statement>),
    /// It has gone.
    Nothing,
    /// It does not count; why.
    Rejected(&'static str),
}

/// What came from a remote.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Brought {
    /// How many artifacts.
    pub artifacts: u64,
    /// Bytes of their files there.
    pub bytes: u64,
}

/// A remote, and what is known of it.
pub struct Remote {
    name: String,
    bucket: Box<dyn Bucket>,
    trusted: Vec<(PublicKey, String)>,
    /// Where what was read of it is kept.
    folder: PathBuf,
    known: RwLock<Known>,
    /// What it was believed to have, and what could not be had.
    gone: Mutex<BTreeSet<ArtifactId>>,
    told: Mutex<Vec<String>>,
    /// Whether nothing more is asked for: it cannot be reached.
    is_off: AtomicBool,
    /// Whether it has been said that what is read cannot be kept.
    is_unkept: AtomicBool,
    /// Actions of which it has been said that this store and the remote differ.
    differing: Mutex<BTreeSet<ActionKey>>,
    place: String,
    artifacts: AtomicU64,
    bytes: AtomicU64,
}

impl Remote {
    /// A remote as it is configured, for a store. The user's own key is trusted too.
    ///
    /// # Errors
    /// When its address cannot be used. Nothing is asked for yet.
    pub fn open(configured: &Configured, own: Option<&SigningKey>, store: &Store) -> Result<Self, RemoteError> {
        let bucket = Box::new(S3::open(&configured.address)?);
        let mut trusted: Vec<(PublicKey, String)> = configured
            .trusted
            .iter()
            .map(|named| (named.key, named.whose.clone()))
            .collect();
        let own = own.map(SigningKey::public);
        if let Some(own) = own.filter(|own| !trusted.iter().any(|(key, _)| key == own)) {
            trusted.push((own, "you".to_owned()));
        }
        let of = configured.address.digest();
        Ok(Self::of(&configured.name, bucket, trusted, &of, store))
    }

    /// A remote on any storage; what is read of it is kept under a digest of its place.
    #[must_use]
    pub fn of(
        name: &str,
        bucket: Box<dyn Bucket>,
        trusted: Vec<(PublicKey, String)>,
        place: &Digest,
        store: &Store,
    ) -> Self {
        Self {
            name: name.to_owned(),
            bucket,
            trusted,
            folder: store.remote_folder(place),
            known: RwLock::default(),
            gone: Mutex::default(),
            told: Mutex::default(),
            is_off: AtomicBool::new(false),
            is_unkept: AtomicBool::new(false),
            differing: Mutex::default(),
            place: place.to_string(),
            artifacts: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where it is.
    #[must_use]
    pub fn place(&self) -> String {
        self.bucket.place()
    }

    /// Its storage.
    #[must_use]
    pub fn bucket(&self) -> &dyn Bucket {
        &*self.bucket
    }

    /// Whose key it is, for people.
    #[must_use]
    pub fn whose(&self, key: &PublicKey) -> String {
        let named = self.trusted.iter().find(|(trusted, _)| trusted == key);
        match named.map(|(_, whose)| whose.as_str()) {
            // Two may have one name.
            Some(whose) if !whose.is_empty() => format!("{whose} ({})", key.short()),
            _ => key.short(),
        }
    }

    /// Reads what has been recorded there since, and forgets what has been removed. Gives what does not count.
    ///
    /// # Errors
    /// When the remote cannot be reached or is none.
    pub fn refresh(&self) -> Result<Foreign, RemoteError> {
        self.check_marker()?;
        let mut foreign = Foreign::default();
        let mut packs = Vec::new();
        for entry in self.bucket.list(RECORDS)? {
            match pack::parse_name(&entry.name) {
                Some((signer, _)) if !self.trusts(&signer) => *foreign.untrusted.entry(signer).or_default() += 1,
                Some(_) if entry.size > pack::LONGEST => {
                    foreign
                        .rejected
                        .push((entry.name, "it is longer than any file of records"));
                }
                Some(pack) => packs.push(pack),
                None => foreign
                    .rejected
                    .push((entry.name, "this is no name of a file of records")),
            }
        }
        // Who has spoken first must not depend on the order of an answer.
        packs.sort_unstable();
        let mut known = Known::default();
        for some in packs.chunks(AT_ONCE) {
            let mut read = side_by_side(some, |pack| Ok::<_, RemoteError>(Some((*pack, self.read(pack)?))))?;
            read.sort_unstable_by_key(|(pack, _)| *pack);
            for ((signer, digest), said) in read {
                match said {
                    Pack::Statements(statements) => statements.into_iter().for_each(|said| known.add(signer, said)),
                    Pack::Nothing => {}
                    Pack::Rejected(why) => foreign.rejected.push((pack::name(&signer, &digest), why)),
                }
            }
        }
        foreign.rejected.sort_unstable();
        let there: BTreeSet<(PublicKey, Digest)> = packs.into_iter().collect();
        for (signer, digest) in self.kept().difference(&there) {
            // Another process may have removed it, and where it stays it is removed the next time.
            let _ = fs::remove_file(self.path_of(signer, digest));
        }
        self.set(known);
        Ok(foreign)
    }

    /// What was kept of it when it was last read.
    pub fn learn(&self) {
        let mut known = Known::default();
        for (signer, digest) in self.kept() {
            let statements = self
                .read_kept(&signer, &digest)
                .and_then(|file| pack::read(&file, &signer, &digest).ok());
            for statement in statements.unwrap_or_default() {
                known.add(signer, statement);
            }
        }
        self.set(known);
    }

    /// It is replaced in one step: a panic elsewhere leaves one that is whole.
    fn set(&self, known: Known) {
        *self.known.write().unwrap_or_else(PoisonError::into_inner) = known;
    }

    fn trusts(&self, signer: &PublicKey) -> bool {
        self.trusted.iter().any(|(key, _)| key == signer)
    }

    /// An empty place is one too: nothing has been pushed there yet.
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

    /// Makes the place a remote.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn mark(&self) -> Result<(), RemoteError> {
        match self.bucket.get(MARKER, 1 << 10)? {
            Some(_) => Ok(()),
            None => self.bucket.put(MARKER, format!("{FORMAT}\n").as_bytes()),
        }
    }

    fn path_of(&self, signer: &PublicKey, digest: &Digest) -> PathBuf {
        self.folder.join(signer.to_string()).join(digest.to_string())
    }

    fn read_kept(&self, signer: &PublicKey, digest: &Digest) -> Option<Vec<u8>> {
        read_own(&self.path_of(signer, digest), pack::LONGEST).ok()
    }

    /// The packs of trusted signers that have been read, in order.
    fn kept(&self) -> BTreeSet<(PublicKey, Digest)> {
        let mut kept = BTreeSet::new();
        for (signer, _) in &self.trusted {
            let entries = fs::read_dir(self.folder.join(signer.to_string())).into_iter().flatten();
            let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
            kept.extend(names.filter_map(|name| Some((*signer, name.parse().ok()?))));
        }
        kept
    }

    /// What a pack says, asked for unless it has been read before.
    fn read(&self, (signer, digest): &(PublicKey, Digest)) -> Result<Pack, RemoteError> {
        let kept = self.read_kept(signer, digest);
        if let Some(Ok(statements)) = kept.map(|file| pack::read(&file, signer, digest)) {
            return Ok(Pack::Statements(statements));
        }
        let Some(file) = self.bucket.get(&pack::name(signer, digest), pack::LONGEST)? else {
            // It has been removed meanwhile.
            return Ok(Pack::Nothing);
        };
        Ok(match pack::read(&file, signer, digest) {
            Ok(statements) => {
                self.keep(signer, digest, &file);
                Pack::Statements(statements)
            }
            Err(NoPack::Altered) => Pack::Rejected("its bytes are not those that were written"),
            Err(NoPack::Unsigned) => Pack::Rejected("it is not signed by the key under which it stands"),
            Err(NoPack::Unreadable | NoPack::OtherVersion) => {
                Pack::Rejected("it does not hold records that this program can read")
            }
        })
    }

    /// Keeps a pack for the next time. Where that cannot be, it is read again then.
    fn keep(&self, signer: &PublicKey, digest: &Digest, file: &[u8]) {
        let path = self.path_of(signer, digest);
        let kept =
            fs::create_dir_all(path.parent().unwrap_or(&self.folder)).is_ok_and(|()| write_output(&path, file).is_ok());
        if !kept && !self.is_unkept.swap(true, Ordering::Relaxed) {
            self.tell(format!(
                "{}: what is read of it cannot be kept in {}",
                self.name,
                self.folder.display()
            ));
        }
    }

    /// Writes statements there, signed; gives the digest that names their file.
    ///
    /// # Errors
    /// When the remote cannot be written.
    pub fn state(&self, statements: &[Statement], key: &SigningKey) -> Result<Digest, RemoteError> {
        let (digest, file) = pack::write(statements, key)?;
        let signer = key.public();
        self.bucket.put(&pack::name(&signer, &digest), &file)?;
        self.keep(&signer, &digest, &file);
        Ok(digest)
    }

    /// Where an upload that was interrupted is noted. Where it cannot be, it begins anew the next time.
    #[must_use]
    pub fn note_of(&self, digest: &ArtifactId) -> PathBuf {
        let folder = self.folder.join("uploads");
        // What is refused here is refused when the note is written, too.
        let _ = fs::create_dir_all(&folder);
        folder.join(digest.to_string())
    }

    /// Looks at what is known.
    pub fn with_known<T>(&self, look: impl FnOnce(&Known) -> T) -> T {
        look(&self.known.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// How many records are known.
    #[must_use]
    pub fn count_records(&self) -> u64 {
        self.with_known(|known| known.records().count() as u64)
    }

    /// What trusted signers disagree on.
    #[must_use]
    pub fn disagreements(&self) -> Vec<Disagreement> {
        self.with_known(|known| known.disagreements().cloned().collect())
    }

    /// A disagreement in words, with whose keys they are.
    #[must_use]
    pub fn words_of(&self, disagreement: &Disagreement) -> String {
        let said = disagreement.said.iter();
        let said: Vec<String> = said
            .map(|said| format!("{} says {}", self.whose(&said.signer), said.artifact.short()))
            .collect();
        format!(
            "{}: signers disagree on what action {} ({}) made: {}; none of them is believed",
            self.name,
            disagreement.key.short(),
            disagreement.kind,
            said.join(", ")
        )
    }

    /// Whether it could not be reached.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.is_off.load(Ordering::Relaxed)
    }

    /// Asks for nothing more.
    pub fn turn_off(&self, why: &RemoteError) {
        if !self.is_off.swap(true, Ordering::Relaxed) {
            self.tell(format!("{}: {why}; going on without it", self.name));
        }
    }

    fn tell(&self, text: String) {
        self.told.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    /// What went wrong since this was last asked.
    #[must_use]
    pub fn told(&self) -> Vec<String> {
        std::mem::take(&mut *self.told.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// What has been brought from it so far.
    #[must_use]
    pub fn brought(&self) -> Brought {
        Brought {
            artifacts: self.artifacts.load(Ordering::Relaxed),
            bytes: self.bytes.load(Ordering::Relaxed),
        }
    }

    /// Promises an artifact no more; tells why, unless that has been told.
    fn lose(&self, artifact: &ArtifactId, why: Option<&str>) {
        let mut gone = self.gone.lock().unwrap_or_else(PoisonError::into_inner);
        if let (true, Some(why)) = (gone.insert(*artifact), why) {
            self.tell(format!(
                "{}: artifact {} cannot be had: {why}",
                self.name,
                artifact.short()
            ));
        }
    }
}

impl Upstream for Remote {
    fn record(&self, key: &ActionKey) -> Option<Record> {
        self.with_known(|known| known.record(key).cloned())
    }

    fn records_of(&self, artifact: &ArtifactId) -> Vec<(Record, String)> {
        let origin = |signer: PublicKey| format!("{} {signer}", self.place);
        self.with_known(|known| {
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
            // Of another remote: what is trusted there is not known here.
            None => true,
        };
        let says_so = |known: &Known| {
            let said = known.record(&record.key).map(|said| said.artifact);
            !known.is_disputed(&record.key) && said.is_none_or(|said| said == record.artifact)
        };
        is_trusted && self.with_known(says_so)
    }

    fn compare(&self, record: &Record) {
        let said = self.with_known(|known| {
            let said = known
                .record(&record.key)
                .filter(|said| said.artifact != record.artifact)?;
            Some((known.signer(&record.key)?, said.artifact))
        });
        let Some((signer, artifact)) = said else { return };
        let is_news = self
            .differing
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .insert(record.key);
        if is_news {
            self.tell(format!(
                "{}: {} says that action {} ({}) made {}; this store has made {}, which stays",
                self.name,
                self.whose(&signer),
                record.key.short(),
                record.action.kind,
                artifact.short(),
                record.artifact.short()
            ));
        }
    }

    fn find_artifact(&self, artifact: &ArtifactId) -> Option<UpstreamArtifact> {
        let is_gone = self
            .gone
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .contains(artifact);
        if is_gone {
            return None;
        }
        self.with_known(|known| known.promised(artifact).cloned())
    }

    fn download(&self, artifact: &ArtifactId, target: &Path) -> Result<bool, StoreError> {
        if self.is_off.load(Ordering::Relaxed) {
            self.lose(artifact, None);
            return Ok(false);
        }
        let size = self.with_known(|known| known.promised(artifact).map_or(0, |promise| promise.size));
        // Files of one content differ by what is said beside it.
        let limit = if size > 0 {
            size.saturating_mul(2).saturating_add(ROOM)
        } else {
            LARGEST
        };
        match self.bucket.get_file(&object_name(artifact), target, limit) {
            Ok(Some(_)) => Ok(true),
            Ok(None) => {
                self.lose(artifact, Some("it is not there any more"));
                Ok(false)
            }
            Err(RemoteError::Io { action, path, source }) => Err(StoreError::Io { action, path, source }),
            Err(RemoteError::Store(error)) => Err(error),
            Err(error @ RemoteError::Unreachable { .. }) => {
                self.turn_off(&error);
                self.lose(artifact, None);
                Ok(false)
            }
            Err(error) => {
                self.lose(artifact, Some(&error.to_string()));
                Ok(false)
            }
        }
    }

    fn accept(&self, _: &ArtifactId, size: u64) {
        self.artifacts.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(size, Ordering::Relaxed);
    }

    fn reject(&self, artifact: &ArtifactId, why: &str) {
        self.lose(artifact, Some(why));
    }
}
