//! Records, runs, pins and artifacts broken at random: damage, and never a panic, a hang or a huge allocation.

use std::fs;

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use tempfile::TempDir;

use super::*;
use deaflow_base::{ActionKey, ArtifactId, Canonical, Digest, FileDigest, decode, encode};

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(22),
        ..ProptestConfig::with_cases(cases)
    }
}

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

/// Some bytes in other places, the end cut off, or other bytes behind it.
fn edits() -> impl Strategy<Value = (Vec<(usize, u8)>, usize, Vec<u8>)> {
    let bytes = prop::collection::vec((0..4000usize, prop_oneof![any::<u8>(), Just(255), Just(0)]), 0..6);
    let more = prop::collection::vec(any::<u8>(), 0..40);
    (bytes, prop_oneof![3 => Just(usize::MAX), 1 => 0..400usize], more)
}

fn edited(sound: &[u8], (bytes, left, more): &(Vec<(usize, u8)>, usize, Vec<u8>)) -> Vec<u8> {
    let mut out = sound.to_vec();
    for &(at, value) in bytes {
        let at = at % out.len();
        out[at] = value;
    }
    out.truncate(*left);
    out.extend(more);
    out
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
    let body = sound[..sound.len() - 32].to_vec();
    proptest!(config(600), |(edits in edits(), forged in any::<bool>())| {
        // Forged: the digest at the end fits whatever stands before it.
        let bytes = if forged { with_checksum(edited(&body, &edits)) } else { edited(&sound, &edits) };
        fs::write(&path, &bytes).unwrap();
        match store.record(&key).unwrap() {
            Lookup::Found(found, _) => prop_assert!(forged || bytes == sound, "{found:?}"),
            Lookup::Damaged(_) => prop_assert!(bytes != sound),
            Lookup::Absent => prop_assert!(false, "it is there"),
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
fn broken_files_of_runs_and_pins_are_passed_over() {
    let (_folder, store) = store();
    let run = Run {
        pipeline: "p".into(),
        path: "p.yaml".into(),
        created: "2026-01-01T00:00:00.000Z".into(),
        stages: vec![RunStage {
            name: "s".into(),
            kind: "sample".into(),
            key: ActionKey::of(b"key"),
            artifact: ArtifactId::of(b"artifact"),
            outcome: StageOutcome::Built,
        }],
        ..Run::default()
    };
    store.put_run(&run).unwrap();
    let path = store.run_files().unwrap().remove(0);
    let sound = fs::read(&path).unwrap();
    let pin = store.layout.pins().join(ArtifactId::of(b"artifact").to_string());
    fs::create_dir_all(pin.parent().unwrap()).unwrap();
    proptest!(config(400), |(edits in edits())| {
        let bytes = edited(&sound, &edits);
        fs::write(&path, &bytes).unwrap();
        fs::write(&pin, &bytes).unwrap();
        prop_assert!(store.runs().unwrap().map(Result::unwrap).count() <= 1);
        prop_assert_eq!(store.pins().unwrap()[0].digest, ArtifactId::of(b"artifact"));
    });
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
    proptest!(config(300), |(edits in edits())| {
        let bytes = edited(&sound, &edits);
        fs::remove_file(&path).unwrap();
        fs::write(&path, &bytes).unwrap();
        match Store::open(store.root()).unwrap().artifact(&digest) {
            Ok(artifact) => {
                prop_assert!(bytes == sound);
                prop_assert_eq!(artifact.object().unwrap(), object.clone());
            }
            Err(error) => prop_assert!(error.is_damage() && bytes != sound, "{error}"),
        }
    });
}
