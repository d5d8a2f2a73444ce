//! Going on after a failure, being held to a lock file, and foretelling what a run takes.

use std::sync::atomic::Ordering;

use super::*;
use deaflow_base::ArtifactId;
use deaflow_store::LockFile;

/// `one` has a chunk that can be told to fail, `two` has not; `sum` needs `one`, `other` needs `two`.
const FORKED: &str = "
version: 1
name: forked
stages:
  one: { kind: count, count: 35 }
  two: { kind: count, count: 10, offset: 5 }
  sum: { kind: sum, needs: [one] }
  squared: { kind: sum, needs: [sum], power: 2 }
  other: { kind: sum, needs: [two] }
";

#[test]
fn a_run_that_keeps_going_builds_all_that_does_not_need_the_failure() {
    let lab = Laboratory::new();
    lab.count.fails.store(2, Ordering::SeqCst);
    let options = RunOptions {
        keep_going: true,
        ..RunOptions::default()
    };
    let (outcome, log) = lab.run_with(FORKED, &[], &options);
    let outcome = outcome.unwrap();
    assert_eq!(
        log,
        [
            "start one (35): not built yet",
            "chunk one 0",
            "chunk one 1",
            "chunk one 3",
            "failed one",
            "start two (10): not built yet",
            "chunk two 0",
            "built two built 1+0: not built yet",
            "skipped sum skipped 0+0: needs `one`, which failed or was not built",
            "skipped squared skipped 0+0: needs `sum`, which failed or was not built",
            "start other (1): not built yet",
            "built other built 1+0: not built yet",
        ]
    );
    assert_eq!(outcome.failures.len(), 1);
    assert_eq!(outcome.failures[0].stage, "one");
    // What was built under way is there for the next run, which knows why the rest is not.
    lab.count.fails.store(u64::MAX, Ordering::SeqCst);
    let (outcome, log) = lab.run_text(FORKED, &[]);
    assert!(outcome.failures.is_empty());
    assert_eq!(
        log[..3],
        [
            "start one (35): not built yet",
            "chunk one 2",
            "built one built 1+3: not built yet"
        ]
        .map(|line| line.replace("(35)", "(10)"))
    );
    assert_eq!(log[3], "reused two");
    assert_eq!(log.last().unwrap(), "reused other");
}

#[test]
fn a_failed_run_lists_what_was_not_begun_because_of_the_failure() {
    let lab = Laboratory::new();
    lab.count.fails.store(2, Ordering::SeqCst);
    let (outcome, _) = lab.run_text(FORKED, &[]);
    let skipped = |stage: &StageReport| (stage.outcome == Outcome::Skipped).then(|| stage.missing.clone());
    let missing: Vec<(&str, Option<Option<String>>)> = outcome
        .stages
        .iter()
        .map(|stage| (stage.name.as_str(), skipped(stage)))
        .collect();
    let of_one = Some(Some("one".to_owned()));
    // `two` needs nothing that failed, and the run ended before it was begun.
    let expected = [
        ("one", None),
        ("two", Some(None)),
        ("sum", of_one.clone()),
        ("squared", of_one),
        ("other", Some(Some("two".to_owned()))),
    ];
    assert_eq!(missing, expected);
    let why = outcome.stages[1].why.as_deref().unwrap_or_default();
    assert!(why.contains("`one` failed"), "{why}");
    let run = lab.store().runs().unwrap().next().unwrap().unwrap();
    assert_eq!((run.stages.len(), run.failures.len()), (0, 1));
    assert_eq!(run.not_begun, ["two", "sum", "squared", "other"]);
}

fn locked<'a>(lock: &'a LockFile) -> RunOptions<'a> {
    RunOptions {
        lock: Some(lock),
        ..RunOptions::default()
    }
}

#[test]
fn a_pipeline_is_held_to_its_lock_file_before_any_work() {
    let lab = Laboratory::new();
    let (outcome, _) = lab.run_text(PIPELINE, &[]);
    let lock = outcome.lock;
    assert_eq!(lock.stages.len(), 4);
    // In the store that made it, and in an empty one.
    for lab in [&lab, &Laboratory::new()] {
        let (outcome, _) = lab.run_with(PIPELINE, &[], &locked(&lock));
        let outcome = outcome.unwrap();
        assert!(outcome.failures.is_empty());
        assert_eq!(outcome.lock, lock);
    }
    let error = |sets: &[&str]| {
        let (outcome, log) = lab.run_with(PIPELINE, sets, &locked(&lock));
        assert_eq!(log, [""; 0], "something ran before the difference was seen");
        outcome.unwrap_err().to_string()
    };
    let one = error(&["stages.halved.by=3"]);
    assert!(one.contains("`halved`") && one.contains("by from 2 to 3"), "{one}");
    let two = error(&["stages.small.count=36", "stages.total.power=2"]);
    assert!(
        two.contains("count from 35 to 36") && two.contains("power from 1 to 2"),
        "{two}"
    );
}

#[test]
fn stages_that_came_or_went_are_named() {
    let lab = Laboratory::new();
    let (outcome, _) = lab.run_text(PIPELINE, &[]);
    let mut lock = outcome.lock;
    let small = lock.stages.remove("small").unwrap();
    lock.stages.insert("tiny".into(), small);
    let (outcome, _) = lab.run_with(PIPELINE, &[], &locked(&lock));
    let Err(RunError::Locked(differences)) = outcome else {
        panic!("it was not refused");
    };
    assert_eq!(
        differences,
        [
            LockDifference::Dropped("tiny".into()),
            LockDifference::Added("small".into())
        ]
    );
}

#[test]
fn an_artifact_that_differs_from_the_lock_file_ends_the_run() {
    let lab = Laboratory::new();
    let (outcome, _) = lab.run_text(PIPELINE, &[]);
    let mut lock = outcome.lock;
    // Keys are those of the pipeline; only the last artifact is said to be another.
    lock.target = "another kind of processor".into();
    let total = lock.stages.get_mut("total").unwrap();
    total.artifact = ArtifactId::of(b"something else");
    for lab in [&lab, &Laboratory::new()] {
        let (outcome, log) = lab.run_with(PIPELINE, &[], &locked(&lock));
        assert_eq!(log.last().unwrap(), "failed total");
        let message = outcome.unwrap().failures[0].error.to_string();
        assert!(
            message.contains(&ArtifactId::of(b"something else").short()),
            "{message}"
        );
        assert!(message.contains("another kind of processor"), "{message}");
    }
}

#[test]
fn what_was_built_foretells_what_is_to_be_built() {
    let lab = Laboratory::new();
    assert!(lab.reports(&[]).iter().all(|stage| stage.price.is_none()));
    lab.run(&[]);
    assert!(
        lab.reports(&[]).iter().all(|stage| stage.price.is_none()),
        "nothing is to be built"
    );
    // Ten more of 35 numbers: one chunk of ten and one that is cut off otherwise, at the cost of each number.
    let plan = lab.reports(&["stages.small.count=45"]);
    let costs = lab.store().costs();
    let kinds: Vec<(&str, u64, u64)> = costs.iter().map(|c| (c.kind.as_str(), c.steps, c.chunks)).collect();
    assert_eq!(
        kinds,
        [("count", 35, 4), ("count", 20, 2), ("divide", 55, 6), ("sum", 1, 1)]
    );
    let (small, price) = (&costs[0], plan[0].price.unwrap());
    let threads = small.jobs.clamp(1, 4) as f64;
    let each = small.seconds * threads / 35.0;
    let expected = each * 15.0 / (small.jobs.min(2) as f64);
    assert!((price.seconds.likely - expected).abs() < 1e-9, "{price:?}, {expected}");
    assert!(price.seconds.low < price.seconds.likely && price.seconds.likely < price.seconds.high);
    assert_eq!(plan[1].price, None);
    // What comes after has a price too, although its inputs have yet to be built.
    assert!(plan[2].price.is_some() && plan[3].price.is_some());
    // The run says the same beside what it took.
    let (outcome, _) = lab.run_text(PIPELINE, &["stages.small.count=45"]);
    assert_eq!(outcome.stages[0].price, Some(price));
    assert_eq!(lab.store().costs().len(), 7);
}

#[test]
fn a_plan_names_every_reason() {
    let lab = Laboratory::new();
    lab.run(&[]);
    let plan = lab.reports(&["stages.small.count=36", "stages.small.offset=3", "stages.halved.by=3"]);
    assert_eq!(
        plan[0].reasons,
        [
            "parameter changed: count from 35 to 36",
            "parameter changed: offset from 0 to 3"
        ]
    );
    assert_eq!(
        plan[2].reasons,
        ["parameter changed: by from 2 to 3", "input changed: small"]
    );
    assert_eq!(plan[1].reasons, [""; 0]);
}
