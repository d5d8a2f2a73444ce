//! Many designs at a glance: each membrane deformed, with what it reaches.

use std::path::Path;

use super::agreement::Case;
use super::canvas::{FigureError, draw, px};
use super::membrane::{Membrane, exaggeration, thumbnail};

/// Membranes in a row.
const COLUMNS: usize = 8;

/// Pixels of a membrane with its caption.
const TILE: (u32, u32) = (240, 300);

/// Draws each design deformed, row by row, displacements exaggerated alike.
///
/// # Errors
/// When there are no designs or data are incomplete, or the file cannot be written.
pub fn draw_gallery(path: &Path, cases: &[Case]) -> Result<(), FigureError> {
    cases.iter().try_for_each(|case| case.membrane.validate())?;
    if cases.is_empty() || cases.iter().any(|case| !case.simulated.is_finite()) {
        return Err(FigureError::Data(
            "a gallery needs designs with finite displacements".into(),
        ));
    }
    let columns = cases.len().min(COLUMNS);
    let rows = cases.len().div_ceil(columns);
    let size = (TILE.0 * columns as u32, TILE.1 * rows as u32);
    draw(path, size, |sheet| {
        let membranes: Vec<&Membrane> = cases.iter().map(|case| &case.membrane).collect();
        let scale = exaggeration(&membranes);
        let tiles = sheet.split_evenly((rows, columns));
        for (tile, case) in tiles.iter().zip(cases) {
            let name = case.name.split_once(": ").map_or(case.name.as_str(), |(name, _)| name);
            let captions = [name.to_owned(), format!("{:.3} mm", case.simulated)];
            thumbnail(
                &tile.margin(px(4), px(4), px(8), px(8)),
                &captions,
                &case.membrane,
                scale,
            )?;
        }
        Ok(())
    })
}
