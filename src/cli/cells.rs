//! `solve --cells`: what an engineer asks of a solution, cell by cell.

use crate::content::{CellFields, NO_STATE, Packed, Row};
use crate::fem::CellState;
use crate::pattern::CELLS;

/// The states of the cells of one pattern, `[y][x]`; `None` where there is no stable solution.
pub type States = Option<Vec<CellState>>;

/// The states of the cells of all patterns.
pub fn fields(results: &[States]) -> CellFields {
    let codes = |states: &States| match states {
        Some(states) => states.iter().map(|state| state.tension.code()).collect(),
        None => vec![NO_STATE; CELLS * CELLS],
    };
    CellFields {
        stretches: packed(results, |state| state.stretches),
        electric_field: packed(results, |state| [state.electric_field]),
        first_piola_stress: packed(results, |state| [0, 1, 2, 3].map(|i| state.piola[i / 2][i % 2])),
        principal_stresses: packed(results, |state| state.stresses),
        state: Packed(results.iter().flat_map(codes).collect()),
    }
}

/// Values of each cell; NaN where there is no solution.
fn packed<R: Row<Value = f64>, const N: usize>(results: &[States], values: fn(&CellState) -> [f64; N]) -> Packed<R> {
    let mut all = Vec::with_capacity(results.len() * CELLS * CELLS * N);
    for states in results {
        match states {
            Some(states) => all.extend(states.iter().flat_map(values)),
            None => all.extend(std::iter::repeat_n(f64::NAN, CELLS * CELLS * N)),
        }
    }
    Packed(all)
}
