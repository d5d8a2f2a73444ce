//! `deaflow solve`: simulates patterns. Each form of it (equilibria, load paths, histories, modes, responses) is a
//! child module.

mod analysis;
mod breakdown;
mod cells;
mod equilibria;
mod equilibrium;
mod figure;
mod history;
pub mod inflation;
mod inflation_path;
mod modes;
mod path;
mod response;
mod simulation;

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;

use super::arguments::{
    EdgesArguments, PatternArguments, StateArguments, TOLERANCE, TimeArguments, accuracy, integer, number,
};
use super::point::PointArguments;
use super::{CliError, Exit, Output, write};
use deaflow_base::Quantity;
use deaflow_fem::{MeshRequest, Method, PathParameter, SolveOptions, SolverParameters};
use deaflow_field::{Mesh, Order};
use deaflow_pattern::has_patterns;
use deaflow_stage::direct::{self, ReadScene};

pub use analysis::{Analysed, Analysis};
pub use equilibria::{Equilibria, SolveRequest, Solved};
use history::HistoryArguments;
pub use history::OutputTimes;
pub use inflation::warnings_of_states;
use modes::ModesArguments;
pub use path::field_along;
pub use response::Frequencies;
use response::ResponseArguments;
pub use simulation::Computation;

/// The heading of options about the numerical method.
const METHOD: &str = "Method";

/// Simulate patterns with finite elements
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow solve scene.yaml mine.csv -o simulated.h5",
    "deaflow solve scene.yaml mine.csv --accuracy \"0.005 mm\" -o simulated.h5",
    "deaflow solve scene.yaml mine.csv --figure moved.png",
))]
pub struct SolveArguments {
    /// The scene: a YAML file of a scene, or of a pipeline that has one
    pub scene: PathBuf,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// Simulate at this voltage instead of the scene's, as in "4 kV"
    #[arg(long, value_name = "VOLTAGE", allow_hyphen_values = true)]
    voltage: Option<String>,
    /// Override a value of the scene, such as drive.voltage="4 kV"
    #[arg(long = "set", value_name = "PATH=VALUE")]
    sets: Vec<String>,
    #[command(flatten)]
    pub edges: EdgesArguments,
    /// The method: newton, or the estimates linear and chord:N (N chord steps), which are not equilibria
    #[arg(
        long,
        value_name = "METHOD",
        default_value = "newton",
        value_parser = Method::from_str,
        help_heading = METHOD
    )]
    pub method: Method,
    /// Elements along one side of a cell [default: 2; 1 for a path]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=8), help_heading = METHOD)]
    elements_per_cell: Option<u64>,
    /// Polynomial order of the elements [default: 1; 2 for a path, because bilinear elements overestimate critical
    /// voltages]
    #[arg(long, value_name = "N", value_parser = integer::<u64>(1..=2), help_heading = METHOD)]
    order: Option<u64>,
    /// Choose mesh and order for each pattern so that the displacement is this accurate, as in "0.005 mm"; the
    /// estimated
    /// error of each pattern is written too
    #[arg(
        long,
        value_name = "LENGTH",
        value_parser = accuracy,
        allow_hyphen_values = true,
        conflicts_with_all = ["elements_per_cell", "order"],
        help_heading = METHOD
    )]
    pub accuracy: Option<Quantity>,
    /// Relative residual at which an equilibrium is accepted [default: 1e-8]
    #[arg(
        long,
        value_name = "R",
        value_parser = number(1e-12..=1e-3, "1e-12 to 1e-3"),
        allow_hyphen_values = true,
        help_heading = METHOD
    )]
    pub tolerance: Option<f64>,
    /// Skip the checks after the solution, which can take longer than the solution: whether a finer mesh could find no
    /// stable solution, and how much neglected effects would change the displacement
    #[arg(long, conflicts_with_all = ["path", "history", "modes", "response"], help_heading = METHOD)]
    pub no_checks: bool,
    #[command(flatten)]
    pub time: TimeArguments,
    /// Draw the patterns with their displacements, at most six; an existing file is replaced
    #[arg(long, value_name = "OUT.png", conflicts_with_all = ["path", "history", "modes", "response"])]
    figure: Option<PathBuf>,
    /// Also write stretches, electric field, stresses and tension state of every cell
    #[arg(long, conflicts_with_all = ["accuracy", "path"])]
    pub cells: bool,
    /// Follow the load path of each pattern from rest past its critical voltage, whatever the voltage of the scene; or
    /// at this voltage, with forces (load), given displacements of bars (displacement), the pressure or the volume of
    /// `loads` rising from 0 to those of the scene. OUT.csv and OUT.png are written next to OUT.h5
    #[arg(
        long,
        value_name = "PARAMETER",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = PathParameter::Voltage.name(),
        value_parser = path_parameter,
        conflicts_with_all = ["accuracy", "time_limit"]
    )]
    pub path: Option<PathParameter>,
    #[command(flatten)]
    pub history: HistoryArguments,
    #[command(flatten)]
    pub modes: ModesArguments,
    #[command(flatten)]
    pub response: ResponseArguments,
    #[command(flatten)]
    pub point: PointArguments,
    #[command(flatten)]
    pub state: StateArguments,
}

/// Parses what changes along a path.
fn path_parameter(text: &str) -> Result<PathParameter, String> {
    let known = PathParameter::ALL
        .into_iter()
        .find(|parameter| parameter.name() == text);
    known.ok_or_else(|| format!("allowed: {}", PathParameter::ALL.map(PathParameter::name).join(", ")))
}

impl SolveArguments {
    /// Returns the scene in the requested state, with its overrides.
    ///
    /// # Errors
    /// When it cannot be read, a value cannot be overridden, or it has no such state.
    fn read_scene(&self) -> Result<ReadScene, CliError> {
        let read = direct::read_scene_with(&self.scene, self.changes())?;
        Ok(ReadScene {
            scene: self.state.of(read.scene)?,
            ..read
        })
    }

    /// Describes the scene: its file, state and overrides.
    fn described(&self) -> String {
        let changes = self.changes().to_texts().map(|set| format!(", {set}"));
        self.state.described(&self.scene) + &changes.collect::<String>()
    }

    fn changes(&self) -> direct::Changes<'_> {
        direct::Changes {
            sets: &self.sets,
            voltage: self.voltage.as_deref(),
        }
    }

    /// The files that are read: patterns, scene, and what the scene names.
    fn inputs(&self) -> Vec<String> {
        [self.patterns.patterns.clone(), direct::files_read(&self.scene)].concat()
    }

    /// The mesh.
    fn mesh(&self) -> Mesh {
        let (elements, order) = if self.path.is_some() { (1, 2) } else { (2, 1) };
        let order = match self.order.unwrap_or(order) {
            1 => Order::Bilinear,
            _ => Order::Biquadratic,
        };
        Mesh::new(self.elements_per_cell.unwrap_or(elements) as usize, order)
    }

    /// Mesh and tolerance of Newton's method.
    fn options(&self) -> SolveOptions {
        SolveOptions {
            mesh: self.mesh(),
            tolerance: self.tolerance.unwrap_or(TOLERANCE),
        }
    }

    /// Method, mesh or accuracy, tolerance and limit of work.
    fn parameters(&self) -> SolverParameters {
        let request = self
            .accuracy
            .map_or(MeshRequest::Fixed(self.mesh()), MeshRequest::Accuracy);
        SolverParameters::new(self.method, request)
            .with_tolerance(self.options().tolerance)
            .with_time_limit(self.time.time_limit)
    }
}

pub fn execute(arguments: &SolveArguments, output: &Output) -> Result<Exit, CliError> {
    check_order(arguments)?;
    check_parameter(arguments)?;
    if let Some(file) = &arguments.patterns.output {
        write::check_output(file, &arguments.inputs())?;
    }
    arguments.patterns.check_ending()?;
    if let Some(file) = &arguments.figure {
        write::check_png(file)?;
        write::check_output(file, &arguments.inputs())?;
    }
    check_options(arguments)?;
    if let Some(parameter) = arguments.path {
        path::execute(arguments, parameter, output)
    } else if let Some(count) = arguments.modes.modes {
        modes::execute(arguments, count, output)
    } else if let Some(range) = arguments.response.response {
        response::execute(arguments, range, output)
    } else if arguments.history.history {
        history::execute(arguments, output)
    } else {
        equilibrium::execute(arguments, output)
    }
}

/// Refuses a pattern in the place of the scene: most likely the two were swapped.
fn check_order(arguments: &SolveArguments) -> Result<(), CliError> {
    let extension = |path: &Path| path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if !has_patterns(&arguments.scene) {
        return Ok(());
    }
    let patterns = &arguments.patterns.patterns;
    let is_scene = |name: &&String| extension(Path::new(name)).is_some_and(|e| e == "yaml" || e == "yml");
    let first = arguments.scene.display();
    let error = CliError::bad_input(format!("{first} is a pattern; the first argument must be the scene"));
    Err(match patterns.iter().find(is_scene) {
        Some(scene) => {
            let others = patterns.iter().filter(|name| *name != scene);
            let others: String = others.map(|name| format!(" {name}")).collect();
            error.help(format!("deaflow solve {scene} {first}{others}"))
        }
        None => error.help("deaflow solve SCENE.yaml PATTERN…"),
    })
}

/// Refuses what changes along a path in the place of a pattern: the value of the option follows `=`.
fn check_parameter(arguments: &SolveArguments) -> Result<(), CliError> {
    let mut patterns = arguments.patterns.patterns.iter();
    let is_parameter = |name: &&String| path_parameter(name).is_ok() && !Path::new(name).exists();
    match patterns.find(is_parameter).filter(|_| arguments.path.is_some()) {
        Some(name) => Err(CliError::bad_input(format!("{name} is not a pattern")).help(format!(
            "what changes along a path follows an equals sign: --path={name}"
        ))),
        None => Ok(()),
    }
}

/// Refuses options that do not go together with the form or the method.
fn check_options(arguments: &SolveArguments) -> Result<(), CliError> {
    let forms = [
        ("--path", arguments.path.is_some()),
        ("--history", arguments.history.history),
        ("--modes", arguments.modes.modes.is_some()),
        ("--response", arguments.response.response.is_some()),
    ];
    let form = forms.into_iter().find(|(_, is_given)| *is_given);
    let has_displacement = |form: &str| ["--path", "--history"].contains(&form);
    if let Some((form, _)) = form.filter(|(form, _)| arguments.point.is_given() && !has_displacement(form)) {
        return Err(CliError::bad_input(format!("--point cannot be combined with {form}"))
            .help("--point reports the displacement of equilibria, histories and paths"));
    }
    let needs_equilibrium = [
        ("--accuracy", arguments.accuracy.is_some()),
        ("--tolerance", arguments.tolerance.is_some()),
        ("--time-limit", arguments.time.time_limit.is_some()),
        ("--cells", arguments.cells),
    ];
    let needs_equilibrium = needs_equilibrium.into_iter().chain(form);
    match needs_equilibrium
        .filter(|_| arguments.method != Method::Newton)
        .find(|(_, is_given)| *is_given)
    {
        Some((option, _)) => Err(CliError::bad_input(format!(
            "{option} cannot be combined with --method {}",
            arguments.method
        ))
        .help("estimates are not equilibria: use --method newton, or omit it")),
        None => Ok(()),
    }
}
