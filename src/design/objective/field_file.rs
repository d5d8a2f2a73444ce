//! Reads a target displacement field from a CSV file.

use std::path::Path;

use super::points::{MAX_MM, PointParameters};
use deaflow_base::{Decimal, Dimension, InputError, Length, Node, Quantity, confined, read_bounded};
use deaflow_field::CORNERS;

const COLUMNS: [&str; 4] = ["x_mm", "y_mm", "ux_mm", "uy_mm"];

/// Maximum number of points: the number of corners of the paper's raster.
const MAX_POINTS: usize = CORNERS * CORNERS;

/// Maximum size of the file.
const MAX_BYTES: u64 = 1 << 20;

/// Reads the CSV file that a node names: a header, then one line per point.
///
/// # Errors
/// If the file does not exist, is outside the folder of the pipeline, or has invalid content; with the line.
pub(super) fn read(node: &Node) -> Result<Vec<PointParameters>, InputError> {
    let named = Path::new(node.text("field")?);
    let folder = node.file().parent().unwrap_or(Path::new(""));
    let path = folder.join(named);
    let refused = |why: &str| node.error(format!("the file {}: {why}", path.display()));
    let found = confined(folder, named).map_err(|why| refused(&why.to_string()).help(why.help()))?;
    let bytes = read_bounded(&found, MAX_BYTES).map_err(|e| refused(&e.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|_| refused("it is not UTF-8 text"))?;
    points(&text).map_err(|why| refused(&why.to_string()).help(format!("the first line is {}", COLUMNS.join(","))))
}

/// Errors of a file of points.
#[derive(Debug, thiserror::Error)]
enum FieldFileError {
    #[error("wrong columns {0}")]
    Columns(String),
    #[error("line {line}: {why}")]
    Line { line: usize, why: LineError },
    #[error("the file has no points")]
    Empty,
    #[error("{0} points; allowed: at most {MAX_POINTS}")]
    Points(usize),
}

/// Errors of a line.
#[derive(Debug, thiserror::Error)]
enum LineError {
    #[error("{0:?} is not a length in mm up to {MAX_MM}")]
    Length(String),
    #[error("{0} numbers, expected 4")]
    Numbers(usize),
}

fn points(text: &str) -> Result<Vec<PointParameters>, FieldFileError> {
    let mut lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty());
    let header = lines.next().map_or("", |(line, _)| line);
    let header: Vec<&str> = header.split(',').map(str::trim).collect();
    if header != COLUMNS {
        return Err(FieldFileError::Columns(header.join(",")));
    }
    let points: Vec<PointParameters> = lines
        .map(|(text, line)| point(text).map_err(|why| FieldFileError::Line { line, why }))
        .collect::<Result<_, _>>()?;
    match points.len() {
        0 => Err(FieldFileError::Empty),
        1..=MAX_POINTS => Ok(points),
        more => Err(FieldFileError::Points(more)),
    }
}

fn point(line: &str) -> Result<PointParameters, LineError> {
    let length = |cell: &str| match Quantity::parse(cell.trim(), Dimension::Length) {
        Ok(length) if length.value().abs() <= MAX_MM => Ok(Length::from_base(length.base())),
        _ => Err(LineError::Length(cell.trim().to_owned())),
    };
    let numbers: Vec<Length> = line.split(',').map(length).collect::<Result<_, _>>()?;
    let [x, y, ux, uy] = <[Length; 4]>::try_from(numbers).map_err(|found| LineError::Numbers(found.len()))?;
    Ok(PointParameters {
        point: [x, y],
        direction: None,
        displacement: Some([ux, uy]),
        weight: Decimal::from(1),
        state: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_point_with_a_displacement() {
        let read = points("x_mm,y_mm,ux_mm,uy_mm\n25, 25, 0.5, -0.25\n\n10,20,0,1e-3\n").unwrap();
        assert_eq!(read.len(), 2);
        assert_eq!(read[0].point.map(|c| c.value()), [25.0, 25.0]);
        assert_eq!(read[0].displacement.unwrap().map(|c| c.value()), [0.5, -0.25]);
    }

    #[test]
    fn invalid_files_are_refused_with_the_line() {
        let header = COLUMNS.join(",");
        for (text, why) in [
            (String::new(), "wrong columns"),
            ("x,y,ux,uy\n1,2,3,4".to_owned(), "wrong columns x,y,ux,uy"),
            (header.clone(), "no points"),
            (format!("{header}\n1,2,3"), "line 2: 3 numbers"),
            (format!("{header}\n1,2,3,4\n1,2,x,4"), "line 3: \"x\""),
            (format!("{header}\n1,2,NaN,4"), "line 2: \"NaN\""),
            (format!("{header}\n{}", "1,2,3,4\n".repeat(2602)), "2602 points"),
        ] {
            let error = points(&text).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
    }
}
