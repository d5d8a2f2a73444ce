//! A scene, and the simulations of patterns in it.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::arrays::{Found, Groups, Keep, Shares, patterns, shaped};
use super::error::raised;
use super::gradient::parameter::{Parameter, values_and_derivatives};
use super::gradient::{ValueAndSlopes, objective, value_and_slopes, values_and_gradients};
use super::work::{is_main_thread, run, run_here};
use deaflow::base::{Document, Progress};
use deaflow::cli::{
    self, AccuracyRequest, Analysed, Analysis, CliError, Computation, Equilibria, Frequencies, Networks, OutputTimes,
    SolveRequest,
};
use deaflow::fem::screening::TestPattern;
use deaflow::fem::{MOST_MODES, PathParameter, SetupError, SolverParameters};
use deaflow::field::{Field, FieldError};
use deaflow::pattern::Pattern;
use deaflow::scene::Scene as Device;
use deaflow::stage::direct::{self, Changes};
use deaflow::stage::weak_drive_warning;
use numpy::{PyReadonlyArray4, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// A scene that has been read.
#[pyclass(frozen, module = "deaflow._deaflow")]
pub struct Scene {
    device: Device,
    notes: Vec<String>,
    /// The options of the last call.
    read: Mutex<Option<(String, SolverParameters)>>,
    /// The solvers of the last call.
    ready: Mutex<Option<Arc<Ready>>>,
}

/// Solvers that are prepared.
struct Ready {
    equilibria: Equilibria,
    /// Whether they solved the last single pattern in less than [`QUICK`].
    is_quick: AtomicBool,
}

/// A call with a pattern that takes less is not handed to other threads.
const QUICK: Duration = Duration::from_millis(50);

/// Progress that nobody is shown.
pub struct Unseen;

impl Progress for Unseen {
    fn advance(&self, _steps: u64) {}

    fn note(&self, _text: &str) {}
}

impl Scene {
    fn new(device: Device, notes: Vec<String>) -> Self {
        Self {
            device,
            notes,
            read: Mutex::new(None),
            ready: Mutex::new(None),
        }
    }

    /// Reads the options of a call, unless they are those of the last one, so that a loop over patterns reads them
    /// once.
    fn parameters(&self, text: &str) -> Result<SolverParameters, CliError> {
        let mut last = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, parameters)) = last.as_ref().filter(|(known, _)| known == text) {
            return Ok(parameters.clone());
        }
        let parameters = SolverParameters::from_text(text)?;
        *last = Some((text.to_owned(), parameters.clone()));
        Ok(parameters)
    }

    /// Returns the solvers for some parameters, those of the last call if they are the same.
    fn ready(&self, parameters: &SolverParameters) -> Result<Arc<Ready>, CliError> {
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(ready) = ready
            .as_ref()
            .filter(|ready| ready.equilibria.parameters() == parameters)
        {
            return Ok(Arc::clone(ready));
        }
        if parameters.follows_time() {
            return Err(CliError::bad_input("`history` cannot be used here").help("use `scene.history`"));
        }
        cli::decide(&self.device)?;
        let made = Arc::new(Ready {
            equilibria: Equilibria::new(&self.device, parameters)?,
            is_quick: AtomicBool::new(false),
        });
        if !deaflow::base::is_interrupted() {
            *ready = Some(Arc::clone(&made));
        }
        Ok(made)
    }

    /// Returns the solvers for some parameters if they are those of the last call, are not being prepared, and were
    /// quick. They have solved a pattern, so that nothing waits in them for other threads.
    fn quick(&self, parameters: &SolverParameters) -> Option<Arc<Ready>> {
        let ready = self.ready.try_lock().ok()?;
        let is_usable = |ready: &&Arc<Ready>| {
            let is_same = ready.equilibria.parameters() == parameters && parameters.accuracy().is_none();
            is_same && ready.is_quick.load(Ordering::Relaxed)
        };
        ready.as_ref().filter(is_usable).map(Arc::clone)
    }
}

/// Solves patterns.
fn solved(ready: &Ready, patterns: &[Pattern], cells: bool, checks: bool) -> Result<Found, CliError> {
    let request = SolveRequest {
        patterns,
        drawings: patterns,
        cells,
        checks,
    };
    let start = Instant::now();
    let solved = ready.equilibria.solve(&request, &Unseen)?;
    let is_quick = patterns.len() == 1 && start.elapsed() < QUICK;
    ready.is_quick.store(is_quick, Ordering::Relaxed);
    let object = solved.content().in_states(&ready.equilibria.states());
    Ok(Found::new(object, solved.warnings()))
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
    ) -> PyResult<Found> {
        let py = slf.py();
        let device = &slf.get().device;
        if device.is_in_space() {
            if cells {
                return Err(raised(py, &SetupError::not_in_space(device, "`cells`").into()));
            }
            return analysed(slf, &groups, shares.as_ref(), solver, Analysis::SpatialEquilibrium);
        }
        let (parameters, patterns) = (|| {
            Ok((
                slf.get().parameters(solver)?,
                patterns(device.form(), &groups, shares.as_ref(), Keep::Cut)?,
            ))
        })()
        .map_err(|error: CliError| raised(py, &error))?;
        if patterns.len() == 1
            && !checks
            && let Some(ready) = slf.get().quick(&parameters)
            && is_main_thread(py)?
        {
            return run_here(py, || solved(&ready, &patterns, cells, checks));
        }
        let scene = slf.clone().unbind();
        run(py, move || {
            let ready = scene.get().ready(&parameters)?;
            solved(&ready, &patterns, cells, checks)
        })
    }

    /// Simulates patterns in time; returns the arrays of the file of `deaflow solve --history`.
    #[pyo3(signature = (groups, shares, solver, *, at, every))]
    fn history<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Option<Shares<'py>>,
        solver: &str,
        at: Option<&str>,
        every: Option<&str>,
    ) -> PyResult<Found> {
        let times = match (at, every) {
            (None, None) => Ok(OutputTimes::default()),
            (Some(at), None) => OutputTimes::at(at).map_err(|why| CliError::bad_input(format!("`at`: {why}"))),
            (None, Some(every)) => {
                OutputTimes::every(every).map_err(|why| CliError::bad_input(format!("`every`: {why}")))
            }
            (Some(_), Some(_)) => Err(CliError::bad_input("`at` cannot be combined with `every`")),
        };
        let analysis = one_state(&slf.get().device, "a history is").and_then(|()| Ok(Analysis::History(times?)));
        analysed(slf, &groups, shares.as_ref(), solver, or_raised(slf, analysis)?)
    }

    /// Follows the load paths of patterns; returns the arrays of the file of `deaflow solve --path`.
    #[pyo3(signature = (groups, shares, solver, *, parameter))]
    fn path<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Option<Shares<'py>>,
        solver: &str,
        parameter: &str,
    ) -> PyResult<Found> {
        let known = PathParameter::ALL.into_iter().find(|known| known.name() == parameter);
        let analysis = known.map(Analysis::Path).ok_or_else(|| {
            let allowed = PathParameter::ALL.map(PathParameter::name).join(", ");
            CliError::bad_input(format!("unknown parameter of a path: {parameter:?}"))
                .help(format!("allowed: {allowed}"))
        });
        analysed(slf, &groups, shares.as_ref(), solver, or_raised(slf, analysis)?)
    }

    /// Finds natural frequencies of patterns; returns the arrays of the file of `deaflow solve --modes`.
    #[pyo3(signature = (groups, shares, solver, *, count, lumped))]
    fn modes<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Option<Shares<'py>>,
        solver: &str,
        count: usize,
        lumped: bool,
    ) -> PyResult<Found> {
        let analysis = match (1..=MOST_MODES).contains(&count) {
            true => one_state(&slf.get().device, "natural frequencies are").map(|()| Analysis::Modes { count, lumped }),
            false => Err(CliError::bad_input(format!(
                "{count} modes: allowed: 1 to {MOST_MODES}"
            ))),
        };
        analysed(slf, &groups, shares.as_ref(), solver, or_raised(slf, analysis)?)
    }

    /// Finds the responses of patterns at given frequencies in Hz, or at `points` between the ends `range`; returns the
    /// arrays of the file of `deaflow solve --response`.
    #[pyo3(signature = (groups, shares, solver, *, hertz, range, points))]
    fn response<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Option<Shares<'py>>,
        solver: &str,
        hertz: Vec<f64>,
        range: Option<&str>,
        points: Option<u64>,
    ) -> PyResult<Found> {
        let frequencies = match range {
            Some(ends) => Frequencies::between(ends, points),
            None => Frequencies::of(&hertz),
        };
        let frequencies = frequencies.map_err(|why| CliError::bad_input(format!("`frequencies`: {why}")));
        let analysis =
            one_state(&slf.get().device, "a frequency response is").and_then(|()| Ok(Analysis::Response(frequencies?)));
        analysed(slf, &groups, shares.as_ref(), solver, or_raised(slf, analysis)?)
    }

    /// Screens the effects of the scene with patterns, or else with reference patterns; returns what `deaflow screen
    /// --json` prints.
    fn screen(slf: &Bound<'_, Self>, groups: Option<Groups<'_>>, solver: &str) -> PyResult<String> {
        let device = &slf.get().device;
        let limit = or_raised(slf, slf.get().parameters(solver))?.work_limit();
        let named = |(at, pattern)| TestPattern::new(&format!("pattern {at}"), pattern);
        let tests = groups.map(|groups| {
            let patterns = patterns(device.form(), &groups, None, Keep::Cut)?.into_iter();
            Ok(patterns.enumerate().map(named).collect())
        });
        let tests = or_raised(slf, tests.transpose())?;
        let device = device.clone();
        run(slf.py(), move || {
            Ok(cli::screen(device, tests, limit)?.document().to_string())
        })
    }

    /// Measures error and time of methods on patterns, or else on families; returns what `deaflow accuracy --json`
    /// prints, without files. `networks` has the names of models and their store, `families` the number of patterns of
    /// each and the seed.
    #[pyo3(signature = (groups, *, reference, methods, target, networks, families))]
    fn accuracy(
        slf: &Bound<'_, Self>,
        groups: Option<Groups<'_>>,
        reference: Option<&str>,
        methods: Option<&str>,
        target: Option<&str>,
        networks: (Vec<String>, Option<PathBuf>),
        families: (u64, u64),
    ) -> PyResult<String> {
        let device = &slf.get().device;
        let request = || -> Result<_, CliError> {
            let refused = |why: String| CliError::bad_input(format!("`target`: {why}"));
            let target = target.map(cli::read_accuracy).transpose().map_err(refused)?;
            let reference =
                Document::from_text(Path::new("reference"), reference.unwrap_or(AccuracyRequest::REFERENCE))?;
            let methods = methods.map(|text| Document::from_text(Path::new("methods"), text));
            let (names, store) = networks;
            let networks = Networks { names: &names, store };
            let request = AccuracyRequest::new(device.clone(), &reference, methods.transpose()?.as_ref(), &networks)?;
            let request = match groups {
                Some(groups) => {
                    let patterns = patterns(device.form(), &groups, None, Keep::Cut)?;
                    request.on_patterns(patterns, Vec::new())
                }
                None => request.on_families(families.0, families.1)?,
            };
            Ok((request, target))
        };
        let (request, target) = or_raised(slf, request())?;
        run(slf.py(), move || {
            let measured = request.solve(&Unseen)?.measure(&Unseen)?;
            Ok(measured.document(target).to_string())
        })
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

    /// Computes the value of an objective and its derivatives with respect to parameters of the scene, for each pattern
    /// of whole cells; NaN without a stable solution. That with respect to voltages has the axes pattern, state and
    /// group, the others only the first of them. With `shares` the last one is that with respect to them.
    #[pyo3(signature = (groups, shares, objective_text, solver, parameters))]
    fn value_and_derivatives<'py>(
        slf: &Bound<'py, Self>,
        groups: Groups<'py>,
        shares: Option<Shares<'py>>,
        objective_text: &str,
        solver: &str,
        parameters: Vec<String>,
    ) -> PyResult<ValuesAndDerivatives<'py>> {
        let py = slf.py();
        let device = &slf.get().device;
        let wanted = parameters.iter().map(|name| Parameter::find(name));
        let wanted: Vec<Parameter> = or_raised(slf, wanted.collect())?;
        let goal = or_raised(slf, objective(objective_text, device))?;
        let solver = or_raised(slf, slf.get().parameters(solver))?;
        let whole = or_raised(slf, patterns(device.form(), &groups, None, Keep::Cut))?;
        let cut = shares.map(|shares| patterns(device.form(), &groups, Some(&shares), Keep::All));
        let cut = or_raised(slf, cut.transpose())?;
        let (of, count, asked, with_shares) = (slf.clone().unbind(), whole.len(), wanted.clone(), cut.is_some());
        let found = run(py, move || {
            let scene = of.get();
            let ready = scene.ready(&solver)?;
            let patterns = (whole.as_slice(), cut.as_deref());
            values_and_derivatives(&ready.equilibria, &scene.device, patterns, &asked, &goal)
        })?;
        let values = found
            .iter()
            .map(|found| found.as_ref().map_or(f64::NAN, |found| found.value));
        let values = shaped(py, values.collect(), vec![count])?;
        let states = device.in_states().len();
        let derivatives = wanted.iter().enumerate().map(|(at, parameter)| {
            let shape = match parameter {
                Parameter::Voltage => vec![states, device.groups()],
                _ => Vec::new(),
            };
            let missing = vec![f64::NAN; shape.iter().product()];
            let each = found
                .iter()
                .map(|found| found.as_ref().map_or(&missing, |found| &found.parameters[at]));
            let numbers: Vec<f64> = each.flatten().copied().collect();
            shaped(py, numbers, [vec![count], shape].concat())
        });
        let mut derivatives: Vec<_> = derivatives.collect::<PyResult<_>>()?;
        if with_shares {
            let raster = device.membrane().raster;
            let missing = vec![f64::NAN; raster.cells()];
            let each = found
                .iter()
                .map(|found| found.as_ref().map_or(&missing, |found| &found.coverage));
            let numbers: Vec<f64> = each.flatten().copied().collect();
            derivatives.push(shaped(py, numbers, vec![count, raster.rows(), raster.columns()])?);
        }
        Ok((values, derivatives))
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

/// Raises an error of a call on a scene.
fn or_raised<T>(scene: &Bound<'_, Scene>, result: Result<T, CliError>) -> PyResult<T> {
    result.map_err(|error| raised(scene.py(), &error))
}

/// Analyses patterns in a scene.
fn analysed<'py>(
    scene: &Bound<'py, Scene>,
    groups: &Groups<'py>,
    shares: Option<&Shares<'py>>,
    solver: &str,
    analysis: Analysis,
) -> PyResult<Found> {
    let parameters = or_raised(scene, scene.get().parameters(solver))?;
    let patterns = or_raised(scene, patterns(scene.get().device.form(), groups, shares, Keep::Cut))?;
    let of = scene.clone().unbind();
    let Analysed { arrays, warnings } = run(scene.py(), move || {
        analysis.run(&Computation {
            scene: &of.get().device,
            patterns: &patterns,
            drawings: &[],
            parameters: &parameters,
            progress: &Unseen,
        })
    })?;
    Ok(Found::new(arrays, warnings))
}

/// Checks that a scene has no states to choose from.
fn one_state(device: &Device, what: &str) -> Result<(), CliError> {
    match device.states.is_empty() {
        true => Ok(()),
        false => Err(
            CliError::bad_input(format!("{what} computed for one state of a device"))
                .help("choose a state with `in_state`"),
        ),
    }
}

/// A value for each pattern, and a gradient for each.
type ValuesAndGradients<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// A value for each pattern, and an array of derivatives for each parameter, then perhaps that for the shares.
type ValuesAndDerivatives<'py> = (Bound<'py, PyAny>, Vec<Bound<'py, PyAny>>);

/// Returns the weights of the corners for each of `count` patterns.
fn weights_of(device: &Device, count: usize, weights: &PyReadonlyArray4<'_, f64>) -> Result<Vec<Field>, CliError> {
    one_state(device, "weighted displacements are")?;
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
        let parameters = scene.get().parameters(solver)?;
        Ok((parameters, patterns(device.form(), groups, Some(shares), Keep::All)?))
    })()
    .map_err(|error: CliError| raised(py, &error))?;
    let scene = scene.clone().unbind();
    let count = patterns.len();
    let found = run(py, move || {
        let scene = scene.get();
        let ready = scene.ready(&parameters)?;
        values_and_gradients(&ready.equilibria, &scene.device, &patterns, functional)
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
