//! Reads a target displacement field from a CSV file.

use std::path::Path;

use super::points::{MAX_MM, PointParameters};
use deaflow_base::{Decimal, Dimension, InputError, Length, Node, Quantity, Row, Table, TableError, confined};
use deaflow_field::CORNERS;

const COLUMNS: [&str; 4] = ["x_mm", "y_mm", "ux_mm", "uy_mm"];

/// Maximum number of points: the number of corners of the paper's raster.
const MAX_POINTS: usize = CORNERS * CORNERS;

/// Maximum size of the file.
const MAX_BYTES: u64 = 1 << 20;

/// Reads the table that a node names: a header, then one line per point.
///
/// # Errors
/// If the file does not exist, is outside the folder of the pipeline, or has invalid content; with the line.
pub(super) fn read(node: &Node) -> Result<Vec<PointParameters>, InputError> {
    let named = Path::new(node.text("field")?);
    let folder = node.file().parent().unwrap_or(Path::new(""));
    let path = folder.join(named);
    let refused = |why: &str| node.error(format!("the file {}: {why}", path.display()));
    let found = confined(folder, named).map_err(|why| refused(&why.to_string()).help(why.help()))?;
    let points_of = |mut table: Table| points(&mut table);
    let read = Table::open(&found, MAX_BYTES)
        .map_err(FieldFileError::from)
        .and_then(points_of);
    read.map_err(|why| refused(&why.to_string()).help(format!("the columns are {}", COLUMNS.join(","))))
}

/// Errors of a file of points.
#[derive(Debug, thiserror::Error)]
enum FieldFileError {
    #[error(transparent)]
    Table(#[from] TableError),
    #[error("the file has no points")]
    Empty,
    #[error("more than {MAX_POINTS} points")]
    Points,
}

fn points(table: &mut Table) -> Result<Vec<PointParameters>, FieldFileError> {
    let columns = table.columns(COLUMNS)?;
    let mut points = Vec::new();
    while let Some(row) = table.next_row()? {
        if points.len() == MAX_POINTS {
            return Err(FieldFileError::Points);
        }
        points.push(point(&row, columns)?);
    }
    match points.is_empty() {
        true => Err(FieldFileError::Empty),
        false => Ok(points),
    }
}

fn point(row: &Row<'_>, columns: [usize; 4]) -> Result<PointParameters, TableError> {
    let length = |column: usize| {
        let text = row.field(column);
        match Quantity::parse(&row.with_point(column)?, Dimension::Length) {
            Ok(length) if length.value().abs() <= MAX_MM => Ok(Length::from_base(length.base())),
            _ => Err(row.error(format!("{text:?} is not a length in mm up to {MAX_MM}"))),
        }
    };
    let [x, y, ux, uy] = columns.map(length);
    Ok(PointParameters {
        point: [x?, y?],
        direction: None,
        displacement: Some([ux?, uy?]),
        height: None,
        weight: Decimal::from(1),
        state: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(text: &str) -> Result<Vec<PointParameters>, FieldFileError> {
        super::points(&mut Table::of_bytes(text.into()).unwrap())
    }

    #[test]
    fn a_line_is_a_point_with_a_displacement() {
        let read = points("x_mm,y_mm,ux_mm,uy_mm\n25, 25, 0.5, -0.25\n\n10,20,0,1e-3\n").unwrap();
        assert_eq!(read.len(), 2);
        assert_eq!(read[0].point.map(|c| c.value()), [25.0, 25.0]);
        let german = points("X_mm;Y_mm;uX_mm;uY_mm;note\r\n25;25;0,5;-0,25;a\r\n10;20;0;0,001 mm;b\r\n").unwrap();
        assert_eq!(german, read);
        assert_eq!(read[0].displacement.unwrap().map(|c| c.value()), [0.5, -0.25]);
    }

    #[test]
    fn invalid_files_are_refused_with_the_line() {
        let header = COLUMNS.join(",");
        for (text, why) in [
            (String::new(), "the column x_mm is missing"),
            ("x,y,ux,uy\n1,2,3,4".to_owned(), "the columns are x, y, ux, uy"),
            (header.clone(), "no points"),
            (format!("{header}\n1,2,3"), "line 2: \"\" is not a length"),
            (format!("{header}\n1,2,3,4\n1,2,x,4"), "line 3: \"x\""),
            (format!("{header}\n1,2,NaN,4"), "line 2: \"NaN\""),
            (
                format!("{header}\n{}", "1,2,3,4\n".repeat(2602)),
                "more than 2601 points",
            ),
        ] {
            let error = points(&text).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
    }
}
