//! The displacement of each corner of the cells as a table, in the columns that an `import` stage reads.

use std::fmt::Write;

use crate::{CliError, Exit, Output};
use deaflow_report::RowSource;
use deaflow_scene::Scene;
use deaflow_store::Data;

/// The columns that an `import` stage reads.
const COLUMNS: &str = "sample,x_mm,y_mm,ux_mm,uy_mm,electrode";

/// Prints the fields of a file or an artifact with this scene. Samples without a field have no lines.
///
/// # Errors
/// When the scene, the displacement or the patterns are missing.
pub fn print(source: &dyn RowSource, scene: Option<&str>, output: &Output) -> Result<Exit, CliError> {
    let lacks = |what: &str| {
        CliError::bad_input(format!("{} has no {what}", source.title()))
            .help("--corners needs the output of `solve` or `predict`, or a stage of kind solve, import or balance")
    };
    let scene = scene.and_then(|text| Scene::from_text(text).ok());
    let membrane = scene.ok_or_else(|| lacks("scene"))?.membrane();
    let ([columns, rows], [width, height]) = (membrane.raster.sides(), membrane.cell_mm());
    let contents = source.contents()?;
    let shape_of = |path: &str| {
        contents
            .iter()
            .find(|array| array.path == path)
            .map(|array| &array.shape)
    };
    let samples = match shape_of("displacement").map(Vec::as_slice) {
        Some(&[n, y, x, 2]) if [x, y] == [columns + 1, rows + 1] => n,
        _ => return Err(lacks("displacement of the corners of cells")),
    };
    if shape_of("patterns").map(Vec::as_slice) != Some(&[samples, rows, columns]) {
        return Err(lacks("pattern for each of its fields"));
    }
    let (Data::F64(fields), Data::U8(cells)) = (source.elements("displacement")?, source.elements("patterns")?) else {
        return Err(lacks("displacement of the corners of cells"));
    };
    let fields = fields.chunks_exact(2 * (columns + 1) * (rows + 1));
    let patterns = cells.chunks_exact(columns * rows);
    output.plain(COLUMNS)?;
    let mut without = 0;
    for (sample, (field, cells)) in fields.zip(patterns).enumerate() {
        if !field[0].is_finite() {
            without += 1;
            continue;
        }
        let mut lines = String::new();
        for (at, u) in field.chunks_exact(2).enumerate() {
            let (x, y) = (at % (columns + 1), at / (columns + 1));
            let electrode = match x < columns && y < rows {
                true => cells[y * columns + x].to_string(),
                false => String::new(),
            };
            let place = [x as f64 * width, y as f64 * height];
            // Writing to a string cannot fail.
            let _ = writeln!(
                lines,
                "{sample},{},{},{:?},{:?},{electrode}",
                place[0], place[1], u[0], u[1]
            );
        }
        output.plain(&lines)?;
    }
    if without > 0 {
        output.note(&format!("omitted: {without} of {samples} samples, without a field"));
    }
    Ok(Exit::Done)
}
