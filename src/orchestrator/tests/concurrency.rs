//! Threads and processes: the same artifacts however many, and no work done twice.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::*;
use deaflow_store::Action;

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
    let lab = Laboratory::by_claims();
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
    assert!(one.failures.is_empty(), "{:?}", one.failures);
    assert!(two.failures.is_empty(), "{:?}", two.failures);
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

fn has_stage(store: &Store, done: &deaflow_store::Run, name: &str) -> bool {
    let key = done.stage(name).unwrap().key;
    store.record(&key).unwrap().record().is_some()
}

/// Runs with two stages at once; what is told of the chunks of a stage is held up until another has begun, or it is
/// clear that none does.
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
    let options = RunOptions {
        parallel_stages: 2,
        ..*options
    };
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
    assert_eq!(outcome.failures.len(), 1);
    let of_others = outcome.stages[2..].iter();
    let mut outcomes = of_others.map(|stage| stage.outcome);
    assert!(outcomes.all(|outcome| outcome == Outcome::Skipped), "{told:?}");
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
    assert!(
        log.contains(&"built small built 3+1: not built yet".to_owned()),
        "{log:?}"
    );
}

#[test]
fn some_chunks_of_a_stage_are_built_and_the_stage_is_left_to_others() {
    let lab = Laboratory::new();
    let some = |chunks| RunOptions {
        until: Some("halved"),
        chunks: Some(chunks),
        skip_history: true,
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

/// Chunks of the stage `small` in a pipeline, with their keys.
fn chunk_keys(lab: &Laboratory, text: &str) -> Vec<ActionKey> {
    let pipeline = lab.pipeline(text, &[]);
    let spec = pipeline.stage("small").unwrap();
    let Plan::Chunks(chunks) = spec.stage().plan(&[]) else {
        panic!("it has chunks");
    };
    let key = |chunk: &Chunk| {
        let action = Action::of_chunk(spec.kind.name(), spec.recipe(), &chunk.parameters, &chunk.inputs);
        action.unwrap().key().unwrap()
    };
    chunks.iter().map(key).collect()
}

#[test]
fn records_of_many_chunks_are_listed_and_opened_when_the_stage_is_put_together() {
    let text = PIPELINE.replace("count: 35", "count: 395");
    let expected: Vec<_> = Laboratory::new()
        .run_text(&text, &[])
        .0
        .stages
        .iter()
        .map(|s| s.digest)
        .collect();
    for by_claims in [false, true] {
        let lab = match by_claims {
            true => Laboratory::by_claims(),
            false => Laboratory::new(),
        };
        let some = |chunks| RunOptions {
            until: Some("small"),
            chunks: Some(chunks),
            ..RunOptions::default()
        };
        lab.run_with(&text, &[], &some((0, 29))).0.unwrap();
        // The object of one is lost, the record of another is damaged, and one is as if nobody had built it.
        let keys = chunk_keys(&lab, &text);
        let store = lab.store();
        let record = |at: usize| lab.record_file(&keys[at]);
        std::fs::remove_file(lab.object(&store.record(&keys[7]).unwrap().record().unwrap().artifact)).unwrap();
        std::fs::write(record(3), "no record").unwrap();
        std::fs::remove_file(record(11)).unwrap();
        // A plan is of what is there. Names of others that nothing was asked of are no reason to wait for anybody.
        let planned = plan(&lab.pipeline(&text, &[]), &store, None, &environment()).unwrap();
        assert_eq!((planned[0].chunks_built, planned[0].chunks_reused), (13, 27));
        let (outcome, _) = lab.run_with(&text, &[], &some((2, 5)));
        let small = &outcome.unwrap().stages[0];
        assert_eq!((small.chunks_built, small.chunks_reused), (1, 3));
        let (outcome, _) = lab.run_text(&text, &[]);
        assert_eq!(
            (outcome.stages[0].chunks_built, outcome.stages[0].chunks_reused),
            (12, 28)
        );
        let digests: Vec<_> = outcome.stages.iter().map(|stage| stage.digest).collect();
        assert_eq!(digests, expected);
        // Where all have been built before, what will come of them is known.
        std::fs::remove_file(lab.record_file(&outcome.lock.stages["small"].key)).unwrap();
        let planned = plan(&lab.pipeline(&text, &[]), &store, None, &environment()).unwrap();
        assert_eq!((planned[0].chunks_reused, planned[0].digest), (40, expected[0]));
        let (outcome, _) = lab.run_text(&text, &[]);
        let small = &outcome.stages[0];
        assert_eq!(
            (small.chunks_built, small.chunks_reused, small.digest),
            (0, 40, expected[0])
        );
    }
}

#[test]
fn a_run_that_is_stopped_neither_waits_for_its_turn_nor_reads_what_others_built() {
    let lab = Laboratory::by_claims();
    let store = lab.store();
    let keys = chunk_keys(&lab, PIPELINE);
    let _chunk = store.try_lock_action(&keys[1]).unwrap().unwrap();
    let whole = Laboratory::new().run_text(PIPELINE, &[]).0.lock.stages["small"].key;
    let _chosen = store.try_reserve(&format!("whole-{whole}")).unwrap().unwrap();
    let stop = AtomicBool::new(false);
    let listener = |event: &Event| {
        if matches!(event, Event::Note { text, .. } if text.contains("assembling this")) {
            stop.store(true, Ordering::SeqCst);
        }
    };
    let options = RunOptions {
        stop: Some(&stop),
        ..RunOptions::default()
    };
    let outcome = run(
        &lab.pipeline(PIPELINE, &[]),
        &store,
        &options,
        &environment(),
        &listener,
    )
    .unwrap();
    assert!(stop.load(Ordering::SeqCst) && matches!(outcome.failures[0].error, StageError::Stopped(_)));
    // And one that was stopped before.
    let outcome = run(&lab.pipeline(PIPELINE, &[]), &store, &options, &environment(), &|_| {}).unwrap();
    assert!(outcome.stages.is_empty() || matches!(outcome.failures[0].error, StageError::Stopped(_)));
}

#[test]
fn one_process_puts_a_stage_together_and_others_wait_for_it() {
    // With few chunks, of which each is looked at, one of them altered or none, and with many.
    for (text, few, is_altered) in [
        (PIPELINE.to_owned(), true, false),
        (PIPELINE.to_owned(), true, true),
        (PIPELINE.replace("count: 35", "count: 395"), false, false),
    ] {
        let (lab, donor) = (Laboratory::by_claims(), Laboratory::new());
        let expected = donor.run_text(&text, &[]).0;
        let source = donor.store();
        let store = lab.store();
        let keys = chunk_keys(&lab, &text);
        let whole = expected.lock.stages["small"].key;
        // Another process is at a chunk, and has been chosen.
        let chunk = store.try_lock_action(&keys[1]).unwrap().unwrap();
        let chosen = store.try_reserve(&format!("whole-{whole}")).unwrap().unwrap();
        let options = RunOptions {
            until: Some("small"),
            ..RunOptions::default()
        };
        let give = |key: &ActionKey| {
            let record = source.record(key).unwrap().record().unwrap();
            let object = source.artifact(&record.artifact).unwrap().object().unwrap();
            store.put(&object, &Default::default()).unwrap();
            store.put_record(&record).unwrap();
        };
        // It is not waited for longer than one likes.
        let patience = Some(Duration::from_millis(20));
        let (outcome, _) = lab.run_with(&text, &[], &RunOptions { patience, ..options });
        assert_eq!(outcome.unwrap().stages[0].outcome, Outcome::Left);
        let last = keys.last().unwrap();
        std::fs::remove_file(lab.record_file(last)).unwrap();
        // A run that found the chunk before it waits would assemble the stage itself.
        let waits = AtomicBool::new(false);
        let listener = |event: &Event| {
            if matches!(event, Event::Note { text, .. } if text.contains("assembling this")) {
                waits.store(true, Ordering::SeqCst);
            }
        };
        let pipeline = lab.pipeline(&text, &[]);
        let outcome = std::thread::scope(|scope| {
            let waiting = scope.spawn(|| run(&pipeline, &lab.store(), &options, &environment(), &listener));
            while !waits.load(Ordering::SeqCst) {
                assert!(!waiting.is_finished(), "it ended without waiting");
                std::thread::sleep(Duration::from_millis(5));
            }
            give(&keys[1]);
            drop(chunk);
            give(&whole);
            if is_altered {
                // What lacks a chunk is not taken.
                let lost = lab.object(&store.record(&keys[1]).unwrap().record().unwrap().artifact);
                std::fs::write(lost, "no artifact").unwrap();
            }
            drop(chosen);
            waiting.join().unwrap()
        });
        let stages = outcome.unwrap().stages;
        let (small, reference) = (&stages[0], &expected.stages[0]);
        assert_eq!((small.outcome, small.digest), (Outcome::Built, reference.digest));
        let built = 1 + u64::from(is_altered);
        assert_eq!(
            (small.chunks_built, small.chunks_reused),
            (built, reference.chunks_built - built)
        );
        let digest = reference.digest.unwrap();
        let lengths = store.parts(&digest).unwrap();
        let lengths = lengths
            .iter()
            .map(|part| std::fs::metadata(lab.object(part)).unwrap().len());
        let size = lengths.sum::<u64>() + source.record(&whole).unwrap().record().unwrap().size;
        if !is_altered {
            assert_eq!(small.size == size, few, "many are not looked at one by one");
        }
    }
}

#[test]
fn who_was_chosen_and_is_gone_is_replaced() {
    let lab = Laboratory::by_claims();
    let store = lab.store();
    let keys = chunk_keys(&lab, PIPELINE);
    let chunk = store.try_lock_action(&keys[1]).unwrap().unwrap();
    let expected = Laboratory::new().digests(&[]);
    let whole = {
        let donor = Laboratory::new();
        donor.run_text(PIPELINE, &[]).0.lock.stages["small"].key
    };
    let chosen = store.try_reserve(&format!("whole-{whole}")).unwrap().unwrap();
    let (outcome, log) = std::thread::scope(|scope| {
        let waiting = scope.spawn(|| lab.run_text(PIPELINE, &[]));
        while !store.record_index().unwrap().contains(&keys[3]) {
            std::thread::sleep(Duration::from_millis(5));
        }
        drop((chunk, chosen));
        waiting.join().unwrap()
    });
    let digests: Vec<_> = outcome.stages.iter().map(|stage| stage.digest).collect();
    assert_eq!(digests, expected);
    assert!(log.contains(&"chunk small 1".to_owned()), "{log:?}");
}
