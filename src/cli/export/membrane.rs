//! The deformed membrane of a design with stresses and electric field, for three-dimensional viewers.

use crate::CliError;
use crate::results::close_to_instability;
use crate::solve::inflation;
use deaflow_fem::screening::{ScreenedScene, TestPattern, examined, observing_breakdown, resolve};
use deaflow_fem::{
    CellState, CriticalSearch, InflationOutcome, InflationSolver, MembraneSolver, SolveOptions, WorkLimit,
};
use deaflow_pattern as pattern;
use deaflow_stage::designs::Design;
use deaflow_store::{Data, Dataset};

/// A membrane in equilibrium at the voltage of its scene.
pub struct Membrane {
    /// Columns and rows of elements.
    pub elements: [usize; 2],
    /// Positions of their corners without displacement, mm, `[y][x]`.
    pub coordinates: Vec<[f64; 2]>,
    /// The raster.
    pub plane: pattern::Membrane,
    /// Displacement of the corners of the elements along x, y and out of the plane, mm, `[y][x]`.
    pub displacement: Vec<[f64; 3]>,
    /// The largest displacement, mm.
    pub largest: f64,
    /// Means over each cell, `[y][x]`, by name.
    pub cells: Vec<(&'static str, Dataset)>,
    /// The scene as it was simulated.
    pub scene: String,
    /// Warnings about significant effects that were not simulated.
    pub warnings: Vec<String>,
}

/// Simulates a design by Newton's method.
///
/// # Errors
/// When the solver cannot be set up, or the membrane has no stable state at this voltage.
pub fn simulate(design: &Design, options: SolveOptions) -> Result<Membrane, CliError> {
    if design.scene.is_in_space() {
        return simulate_in_space(design, options);
    }
    let scene = resolve(&design.scene)?;
    let solver = MembraneSolver::new(&observing_breakdown(&scene), options)?;
    let solution = solver.solve(&design.pattern);
    if !solution.outcome.is_converged() {
        let outcome = &solution.outcome;
        return Err(CliError::failure(match outcome.bracket() {
            Some(_) => format!("no stable solution: {outcome}"),
            None => format!(
                "no solution was found, so the stability is not known: {}",
                outcome.name()
            ),
        }));
    }
    let search = CriticalSearch::if_in_question(&scene, options)?;
    let near_limit = search.and_then(|search| search.uncertain_limit(&design.pattern));
    let tests = [TestPattern::new("design", design.pattern.clone())];
    let solved = [examined(
        "design",
        &scene,
        &design.pattern,
        &solver.simulation(&design.pattern, &solution),
    )];
    let screened = ScreenedScene::for_solutions(&scene, &tests, &solved, WorkLimit::default())?;
    let warnings = screened.warnings.into_iter().chain(screened.breakdown_warning);
    let displacement = solver.corner_displacements(&solution);
    let displacement: Vec<[f64; 3]> = displacement.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
    let states = solver.cell_states(&design.pattern, &solution);
    Ok(Membrane {
        elements: solver.grid().elements(),
        coordinates: solver.corner_places(),
        plane: screened.scene.membrane(),
        largest: largest(&displacement),
        displacement,
        cells: cells(design, &states, screened.scene.thickness_mm()),
        scene: screened.scene.to_text(),
        warnings: warnings.chain(near_limit.map(close_to_instability)).collect(),
    })
}

/// Simulates a design that leaves its plane: at the corners of cells, without states of cells.
fn simulate_in_space(design: &Design, options: SolveOptions) -> Result<Membrane, CliError> {
    let (scene, left_out) = inflation::resolved(&design.scene)?;
    let solver = InflationSolver::new(&scene.with_electrodes_of(&design.pattern), options)?;
    let found = solver.solve(&design.pattern);
    if found.outcome != InflationOutcome::Converged {
        let outcome = inflation::outcome(&found, &scene);
        return Err(CliError::failure(format!("no stable solution: {outcome}")));
    }
    let plane = scene.membrane();
    let [columns, rows] = plane.raster.sides();
    let corners = (0..=rows).flat_map(|row| (0..=columns).map(move |column| [column, row]));
    let displacement: Vec<[f64; 3]> = inflation::components(&found.displacement, &found.heights).collect();
    let of_state = inflation::warnings_of_states(&scene, &[("design".to_owned(), &found)]);
    Ok(Membrane {
        elements: [columns, rows],
        coordinates: corners.map(|corner| inflation::corner_mm(corner, &scene)).collect(),
        plane,
        largest: largest(&displacement),
        displacement,
        cells: vec![active(design)],
        scene: scene.to_text(),
        warnings: left_out.into_iter().chain(of_state).collect(),
    })
}

/// Returns the largest magnitude.
fn largest(displacement: &[[f64; 3]]) -> f64 {
    let magnitude = |[x, y, z]: &[f64; 3]| x.hypot(*y).hypot(*z);
    displacement.iter().map(magnitude).fold(0.0, f64::max)
}

/// Returns the electrode group of each cell.
fn active(design: &Design) -> (&'static str, Dataset) {
    let groups = design.pattern.cells().to_vec();
    let description = "number of the group of electrodes, 0 = bare";
    (
        "active",
        Dataset::new("1", description, &[groups.len()], Data::U8(groups)),
    )
}

fn cells(design: &Design, states: &[CellState], thickness: f64) -> Vec<(&'static str, Dataset)> {
    let real = |units: &str, description: &str, width: usize, value: &dyn Fn(&CellState) -> Vec<f64>| {
        let values = states.iter().flat_map(value).collect();
        let shape: &[usize] = if width == 1 {
            &[states.len()]
        } else {
            &[states.len(), width]
        };
        Dataset::new(units, description, shape, Data::F64(values))
    };
    // Plane stress: the third row and column are zero.
    let piola = |state: &CellState| {
        let p = state.piola;
        vec![p[0][0], p[0][1], 0.0, p[1][0], p[1][1], 0.0, 0.0, 0.0, 0.0]
    };
    let current = |state: &CellState| thickness / (state.stretches[0] * state.stretches[1]);
    let tension = states.iter().map(|state| state.tension.code()).collect();
    vec![
        active(design),
        (
            "first_piola_stress",
            real(
                "Pa",
                "first Piola-Kirchhoff stress, component by material direction, 3 x 3",
                9,
                &piola,
            ),
        ),
        (
            "principal_stresses",
            real("Pa", "in-plane principal Cauchy stresses, larger first", 2, &|s| {
                s.stresses.to_vec()
            }),
        ),
        (
            "stretches",
            real(
                "1",
                "in-plane principal stretches from the undeformed state, larger first",
                2,
                &|s| s.stretches.to_vec(),
            ),
        ),
        (
            "electric_field",
            real("V/m", "true electric field", 1, &|s| vec![s.electric_field]),
        ),
        (
            "thickness",
            real("mm", "thickness under voltage", 1, &|s| vec![current(s)]),
        ),
        (
            "tension",
            Dataset::new("1", "0 taut, 1 wrinkled, 2 slack", &[states.len()], Data::U8(tension)),
        ),
    ]
}
