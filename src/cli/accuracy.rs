//! `deaflow accuracy`: measures error and time of methods and meshes in a scene.

mod findings;
mod networks;
mod request;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use findings::Findings;
use serde_json::json;

pub use request::{AccuracyRequest, MeasuredAccuracy, Networks, SolvedReference};

use super::arguments::{StateArguments, StoreArguments, accuracy, integer};
use super::pipeline::{read_scene, warn_of_units};
use super::progress::Bar;
use super::{CliError, Exit, Output, csv, job, write};
use deaflow_accuracy::{Benchmark, Measured};
use deaflow_base::{Document, Quantity, with_minus};
use deaflow_pattern::DrawingOptions;
use deaflow_report::figures::{Cost, FamilyCosts, accuracy_sheet};
use deaflow_stage::accuracy::content;
use deaflow_stage::direct;
use deaflow_store::{Provenance, write_file};

/// The heading of options about the patterns to measure on.
const PATTERNS: &str = "Patterns";

/// Measure error and time of methods and meshes in a scene
#[derive(Debug, Args)]
#[command(after_help = concat!(
    examples!("deaflow accuracy scene.yaml -o accuracy --target \"0.01 mm\""),
    "\n\n--jobs applies to the reference; methods are measured on one thread."
))]
pub struct AccuracyArguments {
    /// The scene: a YAML file of a scene, or of a pipeline that has one
    pub scene: PathBuf,
    /// Patterns to measure on: FILE.npy, FILE.csv, FILE.png, FILE.dxf, FILE.svg or FILE.h5:/dataset
    #[arg(long, value_name = "PATTERN", num_args = 1.., help_heading = PATTERNS)]
    #[arg(conflicts_with_all = ["families", "count", "seed"])]
    pub patterns: Vec<String>,
    /// The same, as for `solve` and `screen`
    #[arg(value_name = "PATTERN", help_heading = PATTERNS)]
    #[arg(conflicts_with_all = ["patterns", "families", "count", "seed"])]
    pub own: Vec<String>,
    /// Measure on patterns of the families small and large grids, Bézier curves, stripes, blobs, checkers, dithers,
    /// mazes,
    /// diagonals, spirals, glyphs and single cells; the default
    #[arg(long, help_heading = PATTERNS)]
    pub families: bool,
    /// Number of patterns per family
    #[arg(long, value_name = "N", default_value_t = 12, help_heading = PATTERNS)]
    #[arg(value_parser = integer::<u64>(AccuracyRequest::PER_FAMILY))]
    pub count: u64,
    /// Seed of the families
    #[arg(long, value_name = "S", default_value_t = 1, help_heading = PATTERNS)]
    #[arg(value_parser = integer::<u64>(0..=i64::MAX as u64))]
    pub seed: u64,
    /// Folder for accuracy.h5, accuracy.csv and accuracy.png
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Find the fastest setting with an error of at most this, as in "0.01 mm"
    #[arg(long, value_name = "LENGTH", value_parser = accuracy)]
    pub target: Option<Quantity>,
    /// Methods to measure, as in "[linear, chord:1, { elements_per_cell: 4, order: 2 }, { accuracy: 0.01 mm },
    /// { model: FILE.safetensors }]"
    #[arg(long, value_name = "YAML")]
    pub methods: Option<String>,
    /// Also measure this trained model, named as for `predict`; can be repeated
    #[arg(long, value_name = "MODEL")]
    pub model: Vec<String>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// The reference; with `history: { at: [10 s] }` in it, the state at that time is compared, which the methods
    /// `history`
    /// and `creep:3` find too
    #[arg(long, value_name = "YAML", default_value = AccuracyRequest::REFERENCE)]
    pub reference: String,
    #[command(flatten)]
    pub state: StateArguments,
}

/// The written files: arrays, a table and a figure.
const FILES: [&str; 3] = ["accuracy.h5", "accuracy.csv", "accuracy.png"];

pub fn execute(arguments: &AccuracyArguments, output: &Output) -> Result<Exit, CliError> {
    let reference = Document::from_text(Path::new("--reference"), &arguments.reference)?;
    let methods = arguments.methods.as_ref();
    let methods = methods.map(|text| Document::from_text(Path::new("--methods"), text));
    let methods = methods.transpose()?;
    let scene = arguments.state.of(read_scene(&arguments.scene, output)?)?;
    let networks = Networks {
        names: &arguments.model,
        store: arguments.store.given().map(Path::to_path_buf),
    };
    let request = AccuracyRequest::new(scene, &reference, methods.as_ref(), &networks);
    // Also where the request is refused: it may be for a number in another unit.
    for document in [Some(&reference), methods.as_ref()].into_iter().flatten() {
        warn_of_units(document, output);
    }
    let request = on_patterns(request?, arguments, output)?;
    // Checked before minutes of work.
    write::folder(&arguments.output)?;
    let [file, rows, figure] = FILES.map(|name| arguments.output.join(name));
    write::check_file(&file)?;
    write::check_csv(&rows)?;
    write::check_file(&figure)?;
    let start = Instant::now();
    let bar = Bar::new("reference", "patterns", request.patterns() as u64);
    let solved = request.solve(&bar)?;
    bar.clear();
    let bar = Bar::new("measure", "methods", solved.methods() as u64);
    let MeasuredAccuracy { benchmark, measured } = solved.measure(&bar)?;
    bar.clear();
    let files = write_files(arguments, &benchmark, &measured, start, output)?;
    let findings = Findings::new(&benchmark, &measured, arguments.target);
    let document = || {
        let mut document = findings.document();
        document["files"] = json!(files);
        document
    };
    output.result(document, || findings.text(&arguments.scene, &files))?;
    Ok(if findings.is_missed() {
        Exit::Failure
    } else {
        Exit::Done
    })
}

/// Measures on the named patterns, or else on families.
fn on_patterns(
    request: AccuracyRequest,
    arguments: &AccuracyArguments,
    output: &Output,
) -> Result<AccuracyRequest, CliError> {
    let own = [arguments.patterns.as_slice(), &arguments.own].concat();
    if own.is_empty() {
        return request.on_families(arguments.count, arguments.seed);
    }
    let direct::NamedPatterns {
        patterns,
        notes,
        drawings,
        ..
    } = direct::patterns(&own, request.scene().form(), &DrawingOptions::default())?;
    notes.iter().for_each(|note| output.warn(note));
    if patterns.is_empty() {
        return Err(CliError::bad_input("the files contain no patterns"));
    }
    Ok(request.on_patterns(patterns, drawings))
}

fn write_files(
    arguments: &AccuracyArguments,
    benchmark: &Benchmark,
    measured: &[Measured],
    start: Instant,
    output: &Output,
) -> Result<Vec<PathBuf>, CliError> {
    let [file, rows, figure] = FILES.map(|name| arguments.output.join(name));
    let scene = arguments.state.described(&arguments.scene);
    let parameters = format!("{scene}, reference {}", arguments.reference);
    let provenance = Provenance {
        measurements: benchmark.measurements(measured),
        ..job::provenance("accuracy", parameters.clone(), start.elapsed().as_secs_f64())
    };
    write_file(&file, &content(benchmark, measured).object(), &provenance)?;
    let table = table(benchmark, measured)?;
    write::csv(&rows, table.as_bytes(), "deaflow accuracy", &parameters)?;
    let mut files = vec![file, rows];
    let moved = measured.iter().any(|method| method.rms() > 0.0);
    // Without displacement there are no errors to draw.
    if moved {
        let draw = |figure: &Path| accuracy_sheet(&costs(benchmark, measured))?.write_png(figure);
        files.extend(write::drawn(figure, draw, output));
    }
    Ok(files)
}

fn costs(benchmark: &Benchmark, measured: &[Measured]) -> Vec<FamilyCosts> {
    let cost = |k: usize| {
        move |method: &Measured| Cost {
            settings: method.settings.clone(),
            seconds: method.seconds[k],
            error: method.families[k].rms,
        }
    };
    let families = benchmark.families.iter().enumerate();
    let panel = |(k, family): (usize, &String)| FamilyCosts {
        family: family.clone(),
        costs: measured.iter().map(cost(k)).collect(),
    };
    families.map(panel).collect()
}

/// Returns one row per method and family as comma-separated values with a header.
fn table(benchmark: &Benchmark, measured: &[Measured]) -> Result<String, CliError> {
    let header = [
        "settings",
        "family",
        "patterns",
        "rms_mm",
        "max_mm",
        "bound_mm",
        "seconds_per_pattern",
        "missed",
        "false_alarms",
    ];
    let rows = measured.iter().flat_map(|method| {
        benchmark.families.iter().enumerate().map(move |(k, family)| {
            let (error, [patterns, _]) = (&method.families[k], benchmark.counts(k));
            let numbers = [error.rms, error.max, error.bound, method.seconds[k]].map(|x| format!("{x:e}"));
            let counts = [error.missed, error.false_alarms].map(|n| n.to_string());
            let row = [method.settings.clone(), family.clone(), patterns.to_string()];
            row.into_iter().chain(numbers).chain(counts).collect()
        })
    });
    csv::text(&header.map(str::to_owned), rows)
}

/// Formats an error with two digits.
fn millimetres(mm: f64) -> String {
    if mm.is_infinite() {
        return "unknown".to_owned();
    }
    if mm >= 1e-3 || mm == 0.0 {
        let decimals = if mm == 0.0 {
            0
        } else {
            (1 - mm.log10().floor() as i32).max(0) as usize
        };
        format!("{mm:.decimals$}")
    } else {
        with_minus(&format!("{mm:.1e}"))
    }
}
