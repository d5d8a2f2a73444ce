//! Threads and processes: the same artifacts however many, and no work done twice.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::*;

#[test]
fn digests_do_not_depend_on_the_number_of_threads() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Laboratory::new().digests(&[]))
    };
    assert_eq!(with(1), with(4));
}

#[test]
fn two_runs_at_once_share_the_work() {
    two_share_the_work(&Laboratory::new());
}

#[test]
fn two_runs_share_the_work_by_claims_and_blocks_of_chunks() {
    let lab = Laboratory::new();
    std::fs::create_dir(lab.store().root().join("locks/processes")).unwrap();
    two_share_the_work(&lab);
}

fn two_share_the_work(lab: &Laboratory) {
    let text = PIPELINE
        .replace("count: 35", "count: 395")
        .replace("offset: 100", "offset: 500");
    let run = || {
        // A pool for each, as two processes would have.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        pool.install(|| lab.run_text(&text, &[]))
    };
    let ((one, log_one), (two, log_two)) = std::thread::scope(|scope| {
        let other = scope.spawn(run);
        (run(), other.join().unwrap())
    });
    let digests = |outcome: &RunOutcome| outcome.stages.iter().map(|stage| stage.digest).collect::<Vec<_>>();
    assert_eq!(digests(&one), digests(&two));
    let mut chunks: Vec<&String> = log_one
        .iter()
        .chain(&log_two)
        .filter(|line| line.starts_with("chunk"))
        .collect();
    chunks.sort();
    let built = chunks.len();
    chunks.dedup();
    assert_eq!(
        (built, chunks.len()),
        (40 + 2 + 42, 40 + 2 + 42),
        "each chunk is built once"
    );
}

#[test]
fn a_held_action_is_waited_for_and_then_found() {
    let lab = Laboratory::new();
    let donor = Laboratory::new();
    donor.run(&[]);
    let done = donor.store().runs().unwrap().next().unwrap().unwrap();
    let key = done.stage("total").unwrap().key;
    let store = lab.store();
    let guard = store.try_lock_action(&key).unwrap().unwrap();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| lab.run(&[]));
        while store.runs().unwrap().next().is_none() && !has_stage(&store, &done, "halved") {
            std::thread::sleep(Duration::from_millis(5));
        }
        // Another process finishes the action while the run waits for it.
        let record = donor.store().record(&key).unwrap().record().unwrap();
        let object = donor.store().artifact(&record.artifact).unwrap().object().unwrap();
        store.put(&object, &Default::default()).unwrap();
        store.put_record(&record).unwrap();
        drop(guard);
        assert_eq!(waiting.join().unwrap().last().unwrap(), "reused total");
    });
}

fn has_stage(store: &Store, done: &crate::store::Run, name: &str) -> bool {
    let key = done.stage(name).unwrap().key;
    store.record(&key).unwrap().record().is_some()
}

/// Runs with two stages at once; what is told of the chunks of a stage is held up until another has begun, or it is clear that none does.
fn run_abreast(lab: &Laboratory, options: &RunOptions<'_>, held: &str, awaited: &str) -> (RunOutcome, bool) {
    let (begun, met) = (AtomicBool::new(false), AtomicBool::new(false));
    let listener = |event: &Event| match event {
        Event::StageStarted { name, .. } if name == awaited => begun.store(true, Ordering::SeqCst),
        Event::ChunkBuilt { name, .. } if name == held => {
            let start = Instant::now();
            while !begun.load(Ordering::SeqCst) && start.elapsed() < Duration::from_secs(5) {
                std::thread::sleep(Duration::from_millis(1));
            }
            met.fetch_or(begun.load(Ordering::SeqCst), Ordering::SeqCst);
        }
        _ => {}
    };
    let pipeline = lab.pipeline(PIPELINE, &[]);
    let options = RunOptions { abreast: 2, ..*options };
    let outcome = run(&pipeline, &lab.store(), &options, &environment(), &listener).unwrap();
    (outcome, met.into_inner())
}

#[test]
fn stages_that_do_not_need_each_other_are_built_at_once() {
    let lab = Laboratory::new();
    let (outcome, met) = run_abreast(&lab, &RunOptions::default(), "small", "large");
    assert!(met && outcome.failures.is_empty());
    let names: Vec<&str> = outcome.stages.iter().map(|stage| stage.name.as_str()).collect();
    assert_eq!(names, ["small", "large", "halved", "total"]);
    let digests: Vec<_> = outcome.stages.iter().map(|stage| stage.digest).collect();
    assert_eq!(digests, Laboratory::new().digests(&[]));
    assert_eq!(lab.run(&[]).len(), 4, "all is there");
}

#[test]
fn what_is_at_work_beside_a_stage_that_fails_is_finished_and_nothing_else_begun() {
    let lab = Laboratory::new();
    // `large` has two chunks and no third; `small` has.
    lab.count.fails.store(3, Ordering::SeqCst);
    let (outcome, met) = run_abreast(&lab, &RunOptions::default(), "large", "small");
    assert!(met);
    let told: Vec<String> = outcome.stages.iter().map(summary).collect();
    assert!(
        told[0].starts_with("small failed") && told[1].starts_with("large built 2+0"),
        "{told:?}"
    );
    assert_eq!((told.len(), outcome.failures.len()), (2, 1));
}

#[test]
fn a_run_that_is_asked_to_stop_begins_nothing_more_and_is_gone_on_with() {
    let lab = Laboratory::new();
    let stop = AtomicBool::new(false);
    let pipeline = lab.pipeline(PIPELINE, &[]);
    let options = RunOptions {
        stop: Some(&stop),
        ..RunOptions::default()
    };
    let listener = |event: &Event| {
        if matches!(event, Event::ChunkBuilt { .. }) {
            stop.store(true, Ordering::SeqCst);
        }
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let outcome = pool.install(|| run(&pipeline, &lab.store(), &options, &environment(), &listener).unwrap());
    assert!(
        matches!(outcome.failures[0].error, StageError::Stopped(_)),
        "{:?}",
        outcome.failures
    );
    assert_eq!(outcome.stages.len(), 1);
    let log = lab.run(&[]);
    assert!(log.contains(&"built small built 3+1: no record".to_owned()), "{log:?}");
}

#[test]
fn some_chunks_of_a_stage_are_built_and_the_stage_is_left_to_others() {
    let lab = Laboratory::new();
    let some = |chunks| RunOptions {
        until: Some("halved"),
        chunks: Some(chunks),
        unremembered: true,
        ..RunOptions::default()
    };
    let (outcome, _) = lab.run_with(PIPELINE, &[], &some((1, 2)));
    let outcome = outcome.unwrap();
    let halved = outcome.stages.last().unwrap();
    assert_eq!((halved.chunks_built, halved.chunks_reused, halved.digest), (2, 0, None));
    let (outcome, log) = lab.run_with(PIPELINE, &[], &some((2, 100)));
    assert_eq!(outcome.unwrap().stages.last().unwrap().chunks_built, 3);
    assert!(log.contains(&"reused small".to_owned()), "{log:?}");
    assert!(lab.store().runs().unwrap().next().is_none(), "nobody is to know");
    for (stage, chunks) in [("halved", (6, 9)), ("total", (0, 0))] {
        let options = RunOptions {
            until: Some(stage),
            ..some(chunks)
        };
        let (outcome, _) = lab.run_with(PIPELINE, &[], &options);
        assert!(outcome.unwrap().failures[0].error.to_string().contains("chunk"));
    }
    let log = lab.run(&[]);
    assert!(
        log.iter()
            .any(|line| line.starts_with("built halved built 1+5") || line == "reused halved"),
        "{log:?}"
    );
}
