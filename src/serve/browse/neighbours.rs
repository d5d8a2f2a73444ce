//! The rows of a dataset whose patterns are most similar to one of them, under all symmetries.

use serde_json::{Value, json};

use super::artifacts::find_artifact;
use crate::artifact_data::{cells_of, patterns};
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_pattern::{Symmetries, Symmetry};
use deaflow_store::{Artifact, Data};

/// Neighbours in one response.
const MAX_NEIGHBOURS: usize = 100;

/// Cells that are searched: those of 100,000 rows of 50 × 50. Further rows are not read.
const MAX_CELLS: usize = 250_000_000;

/// Rows that are read at a time.
const BLOCK: usize = 2048;

/// A row and its distance from the requested one.
struct Neighbour {
    /// Cells that differ from the nearest image of the requested pattern.
    distance: usize,
    row: usize,
    /// The symmetry of that image.
    symmetry: Symmetry,
}

/// Returns the rows whose patterns differ in the fewest cells from a pattern or one of its images: `row` and `limit`;
/// with `of=DIGEST` the pattern is a row of another artifact, and with `split` only that part of a balanced set is
/// searched.
///
/// # Errors
/// If an artifact has no patterns or no such row, or the patterns have different sizes.
pub fn neighbours(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["row", "limit", "of", "split"])?;
    let limit = request.integer("limit", 8, MAX_NEIGHBOURS)?;
    let (_, artifact) = find_artifact(state, digest)?;
    let (path, shape) = patterns(&artifact)?;
    let [total, rows, columns] = shape;
    let cells = rows * columns;
    // A row of the same set is not its own neighbour.
    let (from, is_own) = match request.nonempty("of") {
        Some(of) => (find_artifact(state, of)?.1, false),
        None => (artifact.clone(), true),
    };
    let (source, of) = patterns(&from)?;
    if of[1..] != shape[1..] {
        return Err(ApiError::bad_request(
            "the patterns of the two artifacts have different sizes",
        ));
    }
    if request.parameter("row").is_none() {
        return Err(ApiError::bad_request("the parameter `row` is missing"));
    }
    let row = request.row(&source, of[0])?;
    let splits = splits(&artifact, request.parameter("split"))?;
    let images = images(&cells_of(&from, &source, row..row + 1)?, [columns, rows]);
    let searched = total.min((MAX_CELLS / cells).max(1));
    let mut found: Vec<Neighbour> = Vec::with_capacity(limit + BLOCK);
    for start in (0..searched).step_by(BLOCK) {
        let block = start..(start + BLOCK).min(searched);
        let read = cells_of(&artifact, &path, block.clone())?;
        let each = block
            .zip(read.chunks_exact(cells))
            .filter(|(other, _)| (!is_own || *other != row) && splits.as_ref().is_none_or(|splits| splits[*other]));
        found.extend(each.filter_map(|(row, pattern)| nearest(row, pattern, &images)));
        // Only the nearest rows are kept.
        found.sort_by_key(|neighbour| (neighbour.distance, neighbour.row));
        found.truncate(limit);
    }
    let neighbour =
        |found: &Neighbour| json!({ "row": found.row, "distance": found.distance, "symmetry": found.symmetry.index() });
    Ok(json!({
        "path": path,
        "row": row,
        "cells": cells,
        "searched": searched,
        "total": total,
        "neighbours": found.iter().map(neighbour).collect::<Vec<Value>>(),
    })
    .into())
}

/// Whether each row is in a part of its set; `None` if no part is named.
fn splits(artifact: &Artifact, part: Option<&str>) -> Result<Option<Vec<bool>>, ApiError> {
    let Some(part) = part else {
        return Ok(None);
    };
    match artifact.read("split").map(|read| read.data) {
        Ok(Data::Text(splits)) => Ok(Some(splits.iter().map(|split| split == part).collect())),
        _ => Err(ApiError::bad_request("the dataset has no parts").help("name a dataset of a `balance` stage")),
    }
}

/// Returns the different images of a pattern.
fn images(cells: &[u8], sides: [usize; 2]) -> Vec<(Symmetry, Vec<u8>)> {
    let group = match sides[0] == sides[1] {
        true => Symmetries::SQUARE,
        false => Symmetries::RECTANGLE,
    };
    let mut found: Vec<(Symmetry, Vec<u8>)> = Vec::new();
    for symmetry in group.iter() {
        let mut image = vec![0; cells.len()];
        symmetry
            .permutation(sides)
            .zip(cells)
            .for_each(|(to, &cell)| image[to] = cell);
        if found.iter().all(|(_, known)| *known != image) {
            found.push((symmetry, image));
        }
    }
    found
}

fn nearest(row: usize, pattern: &[u8], images: &[(Symmetry, Vec<u8>)]) -> Option<Neighbour> {
    let difference = |image: &[u8]| image.iter().zip(pattern).filter(|(one, other)| one != other).count();
    let each = images.iter().map(|(symmetry, image)| Neighbour {
        distance: difference(image),
        row,
        symmetry: *symmetry,
    });
    each.min_by_key(|neighbour| neighbour.distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_differ_and_the_nearest_is_found() {
        // One cell in the corner has four images, each of which belongs to two symmetries.
        let mut corner = vec![0; 9];
        corner[0] = 1;
        let found = images(&corner, [3, 3]);
        assert_eq!(found.len(), 4);
        assert_eq!(found[0].0, Symmetry::IDENTITY);
        let mut other = vec![0; 9];
        (other[8], other[4]) = (1, 1);
        let near = nearest(7, &other, &found).unwrap();
        assert_eq!((near.distance, near.row), (1, 7));
        assert_eq!(images(&corner[..6], [3, 2]).len(), 4);
        assert_eq!(images(&[0; 6], [3, 2]).len(), 1);
    }
}
