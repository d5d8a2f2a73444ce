//! A scene, and the simulations of patterns in it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::arrays::{Described, Groups, Keep, Shares, described, patterns, shaped};
use super::error::raised;
use super::gradient::{ValueAndSlopes, objective, value_and_slopes, values_and_gradients};
use super::work::run;
use deaflow::base::Progress;
use deaflow::cli::{self, CliError, Equilibria, SolveRequest};
use deaflow::fem::SolverParameters;
use deaflow::field::{Field, FieldError};
use deaflow::scene::Scene as Device;
use deaflow::stage::direct::{self, Changes};
use deaflow::stage::weak_drive_warning;
use deaflow::store::Object;
use numpy::{PyReadonlyArray4, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// A scene that has been read.
#[pyclass(frozen, module = "deaflow._deaflow")]
pub struct Scene {
    device: Device,
    notes: Vec<String>,
    /// The solvers of the last call.
    ready: Mutex<Option<Arc<Equilibria>>>,
}

/// Progress that nobody is shown.
struct Unseen;

impl Progress for Unseen {
    fn advance(&self, _steps: u64) {}

    fn note(&self, _text: &str) {}
}

/// Arrays by path, and attributes.
type Arrays<'py> = (BTreeMap<String, Described<'py>>, BTreeMap<String, String>);

impl Scene {
    fn new(device: Device, notes: Vec<String>) -> Self {
        Self {
            device,
            notes,
            ready: Mutex::new(None),
        }
    }

    /// Returns the solvers for some parameters, those of the last call if they are the same.
    fn equilibria(&self, parameters: &SolverParameters) -> Result<Arc<Equilibria>, CliError> {
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(ready) = ready.as_ref().filter(|ready| ready.parameters() == parameters) {
            return Ok(Arc::clone(ready));
        }
        if parameters.follows_time() {
            return Err(CliError::bad_input("`history` cannot be used here").help("use `deaflow solve --history`"));
        }
        cli::decide(&self.device)?;
        let made = Arc::new(Equilibria::new(&self.device, parameters)?);
        if !deaflow::base::is_interrupted() {
            *ready = Some(Arc::clone(&made));
        }
        Ok(made)
    }
}

#[pymethods]
impl Scene {
    /// Reads the scene in a file and changes values.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf, sets: Vec<String>) -> PyResult<Self> {
        let changes = Changes {
            sets: &sets,
            voltage: None,
        };
        let read = direct::read_scene_with(Path::new(&path), changes);
        let read = read.map_err(|error| raised(py, &error.into()))?;
        let notes = read.notes();
        Ok(Self::new(read.scene, notes))
    }

    /// Reads a scene from text in YAML.
    #[staticmethod]
    fn of_text(py: Python<'_>, text: &str) -> PyResult<Self> {
        let read = direct::scene_of_text(text);
        Ok(Self::new(read.map_err(|error| raised(py, &error.into()))?, Vec::new()))
    }

    /// Returns the scene in one of its states.
    fn in_state(&self, py: Python<'_>, name: &str) -> PyResult<Self> {
        let found = self.device.in_state(name);
        let unknown =
            |why: deaflow::scene::UnknownState| raised(py, &CliError::bad_input(why.to_string()).help(why.help()));
        Ok(Self::new(found.map_err(unknown)?, self.notes.clone()))
    }

    /// The canonical text.
    #[getter]
    fn text(&self) -> String {
        self.device.to_text()
    }

    /// What a user should know.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let faint = weak_drive_warning(&self.device.at_largest_voltages());
        self.notes.iter().cloned().chain(faint).collect()
    }

    /// The names of the states.
    #[getter]
    fn states(&self) -> Vec<String> {
        self.device.states.iter().map(|(name, _)| name.to_owned()).collect()
    }

    /// The number of electrode groups.
    #[getter]
    fn groups(&self) -> usize {
        self.device.groups()
    }

    /// The numbers of rows and columns of cells.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        let raster = self.device.membrane().raster;
        (raster.rows(), raster.columns())
    }

    /// The sides along x and y in mm.
    #[getter]
    fn size(&self) -> [f64; 2] {
        self.device.membrane().size_mm
    }

    /// Simulates patterns; returns the arrays and attributes of the file of `deaflow solve`.
    #[pyo3(signature = (groups, shares, solver, *, cells, checks))]
    fn solve<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Option<Shares<'py>>,
        solver: &str,
        cells: bool,
        checks: bool,
    ) -> PyResult<Arrays<'py>> {
        let py = slf.py();
        let (parameters, patterns) = (|| {
            let parameters = SolverParameters::from_text(solver)?;
            let form = slf.get().device.form();
            Ok((parameters, patterns(form, &groups, shares.as_ref(), Keep::Cut)?))
        })()
        .map_err(|error: CliError| raised(py, &error))?;
        let scene = slf.clone().unbind();
        let object: Object = run(py, move || {
            let scene = scene.get();
            let equilibria = scene.equilibria(&parameters)?;
            let request = SolveRequest {
                patterns: &patterns,
                drawings: &patterns,
                cells,
                checks,
            };
            let solved = equilibria.solve(&request, &Unseen)?;
            Ok(solved.content().in_states(&equilibria.states()))
        })?;
        let datasets = object.datasets.into_iter();
        let arrays = datasets.map(|(path, dataset)| Ok((path, described(py, dataset)?)));
        Ok((arrays.collect::<PyResult<_>>()?, object.attributes))
    }

    /// Computes the value of an objective and its gradient with respect to the covered shares, for each pattern; NaN
    /// without a stable solution.
    #[pyo3(signature = (groups, shares, objective_text, solver))]
    fn value_and_gradient<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Shares<'py>,
        objective_text: &str,
        solver: &str,
    ) -> PyResult<ValuesAndGradients<'py>> {
        let py = slf.py();
        let goal = objective(objective_text, &slf.get().device).map_err(|error| raised(py, &error))?;
        differentiated(slf, (&groups, &shares), solver, move |_, fields| {
            value_and_slopes(&goal, fields)
        })
    }

    /// Computes Σ weights · displacement and its gradient with respect to the covered shares, for each pattern; NaN
    /// without a stable solution. `weights` has a vector for each corner.
    #[pyo3(signature = (groups, shares, weights, solver))]
    fn weighted<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Shares<'py>,
        weights: PyReadonlyArray4<'py, f64>,
        solver: &str,
    ) -> PyResult<ValuesAndGradients<'py>> {
        let py = slf.py();
        let device = &slf.get().device;
        let fields = weights_of(device, groups.shape()[0], &weights).map_err(|error| raised(py, &error))?;
        differentiated(slf, (&groups, &shares), solver, move |at, displacements| {
            let weights = &fields[at];
            let pairs = weights.values().iter().zip(displacements[0].values());
            (pairs.map(|(weight, u)| weight * u).sum(), vec![weights.clone()])
        })
    }
}

/// A value for each pattern, and a gradient for each.
type ValuesAndGradients<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Returns the weights of the corners for each of `count` patterns.
fn weights_of(device: &Device, count: usize, weights: &PyReadonlyArray4<'_, f64>) -> Result<Vec<Field>, CliError> {
    if !device.states.is_empty() {
        return Err(
            CliError::bad_input("weights are those of one state of a device").help("choose a state with `in_state`")
        );
    }
    let raster = device.membrane().raster;
    let [columns, rows] = raster.corner_sides();
    if weights.shape() != [count, rows, columns, 2] {
        return Err(
            CliError::bad_input(format!("the array of weights has shape {:?}", weights.shape()))
                .help(format!("allowed: ({count}, {rows}, {columns}, 2)")),
        );
    }
    let values = weights
        .as_slice()
        .map_err(|_| CliError::bad_input("the array of weights is not in the order of C"))?;
    let field = |row: &[f64]| Field::from_values(raster, row.to_vec());
    let fields = values.chunks_exact(2 * raster.corners()).map(field);
    let refused = |error: FieldError| CliError::bad_input(error.to_string());
    fields.collect::<Result<_, _>>().map_err(refused)
}

/// Computes values and gradients of a functional for patterns.
fn differentiated<'py>(
    scene: &Bound<'py, Scene>,
    (groups, shares): (&Groups<'py>, &Shares<'py>),
    solver: &str,
    functional: impl Fn(usize, &[Field]) -> ValueAndSlopes + Send + Sync + 'static,
) -> PyResult<ValuesAndGradients<'py>> {
    let py = scene.py();
    let device = &scene.get().device;
    let raster = device.membrane().raster;
    let (parameters, patterns) = (|| {
        let parameters = SolverParameters::from_text(solver)?;
        Ok((parameters, patterns(device.form(), groups, Some(shares), Keep::All)?))
    })()
    .map_err(|error: CliError| raised(py, &error))?;
    let scene = scene.clone().unbind();
    let count = patterns.len();
    let found = run(py, move || {
        let scene = scene.get();
        let equilibria = scene.equilibria(&parameters)?;
        values_and_gradients(&equilibria, &scene.device, &patterns, functional)
    })?;
    let mut values = Vec::with_capacity(count);
    let mut gradients = Vec::with_capacity(count * raster.cells());
    for found in found {
        let (value, gradient) = found.unwrap_or_else(|| (f64::NAN, vec![f64::NAN; raster.cells()]));
        values.push(value);
        gradients.extend(gradient);
    }
    Ok((
        shaped(py, values, vec![count])?,
        shaped(py, gradients, vec![count, raster.rows(), raster.columns()])?,
    ))
}
