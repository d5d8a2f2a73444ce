//! `solve --cells`: what an engineer asks of a solution, cell by cell.

use rayon::prelude::*;

use super::arrays;
use crate::fem::{CellState, MembraneSolver, Tension};
use crate::field::Simulation;
use crate::pattern::{CELLS, Pattern};
use crate::store::{Data, Dataset, Object};

/// The states of the cells of one pattern, `[y][x]`; `None` where there is no stable solution.
pub type States = Option<Vec<CellState>>;

/// Simulates patterns and keeps the states of their cells.
pub fn simulate(solver: &MembraneSolver, patterns: &[Pattern]) -> Vec<(Simulation, States)> {
    let each = |pattern: &Pattern| {
        let solution = solver.solve(pattern);
        let converged = solution.outcome.is_converged();
        let states = converged.then(|| solver.cell_states(pattern, &solution));
        (solver.simulation(pattern, &solution), states)
    };
    patterns.par_iter().map(each).collect()
}

/// The part of the membrane that is wrinkled or slack; `None` where there is no solution.
pub fn wrinkled_fraction(states: &States) -> Option<f64> {
    let states = states.as_ref()?;
    let wrinkled = states.iter().filter(|state| state.tension != Tension::Taut).count();
    Some(wrinkled as f64 / states.len() as f64)
}

/// Adds the datasets of the cells.
pub fn describe(mut content: Object, results: &[States]) -> Object {
    type Values<const N: usize> = fn(&CellState) -> [f64; N];
    let stretches: Values<2> = |state| state.stretches;
    let field: Values<1> = |state| [state.electric_field];
    let piola: Values<4> = |state| [0, 1, 2, 3].map(|i| state.piola[i / 2][i % 2]);
    let stresses: Values<2> = |state| state.stresses;
    let note =
        |what: &str| format!("{what}, mean over each cell [sample][y][x]; NaN where there is no stable solution");
    let datasets = [
        (
            "cells/stretches",
            real(
                "1",
                &note("in-plane principal stretches from the undeformed state, larger first"),
                &[2],
                results,
                stretches,
            ),
        ),
        (
            "cells/electric_field",
            real("V/m", &note("true electric field"), &[], results, field),
        ),
        (
            "cells/first_piola_stress",
            real(
                "Pa",
                &note("first Piola-Kirchhoff stress [component][material direction]"),
                &[2, 2],
                results,
                piola,
            ),
        ),
        (
            "cells/principal_stresses",
            real(
                "Pa",
                &note("in-plane principal Cauchy stresses, larger first"),
                &[2],
                results,
                stresses,
            ),
        ),
        ("cells/state", codes(results)),
        (
            "wrinkled_fraction",
            arrays::reals(
                "1",
                "part of the membrane whose cells are wrinkled or slack; NaN where there is no stable solution",
                results
                    .iter()
                    .map(|states| wrinkled_fraction(states).unwrap_or(f64::NAN))
                    .collect(),
            ),
        ),
    ];
    for (name, dataset) in datasets {
        content = content.with(name, dataset);
    }
    content
}

fn real<const N: usize>(
    units: &str,
    description: &str,
    inner: &[usize],
    results: &[States],
    values: fn(&CellState) -> [f64; N],
) -> Dataset {
    let mut data = Vec::with_capacity(results.len() * CELLS * CELLS * N);
    for states in results {
        match states {
            Some(states) => data.extend(states.iter().flat_map(values)),
            None => data.extend(std::iter::repeat_n(f64::NAN, CELLS * CELLS * N)),
        }
    }
    let shape = [&[results.len(), CELLS, CELLS], inner].concat();
    Dataset::new(units, description, &shape, Data::F64(data))
}

/// No number says that there is no solution in bytes but one that means nothing else.
const UNKNOWN: u8 = 255;

fn codes(results: &[States]) -> Dataset {
    let code = |states: &States| match states {
        Some(states) => states.iter().map(|state| state.tension.code()).collect(),
        None => vec![UNKNOWN; CELLS * CELLS],
    };
    let note = "0 taut, 1 wrinkled (tension in one direction only), 2 slack, 255 no stable solution [sample][y][x]";
    let shape = [results.len(), CELLS, CELLS];
    Dataset::new("1", note, &shape, Data::U8(results.iter().flat_map(code).collect()))
}
