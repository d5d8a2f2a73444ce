//! VTKHDF for ParaView: the deformed membrane as an unstructured grid of quadrilaterals.

use std::collections::BTreeMap;
use std::path::Path;

use crate::rows::pick;
use deaflow_store::{Data, Dataset, Grid, StoreError, write_grid};

/// A deformed membrane on a raster of elements, `[y][x]`.
pub struct Surface<'a> {
    /// Columns and rows of elements.
    pub elements: [usize; 2],
    /// Positions of their corners without displacement in mm.
    pub places: &'a [[f64; 2]],
    /// Displacement of these corners in mm along x, y and out of the plane.
    pub displacement: &'a [[f64; 3]],
    /// Quantities of the pattern cells; first dimension: cells `[y][x]`. Each cell has the same number of elements.
    pub cells: &'a [(&'static str, Dataset)],
    /// Columns and rows of pattern cells.
    pub sides: [usize; 2],
}

/// Writes the surface, whose plane is z = 0. Corners have `displacement` and `reference`, the position without
/// displacement, both in mm; elements have the values of their pattern cells.
///
/// # Errors
/// If the folder does not exist or is not writable, or HDF5 fails (disk full).
pub fn write_vtkhdf(
    path: &Path,
    surface: &Surface<'_>,
    attributes: BTreeMap<String, String>,
) -> Result<(), StoreError> {
    let reference: Vec<[f64; 3]> = surface.places.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
    let vectors = |description: &str, values: &[[f64; 3]]| {
        let values: Vec<f64> = values.iter().flatten().copied().collect();
        Dataset::new("mm", description, &[values.len() / 3, 3], Data::F64(values))
    };
    let points = reference.iter().zip(surface.displacement);
    let grid = Grid {
        points: points.map(|(x, u)| [0, 1, 2].map(|axis| x[axis] + u[axis])).collect(),
        quadrilaterals: quadrilaterals(surface.elements),
        point_data: vec![
            (
                "displacement",
                vectors("displacement from the prestretched state", surface.displacement),
            ),
            (
                "reference",
                vectors("position in the prestretched state, without voltage", &reference),
            ),
        ],
        cell_data: surface
            .cells
            .iter()
            .map(|(name, dataset)| (*name, spread(surface, dataset)))
            .collect(),
        attributes,
    };
    write_grid(path, &grid)
}

/// Returns the corners of each element, anticlockwise.
fn quadrilaterals(elements: [usize; 2]) -> Vec<[i64; 4]> {
    let [columns, rows] = elements.map(|count| count as i64);
    let corner = |at: i64| at / columns * (columns + 1) + at % columns;
    let of = |low: i64| [low, low + 1, low + columns + 2, low + columns + 1];
    (0..columns * rows).map(|at| of(corner(at))).collect()
}

/// Repeats the rows of cells as rows of elements.
fn spread(surface: &Surface<'_>, dataset: &Dataset) -> Dataset {
    let ([columns, rows], cells) = (surface.elements, surface.sides);
    let [along, across] = [columns / cells[0], rows / cells[1]];
    let width = dataset.shape.iter().skip(1).product::<usize>();
    let cell = |at: usize| at / columns / across * cells[0] + at % columns / along;
    let elements = (0..columns * rows)
        .map(cell)
        .flat_map(|row| row * width..(row + 1) * width);
    let data = pick(&dataset.data, elements);
    let shape = [&[columns * rows], &dataset.shape[1..]].concat();
    Dataset::new(&dataset.units, &dataset.description, &shape, data)
}
