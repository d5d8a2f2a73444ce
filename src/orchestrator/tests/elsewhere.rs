//! A store behind the store: what it has is taken, what it only promises is built, and nothing is brought that nobody
//! reads.

use std::collections::BTreeSet;
use std::fs;
use std::sync::Arc;

use super::*;
use deaflow_store::{Record, StoreError, Upstream, UpstreamArtifact};

/// The store of another laboratory, which no longer has all that it says.
struct Other {
    store: Store,
    lost: bool,
    brought: Mutex<BTreeSet<ArtifactId>>,
    rejected: Mutex<BTreeSet<ArtifactId>>,
}

impl Upstream for Other {
    fn record(&self, key: &ActionKey) -> Option<Record> {
        self.store.record(key).unwrap().record()
    }

    fn records_of(&self, artifact: &ArtifactId) -> Vec<(Record, String)> {
        let held = self.store.stored_artifacts(None).unwrap();
        let of = held.into_iter().find(|held| held.artifact == *artifact);
        let records = of.map_or_else(Vec::new, |held| held.records);
        records.into_iter().map(|record| (record, "other".to_owned())).collect()
    }

    fn is_trusted(&self, _: &Record, origin: &str) -> bool {
        assert_eq!(origin, "other");
        true
    }

    fn compare(&self, _: &Record) {}

    fn find_artifact(&self, artifact: &ArtifactId) -> Option<UpstreamArtifact> {
        if self.rejected.lock().unwrap().contains(artifact) {
            return None;
        }
        let parts = self.store.parts(artifact).ok()?;
        Some(UpstreamArtifact {
            size: 1,
            parts: Some(parts),
        })
    }

    fn download(&self, artifact: &ArtifactId, target: &Path) -> Result<bool, StoreError> {
        if self.lost {
            self.rejected.lock().unwrap().insert(*artifact);
            return Ok(false);
        }
        let (path, _, _) = self.store.file_of(artifact).unwrap();
        fs::copy(path, target).unwrap();
        Ok(true)
    }

    fn accept(&self, artifact: &ArtifactId, _: u64) {
        self.brought.lock().unwrap().insert(*artifact);
    }

    fn reject(&self, artifact: &ArtifactId, why: &str) {
        panic!("{}: {why}", artifact.short());
    }
}

/// Runs in a new laboratory with the store of another behind its own; says what ran, and how many artifacts were
/// brought.
fn run_behind(
    other: &Laboratory,
    lost: bool,
    parallel_stages: usize,
    sets: &[&str],
) -> (RunOutcome, Vec<String>, usize) {
    let upstream = Arc::new(Other {
        store: other.store(),
        lost,
        brought: Mutex::default(),
        rejected: Mutex::default(),
    });
    let lab = Laboratory::new();
    let store = lab.store().with_upstream(upstream.clone());
    let log = Mutex::new(Vec::new());
    let listener = |event: &Event| log.lock().unwrap().extend(line(event));
    let pipeline = lab.pipeline(PIPELINE, sets);
    let options = RunOptions {
        parallel_stages,
        ..RunOptions::default()
    };
    let outcome = run(&pipeline, &store, &options, &environment(), &listener).unwrap();
    let mut log = log.into_inner().unwrap();
    sort_chunks(&mut log);
    assert!(lab.store().fsck(&|_, _| ()).unwrap().is_sound());
    let brought = upstream.brought.lock().unwrap().len();
    (outcome, log, brought)
}

fn digests(outcome: &RunOutcome) -> Vec<Option<ArtifactId>> {
    outcome.stages.iter().map(|stage| stage.digest).collect()
}

#[test]
fn where_all_is_elsewhere_nothing_is_brought() {
    let other = Laboratory::new();
    let made = other.run_text(PIPELINE, &[]).0;
    let (outcome, log, brought) = run_behind(&other, false, 1, &[]);
    assert_eq!(log, ["reused small", "reused large", "reused halved", "reused total"]);
    assert_eq!((digests(&outcome), brought), (digests(&made), 0));
    assert_eq!(outcome.unstable, made.unstable);
    // What is lost there is not missed either.
    let (outcome, _, _) = run_behind(&other, true, 1, &[]);
    assert_eq!(digests(&outcome), digests(&made));
}

#[test]
fn what_is_read_is_brought_and_no_more() {
    let other = Laboratory::new();
    other.run(&[]);
    let sets = ["stages.total.power=2"];
    let (outcome, log, brought) = run_behind(&other, false, 1, &sets);
    assert_eq!(log[..3], ["reused small", "reused large", "reused halved"]);
    assert!(
        log[3].starts_with("start total") && log[4].starts_with("built total"),
        "{log:?}"
    );
    // The manifest of `halved`, and its six chunks.
    assert_eq!(brought, 7);
    assert_eq!(digests(&outcome), Laboratory::new().digests(&sets));
}

#[test]
fn chunks_that_are_elsewhere_are_brought_and_the_others_built() {
    let other = Laboratory::new();
    other.run(&[]);
    let sets = ["stages.small.count=45"];
    let (outcome, log, _) = run_behind(&other, false, 1, &sets);
    let chunks: Vec<&String> = log.iter().filter(|line| line.starts_with("chunk")).collect();
    assert_eq!(
        chunks,
        ["chunk small 3", "chunk small 4", "chunk halved 3", "chunk halved 4"]
    );
    assert_eq!(digests(&outcome), Laboratory::new().digests(&sets));
}

#[test]
fn what_is_promised_and_cannot_be_had_is_built_with_all_that_it_needs() {
    let other = Laboratory::new();
    other.run(&[]);
    let sets = ["stages.total.power=2"];
    for parallel_stages in [1, 3] {
        let untroubled = Laboratory::new().run_text(PIPELINE, &sets).0;
        let (outcome, log, brought) = run_behind(&other, true, parallel_stages, &sets);
        assert!(
            outcome.failures.is_empty(),
            "{parallel_stages}: {:?} {log:?}",
            outcome.failures
        );
        assert_eq!((digests(&outcome), brought), (digests(&untroubled), 0));
        assert_eq!(outcome.unstable, untroubled.unstable);
        let outcomes: Vec<Outcome> = outcome.stages.iter().map(|stage| stage.outcome).collect();
        assert_eq!(outcomes, [Outcome::Built; 4]);
    }
}
