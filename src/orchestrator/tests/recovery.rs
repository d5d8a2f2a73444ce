//! Failures, kills and damage: nothing finished is lost, and what is rebuilt is the same.

use std::fs;
use std::sync::atomic::Ordering;

use super::*;

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
    assert_eq!(outcome.stages.len(), 1);
    assert_eq!(outcome.stages[0].outcome, Outcome::Failed);
    assert_eq!(outcome.failures[0].error.to_string(), "chunk 3 was told to fail");
    lab.count.fails.store(u64::MAX, Ordering::SeqCst);
    let log = lab.run(&[]);
    assert_eq!(
        log[..3],
        [
            "start small (5): no record",
            "chunk small 3",
            "built small built 1+3: no record"
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
    let key = store.runs().unwrap()[0].stage("total").unwrap().key.to_string();
    let record = store.root().join("records").join(&key[..2]).join(&key);
    let whole = fs::read(&record).unwrap();
    for broken in [&whole[..whole.len() - 5], &whole[..10], &[]] {
        fs::write(&record, broken).unwrap();
        assert_eq!(lab.plan(&[])[3], "total stale 1+0: no record");
        assert_eq!(lab.digests(&[]), before);
    }
    fs::write(&record, &whole[1..]).unwrap();
    let report = store.fsck(&|_, _| ()).unwrap();
    assert_eq!(report.damaged.len(), 1);
    assert_eq!(report.damaged[0].path, record);
    assert!(!record.exists());
}

#[test]
fn a_large_input_is_verified_before_it_is_read() {
    let lab = Laboratory::new();
    let pipeline = "
version: 1
name: toy
stages:
  small: { kind: count, count: 5 }
  big: { kind: sum, needs: [small], padding: 20000000 }
  last: { kind: sum, needs: [big] }
";
    let (outcome, _) = lab.run_text(pipeline, &[]);
    let path = lab.object(&outcome.stages[1].digest.unwrap());
    // The disk has lost a bit, and nothing tells: the time is that of the writing.
    let written = fs::metadata(&path).unwrap().modified().unwrap();
    flip(&path);
    fs::File::options()
        .write(true)
        .open(&path)
        .unwrap()
        .set_modified(written)
        .unwrap();
    let (_, log) = lab.run_text(pipeline, &[]);
    assert_eq!(
        log,
        ["reused small", "reused big", "reused last"],
        "too large to digest for good measure"
    );
    let (outcome, log) = lab.run_text(pipeline, &["stages.last.power=2"]);
    assert_eq!(log[1], "start big (1): artifact damaged");
    assert!(outcome.failures.is_empty());
    flip(&path);
    let (_, log) = lab.run_text(pipeline, &["stages.last.power=2"]);
    assert_eq!(
        log[1], "start big (1): artifact damaged",
        "written after its record: suspicious"
    );
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
