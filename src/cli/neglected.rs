//! The effects that the simulations of a pipeline neglect.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::progress::{ProgressMode, show_count};
use super::solve::warnings_of_states;
use super::{CliError, model_warnings};
use deaflow_base::{Digest, build};
use deaflow_content::SOLVED;
use deaflow_fem::screening::{NO_DATA, TestPattern, resolve, resolve_states};
use deaflow_fem::{Inflated, InflationSolver, SetupError, SolveOptions};
use deaflow_field::Mesh;
use deaflow_orchestrator::{Pipeline, StageSpec};
use deaflow_pattern::Pattern;
use deaflow_report::{RunArtifacts, StageArtifact, warned_patterns};
use deaflow_scene::{Effects, Scene};
use rayon::prelude::*;

/// The warnings about effects that the simulations of a pipeline neglect, a line each, after the names of the stages.
pub struct Neglected {
    /// Those that matter.
    pub main: Vec<String>,
    /// Those about samples only, if the pipeline verifies designs.
    pub of_samples: Vec<String>,
}

impl Neglected {
    /// Returns all of them, those about samples last.
    pub fn all(&self) -> Vec<String> {
        [&self.main[..], &self.of_samples].concat()
    }
}

/// Returns a warning for each significant effect that simulating stages neglect, after the names of those stages. It is
/// about patterns that they have simulated. It depends on parts of the scene that affect no result (the drive in time,
/// known material data), so artifacts do not contain it. Progress is shown in `mode`.
///
/// # Errors
/// When an artifact cannot be read, or the effects of a scene cannot be simulated.
pub fn neglected_effects(
    pipeline: &Pipeline,
    run: &RunArtifacts<'_>,
    mode: ProgressMode,
) -> Result<Neglected, CliError> {
    let stages = simulating(pipeline, run);
    let mut warnings: Vec<(String, Vec<&StageArtifact>)> = Vec::new();
    let screened_stages = stages.len().min(MAX_STAGES);
    let done = Arc::new(AtomicU64::new(0));
    let shown = show_count(
        mode,
        ["neglected effects", "stages"],
        done.clone(),
        screened_stages as u64,
    );
    for (count, stage) in (1..).zip(&stages[..screened_stages]) {
        let found = screened(stage, run)?;
        done.store(count, Ordering::Relaxed);
        for text in found {
            match warnings.iter_mut().find(|(known, _)| *known == text) {
                Some((_, of)) => of.push(stage.made),
                None => warnings.push((text, vec![stage.made])),
            }
        }
    }
    drop(shown);
    let verifies = stages.iter().any(|stage| stage.made.kind == VERIFY);
    let mut found = Neglected {
        main: Vec::new(),
        of_samples: Vec::new(),
    };
    for (text, of) in warnings {
        let names: Vec<&str> = of.iter().map(|made| made.stage.as_str()).collect();
        // Say what to do.
        let advice = match text.starts_with(NO_DATA) {
            true => "; to check these effects, add their data to `properties`",
            false => "",
        };
        let line = format!("{}: {text}{advice}", list(&names));
        match verifies && of.iter().all(|made| made.kind != VERIFY) {
            true => found.of_samples.push(line),
            false => found.main.push(line),
        }
    }
    if screened_stages < stages.len() {
        found.main.push(format!(
            "only the first {screened_stages} of {} stages were screened for neglected effects; use `deaflow screen` \
             for others",
            stages.len()
        ));
    }
    Ok(found)
}

/// A stage that has simulated patterns.
struct SimulatingStage<'a> {
    made: &'a StageArtifact,
    scene: Scene,
    /// Whether it simulates in time.
    in_time: bool,
    /// Whether its results have the electric field relative to the breakdown field.
    observes_breakdown: bool,
}

fn simulating<'a>(pipeline: &Pipeline, run: &RunArtifacts<'a>) -> Vec<SimulatingStage<'a>> {
    let mut stages = Vec::new();
    for stage in &pipeline.stages {
        let made = run.stages.iter().find(|made| made.stage == stage.name);
        let Some(made) = made.filter(|_| SIMULATING.contains(&stage.kind.name())) else {
            continue;
        };
        // The pipeline has been read with its scenes, so they are valid.
        let Some(Ok(scene)) = pipeline.scene_of(stage).map(|scene| Scene::read(&scene)) else {
            continue;
        };
        let has = |stage: &StageSpec, is: &dyn Fn(&str) -> bool| {
            let parameters = stage.stage().parameters();
            parameters.leaves().iter().any(|(key, _)| is(key))
        };
        // Designs for an amplitude are verified by the frequency response, which includes all effects in time.
        let needed = stage.needs.iter().filter_map(|at| pipeline.stages.get(*at));
        let in_time = has(stage, &|key| key.starts_with("history"))
            || needed
                .into_iter()
                .any(|stage| has(stage, &|key| key.ends_with("objective.frequency")));
        stages.push(SimulatingStage {
            made,
            scene,
            in_time,
            observes_breakdown: SOLVED.contains(&stage.kind.name()),
        });
    }
    stages
}

/// Returns the warnings of a stage. They depend only on its scene, its artifact and this program and take the time of
/// some solutions, so the store caches them.
fn screened(stage: &SimulatingStage<'_>, run: &RunArtifacts<'_>) -> Result<Vec<String>, CliError> {
    let SimulatingStage { made, scene, .. } = stage;
    let sort = if stage.in_time { "warnings in time" } else { "warnings" };
    let of = format!("{sort} of {}\n{}\n{}", build(), made.digest, scene.to_text());
    let of = Digest::of(of.as_bytes());
    if let Some(known) = run.store.memo(&of) {
        return Ok(known);
    }
    let refused = |error: SetupError| CliError::bad_input(error.to_string());
    let only = RunArtifacts {
        stages: std::slice::from_ref(*made),
        ..*run
    };
    let patterns: Vec<(String, Pattern)> = only.each(&made.kind, warned_patterns)?.into_iter().flatten().collect();
    if scene.is_in_space() {
        let found = in_space(scene, &patterns).map_err(refused)?;
        run.store.put_memo(&of, &found).ok();
        return Ok(found);
    }
    let tests: Vec<TestPattern> = patterns
        .into_iter()
        .map(|(name, pattern)| TestPattern::new(&name, pattern))
        .collect();
    let screened = model_warnings::screened(scene, &tests).map_err(refused)?;
    let mut found = if stage.in_time {
        screened.warnings_in_time
    } else {
        screened.warnings
    };
    found.extend(screened.breakdown_warning.filter(|_| !stage.observes_breakdown));
    // A read-only store does not cache them.
    run.store.put_memo(&of, &found).ok();
    Ok(found)
}

/// Returns the warnings about patterns, which have names, of a membrane that leaves its plane. It is not screened.
fn in_space(scene: &Scene, patterns: &[(String, Pattern)]) -> Result<Vec<String>, SetupError> {
    let largest = resolve(&resolve_states(scene)?.at_largest_voltages())?;
    let solver = InflationSolver::new(&largest, SolveOptions::on(Mesh::biquadratic(1)))?;
    let found: Vec<Inflated> = patterns.par_iter().map(|(_, pattern)| solver.solve(pattern)).collect();
    let named = patterns.iter().map(|(name, _)| name.clone()).zip(&found);
    let of_states = warnings_of_states(&largest, &named.collect::<Vec<_>>());
    Ok(model_warnings::in_space(&largest)?
        .into_iter()
        .chain(of_states)
        .collect())
}

/// Returns the solving stages whose scene has, or with `auto` may have, an effect of which samples are warned.
pub fn observing(pipeline: &Pipeline) -> Vec<String> {
    let may = |stage: &&StageSpec| {
        let scene = pipeline.scene_of(stage).map(|scene| Scene::read(&scene));
        let warns =
            |effects: &Effects| effects.dielectric_breakdown.is_some() || effects.electromechanical_stability.is_some();
        scene.is_some_and(|scene| scene.is_ok_and(|scene| scene.auto || warns(&scene.effects)))
    };
    pipeline
        .stages
        .iter()
        .filter(|stage| SOLVED.contains(&stage.kind.name()))
        .filter(may)
        .map(|stage| stage.name.clone())
        .collect()
}

/// The most stages of a sweep that are screened; each takes as long as solving a few patterns.
const MAX_STAGES: usize = 16;

/// The most stages that a warning names.
const MAX_NAMED: usize = 4;

fn list(names: &[&str]) -> String {
    let some = names.iter().take(MAX_NAMED).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > MAX_NAMED => format!("{some} and {} more", n - MAX_NAMED),
        _ => some,
    }
}

/// The kinds of stages that only simulate the scene.
const SIMULATING: [&str; 2] = ["solve", VERIFY];

/// The kind of stages that simulate designs.
const VERIFY: &str = "verify";
