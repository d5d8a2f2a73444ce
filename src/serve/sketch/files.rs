//! Drawn patterns as files, in the formats that the commands read and write.

use std::fs;
use std::io::Write;

use serde_json::json;

use super::drawn::Drawn;
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_pattern::{Pattern, read_patterns_of};
use deaflow_report::export::{self, mask_drawing};
use deaflow_scene::{Mask, Size};

/// Formats that are read.
const READ: [&str; 3] = ["csv", "npy", "png"];

/// Formats that are written, with their media types.
const WRITTEN: [(&str, &str); 6] = [
    ("csv", "text/csv"),
    ("npy", "application/octet-stream"),
    ("png", "image/png"),
    ("svg", "image/svg+xml"),
    ("dxf", "image/vnd.dxf"),
    ("gbr", "application/vnd.gerber"),
];

/// Pixels for each cell of an image.
const PIXELS: usize = 8;

/// The patterns of a file, which is the body: `?format=` says of which format, `?scene=` for which scene that is served.
///
/// # Errors
/// When it holds none.
pub fn import(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&["format", "scene"])?;
    let format = request.word("format").unwrap_or_default();
    if !READ.contains(&format) {
        return Err(
            Refusal::bad(format!("{format:?} is no format that is read here")).help(format!(
                "allowed: {}; svg and dxf are read by the page itself",
                READ.join(", ")
            )),
        );
    }
    let scene = state.scene(request.word("scene"));
    let scene =
        scene.ok_or_else(|| Refusal::absent("there is no scene of that name").help("GET /api/scenes lists them"))?;
    let failed = |error: std::io::Error| Refusal::new(500, format!("the file cannot be laid down: {error}"));
    // The readers take files; this one has a name of our own, in a folder of our own that goes with it.
    let folder = tempfile::tempdir().map_err(failed)?;
    let path = folder.path().join(format!("drawn.{format}"));
    let mut file = fs::File::create_new(&path).map_err(failed)?;
    file.write_all(&request.body).map_err(failed)?;
    let form = scene.form();
    let found = read_patterns_of(&path, None, form);
    let found = found.map_err(|refusal| Refusal::bad(refusal.to_string()).help(refusal.advice(form)))?;
    let columns = form.raster.columns();
    let rows = |pattern: &Pattern| pattern.cells().chunks(columns).map(<[u8]>::to_vec).collect::<Vec<_>>();
    Ok(json!({ "patterns": found.iter().map(rows).collect::<Vec<_>>() }).into())
}

/// The pattern as a file.
///
/// # Errors
/// When the format is not known, or cannot hold it.
pub fn export(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let drawn: Drawn = request.json()?;
    let scene = drawn.scene(state)?;
    let pattern = drawn.pattern(&scene)?;
    let wanted = drawn.format.as_deref().unwrap_or_default();
    let Some((format, media)) = WRITTEN.into_iter().find(|(format, _)| *format == wanted) else {
        let all: Vec<&str> = WRITTEN.iter().map(|(format, _)| *format).collect();
        return Err(Refusal::bad(format!("{wanted:?} is no format that is written"))
            .help(format!("allowed: {}", all.join(", "))));
    };
    let size = match drawn.size.as_deref() {
        None | Some("prestretched") => Size::Prestretched,
        Some("undeformed") => Size::Undeformed,
        Some(other) => {
            return Err(Refusal::bad(format!("`size` cannot be {other:?}")).help("allowed: prestretched, undeformed"));
        }
    };
    if format == "gbr" && scene.groups() > 1 {
        return Err(Refusal::bad(
            "a Gerber file is one layer, and there are several groups of electrodes",
        ));
    }
    let mask = Mask::new(&pattern, &scene, size, drawn.smooth && !matches!(format, "csv" | "npy"));
    let drawing = mask_drawing(&mask, "drawn", "the sketchpad".to_owned(), Vec::new());
    let [columns, rows] = pattern.raster().sides();
    let bytes = match format {
        "csv" => export::csv(drawing.lines(), pattern.cells(), columns),
        "npy" => npy(&pattern),
        "svg" => export::svg(&drawing),
        "dxf" => export::dxf(&drawing),
        "gbr" => export::gerber(&drawing),
        _ => export::png(&drawing, [PIXELS * columns, PIXELS * rows])
            .map_err(|error| Refusal::new(500, format!("the image cannot be drawn: {error}")))?,
    };
    Ok(Answer::Bytes {
        media,
        bytes,
        file: Some(format!("drawn.{format}")),
    })
}

/// The cells as an array of NumPy, `[y][x]` from below (numpy.lib.format, version 1).
fn npy(pattern: &Pattern) -> Vec<u8> {
    let [columns, rows] = pattern.raster().sides();
    let header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // Magic, version, length and header fill whole blocks of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = length - 1).into_bytes());
    bytes.extend(pattern.cells());
    bytes
}
