//! Failures, kills and damage: nothing finished is lost, and what is rebuilt is the same.

use std::fs;
use std::sync::atomic::Ordering;

use super::*;
use deaflow_store::Record;

fn flip(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

/// File of chunk `chunk` of stage `stage`.
fn chunk_file(lab: &Laboratory, stage: usize, chunk: usize) -> PathBuf {
    let manifest = lab.store().artifact(&lab.digests(&[])[stage].unwrap()).unwrap();
    lab.object(&manifest.parts()[chunk])
}

#[test]
fn a_failed_run_keeps_finished_chunks() {
    let lab = Laboratory::new();
    let untroubled = Laboratory::new().digests(&[]);
    lab.count.fails.store(3, Ordering::SeqCst);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (outcome, log) = pool.install(|| lab.run_text(PIPELINE, &[]));
    assert_eq!(
        log[1..],
        ["chunk small 0", "chunk small 1", "chunk small 2", "failed small"]
    );
    assert_eq!(outcome.stages[0].outcome, Outcome::Failed);
    // What needs it was not begun, and is told of as such.
    let mut others = outcome.stages[1..].iter();
    assert!(others.all(|stage| stage.outcome == Outcome::Skipped));
    assert_eq!(outcome.failures[0].error.to_string(), "chunk 3 was told to fail");
    lab.count.fails.store(u64::MAX, Ordering::SeqCst);
    let log = lab.run(&[]);
    assert_eq!(
        log[..3],
        [
            "start small (5): not built yet",
            "chunk small 3",
            "built small built 1+3: not built yet"
        ]
    );
    assert_eq!(lab.digests(&[]), untroubled);
}

#[test]
fn stages_before_a_failure_stay_built() {
    let lab = Laboratory::new();
    let pipeline = "
version: 1
name: toy
stages:
  one: { kind: count, count: 5 }
  two: { kind: count, count: 45 }
";
    lab.count.fails.store(4, Ordering::SeqCst);
    let (_, log) = lab.run_text(pipeline, &[]);
    assert_eq!(log.last().unwrap(), "failed two");
    let (_, log) = lab.run_text(pipeline, &[]);
    assert_eq!(
        (log[0].as_str(), log.last().unwrap().as_str()),
        ("reused one", "failed two")
    );
}

#[test]
fn a_damaged_chunk_alone_is_rebuilt_to_the_same_digest() {
    let lab = Laboratory::new();
    let before = lab.digests(&[]);
    for (stage, chunk, name) in [(0, 2, "small"), (2, 5, "halved")] {
        flip(&chunk_file(&lab, stage, chunk));
        let mut plan = lab.plan(&[]);
        plan.retain(|line| line.contains("stale"));
        let total = [4, 2, 6][stage];
        assert_eq!(plan, [format!("{name} stale 1+{}: artifact damaged", total - 1)]);
        let mut log = lab.run(&[]);
        log.retain(|line| !line.starts_with("reused"));
        assert_eq!(log[1], format!("chunk {name} {chunk}"));
        assert_eq!(log.len(), 3, "{log:?}");
        assert_eq!(lab.digests(&[]), before);
    }
    assert_eq!(fs::read_dir(lab.store().root().join("quarantine")).unwrap().count(), 2);
    assert!(lab.store().fsck(&|_, _| ()).unwrap().is_sound());
}

#[test]
fn damaged_and_missing_artifacts_of_every_sort_are_rebuilt() {
    let lab = Laboratory::new();
    let before = lab.digests(&[]);
    let (manifest, whole) = (lab.object(&before[2].unwrap()), lab.object(&before[3].unwrap()));
    let chunk = chunk_file(&lab, 1, 0);
    let remove = |path: &Path| fs::remove_file(path).unwrap();
    let cases: [(&dyn Fn(), &str); 6] = [
        (&|| remove(&chunk), "large stale 1+1: artifact missing"),
        (&|| remove(&manifest), "halved stale 0+6: artifact missing"),
        (&|| flip(&manifest), "halved stale 0+6: artifact damaged"),
        (&|| remove(&whole), "total stale 1+0: artifact missing"),
        (&|| fs::write(&whole, []).unwrap(), "total stale 1+0: artifact damaged"),
        (
            &|| {
                remove(&whole);
                fs::create_dir(&whole).unwrap();
            },
            "total stale 1+0: artifact damaged",
        ),
    ];
    for (damage, expected) in cases {
        damage();
        let mut plan = lab.plan(&[]);
        plan.retain(|line| line.contains("stale"));
        assert_eq!(plan, [expected]);
        assert_eq!(lab.digests(&[]), before);
        assert!(lab.plan(&[]).iter().all(|line| line.contains("reused")));
    }
}

#[test]
fn a_damaged_record_is_no_record() {
    let lab = Laboratory::new();
    let before = lab.digests(&[]);
    let store = lab.store();
    let key = store
        .runs()
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .stage("total")
        .unwrap()
        .key
        .to_string();
    let record = store.root().join("records").join(&key[..2]).join(&key);
    let whole = fs::read(&record).unwrap();
    for broken in [&whole[..whole.len() - 5], &whole[..10], &[]] {
        fs::write(&record, broken).unwrap();
        assert_eq!(lab.plan(&[])[3], "total stale 1+0: not built yet");
        assert_eq!(lab.digests(&[]), before);
    }
    fs::write(&record, &whole[1..]).unwrap();
    let report = store.fsck(&|_, _| ()).unwrap();
    assert_eq!(report.damaged.len(), 1);
    assert_eq!(report.damaged[0].path, record);
    assert!(!record.exists());
}

/// Puts a file's modification time back after a flip.
fn flip_in_secret(path: &Path) {
    let written = fs::metadata(path).unwrap().modified().unwrap();
    flip(path);
    let file = fs::File::options().write(true).open(path).unwrap();
    file.set_modified(written).unwrap();
}

const BIG: &str = "
version: 1
name: toy
stages:
  small: { kind: count, count: 5 }
  big: { kind: sum, needs: [small], padding: 20000000 }
  last: { kind: sum, needs: [big] }
";

/// What was made, and a pipeline of which `total` is another action, with the record that this has elsewhere.
fn with_other_total(lab: &Laboratory) -> (Record, [&'static str; 1]) {
    let sets = ["stages.total.power=2"];
    lab.run(&[]);
    let donor = Laboratory::new();
    donor.run(&sets);
    let key = donor
        .store()
        .runs()
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .stage("total")
        .unwrap()
        .key;
    (donor.store().record(&key).unwrap().record().unwrap(), sets)
}

/// A record that must not be believed: nothing uses it, `fsck` names it, and the stage is built.
fn is_not_believed(lab: &Laboratory, forged: &Record, sets: &[&str], reason: &str, built: ArtifactId) {
    let put = || lab.store().put_record(forged).unwrap();
    put();
    let stale = "total stale 1+0: parameter changed: power from 1 to 2";
    assert_eq!(lab.plan(sets).last().unwrap(), stale);
    let explained = explain(&lab.pipeline(PIPELINE, sets), &lab.store(), "total").unwrap();
    assert_eq!((explained.reasons.len(), explained.report.digest), (1, None));
    let report = lab.store().fsck(&|_, _| ()).unwrap();
    assert_eq!(report.damaged.len(), 1, "{report:?}");
    assert!(report.damaged[0].reason.contains(reason), "{report:?}");
    assert!(report.damaged[0].path.ends_with(forged.key.to_string()));
    put();
    assert_eq!(lab.digests(sets).last().unwrap(), &Some(built));
    assert!(lab.store().fsck(&|_, _| ()).unwrap().is_sound());
}

#[test]
fn a_record_copied_under_another_key_is_not_believed() {
    let lab = Laboratory::new();
    let (sound, sets) = with_other_total(&lab);
    let key = lab
        .store()
        .runs()
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .stage("total")
        .unwrap()
        .key;
    let other = lab.store().record(&key).unwrap().record().unwrap();
    let forged = Record {
        key: sound.key,
        ..other
    };
    is_not_believed(&lab, &forged, &sets, "not the key of its action", sound.artifact);
}

#[test]
fn a_record_that_names_an_artifact_of_another_kind_is_not_believed() {
    let lab = Laboratory::new();
    let (sound, sets) = with_other_total(&lab);
    let other = lab
        .store()
        .runs()
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .stage("halved")
        .unwrap()
        .artifact;
    let forged = Record {
        artifact: other,
        ..sound.clone()
    };
    is_not_believed(&lab, &forged, &sets, "has kind `divide`", sound.artifact);
}

#[test]
fn even_a_rerun_finds_bytes_that_changed_in_secret() {
    let lab = Laboratory::new();
    let (before, _) = lab.run_text(BIG, &[]);
    flip_in_secret(&lab.object(&before.stages[1].digest.unwrap()));
    let (after, log) = lab.run_text(BIG, &[]);
    assert_eq!(log[1], "start big (1): artifact damaged");
    let digests = |outcome: &RunOutcome| outcome.stages.iter().map(|stage| stage.digest).collect::<Vec<_>>();
    assert_eq!(digests(&before), digests(&after));
    let (_, log) = lab.run_text(BIG, &[]);
    assert_eq!(log, ["reused small", "reused big", "reused last"]);
}

#[test]
fn an_input_is_verified_before_it_is_read_whatever_the_index_says() {
    let lab = Laboratory::new();
    let (outcome, _) = lab.run_text(BIG, &[]);
    let big = outcome.stages[1].digest.unwrap();
    let path = lab.object(&big);
    // The disk has lost a bit, and no time tells.
    flip(&path);
    lab.store().trust_current_file(&big);
    let (_, log) = lab.run_text(BIG, &[]);
    assert_eq!(
        log,
        ["reused small", "reused big", "reused last"],
        "a rerun reads nothing"
    );
    let (outcome, log) = lab.run_text(BIG, &["stages.last.power=2"]);
    assert_eq!(log[1], "start big (1): artifact damaged");
    assert!(outcome.failures.is_empty());

    flip(&path);
    lab.store().trust_current_file(&big);
    let closely = |store: Store| {
        plan(&lab.pipeline(BIG, &[]), &store, None, &environment())
            .unwrap()
            .remove(1)
    };
    assert_eq!(summary(&closely(lab.store())), "big reused 0+1");
    assert_eq!(
        summary(&closely(lab.store().without_index())),
        "big stale 1+0: artifact damaged"
    );
}

#[test]
fn of_a_thousand_chunks_only_those_that_are_not_there_are_built() {
    let lab = Laboratory::new();
    let with = |count: u32| format!("version: 1\nname: toy\nstages:\n  many: {{ kind: count, count: {count} }}\n");
    let chunks = |log: Vec<String>| -> Vec<String> {
        let chunks = log.iter().filter_map(|line| line.strip_prefix("chunk many "));
        chunks.map(str::to_owned).collect()
    };
    let (_, log) = lab.run_text(&with(9970), &[]);
    assert_eq!(chunks(log).len(), 997);
    let (outcome, log) = lab.run_text(&with(10_000), &[]);
    assert_eq!(chunks(log), ["997", "998", "999"]);
    let manifest = lab.store().artifact(&outcome.stages[0].digest.unwrap()).unwrap();
    flip(&lab.object(&manifest.parts()[7]));
    fs::remove_file(lab.object(&manifest.parts()[500])).unwrap();
    let (again, log) = lab.run_text(&with(10_000), &[]);
    assert_eq!(chunks(log), ["500", "7"]);
    assert_eq!(again.stages[0].digest, outcome.stages[0].digest);
}

#[test]
fn a_rerun_writes_nothing() {
    let lab = Laboratory::new();
    lab.run(&[]);
    let written = || {
        let root = lab.store().root().to_owned();
        let index = fs::metadata(root.join("index")).unwrap().modified().unwrap();
        let runs: Vec<_> = fs::read_dir(root.join("runs"))
            .unwrap()
            .map(|run| run.unwrap().path())
            .collect();
        (index, runs)
    };
    let before = written();
    lab.run(&[]);
    assert_eq!(written(), before);
}

#[test]
fn a_store_that_cannot_be_written_is_an_error_with_its_place() {
    let lab = Laboratory::new();
    let store = lab.store();
    fs::remove_dir(store.root().join("objects")).unwrap();
    fs::write(store.root().join("objects"), "").unwrap();
    let outcome = run(
        &lab.pipeline(PIPELINE, &[]),
        &store,
        &RunOptions::default(),
        &environment(),
        &|_| (),
    )
    .unwrap();
    let message = outcome.failures[0].error.to_string();
    assert!(message.contains("store/objects"), "{message}");
    assert_eq!(outcome.stages[0].outcome, Outcome::Failed);
}
