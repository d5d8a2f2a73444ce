//! The patterns of a set that are most like one of them, whichever way they are turned.

use serde_json::{Value, json};

use super::artifacts::named;
use super::pick::elements;
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_pattern::{Symmetries, Symmetry};
use deaflow_store::{Artifact, Content, Data};

/// Neighbours in one answer.
const MOST: usize = 100;

/// Cells of patterns that are looked through: those of 100,000 rows of 50 × 50. What is beyond is not read.
const MOST_CELLS: usize = 250_000_000;

/// Rows that are read at a time.
const BLOCK: usize = 2048;

/// A row and how far it is from the one that is asked for.
struct Neighbour {
    /// Cells in which it differs from the nearest image.
    distance: usize,
    row: usize,
    /// The symmetry of that image.
    symmetry: Symmetry,
}

/// The rows whose patterns differ in the fewest cells from that of a row, or from an image of it: `?row=`, `?limit=`; with `?of=DIGEST` the
/// row is one of another artifact, and with `?split=` the rows are looked through that are in that part of a balanced set.
///
/// # Errors
/// When the artifacts have no patterns, no such row, or patterns of other cells.
pub fn neighbours(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&["row", "limit", "of", "split"])?;
    let limit = request.number("limit", 8, MOST)?;
    let (_, artifact) = named(state, digits)?;
    let (path, shape) = patterns(&artifact)?;
    let [total, rows, columns] = shape;
    let cells = rows * columns;
    // Of its own set, it is no neighbour of itself.
    let (from, own) = match request.word("of").filter(|of| !of.is_empty()) {
        Some(of) => (named(state, of)?.1, false),
        None => (artifact.clone(), true),
    };
    let (source, of) = patterns(&from)?;
    if of[1..] != shape[1..] {
        return Err(Refusal::bad("the patterns of the two artifacts have other cells"));
    }
    let wanted = request.word("row").ok_or_else(|| Refusal::bad("`row` is missing"))?;
    let row: usize = wanted.parse().ok().filter(|row| *row < of[0]).ok_or_else(|| {
        Refusal::absent(format!("{source} has no row {wanted:?}")).help(format!("rows 0 to {}", of[0] - 1))
    })?;
    let splits = splits(&artifact, request.word("split"))?;
    let images = images(&cells_of(&from, &source, row..row + 1)?, [columns, rows]);
    let searched = total.min((MOST_CELLS / cells).max(1));
    let mut found: Vec<Neighbour> = Vec::with_capacity(limit + BLOCK);
    for start in (0..searched).step_by(BLOCK) {
        let block = start..(start + BLOCK).min(searched);
        let read = cells_of(&artifact, &path, block.clone())?;
        let each = block
            .zip(read.chunks_exact(cells))
            .filter(|(other, _)| (!own || *other != row) && splits.as_ref().is_none_or(|splits| splits[*other]));
        found.extend(each.filter_map(|(row, pattern)| nearest(row, pattern, &images)));
        // Those beyond the limit are not kept, however many there are.
        found.sort_by_key(|neighbour| (neighbour.distance, neighbour.row));
        found.truncate(limit);
    }
    let told = |neighbour: &Neighbour| json!({ "row": neighbour.row, "distance": neighbour.distance, "symmetry": neighbour.symmetry.index() });
    Ok(json!({
        "path": path,
        "row": row,
        "cells": cells,
        "searched": searched,
        "total": total,
        "neighbours": found.iter().map(told).collect::<Vec<Value>>(),
    })
    .into())
}

/// The path of the array of patterns, and its shape, of which nothing is zero.
///
/// # Errors
/// When there is none.
pub fn patterns(artifact: &Artifact) -> Result<(String, [usize; 3]), Refusal> {
    let is_patterns = |content: &&Content| content.axes.len() == 3 && content.axes[1..] == ["y", "x"];
    let found = artifact.contents()?.iter().find(is_patterns).ok_or_else(none)?;
    let shape = <[usize; 3]>::try_from(found.shape.as_slice()).ok();
    let shape = shape.filter(|shape| !shape.contains(&0)).ok_or_else(none)?;
    Ok((found.path.clone(), shape))
}

/// Whether each row is in a part of its set; none where all are looked through.
fn splits(artifact: &Artifact, wanted: Option<&str>) -> Result<Option<Vec<bool>>, Refusal> {
    let Some(wanted) = wanted.filter(|split| !split.is_empty()) else {
        return Ok(None);
    };
    match artifact.read("split").map(|read| read.data) {
        Ok(Data::Text(splits)) => Ok(Some(splits.iter().map(|split| split == wanted).collect())),
        _ => Err(Refusal::bad("the set is not divided into parts").help("a `balance` stage divides it")),
    }
}

fn none() -> Refusal {
    Refusal::absent("the artifact holds no patterns").help("GET /api/artifacts/DIGEST lists what it holds")
}

/// The cells of some rows, one after the other.
///
/// # Errors
/// When they cannot be read.
pub fn cells_of(artifact: &Artifact, path: &str, rows: std::ops::Range<usize>) -> Result<Vec<u8>, Refusal> {
    match elements(artifact, path, rows)? {
        Data::U8(cells) => Ok(cells),
        _ => Err(none()),
    }
}

/// The images of a pattern that differ.
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
    let apart = |image: &[u8]| image.iter().zip(pattern).filter(|(one, other)| one != other).count();
    let each = images.iter().map(|(symmetry, image)| Neighbour {
        distance: apart(image),
        row,
        symmetry: *symmetry,
    });
    each.min_by_key(|neighbour| neighbour.distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_differ_and_the_nearest_is_told() {
        // One cell in the corner has four images, of which each comes from two symmetries.
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
