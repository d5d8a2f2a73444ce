//! Prices for the stages of a pipeline, and the costs that later prices are made of.

use super::event::StageReport;
use super::kind::{Chunk, Plan};
use super::planner::{ChunkState, MANY, StageStatus, State};
use super::price::{Leaves, Price, Work, leaves, price};
use super::provenance::Environment;
use super::spec::{Pipeline, StageSpec};
use deaflow_store::{Cost, Store, StoreError};

/// What is foretold of a stage: a price, or why there is none; neither where it is there.
pub type Foretold = (Option<Price>, Option<String>);

/// A price for every stale stage of a selection, as far as one can be named.
///
/// # Errors
/// When the store cannot be read.
pub fn prices(
    pipeline: &Pipeline,
    selection: &[usize],
    statuses: &[StageStatus],
    store: &Store,
    environment: &Environment,
) -> Result<Vec<Foretold>, StoreError> {
    if !statuses.iter().any(StageStatus::is_stale) {
        return Ok(vec![(None, None); selection.len()]);
    }
    let costs = store.costs();
    let mut lengths: Vec<Option<u64>> = vec![None; pipeline.stages.len()];
    let mut prices = Vec::with_capacity(selection.len());
    for (&index, status) in selection.iter().zip(statuses) {
        let spec = &pipeline.stages[index];
        let input_bytes = spec.needs.iter().map(|&need| lengths[need]).sum();
        let foretold = match status.is_stale() {
            true => {
                let mut work = work(spec, status, input_bytes, environment);
                // What an earlier run has done is not done again; to end it takes a step at least.
                let kept = kept(status, store, &environment.build_of_checkpoints());
                work.steps = work.steps.saturating_sub(kept).max(work.steps.min(1));
                match price(&costs, &work) {
                    Ok(price) => (Some(price), None),
                    Err(unmeasured) => (None, Some(unmeasured.to_string())),
                }
            }
            false => (None, None),
        };
        lengths[index] = length(status, foretold.0.as_ref());
        prices.push(foretold);
    }
    Ok(prices)
}

/// What building a stale stage takes. `input_bytes` is the length of its inputs, where that is known.
fn work(spec: &StageSpec, status: &StageStatus, input_bytes: Option<u64>, environment: &Environment) -> Work {
    Work {
        kind: spec.kind.name().to_owned(),
        recipe: spec.recipe(),
        parameters: parameters(spec, &status.work),
        host: environment.host.clone(),
        jobs: rayon::current_num_threads() as u64,
        steps: steps(status),
        weight: spec.stage.weight(),
        repeats_inputs: spec.stage.repeats_inputs(),
        time_scales_with_inputs: spec.stage.time_scales_with_inputs(),
        size_parameter: spec.stage.size_parameter(),
        mostly_unstable: spec.check.mostly_unstable,
        apart: spec.kind.separate_cost_parameters(),
        chunks: match &status.work {
            Plan::Chunks(_) => Some(missing(status).count() as u64),
            Plan::Whole { .. } => None,
        },
        input_bytes,
    }
}

/// How many steps building takes: samples in the chunks that are not there, or the stage's own measure.
pub fn steps(status: &StageStatus) -> u64 {
    match &status.work {
        Plan::Chunks(_) => missing(status).map(|chunk| chunk.samples).sum(),
        Plan::Whole { steps } => *steps,
    }
}

/// That an earlier run has done some steps of a stage that is stale, in words; none where it has not.
pub fn gone_on_with(
    spec: &StageSpec,
    status: &StageStatus,
    store: &Store,
    environment: &Environment,
) -> Option<String> {
    let kept = kept(status, store, &environment.build_of_checkpoints());
    (kept > 0).then(|| format!("goes on after {kept} of {} {}", steps(status), spec.stage.unit()))
}

/// Steps that an earlier run has done of what is to be built, and that can be gone on with.
fn kept(status: &StageStatus, store: &Store, build: &str) -> u64 {
    let State::Stale { chunks, .. } = &status.state else {
        return 0;
    };
    let actions = match &status.work {
        // So many are each small, and so is what is kept of them.
        Plan::Chunks(all) if all.len() >= MANY => return 0,
        Plan::Chunks(_) => chunks
            .iter()
            .filter(|chunk| !chunk.intact)
            .map(|chunk| &chunk.action)
            .collect(),
        Plan::Whole { .. } => vec![&status.action],
    };
    let kept = actions
        .into_iter()
        .flatten()
        .filter_map(|(_, key)| store.checkpoint_progress(key, build));
    kept.map(|reached| reached.steps).sum()
}

/// The cost of a stage that was built here and now, for the memory of the store, with how many of its samples have no stable solution; `None`
/// where another process had a share.
pub fn cost(
    spec: &StageSpec,
    status: &StageStatus,
    report: &StageReport,
    unstable: u64,
    input_bytes: u64,
    environment: &Environment,
) -> Option<Cost> {
    let work = work(spec, status, Some(input_bytes), environment);
    let chunks = work.chunks.unwrap_or(1);
    let done_here = work.steps.saturating_sub(report.resumed);
    if report.chunks_built != chunks || done_here == 0 {
        return None;
    }
    Some(Cost {
        kind: work.kind,
        recipe: work.recipe,
        parameters: work.parameters,
        host: work.host,
        jobs: work.jobs,
        steps: done_here,
        weight: work.weight,
        chunks,
        input_bytes,
        unstable,
        seconds: report.part.unwrap_or(report.seconds),
        elapsed: Some(report.seconds),
        bytes: report.size_built,
        created: environment.now(),
    })
}

fn missing(status: &StageStatus) -> impl Iterator<Item = &Chunk> {
    let (chunks, states) = match (&status.work, &status.state) {
        (Plan::Chunks(chunks), State::Stale { chunks: states, .. }) => (chunks.as_slice(), states.as_slice()),
        _ => (&[][..], &[][..]),
    };
    let pairs = chunks.iter().zip(states);
    pairs.filter(|(_, state)| !state.intact).map(|(chunk, _)| chunk)
}

/// What the work depends on. Of a chunked stage it is what all its chunks have in common, so that a stage of more samples
/// is the same work, only more of it; and no work depends on a seed.
fn parameters(spec: &StageSpec, work: &Plan) -> Leaves {
    let mut common = match work {
        Plan::Chunks(chunks) => {
            let of = |chunk: Option<&Chunk>| chunk.map(|chunk| leaves(&chunk.parameters)).unwrap_or_default();
            let last = of(chunks.last());
            let mut first = of(chunks.first());
            first.retain(|path, value| last.get(path) == Some(value));
            first
        }
        Plan::Whole { .. } => leaves(&spec.stage.parameters()),
    };
    common.retain(|path, _| path.rsplit('.').next() != Some("seed"));
    common
}

/// The length of a stage's files, now or once it has been built.
fn length(status: &StageStatus, price: Option<&Price>) -> Option<u64> {
    match &status.state {
        State::Fresh { size, .. } => Some(*size),
        State::Stale { chunks, .. } => {
            let there = chunks.iter().filter(|chunk| chunk.intact);
            let there: u64 = there.filter_map(|chunk| Some(chunk.record.as_ref()?.size)).sum();
            // Chunks of which only the name is known are as long as those that are built.
            let [listed, missing] = [ChunkState::is_listed, |chunk: &ChunkState| !chunk.intact]
                .map(|is| chunks.iter().filter(|chunk| is(chunk)).count());
            let share = 1.0 + listed as f64 / missing.max(1) as f64;
            price.map(|price| there + (share * price.bytes.likely) as u64)
        }
    }
}
