//! Patterns from arrays of numpy, and arrays of results for numpy.

use std::collections::BTreeMap;

use deaflow::base::InputError;
use deaflow::cli::CliError;
use deaflow::pattern::{Coverage, Pattern, PatternForm};
use deaflow::store::{Data, Dataset, Object};
use numpy::prelude::*;
use numpy::{Element, PyArray1, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyList;

/// The electrode group of each cell, `(n, ny, nx)`.
pub type Groups<'py> = PyReadonlyArray3<'py, u8>;

/// The share of each cell that its group covers, `(n, ny, nx)`.
pub type Shares<'py> = PyReadonlyArray3<'py, f64>;

/// What shares of cells are kept for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// For cells that are covered in part.
    Cut,
    /// For all cells.
    All,
}

/// Returns the patterns of arrays on a device.
///
/// # Errors
/// When the shape is not that of patterns of the device, or a value is out of range.
pub fn patterns(
    form: PatternForm,
    groups: &Groups<'_>,
    shares: Option<&Shares<'_>>,
    keep: Keep,
) -> Result<Vec<Pattern>, CliError> {
    let refused = |at: usize, why: String| CliError::from(InputError::new(format!("pattern {at}: {why}")));
    let [columns, rows] = form.raster.sides();
    let shapes = [Some(groups.shape()), shares.map(|shares| shares.shape())];
    for shape in shapes.into_iter().flatten() {
        if shape[1..] != [rows, columns] || shape[0] != groups.shape()[0] || shape[0] == 0 {
            let (n, y, x) = (shape[0], shape[1], shape[2]);
            return Err(
                CliError::bad_input(format!("the array of patterns has shape ({n}, {y}, {x})"))
                    .help(format!("allowed: ({rows}, {columns}) or (n, {rows}, {columns})")),
            );
        }
    }
    let not_in_rows = |_| CliError::bad_input("the array of patterns is not in the order of C");
    let groups = groups.as_slice().map_err(not_in_rows)?;
    let shares = shares
        .map(|shares| shares.as_slice().map_err(not_in_rows))
        .transpose()?;
    let cells = form.raster.cells();
    let each = groups.chunks_exact(cells).enumerate();
    each.map(|(at, groups)| {
        let Some(shares) = shares else {
            return Pattern::of_form(form, groups).map_err(|error| refused(at, error.to_string()));
        };
        let shares = &shares[at * cells..(at + 1) * cells];
        let of_covered = |(group, share): (&u8, &f64)| if *share == 0.0 { 0 } else { *group };
        let groups: Vec<u8> = groups.iter().zip(shares).map(of_covered).collect();
        Pattern::of_form(form, &groups).map_err(|error| refused(at, error.to_string()))?;
        let coverage = Coverage::new(form.raster, &groups, shares).map_err(|error| refused(at, error.to_string()))?;
        Ok(match keep {
            Keep::Cut => Pattern::of_coverage(coverage),
            Keep::All => Pattern::of_shares(coverage),
        })
    })
    .collect()
}

/// An array with its unit, description and the names of its axes.
pub type Described<'py> = (Bound<'py, PyAny>, String, String, Vec<String>);

/// Arrays by path, attributes, and warnings about the model.
pub type Arrays<'py> = (BTreeMap<String, Described<'py>>, BTreeMap<String, String>, Vec<String>);

/// Hands the arrays of a result over to numpy.
///
/// # Errors
/// When the shape of one is not that of its values.
pub fn arrays_of<'py>(py: Python<'py>, object: Object, warnings: Vec<String>) -> PyResult<Arrays<'py>> {
    let datasets = object.datasets.into_iter();
    let arrays = datasets.map(|(path, dataset)| Ok((path, described(py, dataset)?)));
    Ok((arrays.collect::<PyResult<_>>()?, object.attributes, warnings))
}

/// Hands a dataset over to numpy, with the bits that a file would have and without a copy of numbers.
///
/// # Errors
/// When its shape is not that of its values.
pub fn described(py: Python<'_>, dataset: Dataset) -> PyResult<Described<'_>> {
    let Dataset {
        units,
        description,
        axes,
        shape,
        data,
    } = dataset;
    let values = match data {
        Data::U8(values) => shaped(py, values, shape)?,
        Data::U32(values) => shaped(py, values, shape)?,
        Data::U64(values) => shaped(py, values, shape)?,
        // Files have no negative zeros.
        Data::F32(values) => shaped(py, values.into_iter().map(|value| value + 0.0).collect(), shape)?,
        Data::F64(values) => shaped(py, values.into_iter().map(|value| value + 0.0).collect(), shape)?,
        Data::Text(values) => {
            let array = py.import("numpy")?.call_method1("array", (PyList::new(py, values)?,))?;
            array.call_method1("reshape", (shape,))?
        }
    };
    Ok((values, units, description, axes))
}

/// Makes an array of a shape from values.
///
/// # Errors
/// When the shape is not that of the values.
pub fn shaped<T: Element>(py: Python<'_>, values: Vec<T>, shape: Vec<usize>) -> PyResult<Bound<'_, PyAny>> {
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
}
