//! Patterns from arrays of numpy, and arrays of results for numpy.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use deaflow::base::InputError;
use deaflow::cli::CliError;
use deaflow::pattern::{Coverage, Pattern, PatternForm};
use deaflow::store::{Data, Dataset, Object};
use numpy::prelude::*;
use numpy::{Element, PyArray1, PyReadonlyArray3};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
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

/// The arrays of a result, attributes, and warnings about the model.
///
/// An array becomes one of numpy when it is first asked for: after a solve all that Python does is slow, because its
/// code and data are no longer in the caches of the processor, and most arrays of a result are never looked at.
#[pyclass(frozen, module = "deaflow._deaflow")]
pub struct Found {
    arrays: BTreeMap<String, Array>,
    attributes: BTreeMap<String, String>,
    warnings: Vec<String>,
}

/// An array with its unit, description and the names of its axes.
struct Array {
    units: String,
    description: String,
    axes: Vec<String>,
    shape: Vec<usize>,
    /// The values, before Python has them.
    data: Mutex<Option<Data>>,
    array: PyOnceLock<Py<PyAny>>,
}

/// Shape, unit, description and the names of the axes of an array.
type About<'a> = (&'a [usize], &'a str, &'a str, &'a [String]);

#[pymethods]
impl Found {
    /// Shape, unit, description and the names of the axes of each array by its path.
    #[getter]
    fn about(&self) -> BTreeMap<&str, About<'_>> {
        let arrays = self.arrays.iter();
        arrays.map(|(path, array)| (path.as_str(), array.about())).collect()
    }

    #[getter]
    fn attributes(&self) -> &BTreeMap<String, String> {
        &self.attributes
    }

    #[getter]
    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Returns an array; `None` if there is none of this path.
    fn array(&self, py: Python<'_>, path: &str) -> PyResult<Option<Py<PyAny>>> {
        let Some(array) = self.arrays.get(path) else {
            return Ok(None);
        };
        let made = array.array.get_or_try_init(py, || {
            let data = array.data.lock().unwrap_or_else(PoisonError::into_inner).take();
            let data = data.ok_or_else(|| PyRuntimeError::new_err("the array was lost by an error before"))?;
            Ok::<_, PyErr>(numbers_or_texts(py, data, array.shape.clone())?.unbind())
        });
        Ok(Some(made?.clone_ref(py)))
    }
}

impl Array {
    fn about(&self) -> About<'_> {
        (&self.shape, &self.units, &self.description, &self.axes)
    }
}

impl Found {
    /// Keeps the arrays of a result.
    pub fn new(object: Object, warnings: Vec<String>) -> Self {
        let array = |dataset: Dataset| Array {
            units: dataset.units,
            description: dataset.description,
            axes: dataset.axes,
            shape: dataset.shape,
            data: Mutex::new(Some(dataset.data)),
            array: PyOnceLock::new(),
        };
        let datasets = object.datasets.into_iter();
        Self {
            arrays: datasets.map(|(path, dataset)| (path, array(dataset))).collect(),
            attributes: object.attributes,
            warnings,
        }
    }
}

/// Hands values over to numpy, with the bits that a file would have and without a copy of numbers.
fn numbers_or_texts(py: Python<'_>, data: Data, shape: Vec<usize>) -> PyResult<Bound<'_, PyAny>> {
    match data {
        Data::U8(values) => shaped(py, values, shape),
        Data::U32(values) => shaped(py, values, shape),
        Data::U64(values) => shaped(py, values, shape),
        // Files have no negative zeros.
        Data::F32(values) => shaped(py, values.into_iter().map(|value| value + 0.0).collect(), shape),
        Data::F64(values) => shaped(py, values.into_iter().map(|value| value + 0.0).collect(), shape),
        Data::Text(values) => {
            // Without texts numpy would choose another type.
            let as_texts = (PyList::new(py, values)?, "str");
            let array = py.import("numpy")?.call_method1("array", as_texts)?;
            array.call_method1("reshape", (shape,))
        }
    }
}

/// Makes an array of a shape from values.
///
/// # Errors
/// When the shape is not that of the values.
pub fn shaped<T: Element>(py: Python<'_>, values: Vec<T>, shape: Vec<usize>) -> PyResult<Bound<'_, PyAny>> {
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
}
