//! Damaged records and artifacts are reported as damaged, without a panic, a hang or a huge allocation.
//! tests/it/fuzz/store.rs has the other files of a store.

use std::fs;

use bolero::check;
use tempfile::TempDir;

use super::*;
use deaflow_base::{ArtifactId, Canonical, Digest, FileDigest, decode, encode};

/// The changes of inputs of all fuzz targets.
#[path = "../../tests/it/fuzz/mutate.rs"]
mod mutate;
use mutate::Seeds;

fn store() -> (TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("store")).unwrap();
    (folder, store)
}

fn record() -> Record {
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
        artifact: ArtifactId::of(b"artifact"),
        file_digest: FileDigest::of(b"file"),
        size: 600,
        seconds: 0.5,
        unstable: 0,
        created: "2026-01-01T00:00:00.000Z".into(),
        version: "0.1.0".into(),
        target: "x86_64-linux".into(),
    }
}

fn with_checksum(mut body: Vec<u8>) -> Vec<u8> {
    let digest = Digest::of(&body);
    body.extend_from_slice(digest.as_bytes());
    body
}

#[test]
fn a_broken_record_is_damage() {
    let (_folder, store) = store();
    store.put_record(&record()).unwrap();
    let key = record().key;
    let path = store.layout.record(&key);
    let sound = fs::read(&path).unwrap();
    let seeds = Seeds::new("record", [sound.clone(), sound[..sound.len() - 32].to_vec()], &[]);
    assert_eq!(seeds.valid, 2);
    let root = store.root().to_owned();
    check!().with_iterations(600).for_each(|entropy: &[u8]| {
        // Half of the records get a checksum that matches their bytes.
        let forged = entropy.first().is_some_and(|byte| byte % 2 == 1);
        let bytes = seeds.mutated(entropy);
        let bytes = if forged { with_checksum(bytes) } else { bytes };
        fs::write(&path, &bytes).unwrap();
        match Store::open(&root).unwrap().record(&key).unwrap() {
            Lookup::Found(found, _) => assert!(forged || bytes == sound, "{found:?}"),
            Lookup::Damaged(_) => assert!(bytes != sound),
            Lookup::Absent => panic!("the record exists"),
        }
    });
}

#[test]
fn a_record_that_claims_too_much_or_is_nested_without_end_is_damage() {
    let (_folder, store) = store();
    let key = record().key;
    let path = store.layout.record(&key);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let head = [
        &encode(&key).unwrap()[..],
        &encode(&"sample").unwrap(),
        &encode(&1u32).unwrap(),
    ]
    .concat();
    // A list of one list of one list …, as deep as a record can be long: four bytes say which, eight how many.
    let list = [&encode(&Canonical::List(vec![])).unwrap()[..4], &1u64.to_le_bytes()].concat();
    for body in [
        [&head[..], &list.repeat(1_000_000)].concat(),
        [&head[..], &list[..4], &u64::MAX.to_le_bytes()].concat(),
        [&head[..], &list[..4], &(1u64 << 40).to_le_bytes()].concat(),
        vec![255; 100],
    ] {
        fs::write(&path, with_checksum(body)).unwrap();
        assert!(matches!(store.record(&key).unwrap(), Lookup::Damaged(_)));
    }
    fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    assert!(
        matches!(store.record(&key).unwrap(), Lookup::Damaged(_)),
        "a sparse file of a tebibyte"
    );
}

#[test]
fn values_may_be_nested_as_deeply_as_parameters_are_and_no_deeper() {
    let nested = |depth| (0..depth).fold(Canonical::Null, |inner, _| Canonical::List(vec![inner]));
    let deep = nested(60);
    assert_eq!(decode::<Canonical>(&encode(&deep).unwrap()).unwrap(), deep);
    assert!(decode::<Canonical>(&encode(&nested(70)).unwrap()).is_err());
    // A refusal leaves nothing behind that the next reader would meet.
    assert_eq!(decode::<Canonical>(&encode(&deep).unwrap()).unwrap(), deep);
}

#[test]
fn a_run_that_is_nested_without_end_is_ignored() {
    let (_folder, store) = store();
    let run = Run {
        pipeline: "p".into(),
        path: "p.yaml".into(),
        created: "2026-01-01T00:00:00.000Z".into(),
        ..Run::default()
    };
    store.put_run(&run).unwrap();
    let path = store.run_files().unwrap().remove(0);
    fs::write(&path, "[".repeat(1 << 20)).unwrap();
    assert!(store.runs().unwrap().next().is_none());
}

#[test]
fn a_broken_artifact_is_damage() {
    let (_folder, store) = store();
    let object = Object::default().with("v", Dataset::new("mm", "d", &[3], Data::F64(vec![1.0, 2.0, 3.0])));
    let digest = store.put(&object, &Provenance::default()).unwrap().digest;
    let path = store.layout.object(&digest);
    let sound = fs::read(&path).unwrap();
    let seeds = Seeds::new("artifact", [sound.clone()], &[]);
    let root = store.root().to_owned();
    check!().with_iterations(300).for_each(|entropy: &[u8]| {
        let bytes = seeds.mutated(entropy);
        fs::remove_file(&path).unwrap();
        fs::write(&path, &bytes).unwrap();
        match Store::open(&root).unwrap().artifact(&digest) {
            Ok(artifact) => {
                assert!(bytes == sound);
                assert_eq!(artifact.object().unwrap(), object);
            }
            Err(error) => assert!(error.is_damage() && bytes != sound, "{error}"),
        }
    });
}
