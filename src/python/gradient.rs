//! Derivatives with respect to the covered share of each cell, by the adjoint method. The module [`parameter`] derives
//! those with respect to voltages and parameters of the material from the same solution.

pub mod parameter;

use std::path::Path;

use deaflow::base::{Document, InputError};
use deaflow::cli::{CliError, Equilibria};
use deaflow::design::{Goal, Objective, ResponseKind};
use deaflow::fem::screening::resolve;
use deaflow::fem::{MembraneSolver, MeshSolution, SetupError};
use deaflow::field::Field;
use deaflow::pattern::Pattern;
use deaflow::scene::Scene;
use rayon::prelude::*;

/// The value of a functional, and its derivative with respect to the covered share of each cell, `[y][x]`.
pub type ValueAndGradient = (f64, Vec<f64>);

/// The value of a functional of the displacement in each state, and its derivatives with respect to them.
pub type ValueAndSlopes = (f64, Vec<Field>);

/// Reads an objective in the keys of a design stage.
///
/// # Errors
/// When it is not valid in the scene, or asks for something other than equilibria.
pub fn objective(text: &str, scene: &Scene) -> Result<Goal, CliError> {
    let root = Document::from_text(Path::new("objective"), text)?.root;
    let objective = Objective::read(&root)?;
    let refused = |key: &str| -> InputError {
        let message = format!("`{key}` cannot be used here: values and gradients are those of equilibria");
        root.peek(key).unwrap_or(&root).error(message).help("remove it")
    };
    match objective.response() {
        ResponseKind::Equilibrium => {}
        ResponseKind::After(_) => return Err(refused("time").into()),
        ResponseKind::Amplitude(_) => return Err(refused("frequency").into()),
    }
    if objective.is_robust() {
        return Err(refused("robust").into());
    }
    Ok(objective
        .goal(scene, None, 0.0)
        .map_err(|error| root.error(error.to_string()))?)
}

/// Computes value and gradient of a functional for each pattern, which has [shares](Pattern::of_shares); `None` for one
/// without a stable solution. `functional` is given the position of the pattern.
///
/// # Errors
/// When a pattern cannot be simulated in this way.
pub fn values_and_gradients(
    equilibria: &Equilibria,
    scene: &Scene,
    patterns: &[Pattern],
    functional: impl Fn(usize, &[Field]) -> ValueAndSlopes + Sync,
) -> Result<Vec<Option<ValueAndGradient>>, CliError> {
    check_shares(scene)?;
    let found = values_and_gradients_in_states(equilibria, patterns, &[patterns], functional)?.into_iter();
    let in_all_states = |(value, forms): ValueAndGradients| (value, sum_of_states(&forms.concat()));
    Ok(found.map(|found| found.map(in_all_states)).collect())
}

/// Checks that there are derivatives with respect to the covered shares.
fn check_shares(scene: &Scene) -> Result<(), CliError> {
    if scene.geometry.sides.is_some() && resolve(scene)?.effects.electrode_stiffness.is_some() {
        // The state of rest would depend on the shares.
        let message = "there is no gradient of `electrode_stiffness` where sides are not held";
        return Err(CliError::bad_input(message).help("remove the effect, or hold the sides"));
    }
    Ok(())
}

/// Returns the sum of what a derivative owes to the cells in each state.
fn sum_of_states(states: &[Vec<f64>]) -> Vec<f64> {
    let mut sum = vec![0.0; states.first().map_or(0, Vec::len)];
    for own in states {
        sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
    }
    sum
}

/// The value of a functional, and what its derivative owes to the cells in each form and state, `[form][state]`, each
/// `[y][x]`.
type ValueAndGradients = (f64, Vec<Vec<Vec<f64>>>);

/// Solves patterns once, and differentiates them in several forms: as whole cells, whose derivative is that with
/// respect to the load of an electrode, or with shares, whose derivative is that of cutting cells.
fn values_and_gradients_in_states(
    equilibria: &Equilibria,
    patterns: &[Pattern],
    forms: &[&[Pattern]],
    functional: impl Fn(usize, &[Field]) -> ValueAndSlopes + Sync,
) -> Result<Vec<Option<ValueAndGradients>>, CliError> {
    for solver in equilibria.solvers() {
        solver.check(patterns)?;
    }
    let solvers = equilibria.solvers().map(|solver| solver.on_one_mesh());
    let solvers: Vec<&MembraneSolver> = solvers.collect::<Result<_, SetupError>>()?;
    let each = patterns.par_iter().enumerate();
    let of_pattern = |(at, pattern)| {
        let forms: Vec<&Pattern> = forms.iter().map(|patterns| &patterns[at]).collect();
        value_and_gradients(&solvers, pattern, &forms, |fields| functional(at, fields))
    };
    Ok(each.map(of_pattern).collect())
}

fn value_and_gradients(
    solvers: &[&MembraneSolver],
    pattern: &Pattern,
    forms: &[&Pattern],
    functional: impl Fn(&[Field]) -> ValueAndSlopes,
) -> Option<ValueAndGradients> {
    let solutions: Vec<MeshSolution> = solvers.iter().map(|solver| solver.solve(pattern)).collect();
    if !solutions.iter().all(|solution| solution.outcome.is_converged()) {
        return None;
    }
    let in_states = solvers.iter().zip(&solutions);
    let fields: Vec<Field> = in_states
        .map(|(solver, solution)| solver.stroke(pattern, solution))
        .collect();
    let (value, slopes) = functional(&fields);
    let of_form = |form: &&Pattern| {
        let in_states = solvers.iter().zip(&solutions).zip(&slopes);
        let gradients = in_states.map(|((solver, solution), slope)| solver.gradient(form, solution, slope));
        gradients.collect::<Option<Vec<_>>>()
    };
    Some((value, forms.iter().map(of_form).collect::<Option<_>>()?))
}

/// Returns the value of an objective and its derivatives: the displacement or force along the directions, or the
/// distance from the targets.
pub fn value_and_slopes(goal: &Goal, fields: &[Field]) -> ValueAndSlopes {
    let score = goal.score(fields);
    let (value, per_score) = match goal.distance_mm(fields) {
        // The score is a negative multiple of it.
        Some(distance) => (distance, if score == 0.0 { 0.0 } else { distance / score }),
        // Scores along directions are proportional to the motion. That of a unit motion along all of them is
        // their unit.
        None => {
            let along: Vec<[f64; 2]> = goal.aims().iter().map(|aim| aim.direction).collect();
            let per_score = goal.score_of(&along).recip();
            (score * per_score, per_score)
        }
    };
    let slopes = goal.slope(fields).into_iter();
    (value, slopes.map(|slope| scaled(slope, per_score)).collect())
}

fn scaled(slope: Field, by: f64) -> Field {
    let raster = slope.raster();
    let of_forces = slope.reactions().map(|force| force.map(|f| by * f));
    let values = slope.values().iter().map(|value| by * value).collect();
    let scaled = Field::from_values(raster, values).unwrap_or_else(|_| Field::zero(raster));
    scaled.with_reactions(of_forces)
}
