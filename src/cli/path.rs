//! `deaflow solve --path`: how patterns get from rest to the loss of stability, and what lies beyond.

use std::time::Instant;

use serde_json::{Value, json};

use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::solve::{SolveArguments, check_file, provenance};
use super::{table, write};
use crate::report::figures::{Branch, Limit, draw_paths};
use crate::stage::direct;
use crate::stage::path::{self, LoadPath, PathAnswer};
use crate::store::write_file;

/// Follows the paths of patterns and writes them as arrays, as a table and as a figure.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, memory is short, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, scene: &str, output: &Output) -> Result<Exit, CliError> {
    let file = &arguments.patterns.output;
    let (values, figure) = (file.with_extension("csv"), file.with_extension("png"));
    if [&values, &figure].contains(&file) {
        return Err(
            CliError::bad_input(format!("{} would be written twice", file.display()))
                .help("-o names the HDF5 file, as in OUT.h5; OUT.csv and OUT.png are written beside it"),
        );
    }
    for beside in [&values, &figure] {
        check_file(beside, &arguments.patterns, scene)?;
    }
    let patterns = direct::patterns(&arguments.patterns.patterns)?;
    let options = arguments.options();
    let (bar, start) = (Bar::new("path", "patterns", patterns.len() as u64), Instant::now());
    let answer = path::paths(&arguments.scene, &patterns, options, &bar)?;
    bar.finish("done");
    let seconds = start.elapsed().as_secs_f64();
    let parameters = format!(
        "scene {}, {}, tolerance: {:e}, path",
        arguments.scene.display(),
        options.mesh,
        options.tolerance
    );
    write_file(file, &answer.content, &provenance("solve", parameters, seconds))?;
    write::file(&values, path::table(&answer.paths).as_bytes())?;
    let branches: Vec<Branch> = answer.paths.iter().enumerate().map(branch).collect();
    draw_paths(&figure, &branches)?;
    if output.is_json() {
        output.document(&json!({
            "file": file,
            "table": values,
            "figure": figure,
            "paths": answer.paths.iter().map(document).collect::<Vec<_>>(),
            "seconds": seconds,
        }))?;
    } else {
        let files = [file, &values, &figure].map(|path| path.display().to_string());
        let time = table::seconds(seconds);
        output.text(&format!("{}\n{} in {time}", overview(&answer), files.join(", ")))?;
    }
    Ok(Exit::Done)
}

/// One line per pattern.
fn overview(answer: &PathAnswer) -> String {
    let header = ["pattern", "limit", "voltage", "displacement", "points", "end"];
    let mut table = table::table(&header, &["voltage", "displacement", "points"]);
    for (index, path) in answer.paths.iter().enumerate() {
        let limit = path.limit();
        let displacement = limit
            .and_then(|limit| path.points.get(limit.point))
            .map(|p| p.max_displacement);
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        table.add_row([
            index.to_string(),
            limit.map_or("none", |limit| limit.kind.name()).to_owned(),
            or_dash(limit.map(|limit| format!("{:.1} V", limit.voltage))),
            or_dash(displacement.map(|mm| format!("{mm:.4} mm"))),
            path.points.len().to_string(),
            path.end.name().to_owned(),
        ]);
    }
    table.trim_fmt()
}

fn document(path: &LoadPath) -> Value {
    let points = path.points.iter().map(|p| {
        json!({
            "voltage": p.voltage,
            "max_displacement": p.max_displacement,
            "displacement": p.displacement,
            "smallest_eigenvalue": p.smallest_eigenvalue,
            "negative_eigenvalues": p.negative_eigenvalues,
            "stable": p.stable,
        })
    });
    let events: Vec<Value> = path
        .events
        .iter()
        .map(|event| json!({ "kind": event.kind.name(), "voltage": event.voltage, "point": event.point }))
        .collect();
    json!({
        "limit": events.first(),
        "watched_corner": path.watched,
        "points": points.collect::<Vec<_>>(),
        "events": events,
        "end": path.end.name(),
    })
}

/// What the figure shows of a path.
fn branch((index, path): (usize, &LoadPath)) -> Branch {
    let limit = path.limit().and_then(|limit| {
        let at = path.points.get(limit.point)?;
        Some(Limit {
            name: limit.kind.name().to_owned(),
            voltage: limit.voltage,
            displacement: at.displacement,
        })
    });
    Branch {
        name: format!("pattern {index}"),
        voltage: path.points.iter().map(|p| p.voltage).collect(),
        displacement: path.points.iter().map(|p| p.displacement).collect(),
        stable: path.points.iter().map(|p| p.stable).collect(),
        limit,
    }
}
