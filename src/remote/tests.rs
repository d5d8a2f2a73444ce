//! Push, pull and garbage collection with storage in memory, which tests make fail, change and lose data.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

use tempfile::TempDir;

use super::bucket::UploadNote;
use super::pack::{self, RECORDS, Statement};
use super::upstream::{OBJECTS, object_name};
use super::*;
use deaflow_base::{ActionKey, ArtifactId, Canonical, Digest};
use deaflow_store::{Action, Condition, Data, Dataset, Effort, Lookup, Object, Provenance, Record, Store};

/// Storage in memory.
#[derive(Default)]
struct Memory {
    objects: Mutex<BTreeMap<String, (Vec<u8>, SystemTime)>>,
    asked: AtomicU64,
    written: AtomicU64,
    /// Writes that still succeed; all, without.
    fails_after: Mutex<Option<u64>>,
    is_down: Mutex<bool>,
    /// How downloads of objects fail.
    fault: Mutex<Option<Fault>>,
}

/// How the download of an object fails.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// It is too slow.
    Slow,
    /// The connection breaks off.
    Cut,
    /// The storage refuses it.
    Denied,
    /// It is listed, but not found.
    Hidden,
}

impl Memory {
    fn ask(&self) -> Result<(), RemoteError> {
        self.asked.fetch_add(1, Ordering::Relaxed);
        match *self.is_down.lock().unwrap() {
            true => Err(RemoteError::Unreachable {
                host: "memory".to_owned(),
                reason: "it is down".to_owned(),
            }),
            false => Ok(()),
        }
    }

    fn write(&self, name: &str, bytes: Vec<u8>) -> Result<(), RemoteError> {
        self.ask()?;
        if let Some(left) = &mut *self.fails_after.lock().unwrap() {
            if *left == 0 {
                return Err(RemoteError::Unreachable {
                    host: "memory".to_owned(),
                    reason: "it broke off".to_owned(),
                });
            }
            *left -= 1;
        }
        self.written.fetch_add(1, Ordering::Relaxed);
        self.objects
            .lock()
            .unwrap()
            .insert(name.to_owned(), (bytes, SystemTime::now()));
        Ok(())
    }

    fn names(&self, prefix: &str) -> Vec<String> {
        let objects = self.objects.lock().unwrap();
        objects
            .keys()
            .filter(|name| name.starts_with(prefix))
            .cloned()
            .collect()
    }

    fn change(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        change(&mut self.objects.lock().unwrap().get_mut(name).unwrap().0);
    }

    fn age(&self, by: Duration) {
        for (_, written) in self.objects.lock().unwrap().values_mut() {
            *written -= by;
        }
    }
}

impl Bucket for Arc<Memory> {
    fn place(&self) -> String {
        "memory".to_owned()
    }

    fn list(&self, prefix: &str) -> Result<Vec<BucketObject>, RemoteError> {
        self.ask()?;
        let objects = self.objects.lock().unwrap();
        let here = objects.iter().filter(|(name, _)| name.starts_with(prefix));
        Ok(here
            .map(|(name, (bytes, modified))| BucketObject {
                name: name.clone(),
                size: bytes.len() as u64,
                modified: *modified,
            })
            .collect())
    }

    fn get(&self, name: &str, _: u64) -> Result<Option<Vec<u8>>, RemoteError> {
        self.ask()?;
        Ok(self.objects.lock().unwrap().get(name).map(|(bytes, _)| bytes.clone()))
    }

    fn get_file(&self, name: &str, target: &Path, _: u64) -> Result<Option<u64>, RemoteError> {
        let host = "memory".to_owned();
        match *self.fault.lock().unwrap() {
            None => {}
            Some(Fault::Hidden) => return Ok(None),
            Some(Fault::Slow) => {
                return Err(RemoteError::Slow {
                    host,
                    reason: "it drips".to_owned(),
                });
            }
            Some(Fault::Cut) => {
                return Err(RemoteError::Unreachable {
                    host,
                    reason: "it broke off".to_owned(),
                });
            }
            Some(Fault::Denied) => {
                return Err(RemoteError::Refused {
                    host,
                    action: "read",
                    name: name.to_owned(),
                    status: 403,
                    code: "AccessDenied".to_owned(),
                    message: String::new(),
                });
            }
        }
        let Some(bytes) = self.get(name, u64::MAX)? else {
            return Ok(None);
        };
        fs::write(target, &bytes).unwrap();
        Ok(Some(bytes.len() as u64))
    }

    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        self.write(name, bytes.to_vec())
    }

    fn put_file(&self, name: &str, file: &Path, size: u64, _: &UploadNote<'_>) -> Result<(), RemoteError> {
        let bytes = fs::read(file).unwrap();
        assert_eq!(bytes.len() as u64, size);
        self.write(name, bytes)
    }

    fn delete(&self, name: &str) -> Result<(), RemoteError> {
        self.ask()?;
        self.objects.lock().unwrap().remove(name);
        Ok(())
    }

    fn now(&self) -> SystemTime {
        SystemTime::now()
    }
}

/// How many records have been made.
static MADE: AtomicU64 = AtomicU64::new(0);

/// Somebody with a store and a key.
struct Person {
    _folder: TempDir,
    store: Store,
    key: SigningKey,
}

impl Person {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self {
            store: Store::open(&folder.path().join("store")).unwrap(),
            key: SigningKey::create(&folder.path().join("key")).unwrap(),
            _folder: folder,
        }
    }

    fn remote(&self, memory: &Arc<Memory>, trusted: &[&Self]) -> Remote {
        let all = trusted.iter().chain([&self]);
        let trusted = all.map(|person| TrustedKey {
            key: person.key.public(),
            owner: String::new(),
        });
        let trusted = trusted.collect();
        Remote::new(
            "lab",
            Box::new(memory.clone()),
            trusted,
            &Digest::of(b"place"),
            &self.store,
        )
    }

    fn push(&self, memory: &Arc<Memory>) -> Result<PushReport, RemoteError> {
        self.push_again(memory, false)
    }

    fn push_again(&self, memory: &Arc<Memory>, again: bool) -> Result<PushReport, RemoteError> {
        let remote = self.remote(memory, &[]);
        remote.refresh()?;
        let all = Push {
            store: &self.store,
            remote: &remote,
            key: &self.key,
            roots: None,
            again,
        };
        push(&all, &|_, _| ())
    }

    /// A store that reads through the remote, and what of that does not count.
    fn reading(&self, memory: &Arc<Memory>, trusted: &[&Self]) -> (Store, Arc<Remote>, IgnoredRecords) {
        let remote = Arc::new(self.remote(memory, trusted));
        let foreign = remote.refresh().unwrap();
        (self.store.clone().with_upstream(remote.clone()), remote, foreign)
    }

    /// Somebody new who pulls all there is.
    fn pulled(memory: &Arc<Memory>, trusted: &[&Self]) -> (Self, PullReport, Arc<Remote>) {
        let person = Self::new();
        let (store, remote, _) = person.reading(memory, trusted);
        let pulled = pull_all(&store, &remote, &|_, _| ()).unwrap();
        (person, pulled, remote)
    }

    /// Makes an artifact by an action of these parameters.
    fn make(&self, parameters: u64, value: f64) -> Record {
        let dataset = Dataset::new("mm", "a number", &[1], Data::F64(vec![value]));
        self.keep("solve", parameters, Object::default().with("x", dataset))
    }

    fn keep(&self, kind: &str, parameters: u64, object: Object) -> Record {
        let provenance = Provenance {
            host: "made by a test".to_owned(),
            ..Provenance::default()
        };
        let stored = self.store.put(&object.of_kind(kind), &provenance).unwrap();
        let action = Action {
            kind: kind.to_owned(),
            recipe: 1,
            parameters: Canonical::from(parameters),
            inputs: Vec::new(),
        };
        let record = Record {
            key: action.key().unwrap(),
            action,
            artifact: stored.digest,
            file_digest: stored.file_digest,
            size: stored.size,
            // No two are made in the same time.
            seconds: 1.0 + MADE.fetch_add(1, Ordering::Relaxed) as f64,
            unstable: 0,
            created: "2026-01-02T03:04:05Z".to_owned(),
            version: "1".to_owned(),
            target: "here".to_owned(),
        };
        self.store.put_record(&record).unwrap();
        record
    }

    /// A manifest of chunks.
    fn make_chunks(&self, n: u64) -> (Record, Vec<ArtifactId>) {
        let chunk = |i: u64| {
            let dataset = Dataset::new("mm", "a number", &[1], Data::F64(vec![i as f64]));
            self.keep("solve chunk", 100 + i, Object::default().with("x", dataset))
        };
        let parts: Vec<ArtifactId> = (0..n).map(|i| chunk(i).artifact).collect();
        let manifest = self.keep("solve", 99, Object::manifest(BTreeMap::new(), parts.clone()));
        (manifest, parts)
    }
}

fn found(store: &Store, key: &ActionKey) -> Option<ArtifactId> {
    store.record(key).unwrap().record().map(|record| record.artifact)
}

#[test]
fn pushed_artifacts_are_pulled_and_verified() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (manifest, parts) = anna.make_chunks(3);
    let single = anna.make(1, 0.5);
    let pushed = anna.push(&memory).unwrap();
    assert_eq!((pushed.objects, pushed.records, pushed.failed.len()), (5, 5, 0));
    let (store, remote, foreign) = ben.reading(&memory, &[&anna]);
    assert_eq!(foreign, IgnoredRecords::default());
    let pulled = pull_all(&store, &remote, &|_, _| ()).unwrap();
    assert_eq!(
        (pulled.artifacts, pulled.artifacts_here, pulled.failed.len()),
        (5, 0, 0)
    );
    for record in [&manifest, &single] {
        assert_eq!(found(&ben.store, &record.key), Some(record.artifact));
    }
    assert_eq!(ben.store.parts(&manifest.artifact).unwrap(), parts);
    let values = ben.store.artifact(&manifest.artifact).unwrap().read("x").unwrap();
    assert_eq!(values.data, Data::F64(vec![0.0, 1.0, 2.0]));
    let report = ben.store.fsck(&|_, _| ()).unwrap();
    assert!(
        report.is_sound() && report.strays.is_empty() && report.rewritten.is_empty(),
        "{report:?}"
    );
    let pulled = pull_all(&store, &remote, &|_, _| ()).unwrap();
    assert_eq!((pulled.artifacts, pulled.artifacts_here), (0, 5));
    // Of one artifact its chunks count, too.
    let pulled = pull_some(&store, &remote, &[manifest.artifact], &|_, _| ()).unwrap();
    assert_eq!((pulled.artifacts, pulled.artifacts_here), (0, 4));
}

#[test]
fn a_second_push_sends_nothing_and_an_interrupted_one_continues() {
    let (memory, anna) = (Arc::new(Memory::default()), Person::new());
    anna.make_chunks(5);
    for writes in 0..7 {
        *memory.fails_after.lock().unwrap() = Some(writes.min(1));
        assert!(anna.push(&memory).is_err(), "{writes}");
        // Whatever is recorded there is there.
        assert!(Person::pulled(&memory, &[&anna]).1.failed.is_empty());
    }
    *memory.fails_after.lock().unwrap() = None;
    let pushed = anna.push(&memory).unwrap();
    assert!(
        pushed.objects_there > 0 && pushed.objects_there + pushed.objects == 6,
        "{pushed:?}"
    );
    let before = memory.written.load(Ordering::Relaxed);
    let pushed = anna.push(&memory).unwrap();
    assert_eq!((pushed.objects, pushed.records, pushed.records_there), (0, 0, 6));
    assert_eq!(memory.written.load(Ordering::Relaxed), before);
}

#[test]
fn objects_are_downloaded_when_they_are_read() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (manifest, parts) = anna.make_chunks(3);
    anna.push(&memory).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    let record = store.record(&manifest.key).unwrap().record().unwrap();
    // The objects are listed once.
    store.inspect_made(&record, Effort::Quick).unwrap();
    let asked = memory.asked.load(Ordering::Relaxed);
    let condition = store.inspect_made(&record, Effort::Quick).unwrap();
    assert_eq!(condition, Condition::Elsewhere { size: manifest.size });
    assert_eq!(store.parts(&manifest.artifact).unwrap(), parts);
    assert_eq!(
        memory.asked.load(Ordering::Relaxed),
        asked,
        "what is known is not asked for"
    );
    assert!(matches!(ben.store.record(&manifest.key).unwrap(), Lookup::Absent));
    // One chunk is read: it alone comes.
    store.artifact(&parts[1]).unwrap();
    assert_eq!(remote.downloads().artifacts, 1);
    let all = store.inspect_made(&record, Effort::Thorough).unwrap();
    assert!(matches!(all, Condition::Intact { .. }), "{all:?}");
    assert_eq!(remote.downloads().artifacts, 4);
    assert_eq!(found(&ben.store, &manifest.key), Some(manifest.artifact));
}

#[test]
fn untrusted_and_unsigned_records_are_ignored_and_reported() {
    let (memory, anna, eve, ben) = (Arc::new(Memory::default()), Person::new(), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    let other = eve.make(2, 0.7);
    anna.push(&memory).unwrap();
    eve.push(&memory).unwrap();
    let (store, _, foreign) = ben.reading(&memory, &[&anna]);
    assert_eq!(foreign.untrusted.get(&eve.key.public()), Some(&1));
    assert!(foreign.rejected.is_empty());
    assert_eq!(found(&store, &record.key), Some(record.artifact));
    assert_eq!(found(&store, &other.key), None);
    // What Eve signed, under the name of Anna; what Anna signed, with a bit turned.
    let eves = memory.names(&format!("{RECORDS}{}", eve.key.public())).remove(0);
    let bytes = memory.get(&eves, 0).unwrap().unwrap();
    let forged = pack::name(&anna.key.public(), &Digest::of(&bytes));
    memory.put(&forged, &bytes).unwrap();
    let annas: Vec<String> = memory.names(&format!("{RECORDS}{}", anna.key.public()));
    let annas = annas.into_iter().find(|name| *name != forged).unwrap();
    memory.change(&annas, |bytes| bytes[200] ^= 1);
    memory.put(&format!("{RECORDS}readme"), b"x").unwrap();
    let cara = Person::new();
    let (store, _, foreign) = cara.reading(&memory, &[&anna]);
    let rejected: BTreeMap<String, PackError> = foreign.rejected.into_iter().collect();
    assert_eq!(rejected.len(), 3, "{rejected:?}");
    assert_eq!(rejected[&forged], PackError::Unsigned);
    assert_eq!(rejected[&annas], PackError::Altered);
    assert!(found(&store, &record.key).is_none() && found(&store, &other.key).is_none());
    // What Ben has read before is not lost by what has become of it there.
    let (store, _, foreign) = ben.reading(&memory, &[&anna]);
    assert_eq!(
        (foreign.rejected.len(), found(&store, &record.key)),
        (2, Some(record.artifact))
    );
}

#[test]
fn a_signed_record_whose_key_differs_from_its_action_is_ignored() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    let wrong = Record {
        key: ActionKey::of(b"another"),
        ..record.clone()
    };
    let remote = anna.remote(&memory, &[]);
    remote
        .publish(&[Statement::new(wrong.clone(), &[])], &anna.key)
        .unwrap();
    let (store, _, _) = ben.reading(&memory, &[&anna]);
    assert_eq!((found(&store, &wrong.key), found(&store, &record.key)), (None, None));
}

#[test]
fn disagreements_of_signers_are_reported_and_not_used() {
    let (memory, anna, eve, ben) = (Arc::new(Memory::default()), Person::new(), Person::new(), Person::new());
    let (one, other) = (anna.make(1, 0.5), eve.make(1, 0.6));
    let agreed = (anna.make(2, 1.0), eve.make(2, 1.0));
    assert_eq!(one.key, other.key);
    anna.push(&memory).unwrap();
    eve.push(&memory).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna, &eve]);
    let disagreements = remote.disagreements();
    assert_eq!((disagreements.len(), disagreements[0].key), (1, one.key));
    let said: Vec<ArtifactId> = disagreements[0].results.iter().map(|said| said.artifact).collect();
    assert!(said.contains(&one.artifact) && said.contains(&other.artifact));
    let text = remote.describe_disagreement(&disagreements[0]);
    for artifact in [one.artifact, other.artifact] {
        assert!(text.contains(&artifact.short()), "{text}");
    }
    assert_eq!(found(&store, &one.key), None);
    assert_eq!(found(&store, &agreed.0.key), Some(agreed.1.artifact));
    let pulled = pull_all(&store, &remote, &|_, _| ()).unwrap();
    assert_eq!(pulled.artifacts, 1);
    // One's own word stays, and that another says otherwise is told once.
    let (store, remote, _) = eve.reading(&memory, &[&anna]);
    assert_eq!(
        (remote.disagreements().len(), found(&store, &one.key)),
        (1, Some(other.artifact))
    );
    let cara = Person::new();
    let own = cara.make(1, 0.9);
    let (store, remote, _) = cara.reading(&memory, &[&anna]);
    for _ in 0..2 {
        assert_eq!(found(&store, &one.key), Some(own.artifact));
    }
    let told = remote.take_warnings();
    assert!(told.len() == 1 && told[0].contains(&own.artifact.short()), "{told:?}");
}

#[test]
fn pulled_records_are_not_signed_again() {
    let (memory, anna, eve, ben) = (Arc::new(Memory::default()), Person::new(), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    anna.push(&memory).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    pull_all(&store, &remote, &|_, _| ()).unwrap();
    let own = ben.make(2, 0.7);
    // Ben signs what he has done, and not what Anna has.
    let pushed = ben.push(&memory).unwrap();
    assert_eq!((pushed.records, pushed.records_of_others, pushed.objects), (1, 1, 1));
    let cara = Person::new();
    let (store, _, _) = cara.reading(&memory, &[&ben]);
    assert_eq!(
        (found(&store, &own.key), found(&store, &record.key)),
        (Some(own.artifact), None)
    );
    // Once Eve says otherwise, or Anna is not trusted any more, what Ben has brought does not count.
    let (store, _, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(found(&store, &record.key), Some(record.artifact));
    let (store, _, _) = ben.reading(&memory, &[]);
    assert_eq!(found(&store, &record.key), None);
    eve.make(1, 0.6);
    eve.push(&memory).unwrap();
    let (store, _, _) = ben.reading(&memory, &[&anna, &eve]);
    assert_eq!(found(&store, &record.key), None);
    // What he does himself does.
    let again = ben.make(1, 0.5);
    assert_eq!(found(&store, &record.key), Some(again.artifact));
    // In a copy of the store it is no more than that.
    let other = Person::new();
    let (store, remote, _) = other.reading(&memory, &[&anna]);
    pull_all(&store, &remote, &|_, _| ()).unwrap();
    other.store.copy_to(&cara.store, record.artifact, &|_, _| ()).unwrap();
    let copied = cara.store.record(&record.key).unwrap().record().unwrap();
    assert!(
        cara.store
            .origin_of(&copied)
            .unwrap()
            .contains(&anna.key.public().to_string())
    );
}

#[test]
fn provenance_of_an_unsigned_file_is_dropped() {
    let (memory, anna) = (Arc::new(Memory::default()), Person::new());
    let record = anna.make(1, 0.5);
    anna.push(&memory).unwrap();
    let host = |person: &Person| {
        let artifact = person.store.artifact(&record.artifact).unwrap();
        artifact.provenance().unwrap()["host"].clone()
    };
    // The file that Anna has signed is believed.
    assert_eq!(host(&Person::pulled(&memory, &[&anna]).0), "made by a test");
    // Another file of the same content is not.
    let eve = Person::new();
    let forged = Provenance {
        host: "evil.example.org".to_owned(),
        ..Provenance::default()
    };
    let object = anna.store.artifact(&record.artifact).unwrap().object().unwrap();
    let stored = eve.store.put(&object, &forged).unwrap();
    let (path, ..) = eve.store.file_of(&stored.digest).unwrap();
    memory
        .put(&object_name(&record.artifact), &fs::read(path).unwrap())
        .unwrap();
    let (ben, pulled, _) = Person::pulled(&memory, &[&anna]);
    assert_eq!((pulled.artifacts, host(&ben).as_str()), (1, ""));
    let provenance = ben.store.artifact(&record.artifact).unwrap().provenance().unwrap();
    assert_eq!(provenance["action"], record.key.to_string());
    assert_eq!(provenance["target"], "here");
}

#[test]
fn damaged_and_missing_artifacts_are_pulled_again() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (manifest, parts) = anna.make_chunks(3);
    anna.push(&memory).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    pull_all(&store, &remote, &|_, _| ()).unwrap();
    let paths: Vec<_> = parts.iter().map(|part| ben.store.file_of(part).unwrap().0).collect();
    fs::remove_file(&paths[0]).unwrap();
    let mut bytes = fs::read(&paths[1]).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&paths[1], bytes).unwrap();
    let fresh = Store::open(ben.store.root()).unwrap();
    fs::remove_file(
        fresh
            .root()
            .join("records")
            .join(&manifest.key.to_string()[..2])
            .join(manifest.key.to_string()),
    )
    .unwrap();
    let store = fresh.clone().with_upstream(remote.clone());
    let pulled = pull_some(&store, &remote, &[manifest.artifact], &|_, _| ()).unwrap();
    assert_eq!((pulled.artifacts, pulled.failed.len()), (2, 0));
    assert!(fresh.fsck(&|_, _| ()).unwrap().is_sound());
    assert_eq!(found(&fresh, &manifest.key), Some(manifest.artifact));
}

#[test]
fn junk_among_the_records_is_ignored() {
    let (memory, anna) = (Arc::new(Memory::default()), Person::new());
    let record = anna.make(1, 0.5);
    anna.push(&memory).unwrap();
    let key = anna.key.public();
    let huge = vec![0; usize::try_from(pack::MAX_PACK).unwrap() + 1];
    let other = b"deaflow-records 2\nwhatever".to_vec();
    for junk in [&huge, &Vec::new(), &other] {
        memory.put(&pack::name(&key, &Digest::of(junk)), junk).unwrap();
    }
    // A length that is none, signed.
    let remote = anna.remote(&memory, &[]);
    let absurd = Record {
        size: u64::MAX,
        ..anna.make(2, 0.6)
    };
    remote
        .publish(&[Statement::new(absurd.clone(), &[])], &anna.key)
        .unwrap();
    let cara = Person::new();
    let (store, remote, foreign) = cara.reading(&memory, &[&anna]);
    assert_eq!(foreign.rejected.len(), 3, "{foreign:?}");
    assert_eq!(
        (found(&store, &record.key), found(&store, &absurd.key)),
        (Some(record.artifact), None)
    );
    let retention = Retention {
        grace: Duration::ZERO,
        age: None,
    };
    // What another version may have written must not lose what it names.
    let error = collect_garbage(&remote, retention, None, false, &|_, _| ())
        .unwrap_err()
        .to_string();
    assert!(error.contains(&Digest::of(&other).to_string()), "{error}");
    memory.delete(&pack::name(&key, &Digest::of(&other))).unwrap();
    let swept = collect_garbage(&remote, retention, None, false, &|_, _| ()).unwrap();
    assert_eq!((swept.objects, swept.objects_kept, swept.foreign), (0, 1, 1));
}

#[test]
fn records_that_cannot_be_cached_are_read_each_time() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    anna.push(&memory).unwrap();
    fs::write(ben.store.root().join("remotes"), "in the way").unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(found(&store, &record.key), Some(record.artifact));
    let told = remote.take_warnings();
    assert!(told.len() == 1 && told[0].contains("remotes"), "{told:?}");
    remote.refresh().unwrap();
    assert!(remote.take_warnings().is_empty());
}

#[test]
fn a_wrong_object_is_rejected_and_repaired_by_the_next_push() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (one, two) = (anna.make(1, 0.5), anna.make(2, 0.6));
    anna.push(&memory).unwrap();
    let (first, second) = (object_name(&one.artifact), object_name(&two.artifact));
    // Another artifact in its place, sound by itself.
    let bytes = memory.get(&second, 0).unwrap().unwrap();
    memory.put(&first, &bytes).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    let pulled = pull_all(&store, &remote, &|_, _| ()).unwrap();
    assert_eq!((pulled.failed, pulled.artifacts), (vec![one.artifact], 1));
    assert!(
        remote
            .take_warnings()
            .iter()
            .any(|text| text.contains(&one.artifact.short()))
    );
    assert!(matches!(
        store.inspect(&one.artifact, Effort::Quick).unwrap(),
        Condition::Missing
    ));
    assert_eq!(found(&ben.store, &one.key), None);
    // With a header that promises what is not in it.
    let name = one.artifact.to_string();
    memory.change(&first, |bytes| {
        let at = bytes
            .windows(64)
            .position(|window| window == two.artifact.to_string().as_bytes())
            .unwrap();
        bytes[at..at + 64].copy_from_slice(name.as_bytes());
    });
    let (_cara, pulled, remote) = Person::pulled(&memory, &[&anna]);
    assert_eq!(pulled.failed, [one.artifact]);
    let warnings = remote.take_warnings();
    assert!(
        warnings.iter().any(|text| text.contains(&two.artifact.short())),
        "{warnings:?}"
    );
    for wrong in [&b""[..], b"deaflow-artifact 1\n", &[0; 4096]] {
        memory.put(&first, wrong).unwrap();
        assert_eq!(Person::pulled(&memory, &[&anna]).1.failed, [one.artifact]);
    }
    anna.push_again(&memory, true).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(pull_all(&store, &remote, &|_, _| ()).unwrap().failed, []);
    assert!(ben.store.fsck(&|_, _| ()).unwrap().is_sound());
}

#[test]
fn a_removed_object_is_not_counted_on() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (one, two) = (anna.make(1, 0.5), anna.make(2, 0.6));
    let (manifest, parts) = anna.make_chunks(3);
    anna.push(&memory).unwrap();
    for removed in [&one.artifact, &parts[1]] {
        memory.delete(&object_name(removed)).unwrap();
    }
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    let condition = |artifact: &ArtifactId| store.inspect(artifact, Effort::Quick).unwrap();
    for missing in [&one.artifact, &parts[1], &manifest.artifact] {
        assert!(matches!(condition(missing), Condition::Missing), "{missing}");
    }
    for there in [&two.artifact, &parts[0], &parts[2]] {
        assert!(matches!(condition(there), Condition::Elsewhere { .. }), "{there}");
    }
    let warnings = remote.take_warnings();
    assert_eq!(warnings.len(), 3, "{warnings:?}");
    assert!(
        warnings[0].contains("removed") && warnings[2].contains(&parts[1].short()),
        "{warnings:?}"
    );
    anna.push_again(&memory, true).unwrap();
    let (store, _, _) = ben.reading(&memory, &[&anna]);
    let condition = store.inspect(&manifest.artifact, Effort::Quick).unwrap();
    assert!(matches!(condition, Condition::Elsewhere { .. }));
}

#[test]
fn an_invalid_object_is_remembered_until_it_is_replaced() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    anna.push(&memory).unwrap();
    let name = object_name(&record.artifact);
    let sound = memory.get(&name, 0).unwrap().unwrap();
    memory.put(&name, b"nothing").unwrap();
    let look = |person: &Person| {
        let (store, remote, _) = person.reading(&memory, &[&anna]);
        let condition = store.inspect(&record.artifact, Effort::Quick).unwrap();
        (matches!(condition, Condition::Elsewhere { .. }), remote.take_warnings())
    };
    // It is listed, and nobody has looked into it.
    assert!(look(&ben).0);
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(pull_all(&store, &remote, &|_, _| ()).unwrap().failed, [record.artifact]);
    let why = remote.take_warnings();
    assert_eq!(look(&ben), (false, why));
    // A pull looks again.
    let asked = memory.asked.load(Ordering::Relaxed);
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(pull_all(&store, &remote, &|_, _| ()).unwrap().failed, [record.artifact]);
    assert!(memory.asked.load(Ordering::Relaxed) > asked + 2);
    memory.put(&name, &sound).unwrap();
    assert_eq!(look(&ben), (true, Vec::new()));
}

#[test]
fn an_object_that_cannot_be_read_is_remembered() {
    for (fault, why) in [
        (Fault::Denied, "403 AccessDenied"),
        (Fault::Hidden, "listed, but not found"),
    ] {
        let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
        let (manifest, parts) = anna.make_chunks(3);
        anna.push(&memory).unwrap();
        let pull = || {
            let (store, remote, _) = ben.reading(&memory, &[&anna]);
            pull_all(&store, &remote, &|_, _| ()).unwrap().failed
        };
        let look = || {
            let (store, remote, _) = ben.reading(&memory, &[&anna]);
            let condition = store.inspect(&manifest.artifact, Effort::Quick).unwrap();
            (matches!(condition, Condition::Elsewhere { .. }), remote.take_warnings())
        };
        *memory.fault.lock().unwrap() = Some(fault);
        assert!(pull().contains(&parts[1]), "{fault:?}");
        let (is_there, warnings) = look();
        assert!(!is_there && warnings[0].contains(why), "{fault:?}: {warnings:?}");
        // A run does not try again, a pull does.
        *memory.fault.lock().unwrap() = None;
        assert!(!look().0);
        assert_eq!(pull(), []);
        fs::remove_dir_all(ben.store.root().join("objects")).unwrap();
        assert_eq!(look(), (true, Vec::new()));
    }
}

#[test]
fn an_interrupted_download_leaves_an_object_in_doubt() {
    for fault in [Fault::Cut, Fault::Slow] {
        let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
        let (manifest, _) = anna.make_chunks(3);
        let other = anna.make(1, 0.5);
        anna.push(&memory).unwrap();
        let (store, remote, _) = ben.reading(&memory, &[&anna]);
        assert!(!remote.is_interrupted(&manifest.artifact));
        *memory.fault.lock().unwrap() = Some(fault);
        let pulled = pull_some(&store, &remote, &[manifest.artifact], &|_, _| ()).unwrap();
        assert_eq!(pulled.failed, [manifest.artifact]);
        // It is not taken for invalid, and the next command that reads it tries again.
        *memory.fault.lock().unwrap() = None;
        let (store, remote, _) = ben.reading(&memory, &[&anna]);
        let condition = store.inspect(&manifest.artifact, Effort::Quick).unwrap();
        assert!(matches!(condition, Condition::Elsewhere { .. }), "{fault:?}");
        assert!(remote.is_interrupted(&manifest.artifact) && !remote.is_interrupted(&other.artifact));
        assert!(store.fetch(&manifest.artifact).unwrap());
        assert!(!remote.is_interrupted(&manifest.artifact));
    }
}

#[test]
fn a_pull_of_a_removed_object_is_incomplete_each_time() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    anna.push(&memory).unwrap();
    memory.delete(&object_name(&record.artifact)).unwrap();
    for _ in 0..2 {
        let (store, remote, _) = ben.reading(&memory, &[&anna]);
        let pulled = pull_some(&store, &remote, &[record.artifact], &|_, _| ()).unwrap();
        assert_eq!(pulled.failed, [record.artifact]);
    }
}

#[test]
fn an_object_that_was_found_invalid_is_replaced_by_the_next_push() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    let (_, parts) = anna.make_chunks(3);
    anna.push(&memory).unwrap();
    let damaged = [record.artifact, parts[1]];
    // Of the same length, so that a list shows nothing.
    let damage = || {
        for artifact in &damaged {
            memory.change(&object_name(artifact), |bytes| *bytes.last_mut().unwrap() ^= 1);
        }
    };
    damage();
    let pull = || {
        let (store, remote, _) = ben.reading(&memory, &[&anna]);
        pull_all(&store, &remote, &|_, _| ()).unwrap().failed
    };
    assert!(pull().contains(&record.artifact));
    // Ben builds what he could not get; to pull again does not lose what is known of the objects.
    ben.make(1, 0.5);
    ben.make_chunks(3);
    assert_eq!(pull(), []);
    let pushed = ben.push(&memory).unwrap();
    assert_eq!((pushed.objects, pushed.objects_there), (2, 3));
    let (_, pulled, _) = Person::pulled(&memory, &[&anna]);
    assert_eq!(pulled.failed, []);
    // What was replaced is not sent again, even if its time and length are the same.
    damage();
    assert_eq!(ben.push(&memory).unwrap().objects, 0);
}

#[test]
fn a_run_goes_on_without_a_server_that_drips() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (one, two) = (anna.make(1, 0.5), anna.make(2, 0.6));
    anna.push(&memory).unwrap();
    *memory.fault.lock().unwrap() = Some(Fault::Slow);
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    let asked = memory.asked.load(Ordering::Relaxed);
    for record in [&one, &two] {
        // It is missing, so that it is built.
        assert!(!store.fetch(&record.artifact).unwrap());
        let condition = store.inspect(&record.artifact, Effort::Quick).unwrap();
        assert!(matches!(condition, Condition::Missing));
    }
    let told = remote.take_warnings();
    assert!(told.len() == 1 && told[0].contains("too slow: it drips"), "{told:?}");
    assert!(told[0].ends_with("continuing without it"), "{told:?}");
    assert!(
        memory.asked.load(Ordering::Relaxed) <= asked + 1,
        "it is not asked again"
    );
    // What came is not taken for invalid.
    *memory.fault.lock().unwrap() = None;
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(pull_all(&store, &remote, &|_, _| ()).unwrap().failed, []);
}

#[test]
fn a_store_that_fetches_has_what_it_reports() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (one, two) = (anna.make(1, 0.5), anna.make(2, 0.6));
    let (manifest, _) = anna.make_chunks(3);
    anna.push(&memory).unwrap();
    memory.put(&object_name(&one.artifact), b"nothing").unwrap();
    let (store, _, _) = ben.reading(&memory, &[&anna]);
    let store = store.fetching();
    let condition = |artifact: &ArtifactId| store.inspect(artifact, Effort::Quick).unwrap();
    assert!(matches!(condition(&one.artifact), Condition::Missing));
    for record in [&two, &manifest] {
        assert!(matches!(condition(&record.artifact), Condition::Intact { .. }));
        assert!(ben.store.has(&record.artifact));
    }
}

#[test]
fn damaged_artifacts_and_their_manifests_are_not_sent() {
    let (memory, anna) = (Arc::new(Memory::default()), Person::new());
    let (manifest, parts) = anna.make_chunks(3);
    let fresh = Store::open(anna.store.root()).unwrap();
    let path = fresh.artifact(&parts[1]).unwrap().path().to_owned();
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&path, bytes).unwrap();
    let pushed = anna.push(&memory).unwrap();
    let left: Vec<ArtifactId> = pushed.failed.iter().map(|(artifact, _)| *artifact).collect();
    assert!(
        left.contains(&parts[1]) && left.contains(&manifest.artifact),
        "{left:?}"
    );
    assert_eq!((pushed.objects, pushed.records), (2, 2));
}

#[test]
fn a_remote_that_is_down_is_disabled() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let record = anna.make(1, 0.5);
    let other = anna.make(2, 0.6);
    anna.push(&memory).unwrap();
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    *memory.is_down.lock().unwrap() = true;
    for record in [&record, &other] {
        assert!(!store.fetch(&record.artifact).unwrap());
        let again = store.inspect(&record.artifact, Effort::Quick).unwrap();
        assert!(matches!(again, Condition::Missing));
    }
    let told = remote.take_warnings();
    assert!(told.len() == 1 && told[0].contains("it is down"), "{told:?}");
    // Later, without any network: what was read before is known.
    let remote = ben.remote(&memory, &[&anna]);
    assert!(remote.refresh().is_err());
    remote.load_cached();
    let asked = memory.asked.load(Ordering::Relaxed);
    let store = ben.store.clone().with_upstream(Arc::new(remote));
    assert_eq!(found(&store, &record.key), Some(record.artifact));
    assert_eq!(memory.asked.load(Ordering::Relaxed), asked);
}

#[test]
fn a_collection_removes_only_old_unnamed_objects() {
    const DAY: Duration = Duration::from_secs(24 * 3600);
    let (memory, anna, eve) = (Arc::new(Memory::default()), Person::new(), Person::new());
    let (manifest, parts) = anna.make_chunks(2);
    eve.make(7, 3.0);
    anna.push(&memory).unwrap();
    eve.push(&memory).unwrap();
    memory.put(&object_name(&ArtifactId::of(b"orphan")), b"x").unwrap();
    memory.put("objects/notes.txt", b"mine").unwrap();
    let remote = anna.remote(&memory, &[]);
    remote.refresh().unwrap();
    let keep = |grace, age| Retention { grace, age };
    let swept = collect_garbage(&remote, keep(7 * DAY, None), None, false, &|_, _| ()).unwrap();
    assert_eq!((swept.objects, swept.objects_kept, swept.foreign), (0, 5, 1));
    memory.age(8 * DAY);
    let tried = collect_garbage(&remote, keep(7 * DAY, None), None, true, &|_, _| ()).unwrap();
    assert_eq!((tried.objects, memory.names(OBJECTS).len()), (1, 6));
    let swept = collect_garbage(&remote, keep(7 * DAY, None), None, false, &|_, _| ()).unwrap();
    assert_eq!((swept, memory.names(OBJECTS).len()), (tried, 5));
    // What Eve has signed holds what it names, although Anna does not trust her; by age all goes.
    memory.age(30 * DAY);
    anna.make(8, 4.0);
    anna.push(&memory).unwrap();
    let swept = collect_garbage(&remote, keep(7 * DAY, Some(20 * DAY)), None, false, &|_, _| ()).unwrap();
    assert_eq!(
        (swept.packs, swept.records, swept.objects, swept.objects_kept),
        (2, 4, 4, 1)
    );
    assert!(Person::pulled(&memory, &[&anna, &eve]).1.failed.is_empty());
    // What has gone is pushed again.
    let pushed = anna.push(&memory).unwrap();
    assert_eq!((pushed.objects, pushed.records), (3, 3));
    let (person, ..) = Person::pulled(&memory, &[&anna]);
    assert_eq!(person.store.parts(&manifest.artifact).unwrap(), parts);
}

#[test]
fn many_small_files_of_records_become_few() {
    let (memory, anna, ben) = (Arc::new(Memory::default()), Person::new(), Person::new());
    for i in 0..20 {
        anna.make(i, i as f64);
        anna.push(&memory).unwrap();
    }
    assert_eq!(memory.names(RECORDS).len(), 20);
    let remote = anna.remote(&memory, &[]);
    remote.refresh().unwrap();
    let retention = Retention {
        grace: Duration::ZERO,
        age: None,
    };
    let swept = collect_garbage(&remote, retention, Some(&anna.key), false, &|_, _| ()).unwrap();
    assert_eq!((swept.merged, memory.names(RECORDS).len(), swept.objects), (20, 1, 0));
    let (store, remote, _) = ben.reading(&memory, &[&anna]);
    assert_eq!(pull_all(&store, &remote, &|_, _| ()).unwrap().artifacts, 20);
    assert_eq!(anna.push(&memory).unwrap().records_there, 20);
}

#[test]
fn a_remote_of_another_version_is_refused() {
    let (memory, anna) = (Arc::new(Memory::default()), Person::new());
    memory.put("format", b"deaflow-remote 2\n").unwrap();
    let error = anna.push(&memory).unwrap_err();
    assert!(matches!(error, RemoteError::Format { .. }), "{error}");
    assert_eq!(memory.names("").len(), 1);
}

#[test]
fn packs_hold_no_more_than_fits() {
    let anna = Person::new();
    let record = anna.make(1, 0.5);
    let statements = vec![Statement::new(record, &[]); pack::MOST_RECORDS + 1];
    let packs = pack::divide(statements).unwrap();
    assert_eq!(packs.iter().map(Vec::len).collect::<Vec<_>>(), [pack::MOST_RECORDS, 1]);
    let (digest, file) = pack::write(&packs[0], &anna.key).unwrap();
    assert!((file.len() as u64) < pack::MAX_PACK);
    assert_eq!(
        pack::read(&file, &anna.key.public(), &digest).unwrap().len(),
        pack::MOST_RECORDS
    );
}
