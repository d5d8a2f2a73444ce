//! The small files of a store: with any content, the store opens or reports an error, and other files are unaffected.

use std::fs;
use std::path::{Path, PathBuf};

use bolero::check;
use deaflow::base::{ActionKey, ArtifactId, Canonical, FileDigest};
use deaflow::store::{
    Action, CheckpointProgress, Cost, Data, Dataset, LockFile, LockedStage, Lookup, Object, Pin, Provenance, Record,
    Run, RunStage, StageOutcome, Store, StoreError,
};

use super::checked::{check_message, in_time};
use super::mutate::Seeds;
use crate::common::files;

const BUILD: &str = "build";

fn record(artifact: ArtifactId) -> Record {
    let parameters = [
        ("list", Canonical::List(vec![1u64.into(), Canonical::Null])),
        ("text", "text".into()),
    ];
    let action = Action {
        kind: "sample".into(),
        recipe: 1,
        parameters: Canonical::map(parameters),
        inputs: vec![ArtifactId::of(b"input")],
    };
    Record {
        key: action.key().unwrap(),
        action,
        artifact,
        file_digest: FileDigest::of(b"file"),
        size: 600,
        seconds: 0.5,
        unstable: 0,
        created: "2026-01-01T00:00:00.000Z".into(),
        version: "0.1.0".into(),
        target: "x86_64-linux".into(),
    }
}

/// Creates a store with a file of every format except artifacts, which are HDF5.
fn fill(root: &Path) -> ActionKey {
    let store = Store::open(&root.join("store")).unwrap();
    let object = Object::default().with("v", Dataset::new("mm", "d", &[2], Data::F64(vec![1.0, 2.0])));
    let artifact = store.put(&object, &Provenance::default()).unwrap().digest;
    let record = record(artifact);
    store.put_record(&record).unwrap();
    let stage = RunStage {
        name: "s".into(),
        kind: "sample".into(),
        key: record.key,
        artifact,
        outcome: StageOutcome::Built,
        from_scene: Vec::new(),
    };
    store
        .put_run(&Run {
            pipeline: "p".into(),
            path: "p.yaml".into(),
            created: record.created.clone(),
            stages: vec![stage],
            ..Run::default()
        })
        .unwrap();
    store
        .pin(&Pin {
            digest: artifact,
            label: "kept".into(),
            result_only: true,
            created: record.created.clone(),
        })
        .unwrap();
    let cost = serde_json::json!({
        "kind": "sample", "recipe": 1, "parameters": { "count": "2" }, "host": "here", "jobs": 1, "steps": 2, "chunks": 1,
        "input_bytes": 0, "seconds": 0.5, "bytes": 600, "created": record.created,
    });
    store.put_cost(&serde_json::from_value::<Cost>(cost).unwrap()).unwrap();
    let reached = CheckpointProgress::default();
    store
        .put_checkpoint(&record.key, "training", BUILD, &reached, &[7; 40])
        .unwrap();
    let locked = LockedStage {
        key: record.key,
        artifact,
    };
    let lock = LockFile {
        pipeline: "p".into(),
        target: "t".into(),
        stages: [("s".to_owned(), locked)].into(),
    };
    lock.write(&root.join("p.yaml.lock")).unwrap();
    store.remember_lock_file(&root.join("p.yaml.lock")).unwrap();
    store.save_index();
    record.key
}

/// Reads all files of a store.
fn read(root: &Path, key: &ActionKey) -> Result<(), StoreError> {
    let store = Store::open_existing(&root.join("store"))?;
    if let Lookup::Found(found, _) = store.record(key)? {
        assert_eq!(found.action.key().unwrap(), *key, "a record of another action is none");
        store.put_record(&found)?;
        assert!(matches!(store.record(key)?, Lookup::Found(again, _) if again == found));
    }
    store.runs()?;
    store.last_made("s", None)?;
    assert!(store.costs().iter().all(|cost| cost.steps > 0));
    // Each of these may report its own file as damaged; the others continue.
    let errors = [
        store.pins().err(),
        store.lock_files().err(),
        store.checkpoint(key, "training", BUILD).err(),
        store.checkpoints().err(),
        store.totals().err(),
        store.fsck(&|_, _| {}).err(),
    ];
    errors
        .into_iter()
        .flatten()
        .for_each(|error| check_message(&error.to_string()));
    Ok(())
}

#[test]
fn small_files() {
    let place = tempfile::tempdir().unwrap();
    let root = place.path().to_owned();
    let key = fill(&root);
    assert!(read(&root, &key).is_ok());
    let store = root.join("store");
    let is_small = |path: &PathBuf| !path.starts_with(store.join("objects")) && !path.starts_with(store.join("locks"));
    let small: Vec<(PathBuf, Vec<u8>)> = files(&store)
        .into_iter()
        .filter(is_small)
        .map(|path| (path.clone(), fs::read(path).unwrap()))
        .collect();
    // Format, record, run, pin, costs, checkpoint, place of a lock file; and the index, once there is something to
    // know.
    assert!(small.len() >= 7, "{small:?}");
    let seeds: Vec<Seeds> = small
        .iter()
        .map(|(_, bytes)| {
            Seeds::new(
                "store",
                [bytes.clone()],
                &["{", "}", "[", "\"", ":", ",", "\n", "\0", "null", "../", "1e400"],
            )
        })
        .collect();
    check!().with_iterations(400).for_each(|entropy: &[u8]| {
        let (which, rest) = entropy.split_first().unwrap_or((&0, &[]));
        let at = usize::from(*which) % small.len();
        let (path, valid) = &small[at];
        fs::write(path, seeds[at].mutated(rest)).unwrap();
        in_time(|| {
            if let Err(error) = read(&root, &key) {
                check_message(&error.to_string());
            }
        });
        fs::write(path, valid).unwrap();
    });
    assert!(read(&root, &key).is_ok(), "the store is valid again");
}
