//! Threads and processes: the same artifacts however many, and no work done twice.

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
    let lab = Laboratory::new();
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
    let guard = store.lock_action(&key).unwrap();
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
