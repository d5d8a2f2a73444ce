//! Finds out on which mesh fields were solved, where the dataset does not say: on that mesh they come out the same.

use super::facts::Row;
use super::rows::{Bench, Mesh, Wanted};
use super::symmetric::largest_difference;

/// The meshes that are tried, cheapest first.
const TRIED: [Mesh; 7] = [
    Mesh::new(1, 1),
    Mesh::new(2, 1),
    Mesh::new(1, 2),
    Mesh::new(4, 1),
    Mesh::new(2, 2),
    Mesh::new(8, 1),
    Mesh::new(4, 2),
];

/// Part of the largest displacement within which fields are the same. Meshes differ by far more.
const SAME: f64 = 1e-5;

/// The mesh on which more than half of these rows come out the same; `None` where there is no such among those tried.
///
/// # Errors
/// When a simulator cannot be set up; why.
pub fn mesh(bench: &dyn Bench, rows: &[Row]) -> Result<Option<Mesh>, String> {
    // A field of zeros is the same on every mesh.
    let moving = |(_, field): &(_, &crate::field::Field)| field.max_magnitude() > 0.0;
    let rows: Vec<_> = rows.iter().filter_map(Row::usable).filter(moving).collect();
    let patterns: Vec<_> = rows.iter().map(|(pattern, _)| (*pattern).clone()).collect();
    for mesh in TRIED {
        let found = bench.simulator(Wanted::Newton(mesh))?.simulate(&patterns);
        let same = rows.iter().zip(&found).filter(|((_, stored), found)| {
            let found = found.field.as_ref();
            found.is_some_and(|found| largest_difference(stored, found) <= SAME * found.max_magnitude())
        });
        if 2 * same.count() > rows.len() {
            return Ok(Some(mesh));
        }
    }
    Ok(None)
}
