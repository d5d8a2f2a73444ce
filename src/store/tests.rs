//! What a store promises, tried on small objects in temporary folders.

mod trust;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;

use super::read::Access;
use super::*;
use deaflow_base::{ActionKey, ArtifactId, Canonical, Digest};

/// Serves the tests of this room, which start their program anew with this one alone.
#[test]
#[ignore = "the process that other tests start"]
fn the_process_that_other_tests_start() {
    deaflow_hdf::serve().unwrap();
}

fn store() -> (TempDir, Store) {
    deaflow_hdf::read_by_test();
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("store")).unwrap();
    (folder, store)
}

/// A chunk of `n` samples counting from `first`.
fn chunk(first: u8, n: usize) -> Object {
    let numbers: Vec<u8> = (0..2 * n).map(|i| first + i as u8).collect();
    let texts: Vec<String> = (0..n).map(|i| format!("{}{}", "x".repeat(63), i % 10)).collect();
    let reals = numbers.iter().map(|&x| f64::from(x) / 3.0).collect();
    Object::default()
        .of_kind("count")
        .with(
            "patterns",
            Dataset::new("1", "Patterns", &[n, 2], Data::U8(numbers)).with_axes(&["sample", "x"]),
        )
        .with(
            "deep/outcome",
            Dataset::new("", "Outcome of each", &[n], Data::Text(texts)),
        )
        .with(
            "deep/er/field",
            Dataset::new("mm", "A field", &[n, 1, 2], Data::F64(reals)),
        )
}

fn put(store: &Store, object: &Object) -> ArtifactId {
    store.put(object, &Provenance::default()).unwrap().digest
}

fn object_path(store: &Store, digest: &ArtifactId) -> std::path::PathBuf {
    let name = digest.to_string();
    store.root().join("objects").join(&name[..2]).join(format!("{name}.h5"))
}

/// Overwrites one byte in place.
fn flip(path: &Path, at: usize) {
    let mut bytes = fs::read(path).unwrap();
    bytes[at] ^= 1;
    fs::write(path, bytes).unwrap();
}

#[test]
fn an_object_comes_back_as_it_was_put() {
    let (_folder, store) = store();
    let object = chunk(1, 3)
        .attribute("scene", "side: 50 mm — é")
        .with("u32", Dataset::new("", "d", &[1], Data::U32(vec![u32::MAX])))
        .with("u64", Dataset::new("", "d", &[], Data::U64(vec![u64::MAX])))
        .with("f32", Dataset::new("", "d", &[0, 5], Data::F32(Vec::new())));
    let stored = store.put(&object, &Provenance::default()).unwrap();
    assert_eq!(stored.digest, object.digest().unwrap());
    let artifact = store.artifact(&stored.digest).unwrap();
    assert_eq!(artifact.object().unwrap(), object);
    assert_eq!(artifact.attribute("scene"), Some("side: 50 mm — é"));
    assert_eq!(artifact.u64s("u64").unwrap(), (vec![], vec![u64::MAX]));
    assert!(matches!(
        artifact.u8s("u64"),
        Err(StoreError::WrongType { found: "u64", .. })
    ));
    assert!(artifact.u8s("pattern").unwrap_err().to_string().contains("patterns"));
}

#[test]
fn what_is_only_looked_at_leaves_no_trace_where_the_disk_is_this_machines() {
    let (folder, store) = store();
    if !super::file_system::file_system(folder.path()).1 {
        return;
    }
    let digest = put(&store, &chunk(0, 3));
    store.save_index();
    drop(store);
    let root = folder.path().join("store");
    let changed = |name: &str| fs::metadata(root.join(name)).unwrap().modified().unwrap();
    let names = ["", "tmp", "objects", "records", "index"];
    let before = names.map(changed);
    std::thread::sleep(std::time::Duration::from_millis(30));
    let store = Store::open(&root).unwrap();
    let found = store.inspect(&digest, Effort::Quick).unwrap();
    assert!(matches!(found, Condition::Intact { .. }), "{found:?}");
    assert!(store.now() > std::time::UNIX_EPOCH);
    store.save_index();
    drop(store);
    assert_eq!(names.map(changed), before);
}

#[test]
fn a_manifest_reads_as_its_chunks_laid_end_to_end() {
    let (_folder, store) = store();
    let parts: Vec<ArtifactId> = [chunk(0, 2), chunk(50, 0), chunk(4, 1)]
        .iter()
        .map(|c| put(&store, c))
        .collect();
    let manifest = store
        .artifact(&put(&store, &Object::manifest(Default::default(), parts.clone())))
        .unwrap();
    assert_eq!(manifest.parts(), parts);
    assert_eq!(manifest.u8s("patterns").unwrap(), (vec![3, 2], vec![0, 1, 2, 3, 4, 5]));
    let (shape, fields) = manifest.f64s("deep/er/field").unwrap();
    assert_eq!((shape, fields[5]), (vec![3, 1, 2], 5.0 / 3.0));
    let shapes: Vec<Vec<usize>> = manifest.contents().unwrap().iter().map(|c| c.shape.clone()).collect();
    assert_eq!(shapes, [vec![3, 1, 2], vec![3], vec![3, 2]]);
}

#[test]
fn virtual_datasets_show_the_chunks_to_any_reader_even_after_a_move() {
    let (folder, store) = store();
    let parts = [chunk(0, 2), chunk(50, 0), chunk(4, 1)]
        .iter()
        .map(|c| put(&store, c))
        .collect();
    let manifest = put(&store, &Object::manifest(Default::default(), parts));
    drop(store);
    fs::rename(folder.path().join("store"), folder.path().join("moved")).unwrap();
    let store = Store::open(&folder.path().join("moved")).unwrap();
    let file = hdf5::File::open(object_path(&store, &manifest)).unwrap();
    assert_eq!(
        file.dataset("patterns").unwrap().read_raw::<u8>().unwrap(),
        [0, 1, 2, 3, 4, 5]
    );
    assert_eq!(
        file.dataset("deep/er/field").unwrap().read_raw::<f64>().unwrap()[5],
        5.0 / 3.0
    );
}

#[test]
fn chunks_that_differ_in_their_datasets_are_refused() {
    let (_folder, store) = store();
    let other = chunk(0, 1).with("extra", Dataset::new("", "", &[1], Data::U8(vec![1])));
    let wide = Object::default().with("patterns", Dataset::new("1", "Patterns", &[1, 3], Data::U8(vec![1; 3])));
    let narrow = Object::default().with("patterns", Dataset::new("1", "Patterns", &[1, 2], Data::U8(vec![1; 2])));
    for (a, b) in [(chunk(0, 1), other), (narrow, wide)] {
        let manifest = Object::manifest(Default::default(), vec![put(&store, &a), put(&store, &b)]);
        let refused = store.put(&manifest, &Provenance::default());
        assert!(matches!(refused, Err(StoreError::Parts { .. })), "{refused:?}");
    }
}

#[test]
fn damage_of_every_sort_is_an_error_and_a_new_put_heals_it() {
    let (_folder, store) = store();
    let object = chunk(1, 40);
    let digest = put(&store, &object);
    let path = object_path(&store, &digest);
    let whole = fs::read(&path).unwrap();
    let damages: [&dyn Fn(); 7] = [
        &|| flip(&path, 3),
        &|| flip(&path, 511),
        &|| flip(&path, 530),
        &|| flip(&path, whole.len() - 1),
        &|| fs::write(&path, &whole[..whole.len() / 2]).unwrap(),
        &|| fs::write(&path, []).unwrap(),
        &|| {
            fs::remove_file(&path).unwrap();
            fs::create_dir(&path).unwrap();
        },
    ];
    for (i, damage) in damages.iter().enumerate() {
        damage();
        let store = Store::open(store.root()).unwrap();
        let error = store.artifact(&digest).err().unwrap();
        assert!(matches!(error, StoreError::Damaged { .. }), "{i}: {error}");
        assert_eq!(put(&store, &object), digest);
        assert_eq!(store.artifact(&digest).unwrap().object().unwrap(), object, "{i}");
    }
    assert_eq!(
        fs::read_dir(store.root().join("quarantine")).unwrap().count(),
        damages.len()
    );
    fs::remove_file(&path).unwrap();
    assert!(matches!(store.artifact(&digest), Err(StoreError::Missing { .. })));
}

#[test]
fn a_file_under_the_name_of_another_artifact_is_damage() {
    let (_folder, store) = store();
    let (one, two) = (put(&store, &chunk(1, 1)), put(&store, &chunk(2, 1)));
    fs::copy(object_path(&store, &one), object_path(&store, &two)).unwrap();
    assert!(store.artifact(&two).err().unwrap().is_damage());
}

#[test]
fn only_a_store_of_this_version_or_an_empty_folder_is_opened() {
    let (folder, store) = store();
    fs::write(store.root().join("format"), "deaflow-store 3\n").unwrap();
    let error = Store::open(store.root()).err().unwrap();
    assert!(error.to_string().contains("deaflow-store 3"), "{error}");
    fs::write(folder.path().join("thesis.tex"), "").unwrap();
    assert!(matches!(Store::open(folder.path()), Err(StoreError::NotAStore { .. })));
    let error = Store::open(&folder.path().join("thesis.tex/store")).err().unwrap();
    assert!(error.to_string().starts_with("cannot "), "{error}");
}

#[test]
fn leftovers_are_cleared_once_nobody_is_at_work() {
    let (_folder, store) = store();
    let (leftover, mine) = (store.root().join("tmp/.tmpDead01"), store.root().join("tmp/mine"));
    fs::create_dir(&leftover).unwrap();
    fs::create_dir(&mine).unwrap();
    fs::write(leftover.join("artifact.h5"), "half").unwrap();
    let second = Store::open(store.root()).unwrap();
    assert!(leftover.exists(), "the first may still be writing it");
    let root = store.root().to_owned();
    drop((store, second));
    Store::open(&root).unwrap();
    assert!(!leftover.exists());
    assert!(mine.exists(), "it is not named as we name things");
}

#[test]
fn looking_for_a_store_makes_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("typo");
    assert!(matches!(Store::open_existing(&path), Err(StoreError::NoStore { .. })));
    assert!(!path.exists());
    drop(Store::open(&path).unwrap());
    assert!(Store::open_existing(&path).is_ok());
}

/// A record of an action that made `stored`.
fn record(name: &str, stored: Stored) -> Record {
    let action = Action {
        kind: "count".into(),
        recipe: 3,
        parameters: Canonical::map([("name", Canonical::from(name))]),
        inputs: vec![ArtifactId::of(b"input")],
    };
    Record {
        key: action.key().unwrap(),
        action,
        artifact: stored.digest,
        file_digest: stored.file_digest,
        size: stored.size,
        seconds: 0.25,
        unstable: 2,
        created: "2026-01-01T00:00:00.000Z".into(),
        version: "0".into(),
        target: "none".into(),
    }
}

fn record_path(store: &Store, key: &ActionKey) -> std::path::PathBuf {
    let name = key.to_string();
    store.root().join("records").join(&name[..2]).join(name)
}

#[test]
fn records_come_back_whole_or_not_at_all() {
    let (_folder, store) = store();
    let stored = store.put(&chunk(1, 1), &Provenance::default()).unwrap();
    let (one, two) = (record("one", stored), record("two", stored));
    assert!(matches!(store.record(&one.key).unwrap(), Lookup::Absent));
    store.put_record(&one).unwrap();
    assert_eq!(store.record(&one.key).unwrap().record(), Some(one.clone()));
    let path = record_path(&store, &one.key);
    let whole = fs::read(&path).unwrap();
    for at in 0..whole.len() {
        flip(&path, at);
        assert!(
            matches!(store.record(&one.key).unwrap(), Lookup::Damaged(_)),
            "byte {at}"
        );
        fs::write(&path, &whole).unwrap();
    }
    for length in 0..whole.len() {
        fs::write(&path, &whole[..length]).unwrap();
        assert!(
            matches!(store.record(&one.key).unwrap(), Lookup::Damaged(_)),
            "{length} bytes"
        );
    }
    // Whoever can write a file can write any key into it, but not an action that has it.
    let forged = Record {
        key: one.key,
        ..two.clone()
    };
    store.put_record(&forged).unwrap();
    assert!(matches!(store.record(&one.key).unwrap(), Lookup::Damaged(why) if why.contains("not the key")));
    store.put_record(&one).unwrap();
    store.put_record(&two).unwrap();
    fs::copy(record_path(&store, &two.key), &path).unwrap();
    assert!(
        matches!(store.record(&one.key).unwrap(), Lookup::Damaged(_)),
        "another's record"
    );
}

#[test]
fn fsck_finds_every_fault_and_names_it() {
    let (_folder, store) = store();
    let sound = store.put(&chunk(1, 1), &Provenance::default()).unwrap();
    let stored = store.put(&chunk(2, 1), &Provenance::default()).unwrap();
    let manifest = put(
        &store,
        &Object::manifest(Default::default(), vec![sound.digest, stored.digest]),
    );
    store.put_record(&record("sound", sound)).unwrap();
    store.put_record(&record("stored", stored)).unwrap();
    let report = store.fsck(&|done, total| assert!(done <= total)).unwrap();
    assert!(report.is_sound());
    assert_eq!((report.objects, report.records), (3, 2));

    flip(&object_path(&store, &stored.digest), 600);
    let run = "runs/2026-01-01T00-00-01.000Z-0123456789ab.json";
    fs::write(store.root().join(run), "{}").unwrap();
    fs::write(store.root().join("objects/notes.txt"), "").unwrap();
    let report = store.fsck(&|_, _| ()).unwrap();
    assert_eq!(report.damaged.len(), 2);
    assert_eq!(report.damaged[0].path, object_path(&store, &stored.digest));
    assert!(report.damaged[0].quarantined.as_ref().unwrap().exists());
    let wanted: Vec<&str> = report
        .missing
        .iter()
        .map(|absence| absence.needed_by.as_str())
        .collect();
    assert_eq!(report.missing[0].digest, stored.digest);
    assert!(
        wanted.contains(&format!("manifest {}", manifest.short()).as_str()),
        "{wanted:?}"
    );
    assert_eq!(wanted.len(), 2, "{wanted:?}");
    assert_eq!(report.strays, [store.root().join("objects/notes.txt")]);

    let provenance = Provenance {
        host: "elsewhere".into(),
        ..Provenance::default()
    };
    store.put(&chunk(2, 1), &provenance).unwrap();
    let report = store.fsck(&|_, _| ()).unwrap();
    assert!(report.is_sound());
    assert_eq!(report.rewritten, [stored.digest], "the record saw another file");
}

#[test]
fn a_repair_leaves_nothing_that_promises_what_is_gone() {
    let (_folder, store) = store();
    let sound = store.put(&chunk(1, 1), &Provenance::default()).unwrap();
    let lost = store.put(&chunk(2, 1), &Provenance::default()).unwrap();
    let manifest = Object::manifest(Default::default(), vec![sound.digest, lost.digest]).of_kind("count");
    let manifest = store.put(&manifest, &Provenance::default()).unwrap();
    for (name, stored) in [("sound", sound), ("lost", lost), ("manifest", manifest)] {
        store.put_record(&record(name, stored)).unwrap();
    }
    fs::remove_file(object_path(&store, &lost.digest)).unwrap();
    fs::write(store.root().join("objects/notes.txt"), "").unwrap();
    let report = store.repair(&|_, _| ()).unwrap();
    assert!(!report.is_sound(), "it was not");
    let record_path = |name| store.layout.record(&record(name, sound).key);
    let mut moved = report.repaired.clone();
    moved.sort();
    let mut expected = vec![
        object_path(&store, &manifest.digest),
        record_path("lost"),
        record_path("manifest"),
        store.root().join("objects/notes.txt"),
    ];
    expected.sort();
    assert_eq!(moved, expected);
    // Moved, and not lost.
    assert_eq!(fs::read_dir(store.root().join("quarantine")).unwrap().count(), 4);
    let after = store.fsck(&|_, _| ()).unwrap();
    assert!(after.is_sound() && after.strays.is_empty());
    assert_eq!((after.objects, after.records), (1, 1));
}

#[test]
fn a_seal_that_was_forged_does_not_deceive_fsck() {
    let (_folder, store) = store();
    let (one, two) = (put(&store, &chunk(1, 1)), put(&store, &chunk(2, 1)));
    let path = object_path(&store, &one);
    fs::copy(object_path(&store, &two), &path).unwrap();
    super::header::Header::write(&path, one).unwrap();
    assert!(
        Store::open(store.root()).unwrap().artifact(&one).is_ok(),
        "the header fits the file"
    );
    let report = store.fsck(&|_, _| ()).unwrap();
    assert!(report.damaged[0].reason.contains(&two.short()), "{:?}", report.damaged);
}

fn run_at(second: u32, pipeline: &str, stage: &str, artifact: &str) -> Run {
    Run {
        pipeline: pipeline.into(),
        path: format!("{pipeline}.yaml"),
        created: format!("2026-01-01T00:00:{second:02}.000Z"),
        stages: vec![RunStage {
            name: stage.into(),
            kind: "count".into(),
            key: ActionKey::of(b"key"),
            artifact: ArtifactId::of(artifact.as_bytes()),
            outcome: StageOutcome::Reused,
            from_scene: Vec::new(),
        }],
        ..Run::default()
    }
}

#[test]
fn every_run_is_remembered_but_the_last_of_a_pipeline_said_again() {
    let (_folder, store) = store();
    let created = || {
        let runs = store.runs().unwrap();
        runs.map(|run| run.unwrap().created[17..19].to_owned())
            .collect::<Vec<_>>()
    };
    for (second, pipeline, artifact) in [
        (1, "p", "a"),
        (2, "q", "b"),
        (3, "p", "a"),
        (4, "p", "c"),
        (5, "p", "a"),
    ] {
        store.put_run(&run_at(second, pipeline, "s", artifact)).unwrap();
    }
    // The third says what the first did, with another pipeline's between them; the fifth is a return to it.
    assert_eq!(created(), ["05", "04", "02", "01"]);
    // What was built again, or failed again, is news.
    let mut built = run_at(7, "p", "s", "a");
    assert!(!store.is_new_run(&built).unwrap());
    built.stages[0].outcome = StageOutcome::Built;
    assert!(store.is_new_run(&built).unwrap());
    let failed = Run {
        failures: vec!["t".into()],
        ..run_at(8, "p", "s", "a")
    };
    assert!(store.is_new_run(&failed).unwrap());
    let stopped = Run {
        stopped: vec!["t".into()],
        ..run_at(8, "p", "s", "a")
    };
    assert!(store.is_new_run(&stopped).unwrap());
    let overridden = Run {
        overrides: [("stages.s.count".to_owned(), "4".to_owned())].into(),
        ..run_at(6, "p", "s", "a")
    };
    assert!(store.is_new_run(&overridden).unwrap());
    store.put_run(&overridden).unwrap();
    let last = store.runs().unwrap().next().unwrap().unwrap();
    assert_eq!(last.id.len(), 12);
    assert_eq!(
        Run {
            id: String::new(),
            ..last
        },
        overridden
    );
}

#[test]
fn a_run_without_what_later_versions_say_can_be_read() {
    let (_folder, store) = store();
    let digest = "0".repeat(64);
    let text = format!(
        r#"{{ "pipeline": "p", "path": "/p.yaml", "created": "2026-01-01T00:00:01.000Z",
             "stages": [{{ "name": "s", "kind": "count", "key": "{digest}", "artifact": "{digest}" }}] }}"#
    );
    fs::write(
        store.layout.runs().join("2026-01-01T00-00-01.000Z-0123456789ab.json"),
        text,
    )
    .unwrap();
    let run = store.runs().unwrap().next().unwrap().unwrap();
    assert_eq!(
        (run.id.as_str(), run.command, run.stages[0].outcome),
        ("0123456789ab", Command::Run, StageOutcome::Reused)
    );
    assert!(run.results.is_empty() && run.overrides.is_empty());
}

#[test]
fn of_ten_thousand_runs_the_oldest_are_forgotten() {
    let (_folder, store) = store();
    for number in 0..10_004 {
        let name = format!("2026-01-01T00-00-00.000Z.{number:06}-0123456789ab.json");
        fs::write(store.layout.runs().join(name), "{}").unwrap();
    }
    store.put_run(&run_at(1, "p", "s", "a")).unwrap();
    let files = store.run_files().unwrap();
    assert_eq!(files.len(), 10_000);
    let oldest = files.last().unwrap().file_name().unwrap().to_str().unwrap().to_owned();
    assert!(oldest.starts_with("2026-01-01T00-00-00.000Z.000005"), "{oldest}");
    assert_eq!(store.runs().unwrap().next().unwrap().unwrap().pipeline, "p");
}

#[test]
fn a_stage_is_found_by_its_name_in_the_last_run_that_had_it() {
    let (_folder, store) = store();
    for run in [
        run_at(1, "p", "s", "old"),
        run_at(2, "q", "s", "new"),
        run_at(3, "q", "t", "other"),
    ] {
        store.put_run(&run).unwrap();
    }
    let made = |pipeline| store.last_made("s", pipeline).unwrap().map(|stage| stage.artifact);
    assert_eq!(made(None), Some(ArtifactId::of(b"new")));
    assert_eq!(made(Some("p")), Some(ArtifactId::of(b"old")));
    assert_eq!(made(Some("p.yaml")), Some(ArtifactId::of(b"old")));
    assert_eq!(made(Some("r")), None);
}

#[test]
fn artifacts_are_found_by_the_beginning_of_their_digest() {
    let (_folder, store) = store();
    let digest = put(&store, &chunk(1, 1));
    put(&store, &chunk(2, 1));
    assert_eq!(store.find(&digest.short()).unwrap(), [digest]);
    assert_eq!(store.find("").unwrap().len(), 2);
    assert_eq!(store.find("xyz").unwrap(), []);
}

#[test]
fn equal_content_put_at_once_is_one_file() {
    let (_folder, store) = store();
    let stored: Vec<Stored> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..8)
            .map(|i| {
                let store = store.clone();
                let provenance = Provenance {
                    host: format!("host {i}"),
                    ..Provenance::default()
                };
                scope.spawn(move || store.put(&chunk(1, 20), &provenance).unwrap())
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(stored.iter().all(|one| *one == stored[0]), "{stored:?}");
}

#[test]
fn a_store_is_collected_alone() {
    let (_folder, store) = store();
    let root = store.root().to_owned();
    assert!(matches!(Store::open_exclusive(&root), Err(StoreError::Busy { .. })));
    let aside = Store::open_unlocked(&root).unwrap();
    drop(store);
    let alone = Store::open_exclusive(&root).unwrap();
    assert!(aside.runs().is_ok(), "who looks on is in nobody's way");
    drop(alone);
    assert!(Store::open_existing(&root).is_ok());
}

fn everything_old() -> Retention {
    Retention {
        runs: 0,
        grace: std::time::Duration::ZERO,
        free: None,
    }
}

fn pinned(store: &Store, digest: ArtifactId) {
    let (label, created) = (String::new(), String::new());
    let result_only = false;
    store
        .pin(&Pin {
            digest,
            label,
            created,
            result_only,
        })
        .unwrap();
}

/// Puts a run of a pipeline with one artifact into the history; returns the artifact.
fn ran(store: &Store, second: u8, pipeline: (&str, &std::path::Path), command: Command) -> ArtifactId {
    ran_until(store, second, pipeline, command, &[])
}

/// The same of a run in which some stages were stopped.
fn ran_until(
    store: &Store,
    second: u8,
    (name, file): (&str, &std::path::Path),
    command: Command,
    stopped: &[&str],
) -> ArtifactId {
    let artifact = put(store, &chunk(second, 1));
    let stage = RunStage {
        name: "s".into(),
        kind: "k".into(),
        key: ActionKey::of(&[second]),
        artifact,
        outcome: StageOutcome::Built,
        from_scene: Vec::new(),
    };
    let run = Run {
        pipeline: name.into(),
        path: file.display().to_string(),
        created: format!("2026-01-01T00:00:{second:02}.000Z"),
        command,
        stages: vec![stage],
        stopped: stopped.iter().map(|name| (*name).to_owned()).collect(),
        ..Run::default()
    };
    store.put_run(&run).unwrap();
    artifact
}

#[test]
fn runs_that_were_stopped_are_kept_and_not_counted() {
    let (folder, store) = store();
    let file = folder.path().join("p.yaml");
    std::fs::write(&file, "").unwrap();
    let run = |second: u8, stopped: &[&str]| ran_until(&store, second, ("p", &file), Command::Run, stopped);
    let [oldest, complete] = [1, 2].map(|second| run(second, &[]));
    let stopped = run(3, &["t"]);
    assert_eq!(removed_by(&store, 2, None).0, []);
    assert_eq!(removed_by(&store, 1, None).0, [oldest]);
    let (all, _) = removed_by(&store, 0, None);
    assert_eq!(all.len(), 3);
    // However much is to be freed, the last run and the last complete one stay.
    let (freed, _) = removed_by(&store, 2, Some(u64::MAX));
    assert_eq!(freed, [oldest]);
    assert!(!freed.contains(&complete) && !freed.contains(&stopped));
}

fn removed_by(store: &Store, runs: usize, free: Option<u64>) -> (Vec<ArtifactId>, Vec<std::path::PathBuf>) {
    let grace = std::time::Duration::ZERO;
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    let plan = store.plan_gc(&Retention { runs, grace, free }, later).unwrap();
    (
        plan.removed.iter().map(|artifact| artifact.digest).collect(),
        plan.last_runs,
    )
}

#[test]
fn runs_of_each_pipeline_are_counted_apart() {
    let (folder, store) = store();
    let file = |name: &str| folder.path().join(name);
    for name in ["a.yaml", "b.yaml"] {
        fs::write(file(name), "").unwrap();
    }
    let (a, b, gone) = (file("a.yaml"), file("b.yaml"), file("gone.yaml"));
    let other = ran(&store, 1, ("a", &b), Command::Run);
    let lost = ran(&store, 2, ("lost", &gone), Command::Run);
    let audit = ran(&store, 3, ("a", &a), Command::Audit);
    let sweep = ran(&store, 4, ("a", &a), Command::Sweep);
    let own: Vec<ArtifactId> = (5..17)
        .map(|second| ran(&store, second, ("a", &a), Command::Run))
        .collect();
    // Ten of the twelve stay, and the last of every other.
    let sorted = |artifacts: &[ArtifactId]| artifacts.iter().copied().collect::<std::collections::BTreeSet<_>>();
    let (removed, last_runs) = removed_by(&store, 10, None);
    assert_eq!((sorted(&removed), last_runs), (sorted(&own[..2]), vec![]));
    let (removed, last_runs) = removed_by(&store, 1, None);
    assert_eq!((sorted(&removed), last_runs), (sorted(&own[..11]), vec![]));
    let (removed, last_runs) = removed_by(&store, 0, None);
    assert_eq!(removed.len(), 16);
    let whole = |path: &std::path::Path| fs::canonicalize(path).unwrap();
    assert_eq!(last_runs, [whole(&a), whole(&b)], "files that exist");

    // The oldest runs give way, but not the last of a file.
    let size = fs::metadata(object_path(&store, &own[0])).unwrap().len();
    let freed = |count: u64| sorted(&removed_by(&store, 10, Some(count * size - size / 2)).0);
    assert_eq!(freed(1), sorted(&own[..2]), "nothing needs them");
    assert_eq!(freed(3), sorted(&[&own[..2], &[lost]].concat()));
    assert_eq!(freed(4), sorted(&[&own[..2], &[lost, audit]].concat()));
    assert_eq!(freed(6), sorted(&[&own[..3], &[lost, audit, sweep]].concat()));
    let all = [&own[..11], &[lost, audit, sweep]].concat();
    assert_eq!(freed(100), sorted(&all));
    assert!(!all.contains(&other));
    pinned(&store, lost);
    assert!(!freed(100).contains(&lost));
}

#[test]
fn a_collection_removes_artifacts_whose_list_cannot_be_written() {
    let (_folder, store) = store();
    let digest = put(&store, &chunk(1, 1));
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    let collection = store.plan_gc(&everything_old(), later).unwrap();
    // A folder in its place stands for a full disk.
    fs::create_dir(store.root().join("removed.jsonl")).unwrap();
    let why = store.remove(&collection, "", &|_, _| ()).unwrap().unwrap();
    assert!(why.to_string().contains("removed.jsonl"), "{why}");
    assert!(!object_path(&store, &digest).exists());
    fs::remove_dir(store.root().join("removed.jsonl")).unwrap();
    assert!(store.removed().is_empty());
}

#[test]
fn a_copy_beside_an_artifact_does_not_take_its_place() {
    let (_folder, store) = store();
    let digest = put(&store, &chunk(1, 1));
    pinned(&store, digest);
    let path = object_path(&store, &digest);
    let copies = ["h5~", "bak"].map(|extension| path.with_extension(extension));
    for copy in &copies {
        fs::copy(&path, copy).unwrap();
    }
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    let collection = store.plan_gc(&everything_old(), later).unwrap();
    assert_eq!((collection.kept.len(), collection.removed.len()), (1, 0));
    let report = store.repair(&|_, _| ()).unwrap();
    assert_eq!(report.repaired.len(), 2);
    assert!(store.artifact(&digest).is_ok());
}

#[test]
fn a_collection_does_not_guess_what_a_pin_needs() {
    let (_folder, store) = store();
    let (one, two) = (put(&store, &chunk(1, 1)), put(&store, &chunk(2, 1)));
    let manifest = put(&store, &Object::manifest(Default::default(), vec![one, two]));
    pinned(&store, manifest);
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    assert_eq!(store.plan_gc(&everything_old(), later).unwrap().kept.len(), 3);
    for lost in [one, manifest] {
        let (path, aside) = (object_path(&store, &lost), store.root().join("aside"));
        fs::rename(&path, &aside).unwrap();
        let error = store.plan_gc(&everything_old(), later).unwrap_err();
        assert!(error.to_string().contains(&lost.short()), "{error}");
        fs::rename(&aside, &path).unwrap();
    }
    // A folder of pins that is something else may hide pins.
    fs::rename(store.root().join("pins"), store.root().join("elsewhere")).unwrap();
    fs::write(store.root().join("pins"), "").unwrap();
    assert!(store.plan_gc(&everything_old(), later).is_err());
}

#[test]
fn what_an_artifact_was_made_from_stays_although_its_record_is_lost() {
    let (_folder, store) = store();
    let input = put(&store, &chunk(1, 1));
    let provenance = Provenance {
        inputs: vec![input],
        ..Provenance::default()
    };
    let made = store.put(&chunk(2, 1), &provenance).unwrap().digest;
    pinned(&store, made);
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    assert_eq!(store.plan_gc(&everything_old(), later).unwrap().kept.len(), 2);
}

#[test]
fn a_file_that_another_has_locked_is_read_all_the_same() {
    let (_folder, store) = store();
    let digest = put(&store, &chunk(1, 1));
    let held = fs::File::open(object_path(&store, &digest)).unwrap();
    held.lock().unwrap();
    assert!(store.fsck(&|_, _| ()).unwrap().is_sound());
    assert_eq!(store.artifact(&digest).unwrap().u8s("patterns").unwrap().1, [1, 2]);
}

#[test]
fn what_lies_among_pins_and_lock_files_and_is_none_is_moved_aside() {
    let (_folder, store) = store();
    pinned(&store, put(&store, &chunk(1, 1)));
    fs::write(store.root().join("pins/.hidden"), "").unwrap();
    assert_eq!(store.pins().unwrap().len(), 1);
    fs::write(store.root().join("pins/notes"), "").unwrap();
    assert_eq!(store.pins().unwrap().len(), 1);
    assert_eq!(
        store.fsck(&|_, _| ()).unwrap().strays,
        [store.root().join("pins/notes")]
    );
    store.repair(&|_, _| ()).unwrap();
    assert_eq!(store.pins().unwrap().len(), 1);
}

#[test]
fn axes_have_scales_that_are_no_datasets_of_the_artifact() {
    let (_folder, store) = store();
    let chunks = [chunk(0, 2), chunk(4, 1)];
    let parts = chunks.iter().map(|c| put(&store, c)).collect();
    let manifest = put(&store, &Object::manifest(Default::default(), parts));
    for (digest, length) in [(put(&store, &chunks[0]), 2), (manifest, 3)] {
        // HDF5 opens no file twice in one process, once with locks and once without.
        {
            let file = hdf5::File::open(object_path(&store, &digest)).unwrap();
            assert_eq!(file.dataset("sample").unwrap().shape(), [length]);
            assert_eq!(file.dataset("x").unwrap().shape(), [2]);
            let named = file.dataset("patterns").unwrap().attr("_Netcdf4Coordinates").unwrap();
            let numbers = ["sample", "x"].map(|axis| {
                let number = file.dataset(axis).unwrap().attr("_Netcdf4Dimid").unwrap();
                number.read_scalar::<i32>().unwrap()
            });
            assert_eq!(named.read_raw::<i32>().unwrap(), numbers);
            assert_ne!(numbers[0], numbers[1]);
        }
        let artifact = store.artifact(&digest).unwrap();
        let contents = artifact.contents().unwrap();
        assert!(
            contents
                .iter()
                .all(|content| !["sample", "x"].contains(&content.path.as_str()))
        );
        assert_eq!(artifact.read("patterns").unwrap().axes, ["sample", "x"]);
    }
    assert!(store.fsck(&|_, _| ()).unwrap().is_sound());
    // Its chunks are elsewhere: what it shows must not look like data.
    let alone = store.root().join("alone.h5");
    fs::copy(object_path(&store, &manifest), &alone).unwrap();
    let file = hdf5::File::open(&alone).unwrap();
    let reals = file.dataset("deep/er/field").unwrap().read_raw::<f64>().unwrap();
    assert!(reals.len() == 6 && reals.iter().all(|x| x.is_nan()));
    assert_eq!(file.dataset("patterns").unwrap().read_raw::<u8>().unwrap(), [255; 6]);
}

#[test]
fn attributes_of_any_length_come_back_and_nothing_stands_in_the_global_heap() {
    let (_folder, store) = store();
    let mut object = Object::default().of_kind("sample").with(
        "a/b",
        Dataset::new("", "", &[1, 2], Data::F64(vec![1.0, 2.0])).with_axes(&["row", "é and more"]),
    );
    for length in [0_usize, 1, 64, 65, 1024, 1025, 60_000, 60_001, 1 << 20] {
        object = object.attribute(
            &format!("of {length}"),
            "é".repeat(length / 2) + &"x".repeat(length % 2),
        );
    }
    let provenance = Provenance {
        parameters: "p".repeat(100_000),
        ..Provenance::default()
    };
    let stored = store.put(&object, &provenance).unwrap();
    let artifact = Artifact::load(
        Access::Here,
        store.layout.object(&stored.digest),
        stored.digest,
        Arc::default(),
    )
    .unwrap();
    assert_eq!(artifact.object().unwrap(), object);
    assert_eq!(artifact.provenance().unwrap()["parameters"].len(), 100_000);
    let bytes = fs::read(artifact.path()).unwrap();
    assert!(!bytes.windows(4).any(|window| window == b"GCOL"));
}
