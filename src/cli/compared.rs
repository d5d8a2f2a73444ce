//! How measured numbers agree with simulated ones, for people and scripts.

use std::path::Path;

use serde_json::{Value, json};

use super::text::Text;
use super::{CliError, Output, table, write};
use deaflow_base::{four_significant, with_minus};
use deaflow_report::figures::measured_sheet;
use deaflow_report::figures_of_files;
use deaflow_scene::Scene;
use deaflow_stage::measured::{Agreement, Compared, MeasuredSet, Values, compared_files, compared_rows, named_notes};

/// Returns a table with a row for each file.
pub fn summary(compared: &[Compared]) -> Text {
    let header = ["file", "points", "bias", "RMS", "largest", "R²", "χ²/dof"];
    let numbers = &header[1..];
    let mut table = table::table(&header, numbers);
    for one in compared {
        let Agreement {
            points,
            bias,
            rms,
            largest,
            r_squared,
            chi2_per_dof,
        } = &one.agreement;
        let bias = bias.map_or_else(|| "–".to_owned(), |bias| with_unit(bias, &one.values));
        table.add_row([
            one.name.clone(),
            points.to_string(),
            bias,
            with_unit(*rms, &one.values),
            format!("{} (row {})", with_unit(largest.0, &one.values), largest.1),
            r_squared.map_or_else(|| "–".to_owned(), |r| with_minus(&format!("{r:.4}"))),
            chi2_per_dof.map_or_else(|| "–".to_owned(), four_significant),
        ]);
    }
    let mut text = Text::of(table);
    for one in compared {
        if let [first, ..] = one.without_equilibrium[..] {
            let count = one.without_equilibrium.len();
            text.line(format!(
                "{}: the simulation has no stable equilibrium at {}, the first of them row {first}; they are not \
                 compared",
                one.name,
                table::counted(count as u64, "rows")
            ));
        }
        if let Values::Field { result, .. } = &one.values {
            let [x, y] = result.translation_mm.map(four_significant);
            let degrees = four_significant(result.rotation.to_degrees());
            text.line(format!("{}: motion of the camera {x}, {y} mm and {degrees}°", one.name));
        }
    }
    text
}

/// Writes a number with its unit.
pub fn with_unit(value: f64, values: &Values) -> String {
    values.quantities().measured().dimension.with_unit(value)
}

/// Warns of the notes of all files, and returns them.
pub fn notes(sets: &[MeasuredSet], output: &Output) -> Vec<String> {
    let notes: Vec<String> = sets.iter().flat_map(|set| named_notes(&set.name, &set.notes)).collect();
    notes.iter().for_each(|note| output.warn(note));
    notes
}

/// Writes a file and draws the figure next to it; returns the names of both.
///
/// # Errors
/// When the file cannot be written.
pub fn write_with_figure(
    file: &Path,
    bytes: &[u8],
    compared: &[Compared],
    scene: &Scene,
    output: &Output,
) -> Result<Vec<String>, CliError> {
    write::file(file, bytes)?;
    let draw = |path: &Path| {
        let figures = figures_of_files(&compared_files(compared), &compared_rows(compared), scene);
        measured_sheet(&figures)?.write_png(path)
    };
    let figure = write::drawn(file.with_extension("png"), draw, output);
    let written = std::iter::once(file.to_path_buf()).chain(figure);
    Ok(written.map(|path| path.display().to_string()).collect())
}

/// Describes all files.
pub fn document(compared: &[Compared]) -> Value {
    let one = |one: &Compared| {
        let own = &one.agreement;
        let mut found = json!({
            "file": one.name,
            "points": own.points,
            "without_equilibrium": one.without_equilibrium,
            "bias": own.bias,
            "rms": own.rms,
            "largest": own.largest.0,
            "largest_row": own.largest.1,
            "r_squared": own.r_squared,
            "chi2_per_dof": own.chi2_per_dof,
        });
        if let Values::Field { result, .. } = &one.values {
            found["camera"] = json!({ "translation_mm": result.translation_mm, "rotation_rad": result.rotation });
        }
        found
    };
    compared.iter().map(one).collect()
}
