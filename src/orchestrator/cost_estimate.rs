//! Estimates prices for the stages of a pipeline, and returns costs from which later prices are estimated.

use super::event::StageReport;
use super::kind::{Chunk, Plan};
use super::planner::{ChunkState, MANY, StageState, StageStatus};
use super::price::{CostQuery, Leaves, Price, leaves, price};
use super::provenance::Environment;
use super::spec::{Pipeline, StageSpec};
use deaflow_store::{Cost, Store, StoreError};

/// The price of a stage, or why there is none; neither if the stage is up to date.
pub type PriceOrReason = (Option<Price>, Option<String>);

/// Estimates a price for every stale stage of a selection.
///
/// # Errors
/// If the store cannot be read.
pub fn prices(
    pipeline: &Pipeline,
    selection: &[usize],
    statuses: &[StageStatus],
    store: &Store,
    environment: &Environment,
) -> Result<Vec<PriceOrReason>, StoreError> {
    if !statuses.iter().any(StageStatus::is_stale) {
        return Ok(vec![(None, None); selection.len()]);
    }
    let costs = store.costs();
    let mut lengths: Vec<Option<u64>> = vec![None; pipeline.stages.len()];
    let mut prices = Vec::with_capacity(selection.len());
    for (&index, status) in selection.iter().zip(statuses) {
        let spec = &pipeline.stages[index];
        let input_bytes = spec.needs.iter().map(|&need| lengths[need]).sum();
        let price = match status.is_stale() {
            true => {
                let mut work = work(spec, status, input_bytes, environment);
                // Steps of an earlier run are not repeated; finishing takes at least one step.
                let kept = resumable_steps(status, store, &environment.build_of_checkpoints());
                work.steps = work.steps.saturating_sub(kept).max(work.steps.min(1));
                match price(&costs, &work) {
                    Ok(price) => (Some(price), None),
                    Err(unmeasured) => (None, Some(unmeasured.to_string())),
                }
            }
            false => (None, None),
        };
        lengths[index] = length(status, price.0.as_ref());
        prices.push(price);
    }
    Ok(prices)
}

/// Describes the work of building a stale stage. `input_bytes` is the length of its inputs, if known.
fn work(spec: &StageSpec, status: &StageStatus, input_bytes: Option<u64>, environment: &Environment) -> CostQuery {
    CostQuery {
        kind: spec.kind.name().to_owned(),
        recipe: spec.recipe(),
        parameters: parameters(spec, &status.work),
        host: environment.host.clone(),
        jobs: rayon::current_num_threads() as u64,
        steps: steps(status),
        weight: spec.stage().weight(),
        repeats_inputs: spec.stage().repeats_inputs(),
        time_scales_with_inputs: spec.stage().time_scales_with_inputs(),
        size_parameter: spec.stage().size_parameter(),
        mostly_unstable: spec.check.mostly_unstable,
        separate_parameters: spec.kind.separate_cost_parameters(),
        chunks: match &status.work {
            Plan::Chunks(_) => Some(missing(status).count() as u64),
            Plan::Whole { .. } => None,
        },
        input_bytes,
    }
}

/// Returns the number of steps to build: samples in missing chunks, or the steps of a stage in one piece.
pub fn steps(status: &StageStatus) -> u64 {
    match &status.work {
        Plan::Chunks(_) => missing(status).map(|chunk| chunk.samples).sum(),
        Plan::Whole { steps } => *steps,
    }
}

/// Returns a text with the number of steps that are resumed from an earlier run, if any.
pub fn resumed_text(
    spec: &StageSpec,
    status: &StageStatus,
    store: &Store,
    environment: &Environment,
) -> Option<String> {
    let kept = resumable_steps(status, store, &environment.build_of_checkpoints());
    (kept > 0).then(|| format!("resumes after {kept} of {} {}", steps(status), spec.stage().unit()))
}

/// Returns the number of steps that can be resumed from checkpoints.
fn resumable_steps(status: &StageStatus, store: &Store, build: &str) -> u64 {
    let StageState::Stale { chunks, .. } = &status.state else {
        return 0;
    };
    let actions = match &status.work {
        // So many chunks are small, and so are their checkpoints.
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

/// Returns the cost of a stage that was built here, with its number of unstable samples; `None` if another process
/// built a part.
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
        (Plan::Chunks(chunks), StageState::Stale { chunks: states, .. }) => (chunks.as_slice(), states.as_slice()),
        _ => (&[][..], &[][..]),
    };
    let pairs = chunks.iter().zip(states);
    pairs.filter(|(_, state)| !state.intact).map(|(chunk, _)| chunk)
}

/// Returns the parameters on which the cost depends. For a chunked stage those are the ones common to all chunks, so
/// that a stage with more samples is the same work, only more of it. Seeds are left out.
fn parameters(spec: &StageSpec, work: &Plan) -> Leaves {
    let mut common = match work {
        Plan::Chunks(chunks) => {
            let of = |chunk: Option<&Chunk>| chunk.map(|chunk| leaves(&chunk.parameters)).unwrap_or_default();
            let last = of(chunks.last());
            let mut first = of(chunks.first());
            first.retain(|path, value| last.get(path) == Some(value));
            first
        }
        Plan::Whole { .. } => leaves(&spec.stage().parameters()),
    };
    common.retain(|path, _| path.rsplit('.').next() != Some("seed"));
    common
}

/// Returns the length of the files of a stage, now or after it has been built.
fn length(status: &StageStatus, price: Option<&Price>) -> Option<u64> {
    match &status.state {
        StageState::Fresh { size, .. } => Some(*size),
        StageState::Stale { chunks, .. } => {
            let there = chunks.iter().filter(|chunk| chunk.intact);
            let there: u64 = there.filter_map(|chunk| Some(chunk.record.as_ref()?.size)).sum();
            // Assume that chunks whose records were not read are as long as those to be built.
            let [listed, missing] = [ChunkState::is_listed, |chunk: &ChunkState| !chunk.intact]
                .map(|is| chunks.iter().filter(|chunk| is(chunk)).count());
            let share = 1.0 + listed as f64 / missing.max(1) as f64;
            price.map(|price| there + (share * price.bytes.likely) as u64)
        }
    }
}
