//! `deaflow solve --cells`: stretches, stresses and electric field of each cell.

use deaflow_content::{CellFields, NO_STATE, Packed, Row};
use deaflow_fem::CellState;
use deaflow_pattern::Raster;

/// The states of the cells of one pattern, `[y][x]`; `None` without a stable solution.
pub type States = Option<Vec<CellState>>;

/// Returns the arrays of the cells of all patterns.
pub fn fields(results: &[&States], raster: Raster) -> CellFields {
    let codes = |states: &&States| match states {
        Some(states) => states.iter().map(|state| state.tension.code()).collect(),
        None => vec![NO_STATE; raster.cells()],
    };
    CellFields {
        stretches: packed(results, raster, |state| state.stretches),
        electric_field: packed(results, raster, |state| [state.electric_field]),
        first_piola_stress: packed(results, raster, |state| [0, 1, 2, 3].map(|i| state.piola[i / 2][i % 2])),
        principal_stresses: packed(results, raster, |state| state.stresses),
        state: Packed(results.iter().flat_map(codes).collect()),
    }
}

/// Returns the values of each cell; NaN without a solution.
fn packed<R: Row<Value = f64>, const N: usize>(
    results: &[&States],
    raster: Raster,
    values: fn(&CellState) -> [f64; N],
) -> Packed<R> {
    let mut all = Vec::with_capacity(results.len() * raster.cells() * N);
    for states in results {
        match states {
            Some(states) => all.extend(states.iter().flat_map(values)),
            None => all.extend(std::iter::repeat_n(f64::NAN, raster.cells() * N)),
        }
    }
    Packed(all)
}
