//! VTKHDF for ParaView: the deformed membrane as an unstructured grid of quadrilaterals.

use std::collections::BTreeMap;
use std::path::Path;

use deaflow_store::{Data, Dataset, Grid, StoreError, write_grid};

/// A deformed membrane on a raster of elements, `[y][x]`.
pub struct Surface<'a> {
    /// Where the corners of elements lie along x and y without displacement, in mm.
    pub places: [&'a [f64]; 2],
    /// Displacement in mm of these corners in both directions.
    pub displacement: &'a [[f64; 2]],
    /// What is known of each pattern cell, a number of elements along each of its sides; first dimension: cells `[y][x]`.
    pub cells: &'a [(&'static str, Dataset)],
    /// Columns and rows of pattern cells.
    pub sides: [usize; 2],
}

/// Writes the surface with z = 0. Corners have `displacement` and `reference`, where they were without displacement, both
/// in mm; every element has the values of its pattern cell.
///
/// # Errors
/// When the folder does not exist or cannot be written in, or the library refuses (disk full).
pub fn write_vtkhdf(
    path: &Path,
    surface: &Surface<'_>,
    attributes: BTreeMap<String, String>,
) -> Result<(), StoreError> {
    let [columns, rows] = surface.places.map(<[f64]>::len);
    let reference: Vec<[f64; 3]> = (0..columns * rows)
        .map(|at| [surface.places[0][at % columns], surface.places[1][at / columns], 0.0])
        .collect();
    let displacement: Vec<[f64; 3]> = surface.displacement.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
    let vectors = |description: &str, values: &[[f64; 3]]| {
        let values = values.iter().flatten().copied().collect();
        Dataset::new("mm", description, &[columns * rows, 3], Data::F64(values))
    };
    let points = reference.iter().zip(&displacement);
    let grid = Grid {
        points: points.map(|(x, u)| [x[0] + u[0], x[1] + u[1], 0.0]).collect(),
        quadrilaterals: quadrilaterals([columns - 1, rows - 1]),
        point_data: vec![
            (
                "displacement",
                vectors("displacement from the prestretched state", &displacement),
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

/// Corners of each element, anticlockwise.
fn quadrilaterals(elements: [usize; 2]) -> Vec<[i64; 4]> {
    let [columns, rows] = elements.map(|count| count as i64);
    let corner = |at: i64| at / columns * (columns + 1) + at % columns;
    let of = |low: i64| [low, low + 1, low + columns + 2, low + columns + 1];
    (0..columns * rows).map(|at| of(corner(at))).collect()
}

/// The rows of cells as rows of elements.
fn spread(surface: &Surface<'_>, dataset: &Dataset) -> Dataset {
    let ([columns, rows], cells) = (surface.places.map(|places| places.len() - 1), surface.sides);
    let [along, across] = [columns / cells[0], rows / cells[1]];
    let width = dataset.shape.iter().skip(1).product::<usize>();
    let cell = |at: usize| at / columns / across * cells[0] + at % columns / along;
    fn repeated<T: Copy>(values: &[T], width: usize, order: impl Iterator<Item = usize>) -> Vec<T> {
        order.flat_map(|row| &values[row * width..][..width]).copied().collect()
    }
    let order = (0..columns * rows).map(cell);
    let data = match &dataset.data {
        Data::U8(v) => Data::U8(repeated(v, width, order)),
        Data::U32(v) => Data::U32(repeated(v, width, order)),
        Data::U64(v) => Data::U64(repeated(v, width, order)),
        Data::F32(v) => Data::F32(repeated(v, width, order)),
        Data::F64(v) => Data::F64(repeated(v, width, order)),
        Data::Text(v) => Data::Text(order.map(|row| v[row].clone()).collect()),
    };
    let shape = [&[columns * rows], &dataset.shape[1..]].concat();
    Dataset::new(&dataset.units, &dataset.description, &shape, data)
}
