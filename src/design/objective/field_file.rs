//! A wanted displacement field, from a file.

use std::path::Path;

use super::parameters::{AimText, LONGEST_MM, MotionText};
use crate::base::{Decimal, Dimension, InputError, Node, Quantity, read_bounded};
use crate::field::CORNERS;

const COLUMNS: [&str; 4] = ["x_mm", "y_mm", "ux_mm", "uy_mm"];

/// As many points as a field has values.
const MOST: usize = CORNERS * CORNERS;

/// Bytes of such a file.
const MAX_BYTES: u64 = 1 << 20;

/// Reads the CSV file that a node names: a line with the names of the columns, then a line for each point.
///
/// # Errors
/// When the file does not exist, lies outside the folder of the pipeline, or has something else in it; with its line.
pub(super) fn read(node: &Node) -> Result<Vec<AimText>, InputError> {
    let named = Path::new(node.text("field")?);
    let folder = node.file().parent().unwrap_or(Path::new(""));
    let path = folder.join(named);
    let refused = |why: &str| node.error(format!("the file {}: {why}", path.display()));
    let (Ok(within), Ok(found)) = (Path::new(".").join(folder).canonicalize(), path.canonicalize()) else {
        return Err(refused("it does not exist").help("it is named relative to the pipeline's file"));
    };
    // Whoever runs a pipeline of somebody else's must not be made to read what lies elsewhere.
    if named.is_absolute() || !found.starts_with(&within) {
        return Err(refused("it lies outside the folder of the pipeline")
            .help("put it beside the pipeline or in a folder below, without a link that leads out"));
    }
    let bytes = read_bounded(&found, MAX_BYTES).map_err(|e| refused(&e.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|_| refused("it is not text"))?;
    points(&text).map_err(|why| refused(&why).help(format!("the first line is {}", COLUMNS.join(","))))
}

fn points(text: &str) -> Result<Vec<AimText>, String> {
    let mut lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty());
    let header: Vec<&str> = lines
        .next()
        .map_or("", |(line, _)| line)
        .split(',')
        .map(str::trim)
        .collect();
    if header != COLUMNS {
        return Err(format!("its columns are {}", header.join(",")));
    }
    let points: Vec<AimText> = lines
        .map(|(line, number)| point(line).map_err(|why| format!("line {number}: {why}")))
        .collect::<Result<_, _>>()?;
    match points.len() {
        0 => Err("it has no points".to_owned()),
        1..=MOST => Ok(points),
        more => Err(format!("{more} points; allowed: at most {MOST}")),
    }
}

fn point(line: &str) -> Result<AimText, String> {
    let numbers: Vec<Quantity> = line
        .split(',')
        .map(|cell| match Quantity::parse(cell.trim(), Dimension::Length) {
            Ok(length) if length.value().abs() <= LONGEST_MM => Ok(length),
            _ => Err(format!("{:?} is no length in mm up to {LONGEST_MM}", cell.trim())),
        })
        .collect::<Result<_, _>>()?;
    let found = numbers.len();
    let [x, y, ux, uy] = <[Quantity; 4]>::try_from(numbers).map_err(|_| format!("{found} numbers where 4 belong"))?;
    Ok(AimText {
        point: [x, y],
        motion: MotionText::Displacement([ux, uy]),
        weight: Decimal::from(1),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_point_with_its_displacement() {
        let read = points("x_mm,y_mm,ux_mm,uy_mm\n25, 25, 0.5, -0.25\n\n10,20,0,1e-3\n").unwrap();
        assert_eq!(read.len(), 2);
        assert_eq!(read[0].point.each_ref().map(Quantity::value), [25.0, 25.0]);
        let MotionText::Displacement(vector) = &read[0].motion else {
            panic!("a displacement is wanted")
        };
        assert_eq!(vector.each_ref().map(Quantity::value), [0.5, -0.25]);
    }

    #[test]
    fn other_files_are_refused_with_their_line() {
        let header = COLUMNS.join(",");
        for (text, why) in [
            (String::new(), "its columns are"),
            ("x,y,ux,uy\n1,2,3,4".to_owned(), "its columns are x,y,ux,uy"),
            (header.clone(), "no points"),
            (format!("{header}\n1,2,3"), "line 2: 3 numbers"),
            (format!("{header}\n1,2,3,4\n1,2,x,4"), "line 3: \"x\""),
            (format!("{header}\n1,2,NaN,4"), "line 2: \"NaN\""),
            (format!("{header}\n{}", "1,2,3,4\n".repeat(2602)), "2602 points"),
        ] {
            let error = points(&text).unwrap_err();
            assert!(error.contains(why), "{error}");
        }
    }
}
