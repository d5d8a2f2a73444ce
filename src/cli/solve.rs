//! `deaflow solve`: simulates patterns that somebody drew.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{PatternArguments, StateArguments, TOLERANCE, TimeArguments, accuracy, number};
use super::error::CliError;
use super::examples::examples;
use super::history::HistoryArguments;
use super::modes::ModesArguments;
use super::outcomes::FEW;
use super::output::{Exit, Output};
use super::point::PointArguments;
use super::progress::Bar;
use super::response::ResponseArguments;
use super::simulate::{self, Answer};
use super::text::Text;
use super::tone::Tone;
use super::{history, modes, outcomes, path, response, table, write};
use deaflow_base::Quantity;
use deaflow_fem::{MeshRequest, Method, SolveOptions, SolverParameters, check_leads};
use deaflow_field::{Mesh, Order};
use deaflow_orchestrator::Environment;
use deaflow_scene::Scene;
use deaflow_stage as stage;
use deaflow_stage::direct;
use deaflow_store::{Provenance, write_file};

/// The heading of options about the numerical method.
const METHOD: &str = "Method";

/// What is said of voltages at which bilinear elements lose stability.
const LATE: &str = "these voltages are of this mesh of bilinear elements, which lose stability too late: --order 2 is nearer, --path says by how much";

/// What is said of those at which other elements do.
const ALONE: &str = "each of these voltages is of one mesh alone, and a little too high next to corners of electrodes: --path says by how much";

/// Simulate patterns with finite elements
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow solve scene.yaml mine.csv -o simulated.h5", "deaflow solve scene.yaml mine.csv --accuracy \"0.005 mm\" -o simulated.h5"))]
pub struct SolveArguments {
    /// A scene, or a pipeline whose scene is meant; a YAML file
    pub scene: PathBuf,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// Simulate at this voltage instead of the scene's, as in "4 kV"
    #[arg(long, value_name = "VOLTAGE", allow_hyphen_values = true)]
    voltage: Option<String>,
    /// Change a value of the scene for this call, such as drive.voltage="4 kV"
    #[arg(long = "set", value_name = "PATH=VALUE")]
    sets: Vec<String>,
    /// How fields are found: newton, or as estimates that are no equilibria linear or chord:N (N chord steps)
    #[arg(long, value_name = "METHOD", default_value = "newton", value_parser = Method::from_str, help_heading = METHOD)]
    pub method: Method,
    /// Elements along one side of a cell [default: 2; 1 for a path]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=8), help_heading = METHOD)]
    elements_per_cell: Option<u64>,
    /// Polynomial order of the elements [default: 1; 2 for a path, because bilinear ones lose stability too late]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=2), help_heading = METHOD)]
    order: Option<u64>,
    /// Pick mesh and order for each pattern so that the displacement is this accurate, as in "0.005 mm"; the estimated
    /// error of each pattern is written too
    #[arg(long, value_name = "LENGTH", value_parser = accuracy, allow_hyphen_values = true, conflicts_with_all = ["elements_per_cell", "order"], help_heading = METHOD)]
    pub accuracy: Option<Quantity>,
    /// Relative residual at which an equilibrium is accepted [default: 1e-8]
    #[arg(long, value_name = "R", value_parser = number(1e-12..=1e-3, "1e-12 to 1e-3"), allow_hyphen_values = true, help_heading = METHOD)]
    pub tolerance: Option<f64>,
    #[command(flatten)]
    pub time: TimeArguments,
    /// Write stretches, field, stresses and tension of every cell too
    #[arg(long, conflicts_with_all = ["accuracy", "path"])]
    pub cells: bool,
    /// Follow each pattern from rest past the voltage at which it loses stability, whatever the voltage of the scene;
    /// OUT.csv and OUT.png are written beside OUT.h5
    #[arg(long, conflicts_with_all = ["accuracy", "time_limit"])]
    pub path: bool,
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

impl SolveArguments {
    /// The scene as it is to be simulated.
    ///
    /// # Errors
    /// When it cannot be read, a value cannot be changed, or it has no such state.
    pub fn read_scene(&self) -> Result<Scene, CliError> {
        self.state.of(direct::read_scene_with(&self.scene, self.changes())?)
    }

    /// The scene in words: its file, state and changes.
    pub fn described(&self) -> String {
        let changes = self.changes().said().map(|set| format!(", {set}"));
        self.state.described(&self.scene) + &changes.collect::<String>()
    }

    fn changes(&self) -> direct::Changes<'_> {
        direct::Changes {
            sets: &self.sets,
            voltage: self.voltage.as_deref(),
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> Mesh {
        let (elements, order) = if self.path { (1, 2) } else { (2, 1) };
        let order = match self.order.unwrap_or(order) {
            1 => Order::Bilinear,
            _ => Order::Biquadratic,
        };
        Mesh::new(self.elements_per_cell.unwrap_or(elements) as usize, order)
    }

    /// Mesh and tolerance of Newton's method.
    pub fn options(&self) -> SolveOptions {
        SolveOptions {
            mesh: self.mesh(),
            tolerance: self.tolerance.unwrap_or(TOLERANCE),
        }
    }

    /// Method, mesh or accuracy, and tolerance.
    pub fn parameters(&self) -> SolverParameters {
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
    let scene = direct::files_read(&arguments.scene);
    let scene: Vec<&str> = scene.iter().map(String::as_str).collect();
    if let Some(file) = &arguments.patterns.output {
        check_file(file, &arguments.patterns, &scene)?;
    }
    arguments.patterns.check_ending()?;
    check_method(arguments)?;
    let is_other = arguments.path
        || arguments.history.history
        || arguments.modes.modes.is_some()
        || arguments.response.response.is_some();
    if is_other && arguments.point.is_given() {
        return Err(CliError::bad_input(
            "--point is of one equilibrium, and stands beside none of --path, --history, --modes and --response",
        ));
    }
    if arguments.path {
        return path::execute(arguments, &scene, output);
    }
    if let Some(count) = arguments.modes.modes {
        return modes::execute(arguments, count, output);
    }
    if let Some(range) = arguments.response.response {
        return response::execute(arguments, range, &scene, output);
    }
    if arguments.history.history {
        return history::execute(arguments, &scene, output);
    }
    let read = arguments.read_scene()?;
    if let Some(faint) = stage::of_faint_drive(&read.at_largest_voltages()) {
        output.complain(&format!("warning: {faint}"));
    }
    let (patterns, names) = direct::patterns_with_names(&arguments.patterns.patterns, read.form())?;
    let watched = arguments.point.on(&read)?;
    check_leads(read.leads.as_ref(), &patterns)?;
    let request = arguments.parameters();
    let (bar, start) = (
        Bar::new("solve", "patterns", (patterns.len() * read.in_states().len()) as u64),
        Instant::now(),
    );
    let mut answer = simulate::solve(&read, &patterns, &request, (arguments.cells, watched), &bar)?;
    for ending in &mut answer.endings {
        ending.name.clone_from(&names[ending.place.index]);
    }
    bar.clear();
    let parameters = format!("{}, {request}", arguments.described());
    conclude(&arguments.patterns, answer, ("solve", parameters), start, output)
}

/// A pattern in the place of the scene is most likely one that was named first.
fn check_order(arguments: &SolveArguments) -> Result<(), CliError> {
    let extension = |path: &Path| path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let is_pattern =
        extension(&arguments.scene).is_some_and(|e| ["csv", "npy", "png", "h5", "hdf5"].contains(&e.as_str()));
    if !is_pattern {
        return Ok(());
    }
    let patterns = &arguments.patterns.patterns;
    let is_scene = |name: &&String| extension(Path::new(name)).is_some_and(|e| e == "yaml" || e == "yml");
    let first = arguments.scene.display();
    let error = CliError::bad_input(format!("{first} is a pattern, and a scene is wanted first"));
    Err(match patterns.iter().find(is_scene) {
        Some(scene) => {
            let others = patterns.iter().filter(|name| *name != scene).map(String::as_str);
            let others: Vec<&str> = others.collect();
            let others = [
                &[first.to_string()][..],
                &others.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>(),
            ]
            .concat();
            error.help(format!(
                "the order is SCENE PATTERN…: deaflow solve {scene} {}",
                others.join(" ")
            ))
        }
        None => error.help("the order is SCENE PATTERN…, and a scene is a YAML file"),
    })
}

/// An estimate is no equilibrium: it has no accuracy, no tolerance, no stresses to be trusted and no path.
fn check_method(arguments: &SolveArguments) -> Result<(), CliError> {
    let beside = match arguments {
        a if a.method == Method::Newton => return Ok(()),
        a if a.accuracy.is_some() => "--accuracy",
        a if a.tolerance.is_some() => "--tolerance",
        a if a.time.time_limit.is_some() => "--time-limit",
        a if a.cells => "--cells",
        a if a.path => "--path",
        a if a.history.history => "--history",
        a if a.modes.modes.is_some() => "--modes",
        a if a.response.response.is_some() => "--response",
        _ => return Ok(()),
    };
    let message = format!("{beside} cannot stand beside --method {}", arguments.method);
    Err(CliError::bad_input(message).help("an estimate is no equilibrium: take --method newton, or leave it out"))
}

/// What cannot be written, or must not be, has to be known before hours of work, not after: the file that `-o` names, or one beside it.
/// `others` are read beside the patterns: the scene with its files, or the model.
pub fn check_file(path: &Path, arguments: &PatternArguments, others: &[&str]) -> Result<(), CliError> {
    let inputs = arguments
        .patterns
        .iter()
        .map(String::as_str)
        .chain(others.iter().copied());
    check_not_read(path, &inputs.collect::<Vec<_>>())?;
    write::check_file(path)
}

/// Refuses to write a file that one of these arguments means.
///
/// # Errors
/// When it would be lost.
pub fn check_not_read(path: &Path, inputs: &[&str]) -> Result<(), CliError> {
    let shown = path.display();
    if inputs
        .iter()
        .flat_map(|input| files_named(input))
        .any(|input| is_same_file(&input, path))
    {
        return Err(
            CliError::bad_input(format!("{shown} is read here: writing it would lose it"))
                .help("-o must name another file"),
        );
    }
    Ok(())
}

/// The files that an argument may mean: itself, and what stands before each colon (`FILE.h5:/dataset`, `PIPELINE:STAGE`).
pub fn files_named(argument: &str) -> impl Iterator<Item = PathBuf> {
    let ends = argument.match_indices(':').map(|(at, _)| at).chain([argument.len()]);
    ends.map(|end| PathBuf::from(&argument[..end]))
}

/// Whether two paths lead to one file.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Writes the file and says what is in it.
pub fn conclude(
    arguments: &PatternArguments,
    answer: Answer,
    (kind, parameters): (&str, String),
    start: Instant,
    output: &Output,
) -> Result<Exit, CliError> {
    let seconds = start.elapsed().as_secs_f64();
    let provenance = provenance(kind, parameters, seconds);
    if let Some(file) = &arguments.output {
        write_file(file, &answer.content, &provenance)?;
    }
    let (n, unstable) = (answer.samples, answer.unstable.len());
    if output.is_json() {
        let outcomes = answer
            .unstable
            .iter()
            .map(|(place, outcome)| place.document(json!({ "outcome": outcome })));
        let missed = answer
            .missed
            .iter()
            .map(|(place, error)| place.document(json!({ "discretisation_error": error })));
        let wrinkled = answer
            .wrinkled
            .iter()
            .map(|(place, fraction)| place.document(json!({ "wrinkled_fraction": fraction })));
        let near = answer.near_limit.iter().map(|(place, found)| {
            place.document(json!({
                "critical_voltage": found.map(|found| found.voltage),
                "error": found.and_then(|found| found.error),
            }))
        });
        let critical = answer.critical.iter();
        let critical = critical.map(|found| {
            found.place.document(json!({
                "between": found.between,
                "elements_per_cell": found.mesh.elements_per_cell(),
                "order": found.mesh.order().degree(),
            }))
        });
        let mut document = json!({
            "file": arguments.output,
            "samples": n,
            "unstable": unstable,
            "unstable_samples": outcomes.collect::<Vec<_>>(),
            "accuracy_missed": missed.collect::<Vec<_>>(),
            "near_limit": near.collect::<Vec<_>>(),
            "critical_voltages": critical.collect::<Vec<_>>(),
            "warnings": answer.warnings,
            "wrinkled": wrinkled.collect::<Vec<_>>(),
            "seconds": seconds,
        });
        if let (Some(document), Value::Object(of_all)) = (document.as_object_mut(), outcomes::document(&answer.endings))
        {
            document.extend(of_all);
        }
        if let Some(watched) = &answer.watched {
            document["along"] = watched.document();
        }
        if !answer.statement.key.is_empty() {
            document[answer.statement.key] = json!(answer.statement.document);
        }
        output.document(&document)?;
    } else {
        output.text(text(arguments, answer, seconds))?;
    }
    Ok(if unstable > 0 { Exit::Unstable } else { Exit::Done })
}

/// What is said of an answer.
fn text(arguments: &PatternArguments, answer: Answer, seconds: f64) -> Text {
    let n = answer.samples;
    let done = format!(
        "{} in {}",
        table::counted(n as u64, "patterns"),
        table::seconds(seconds)
    );
    let mut text = Text::from(match &arguments.output {
        Some(file) => format!("{}: {done}", file.display()),
        None => done,
    });
    if answer.endings.len() > FEW || !answer.statement.tells_each || answer.watched.is_some() {
        text.append(outcomes::text(
            &answer.endings,
            arguments.output.as_deref(),
            answer.watched.as_ref(),
        ));
    }
    let outcomes = answer.unstable.iter();
    let outcomes = outcomes.map(|(place, outcome)| match outcome.as_str() {
        "no-estimate" => format!("{place} has no estimate: the steps lead to no state of the membrane"),
        outcome => format!("{place}: no stable solution was found: {outcome}"),
    });
    first(&mut text, Tone::Bad, outcomes);
    // How a pattern ended that has no state says it already.
    let critical: Vec<_> = answer.critical.iter().filter(|found| !found.is_lost).collect();
    let critical = critical.into_iter().map(|found| match found.between {
        Some([stable, lost]) => format!(
            "{}: stability is lost between {stable:.1} V and {lost:.1} V{}",
            found.place, found.on
        ),
        None => format!("{}: where stability is lost was not found", found.place),
    });
    first(&mut text, Tone::Plain, critical);
    if answer.is_late {
        text.toned(Tone::Caution, LATE);
    } else if answer.critical.iter().any(|found| found.between.is_some()) {
        text.toned(Tone::Caution, ALONE);
    }
    let near = answer.near_limit.iter().map(|(place, found)| {
        let limit = found.map_or("; where stability is lost was not found".to_owned(), |found| {
            format!(": stability is lost at {}", path::with_error(&found))
        });
        format!("{place}: a finer mesh could refuse it{limit}")
    });
    first(&mut text, Tone::Caution, near);
    let missed = answer.missed.iter().map(|(place, error)| {
        format!("{place}: the finest mesh leaves an estimated error of {error:.2e} mm, more than was asked for")
    });
    first(&mut text, Tone::Caution, missed);
    for warning in &answer.warnings {
        text.line(format!("model warning: {warning}"));
    }
    let wrinkled = answer.wrinkled.iter();
    let wrinkled =
        wrinkled.map(|(place, fraction)| format!("{place}: {:.1} % of the membrane would wrinkle", 100.0 * fraction));
    first(&mut text, Tone::Plain, wrinkled);
    text.append(answer.statement.text);
    text
}

/// Adds a line for each of a few patterns, and how many more there are.
fn first(text: &mut Text, tone: Tone, mut lines: impl ExactSizeIterator<Item = String>) {
    for line in lines.by_ref().take(FEW) {
        text.toned(tone, line);
    }
    if lines.len() > 0 {
        text.toned(
            tone,
            format!("and {} more such patterns: --json lists all", lines.len()),
        );
    }
}

/// Who made a file, when and how.
pub fn provenance(kind: &str, parameters: String, seconds: f64) -> Provenance {
    let environment = Environment::system();
    Provenance {
        created: environment.now(),
        host: environment.host,
        version: environment.version,
        build: environment.build,
        target: environment.target,
        seconds,
        kind: kind.to_owned(),
        parameters,
        ..Provenance::default()
    }
}
