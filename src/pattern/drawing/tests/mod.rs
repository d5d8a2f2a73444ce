//! Drawings with known areas, and hostile ones.

mod dxf;
mod fuzz;
mod svg;

use super::{Drawing, DrawingFormat, DrawingOptions, read_text};
use crate::PatternFileError;
use crate::contour::area as area_of_sets;

/// Asserts a relative difference of less than 1e-12, rounding.
#[track_caller]
fn assert_exact(found: f64, exact: f64) {
    assert!((found / exact - 1.0).abs() < 1e-12, "{found} {exact}");
}

/// Reads a drawing with one group.
fn read(text: &str, format: DrawingFormat, options: &DrawingOptions) -> Result<Drawing, PatternFileError> {
    let mut groups = read_text(text, format, options)?;
    assert_eq!(groups.iter().map(|(group, _)| *group).collect::<Vec<_>>(), [1]);
    Ok(groups.remove(0).1)
}

/// Returns the area that a drawing fills.
fn area(drawing: &Drawing) -> f64 {
    let sets: Vec<_> = drawing.filled.iter().map(|filled| filled.contours.clone()).collect();
    area_of_sets(&sets, &|windings: &[i32]| {
        let mut each = drawing.filled.iter().zip(windings);
        each.any(|(filled, winding)| filled.rule.fills(*winding))
    })
}
