//! The artifact of a solve stage.

use deaflow_content::{
    Meshes, Observations, Packed, SampleRows, Solutions, SolvedHistories, Unstable, rotations, translations,
};
use deaflow_fem::{AccurateHistory, AccurateSimulation, GeometryError, History, Instant, Solver};
use deaflow_field::{Field, Motion, OutcomeKind};
use deaflow_scene::{Effects, Scene};

/// Returns the results of one chunk of samples; those without a field are stored separately.
pub fn solutions(
    rows: &SampleRows,
    results: &[AccurateSimulation],
    scene: &Scene,
    solver: (&Solver, String),
    effects: &Effects,
) -> Solutions {
    let (stable, unstable): (Vec<usize>, Vec<usize>) =
        (0..results.len()).partition(|&i| results[i].simulation.field.is_some());
    let solved: Vec<&AccurateSimulation> = stable.iter().map(|&i| &results[i]).collect();
    let fields: Vec<Field> = solved.iter().filter_map(|r| r.simulation.field.clone()).collect();
    let observed: Vec<_> = solved.iter().map(|r| Some(&r.simulation.observation)).collect();
    let (solver, settings) = solver;
    Solutions {
        rows: rows.select(&stable),
        outcome: outcomes(results, &stable),
        max_displacement: fields.iter().map(Field::max_magnitude).collect(),
        displacement: fields,
        newton_iterations: Some(solved.iter().map(|r| r.simulation.newton_iterations).collect()),
        residual: Some(solved.iter().map(|r| r.simulation.residual).collect()),
        observations: Observations::of(&solver.observed(effects), scene, &observed),
        meshes: solver.estimates_errors().then(|| meshes(solved.iter().copied())),
        history: None,
        unstable: Unstable {
            rows: rows.select(&unstable),
            outcome: outcomes(results, &unstable),
            voltage_bracket: brackets(results, &unstable),
            time_bracket: None,
        },
        scene: scene.clone(),
        solver: Some(settings),
        effects: Some(effects.clone()),
    }
}

/// Adds the histories of the samples.
pub fn in_time(solved: Solutions, histories: &[AccurateHistory]) -> Solutions {
    let (stable, unstable): (Vec<&History>, Vec<&History>) = histories
        .iter()
        .map(|found| &found.history)
        .partition(|history| history.outcome.is_converged());
    Solutions {
        history: Some(solved_histories(&stable, Datum::Mount)),
        // The forces of sides are those of equilibria.
        observations: Observations {
            reaction: None,
            ..solved.observations
        },
        unstable: Unstable {
            time_bracket: Some(
                unstable
                    .iter()
                    .map(|history| history.outcome.time_bracket().unwrap_or_default())
                    .collect(),
            ),
            ..solved.unstable
        },
        ..solved
    }
}

/// The state from which displacements count, where sides are not held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Datum {
    /// The mount.
    Mount,
    /// Rest.
    Rest,
}

/// Returns the histories of patterns that have a field at all times.
pub fn solved_histories(stable: &[&History], datum: Datum) -> SolvedHistories {
    let instants = || stable.iter().flat_map(|history| history.asked());
    let values = |fields: &[Field]| fields.iter().flat_map(Field::values).copied().collect::<Vec<f64>>();
    let displacement = stable.iter().flat_map(|history| match datum {
        Datum::Mount => values(&history.fields),
        Datum::Rest => values(&history.strokes()),
    });
    let motions = |of: fn(&Instant) -> &Option<Vec<Motion>>| {
        let each: Option<Vec<Vec<Motion>>> = instants().map(|instant| of(instant).clone()).collect();
        each.filter(|all| !all.is_empty()).map(|all| all.concat())
    };
    let [bodies, bars] = [motions(|instant| &instant.bodies), motions(|instant| &instant.bars)];
    let errors = stable.iter().map(|history| history.time_error_mm);
    SolvedHistories {
        time: Packed(instants().map(|instant| instant.time).collect()),
        displacement: Packed(displacement.collect()),
        charge: Packed(instants().map(|instant| instant.charge).collect()),
        body_translation: bodies.as_deref().map(translations),
        body_rotation: bodies.as_deref().map(rotations),
        bar_translation: bars.as_deref().map(translations),
        bar_rotation: bars.as_deref().map(rotations),
        error_in_time: errors.map(Option::unwrap_or_default).collect(),
    }
}

fn outcomes(results: &[AccurateSimulation], rows: &[usize]) -> Vec<OutcomeKind> {
    rows.iter().map(|&i| results[i].simulation.outcome.kind()).collect()
}

fn brackets(results: &[AccurateSimulation], rows: &[usize]) -> Vec<[f64; 2]> {
    let bracket = |&i: &usize| results[i].simulation.outcome.bracket().unwrap_or_default();
    rows.iter().map(bracket).collect()
}

/// Returns the mesh that was chosen for each sample, with its error.
pub fn meshes<'a>(results: impl Iterator<Item = &'a AccurateSimulation> + Clone) -> Meshes {
    let errors = results.clone().map(|r| r.discretisation_error.unwrap_or(f64::NAN));
    let geometry = results.clone().any(|r| r.geometry_error.is_some());
    let of_geometry = |r: &AccurateSimulation| r.geometry_error.and_then(GeometryError::mm).unwrap_or(f64::NAN);
    Meshes {
        discretisation_error: errors.collect(),
        geometry_error: geometry.then(|| results.clone().map(of_geometry).collect()),
        elements_per_cell: results.clone().map(|r| r.mesh.elements_per_cell() as u64).collect(),
        order: results.map(|r| r.mesh.order().degree() as u64).collect(),
    }
}
