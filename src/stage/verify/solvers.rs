//! Simulation of designs on two meshes.

use std::slice;

use rayon::prelude::*;

use deaflow_design::Goal;
use deaflow_fem::{
    AccurateHistory, AccurateSimulation, GeometryError, GeometryErrors, History, SetupError, SolvedOnce, Solver,
    SolverParameters, Swing,
};
use deaflow_field::{Field, Outcome, StateFields};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

use super::CaseGoal;

/// A solver on a second mesh, and how many times the difference between both meshes the error of the first may be.
pub type SecondMesh<S> = (S, f64);

/// The difference between a mesh and a coarser one is larger than the error on the finer one. That between a mesh and a
/// finer one is smaller than the error on the coarser one: for 16 patterns at most 1.5 times.
const MARGIN_OF_COARSER: f64 = 1.0;
const MARGIN_OF_FINER: f64 = 2.0;

/// Returns the parameters on a second mesh with the margin; `None` if the mesh follows from an accuracy.
pub fn second_mesh(solver: &SolverParameters) -> Option<SecondMesh<SolverParameters>> {
    let other = solver.with_comparison_mesh()?;
    let fineness = |of: &SolverParameters| of.mesh().map(|mesh| mesh.elements_per_cell() * mesh.order().degree());
    let margin = match fineness(&other) > fineness(solver) {
        true => MARGIN_OF_FINER,
        false => MARGIN_OF_COARSER,
    };
    Some((other, margin))
}

/// Returns the error of the value of a goal in mm from the fields in all states on two meshes, without the margin.
///
/// The difference of two values may be zero by chance, because its sign differs from place to place. So the error is at
/// least the root mean square difference of the displacements of the membrane, or of its heights for those and volumes.
/// For 16 patterns on 25 x 25 cells the difference alone was exceeded at 2 to 10 % of the corners, by up to a thousand
/// times; both together at 0 to 3 %, by up to 2.2 times.
fn mesh_error(goal: &Goal, fields: &[Field], others: &[Field]) -> f64 {
    let difference = (goal.value_mm(fields) - goal.value_mm(others)).abs();
    if goal.is_reaction() {
        return difference;
    }
    let states = fields.iter().zip(others);
    let usual = states.map(|(field, other)| match goal.is_out_of_plane() {
        true => rms_of_moved(field.plus(-1.0, other).heights()),
        false => rms_difference_of_moved(field, other),
    });
    usual.fold(difference, f64::max)
}

/// Returns the root mean square difference over the components that differ: corners that are held do not count.
fn rms_difference_of_moved(field: &Field, other: &Field) -> f64 {
    let difference = field.plus(-1.0, other);
    rms_of_moved(&[difference.values(), difference.heights()].concat())
}

/// Returns the root mean square of the differences that are not zero.
fn rms_of_moved(differences: &[f64]) -> f64 {
    let moved = || differences.iter().filter(|difference| **difference != 0.0);
    let sum = moved().fold(0.0, |sum, difference| sum + difference * difference);
    (sum / moved().count().max(1) as f64).sqrt()
}

/// The solvers of an amplitude on the mesh of the stage, and on a second mesh.
pub struct AmplitudeSolvers {
    /// On the mesh of the stage.
    pub own: Swing,
    /// On the second mesh.
    pub other: Option<SecondMesh<Swing>>,
    /// The solvers that tell the error of geometry, if elements follow cells in place of shapes.
    pub geometry: Option<SwingGeometry>,
}

/// On cells and on shapes, on the mesh of the stage; `None` if elements cannot follow the shapes.
pub type SwingGeometry = Option<[Swing; 2]>;

/// The solvers in each state of the device.
pub struct Solvers(Vec<StateSolvers>);

struct StateSolvers {
    /// On the mesh of the stage.
    own: Solver,
    /// On the second mesh.
    other: Option<SecondMesh<Solver>>,
    /// Errors of geometry, if elements follow cells in place of shapes.
    geometry: Option<GeometryErrors>,
}

/// The solutions of a pattern in each state of the device.
pub struct SolvedStates(Vec<SolvedState>);

/// The solution in one state, on two meshes.
struct SolvedState {
    result: AccurateSimulation,
    /// The history, if times are requested.
    history: Option<History>,
    /// The fields at all requested times; one field without times.
    fields: Option<Vec<Field>>,
    /// The same on the second mesh, with the margin.
    others: Option<SecondMesh<Vec<Field>>>,
    geometry: GeometrySolved,
}

/// The solutions that tell the error of geometry.
enum GeometrySolved {
    /// Elements follow all shapes.
    Exact,
    /// The fields at all requested times on cells and on shapes; `None` if one of them is missing.
    Compared(Option<[Vec<Field>; 2]>),
}

/// The simulation of a design.
pub struct Simulated {
    /// The outcome of the first state without a field, otherwise of the first state.
    pub outcome: Outcome,
    /// The fields in each state.
    pub fields: Option<StateFields>,
    /// Estimated discretisation error of the displacement along the target directions in mm, if known.
    pub error: Option<f64>,
    /// The value in mm at each requested time; empty without a field.
    pub values_mm: Vec<f64>,
    /// The history, if times are requested and there is one state.
    pub history: Option<History>,
}

impl Solvers {
    /// Creates the solvers of scenes with decided effects.
    ///
    /// # Errors
    /// If a scene cannot be simulated.
    pub fn new(solver: &SolverParameters, states: &[Scene]) -> Result<Self, SetupError> {
        let of_state = |scene: &Scene| {
            let other = second_mesh(solver).map(|(other, margin)| Ok((other.build(scene)?, margin)));
            Ok(StateSolvers {
                own: solver.build(scene)?,
                other: other.transpose()?,
                geometry: GeometryErrors::new(scene, solver, false)?,
            })
        };
        states.iter().map(of_state).collect::<Result<_, _>>().map(Self)
    }

    /// Simulates patterns.
    ///
    /// # Errors
    /// If a solver fails.
    pub fn solve(&self, patterns: &[Pattern]) -> Result<Vec<SolvedStates>, SetupError> {
        let mut solved: Vec<SolvedStates> = patterns.iter().map(|_| SolvedStates(Vec::new())).collect();
        for StateSolvers { own, other, geometry } in &self.0 {
            let (results, histories) = own.simulate_in_time(patterns)?;
            let mut histories = histories.unwrap_or_default().into_iter().map(|found| found.history);
            let mut others = match other {
                None => Vec::new(),
                Some((other, margin)) => {
                    let fields = fields_in_time(other.simulate_in_time(patterns)?).into_iter();
                    fields.map(|fields| Some((fields?, *margin))).collect()
                }
            }
            .into_iter();
            let compared = |pattern: &Pattern| match geometry {
                None => Ok(GeometrySolved::Exact),
                Some(geometry) => Ok(GeometrySolved::Compared(
                    geometry.solve(pattern, pattern)?.and_then(both_in_time),
                )),
            };
            let compared: Vec<_> = patterns.par_iter().map(compared).collect::<Result<_, SetupError>>()?;
            for ((SolvedStates(states), result), geometry) in solved.iter_mut().zip(results).zip(compared) {
                let history = histories.next();
                states.push(SolvedState {
                    fields: fields_of(&result, history.as_ref()),
                    others: others.next().flatten(),
                    result,
                    history,
                    geometry,
                });
            }
        }
        Ok(solved)
    }
}

impl SolvedStates {
    /// The simulation of a design for its goal.
    pub fn simulated(&self, case: &CaseGoal, pattern: &Pattern) -> Simulated {
        if let Some(amplitude) = &case.amplitude {
            return amplitude.simulated(&case.goal, pattern);
        }
        let goal = &case.goal;
        let Self(states) = self;
        let mut outcomes = states.iter().map(|state| state.result.simulation.outcome);
        let without = outcomes.find(|outcome| !outcome.has_field());
        let at_time = |at: usize| -> Option<StateFields> {
            let fields = states.iter().map(|state| state.fields.as_ref()?.get(at).cloned());
            fields.collect()
        };
        let fields = at_time(case.time_index);
        let others: Option<Vec<SecondMesh<Field>>> = states
            .iter()
            .map(|state| {
                let (fields, margin) = state.others.as_ref()?;
                Some((fields.get(case.time_index)?.clone(), *margin))
            })
            .collect();
        let both = fields.as_ref().zip(others);
        let difference = both.map(|(fields, others)| {
            let (others, margins): (StateFields, Vec<f64>) = others.into_iter().unzip();
            margins.into_iter().fold(1.0, f64::max) * mesh_error(goal, fields, &others)
        });
        let values_mm = (0..).map_while(at_time).map(|fields| goal.value_mm(&fields)).collect();
        // An error bound of every state is an error bound of their mean.
        let bounds = states.iter().map(|state| state.result.discretisation_error);
        // It is one of displacements, and not of forces.
        let bounds = bounds.collect::<Option<Vec<f64>>>().filter(|_| !goal.is_reaction());
        let bound = bounds.map(|errors| goal.value_per_displacement() * errors.into_iter().fold(0.0, f64::max));
        Simulated {
            outcome: without.unwrap_or(states[0].result.simulation.outcome),
            error: self
                .geometry_mm(case)
                .and_then(|geometry| Some(bound.or(difference)? + geometry)),
            values_mm,
            fields,
            history: match &states[..] {
                [only] => only.history.clone(),
                _ => None,
            },
        }
    }
}

impl SolvedStates {
    /// Returns the error of geometry of a goal in mm, if it is known.
    fn geometry_mm(&self, case: &CaseGoal) -> Option<f64> {
        let Self(states) = self;
        if states
            .iter()
            .all(|state| matches!(state.geometry, GeometrySolved::Exact))
        {
            return Some(0.0);
        }
        let fields = |on: usize| -> Option<StateFields> {
            let of_state = |state: &SolvedState| match &state.geometry {
                GeometrySolved::Exact => state.fields.as_ref()?.get(case.time_index).cloned(),
                GeometrySolved::Compared(both) => both.as_ref()?[on].get(case.time_index).cloned(),
            };
            states.iter().map(of_state).collect()
        };
        let [on_cells, on_shapes] = match &case.on_both {
            Some(both) => both.as_ref()?.each_ref(),
            None => [&case.goal; 2],
        };
        Some(GeometryError::between(
            on_cells.value_mm(&fields(0)?),
            on_shapes.value_mm(&fields(1)?),
        ))
    }
}

impl AmplitudeSolvers {
    fn simulated(&self, goal: &Goal, pattern: &Pattern) -> Simulated {
        let (outcome, field) = self.own.farthest(pattern);
        let value = |field: &Field| goal.value_mm(slice::from_ref(field));
        let difference = self.other.as_ref().and_then(|(other, margin)| {
            let (field, other) = (field.as_ref()?, other.farthest(pattern).1?);
            Some(margin * mesh_error(goal, slice::from_ref(field), slice::from_ref(&other)))
        });
        let geometry = match &self.geometry {
            None => Some(0.0),
            Some(solvers) => solvers.as_ref().and_then(|solvers| {
                let [on_cells, on_shapes] = solvers.each_ref().map(|swing| swing.farthest(pattern).1);
                Some(GeometryError::between(value(&on_cells?), value(&on_shapes?)))
            }),
        };
        Simulated {
            outcome,
            error: difference.zip(geometry).map(|(mesh, geometry)| mesh + geometry),
            values_mm: field.iter().map(value).collect(),
            fields: field.map(|field| vec![field]),
            history: None,
        }
    }
}

/// Returns the displacements from rest of a result at all requested times; one field without times.
fn fields_of(result: &AccurateSimulation, history: Option<&History>) -> Option<Vec<Field>> {
    let last = result.simulation.stroke()?;
    Some(history.map_or_else(|| vec![last], History::strokes))
}

/// Returns the fields of two solutions at all requested times, if both have them.
fn both_in_time([one, other]: [SolvedOnce; 2]) -> Option<[Vec<Field>; 2]> {
    let fields = |(result, history): SolvedOnce| fields_of(&result, history.as_ref().map(|found| &found.history));
    Some([fields(one)?, fields(other)?])
}

/// [`fields_of`] for several results.
fn fields_in_time(
    (results, histories): (Vec<AccurateSimulation>, Option<Vec<AccurateHistory>>),
) -> Vec<Option<Vec<Field>>> {
    let mut histories = histories.unwrap_or_default().into_iter();
    let each = results.iter();
    each.map(|result| fields_of(result, histories.next().map(|found| found.history).as_ref()))
        .collect()
}
