//! `deaflow accuracy`: what accuracy costs in a scene, without a store.

mod findings;
mod networks;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use findings::Findings;

use super::arguments::{StateArguments, StoreArguments, accuracy};
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::{model, solve, write};
use deaflow_accuracy::{AccuracyError, Benchmark, Candidate, Families, Measured, Network, Reference, drawn, given};
use deaflow_base::{Document, Quantity};
use deaflow_report::figures::{Cost, FamilyCosts, draw_accuracy};
use deaflow_sample::Canvas;
use deaflow_scene::Scene;
use deaflow_stage::accuracy::content;
use deaflow_stage::direct;
use deaflow_store::{Provenance, write_file};

/// The heading of options about the patterns to measure on.
const PATTERNS: &str = "Patterns";

/// Measure what accuracy costs in a scene: error and time of methods and meshes
#[derive(Debug, Args)]
#[command(after_help = concat!(examples!("deaflow accuracy scene.yaml -o accuracy --target \"0.01 mm\""), "\n\n--jobs is for the reference; methods are measured on one thread."))]
pub struct AccuracyArguments {
    /// A scene, or a pipeline whose scene is meant; a YAML file
    pub scene: PathBuf,
    /// Measure on these patterns: FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset
    #[arg(long, value_name = "PATTERN", num_args = 1.., conflicts_with_all = ["families", "count", "seed"], help_heading = PATTERNS)]
    pub patterns: Vec<String>,
    /// The same, as `solve` and `screen` take them
    #[arg(value_name = "PATTERN", conflicts_with_all = ["patterns", "families", "count", "seed"], help_heading = PATTERNS)]
    pub own: Vec<String>,
    /// Measure on patterns drawn from small and large grids, Bézier curves, stripes, blobs, checkers, dithers, mazes, diagonals,
    /// spirals, glyphs and single cells; the default
    #[arg(long, help_heading = PATTERNS)]
    pub families: bool,
    /// Patterns of each family
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..=10_000), help_heading = PATTERNS)]
    pub count: u64,
    /// Seed of the families
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=i64::MAX as u64), help_heading = PATTERNS)]
    pub seed: u64,
    /// Folder for accuracy.h5, accuracy.csv and accuracy.png
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Name the cheapest setting that is bound to err by no more than this, as in "0.01 mm"
    #[arg(long, value_name = "LENGTH", value_parser = accuracy)]
    pub target: Option<Quantity>,
    /// What to measure, as in "[linear, chord:1, { elements_per_cell: 4, order: 2 }, { accuracy: 0.01 mm },
    /// { model: FILE.safetensors }]"
    #[arg(long, value_name = "YAML")]
    pub methods: Option<String>,
    /// A trained model to measure too, named as for `predict`; may be given again
    #[arg(long, value_name = "MODEL")]
    pub model: Vec<String>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// What to compare with; with `history: { at: [10 s] }` in it, the state at that time, and the methods `history` and `creep:3` find it too
    #[arg(long, value_name = "YAML", default_value = "{ elements_per_cell: 8, order: 2 }")]
    pub reference: String,
    #[command(flatten)]
    pub state: StateArguments,
}

/// What is written: arrays, a table and a figure.
const FILES: [&str; 3] = ["accuracy.h5", "accuracy.csv", "accuracy.png"];

pub fn execute(arguments: &AccuracyArguments, output: &Output) -> Result<Exit, CliError> {
    let bad_input = |e: AccuracyError| CliError::bad_input(e.to_string());
    let failed = |e: AccuracyError| CliError::failure(e.to_string());
    let reference = Document::from_text(Path::new("--reference"), &arguments.reference)?;
    let reference = Reference::read(&reference.root)?;
    let scene = arguments.state.of(direct::read_scene(&arguments.scene)?)?;
    // Before the reference is solved, which may take long.
    reference.check_scene(&scene).map_err(bad_input)?;
    let methods = methods(arguments, &scene, &reference)?;
    let methods: Vec<&Candidate> = methods.iter().collect();
    reference.check(methods.iter().copied()).map_err(bad_input)?;
    for method in &methods {
        method
            .check_scene(&scene, reference.settings().time())
            .map_err(bad_input)?;
    }
    let families = families(arguments, &scene)?;
    // What cannot be written has to be known before minutes of work, not after.
    write::folder(&arguments.output)?;
    let [file, rows, figure] = FILES.map(|name| arguments.output.join(name));
    write::check_file(&file)?;
    write::check_csv(&rows)?;
    write::check_file(&figure)?;
    let start = Instant::now();
    let count: usize = families.values().map(Vec::len).sum();
    let bar = Bar::new("reference", "patterns", count as u64);
    let benchmark = Benchmark::new(scene, reference, families, &bar).map_err(failed)?;
    bar.clear();
    let bar = Bar::new("measure", "methods", methods.len() as u64);
    let measured = benchmark.measure(&methods, &bar).map_err(failed)?;
    bar.clear();
    let files = write_files(arguments, &benchmark, &measured, start)?;
    let findings = Findings::new(arguments, &benchmark, &measured);
    if output.is_json() {
        output.document(&findings.document(&files))?;
    } else {
        output.text(findings.text(&files))?;
    }
    Ok(if findings.is_missed() {
        Exit::Failure
    } else {
        Exit::Done
    })
}

fn methods(arguments: &AccuracyArguments, scene: &Scene, reference: &Reference) -> Result<Vec<Candidate>, CliError> {
    let mut networks = Vec::new();
    for model in &arguments.model {
        let bytes = model::weights(model, &arguments.store.folder_of_any([model]))?;
        let network = Network::from_bytes(&bytes);
        networks.push(network.map_err(|e| CliError::bad_input(format!("cannot use {model}: {e}")))?);
    }
    let Some(text) = &arguments.methods else {
        let time = reference.settings().time();
        let usual: Vec<Candidate> = match time {
            // What this scene has no place for was not asked for.
            Some(_) => {
                let usual = Candidate::usual_in_time().into_iter();
                usual.filter(|method| method.check_scene(scene, time).is_ok()).collect()
            }
            None => Candidate::usual(),
        };
        return Ok(usual.into_iter().chain(Network::named(networks)).collect());
    };
    let document = Document::from_text(Path::new("--methods"), text)?;
    Ok(Candidate::read_with_models(&document.root, networks)?)
}

/// The patterns by family; those that were given are one of their own.
fn families(arguments: &AccuracyArguments, scene: &Scene) -> Result<Families, CliError> {
    let own = [arguments.patterns.as_slice(), &arguments.own].concat();
    if own.is_empty() {
        let canvas = Canvas::of(&scene.membrane());
        return drawn(canvas, arguments.count, arguments.seed).map_err(|e| CliError::bad_input(e.to_string()));
    }
    let patterns = direct::patterns(&own, scene.form())?;
    if patterns.is_empty() {
        return Err(CliError::bad_input("the files hold no patterns"));
    }
    Ok(given(patterns))
}

fn write_files(
    arguments: &AccuracyArguments,
    benchmark: &Benchmark,
    measured: &[Measured],
    start: Instant,
) -> Result<Vec<PathBuf>, CliError> {
    let [file, rows, figure] = FILES.map(|name| arguments.output.join(name));
    let scene = arguments.state.described(&arguments.scene);
    let parameters = format!("{scene}, reference {}", arguments.reference);
    let provenance = Provenance {
        measurements: benchmark.measurements(measured),
        ..solve::provenance("accuracy", parameters.clone(), start.elapsed().as_secs_f64())
    };
    write_file(&file, &content(benchmark, measured).object(), &provenance)?;
    let failed = |e: csv::Error| CliError::failure(format!("cannot write {}: {e}", rows.display()));
    let text = table_text(benchmark, measured).map_err(failed)?;
    write::csv(&rows, &text, "deaflow accuracy", &parameters)?;
    let mut files = vec![file, rows];
    let moved = measured.iter().any(|method| method.rms() > 0.0);
    // Patterns that do not move have no error to draw.
    if moved {
        draw_accuracy(&figure, &costs(benchmark, measured))?;
        files.push(figure);
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

/// One row for each method and family.
fn table_text(benchmark: &Benchmark, measured: &[Measured]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header = "settings,family,patterns,rms_mm,max_mm,bound_mm,seconds_per_pattern,missed,false_alarms";
    writer.write_record(header.split(','))?;
    for method in measured {
        for (k, family) in benchmark.families.iter().enumerate() {
            let (error, [patterns, _]) = (&method.families[k], benchmark.counts(k));
            let numbers = [error.rms, error.max, error.bound, method.seconds[k]].map(|x| format!("{x:e}"));
            let counts = [error.missed, error.false_alarms].map(|n| n.to_string());
            let row = [method.settings.clone(), family.clone(), patterns.to_string()];
            let row = row.into_iter().chain(numbers).chain(counts);
            writer.write_record(row)?;
        }
    }
    Ok(writer.into_inner().map_err(|e| e.into_error())?)
}
