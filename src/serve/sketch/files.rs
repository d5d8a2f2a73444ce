//! Drawn patterns as files: import and export.

use std::fs;
use std::io::Write;

use serde_json::json;

use super::request::SketchRequest;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_pattern::{DrawingOptions, Pattern, read_patterns_of};
use deaflow_report::export::{self, mask_drawing};
use deaflow_scene::{Mask, Size};

/// Formats that can be imported.
const IMPORT_FORMATS: [&str; 10] = ["csv", "npy", "png", "jpg", "jpeg", "tif", "tiff", "bmp", "dxf", "svg"];

/// Formats that can be exported, with their media types.
const EXPORT_FORMATS: [(&str, &str); 6] = [
    ("csv", "text/csv"),
    ("npy", "application/octet-stream"),
    ("png", "image/png"),
    ("svg", "image/svg+xml"),
    ("dxf", "image/vnd.dxf"),
    ("gbr", "application/vnd.gerber"),
];

/// Pixels for each cell of an image.
const PIXELS: usize = 8;

/// Reads the patterns of the file in the body; `?format=` is its format, `?scene=` the scene.
///
/// # Errors
/// If it has no pattern.
pub fn import(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&["format", "scene"])?;
    let format = request.parameter("format").unwrap_or_default();
    if !IMPORT_FORMATS.contains(&format) {
        let allowed = IMPORT_FORMATS.join(", ");
        return Err(ApiError::bad_request(format!("cannot read format {format:?}")).help(format!("allowed: {allowed}")));
    }
    let scene = state.scene(request.query.get("scene").map(String::as_str));
    let scene = scene.ok_or_else(|| ApiError::not_found("unknown scene").help("GET /api/scenes lists the scenes"))?;
    let failed = |error: std::io::Error| ApiError::new(500, format!("cannot write a temporary file: {error}"));
    // The readers need a file: this one is in a temporary folder, which is removed at the end.
    let folder = tempfile::tempdir().map_err(failed)?;
    let path = folder.path().join(format!("drawn.{format}"));
    let mut file = fs::File::create_new(&path).map_err(failed)?;
    file.write_all(&request.body).map_err(failed)?;
    let form = scene.form();
    let found = read_patterns_of(&path, None, form, &DrawingOptions::default());
    let found = found.map_err(|error| ApiError::bad_request(error.to_string()).help(error.advice(form)))?;
    let columns = form.raster.columns();
    let rows = |pattern: &Pattern| pattern.cells().chunks(columns).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let patterns: Vec<_> = found.patterns.iter().map(rows).collect();
    Ok(json!({ "patterns": patterns, "notes": found.notes }).into())
}

/// Writes the pattern as a file.
///
/// # Errors
/// If the format is unknown, or cannot hold the pattern.
pub fn export(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let drawn: SketchRequest = request.json()?;
    let scene = drawn.scene(state)?;
    let pattern = drawn.pattern(&scene)?;
    let format = drawn.format.as_deref().unwrap_or_default();
    let Some((format, media)) = EXPORT_FORMATS.into_iter().find(|(known, _)| *known == format) else {
        let all = EXPORT_FORMATS.map(|(known, _)| known).join(", ");
        return Err(ApiError::bad_request(format!("cannot write format {format:?}")).help(format!("allowed: {all}")));
    };
    let size = match drawn.size.as_deref() {
        None | Some("prestretched") => Size::Prestretched,
        Some("undeformed") => Size::Undeformed,
        Some(other) => {
            return Err(
                ApiError::bad_request(format!("invalid `size`: {other:?}")).help("allowed: prestretched, undeformed")
            );
        }
    };
    if format == "gbr" && scene.groups() > 1 {
        return Err(
            ApiError::bad_request("a Gerber file has one layer, but the pattern has several electrode groups")
                .help("export svg or dxf"),
        );
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
            .map_err(|error| ApiError::new(500, format!("cannot draw the image: {error}")))?,
    };
    Ok(Response::Bytes {
        media,
        bytes,
        file: Some(format!("drawn.{format}")),
    })
}

/// Writes the cells as a NumPy array, `[y][x]` from below (numpy.lib.format, version 1).
fn npy(pattern: &Pattern) -> Vec<u8> {
    let [columns, rows] = pattern.raster().sides();
    let header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // The header is padded to a multiple of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = length - 1).into_bytes());
    bytes.extend(pattern.cells());
    bytes
}
