//! `deaflow predict`: predicts the fields of patterns with a trained model, and says how far they may be off.

mod calibration;
mod intervals;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;

use super::arguments::{PatternArguments, StateArguments, StoreArguments};
use super::error::CliError;
use super::examples::examples;
use super::outcomes::{Ending, Peak};
use super::output::{Exit, Output};
use super::point::PointArguments;
use super::progress::Bar;
use super::simulate::{Answer, Place, Statement, seconds_each};
use super::text::Text;
use super::{model, solve, write};
use deaflow_base::{Digest, Progress};
use deaflow_content::{Packed, SolveFile};
use deaflow_field::{Field, Predictor};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_surrogate::{COVERAGE, Surrogate};

use intervals::Intervals;

/// Predict patterns with a trained model, with intervals where it has a calibration
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow predict pipeline.yaml:surrogate mine.csv -o predicted.h5"))]
pub struct PredictArguments {
    /// A digest or its beginning, a stage of the last run, PIPELINE.yaml:STAGE, or a file
    pub model: String,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// Refuse a model for another scene than this one, or than that of a pipeline; a YAML file
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    #[command(flatten)]
    pub point: PointArguments,
    #[command(flatten)]
    pub state: StateArguments,
    /// What a stage of kind `calibrate` made for the model, named like a model [default: of a model in the store what the last
    /// run that calibrated it made from the most patterns]; beside OUT.h5 they go into OUT.csv
    #[arg(long, value_name = "CALIBRATION")]
    pub calibration: Option<String>,
    /// State the interval of a displacement too, as in "{ point: [25 mm, 25 mm], direction: 0 deg }"; may be given again
    #[arg(long, value_name = "YAML")]
    pub objective: Vec<String>,
    #[command(flatten)]
    pub store: StoreArguments,
}

impl PredictArguments {
    /// The folder of the store in which model and calibration are looked for.
    fn store_folder(&self) -> PathBuf {
        self.store
            .folder_of_any([&self.model].into_iter().chain(&self.calibration))
    }
}

pub fn execute(arguments: &PredictArguments, output: &Output) -> Result<Exit, CliError> {
    let file = arguments.patterns.output.as_deref();
    if let Some(file) = file {
        solve::check_file(file, &arguments.patterns, &[&arguments.model])?;
    }
    arguments.patterns.check_ending()?;
    if arguments.state.state.is_some() && arguments.scene.is_none() {
        return Err(CliError::bad_input("--state is one of a scene, and none is given").help("give it with --scene"));
    }
    let scene = arguments.scene.as_deref().map(direct::read_scene).transpose()?;
    let scene = scene.map(|scene| arguments.state.of(scene)).transpose()?;
    let weights = model::weights(&arguments.model, &arguments.store_folder())?;
    let surrogate = surrogate(&weights, scene.as_ref())?;
    let (patterns, names) = direct::patterns_with_names(&arguments.patterns.patterns, surrogate.form())?;
    let calibration = calibration::find(arguments, &weights)?;
    if calibration.is_some() {
        check_table(arguments)?;
    } else if !arguments.objective.is_empty() {
        return Err(
            CliError::bad_input("--objective states an interval, and this model has no calibration")
                .help("name one with --calibration: what a stage of kind `calibrate` made for the model"),
        );
    }
    let (bar, start) = (Bar::new("predict", "patterns", patterns.len() as u64), Instant::now());
    let (fields, seconds) = predict(&surrogate, &patterns, &bar)?;
    let of = |calibration| Intervals::of(calibration, &arguments.objective, &patterns, &fields);
    let intervals = calibration.map(of).transpose()?;
    bar.clear();
    let parameters = format!("model {}", arguments.model);
    let rows_file = file.map(table);
    if let (Some(intervals), Some(file)) = (&intervals, &rows_file) {
        let rows = intervals.csv().map_err(|e| CliError::failure(e.to_string()))?;
        let source = format!("{parameters}, {}", Digest::of(&weights));
        write::csv(file, &rows, "deaflow predict", &source)?;
    }
    let scene = surrogate.scene().and_then(|text| Scene::from_text(text).ok());
    let watched = match &scene {
        Some(scene) => arguments.point.on(scene)?,
        None if arguments.point.is_given() => {
            return Err(CliError::bad_input(
                "the model does not say how large its membrane is: --point is nowhere on it",
            ));
        }
        None => None,
    };
    let cell_mm = scene.map(|scene| scene.membrane().cell_mm());
    let ending = |(index, field)| Ending {
        place: Place { index, state: None },
        outcome: PREDICTED.to_owned(),
        peak: Some(Peak::of(field, cell_mm)),
        name: names[index].clone(),
        along_mm: watched.map(|watched| watched.of(field)),
        reached: None,
    };
    let (at_point, point) = watched
        .map(|watched| watched.of_all(fields.iter().map(|field| Some(watched.of(field)))))
        .unzip();
    let content = SolveFile {
        at_point,
        point,
        ..content(&surrogate, &patterns, &fields, seconds, intervals.as_ref())
    };
    let answer = Answer {
        endings: fields.iter().enumerate().map(ending).collect(),
        content: content.object(),
        samples: patterns.len(),
        watched,
        statement: statement(intervals.as_ref(), rows_file.as_deref()),
        ..Answer::default()
    };
    solve::conclude(&arguments.patterns, answer, ("predict", parameters), start, output)
}

/// Where intervals go as comma-separated values.
fn table(file: &Path) -> PathBuf {
    file.with_extension("csv")
}

fn check_table(arguments: &PredictArguments) -> Result<(), CliError> {
    let Some(file) = arguments.patterns.output.as_deref() else {
        return Ok(());
    };
    let table = table(file);
    write::check_csv(&table)?;
    for read in std::iter::once(&arguments.model).chain(&arguments.calibration) {
        solve::check_file(&table, &arguments.patterns, &[read])?;
        solve::check_file(file, &arguments.patterns, &[read])?;
    }
    Ok(())
}

/// The network in the bytes of a safetensors file, which must be one for the scene if that is given.
fn surrogate(weights: &[u8], scene: Option<&Scene>) -> Result<Surrogate, CliError> {
    let refused = |e: &dyn std::fmt::Display| CliError::bad_input(format!("cannot use the model: {e}"));
    let surrogate = Surrogate::load(weights).map_err(|e| refused(&e))?;
    if let Some(scene) = scene {
        surrogate.check_scene(scene).map_err(|e| refused(&e))?;
    }
    Ok(surrogate)
}

/// The fields of patterns with the seconds that each took.
fn predict(
    surrogate: &Surrogate,
    patterns: &[Pattern],
    progress: &dyn Progress,
) -> Result<(Vec<Field>, Vec<f64>), CliError> {
    let threads = rayon::current_num_threads();
    let (mut fields, mut seconds) = (Vec::with_capacity(patterns.len()), Vec::with_capacity(patterns.len()));
    for batch in patterns.chunks(256) {
        let start = Instant::now();
        fields.extend(surrogate.predict(batch)?);
        seconds.extend(seconds_each(start, batch.len(), threads));
        progress.advance(batch.len() as u64);
    }
    Ok((fields, seconds))
}

/// The outcome of what was not simulated.
const PREDICTED: &str = "predicted";

fn content(
    surrogate: &Surrogate,
    patterns: &[Pattern],
    fields: &[Field],
    seconds: Vec<f64>,
    intervals: Option<&Intervals>,
) -> SolveFile {
    SolveFile {
        patterns: patterns.to_vec(),
        outcome: vec![PREDICTED.to_owned(); patterns.len()],
        max_displacement: fields.iter().map(Field::max_magnitude).collect(),
        displacement: Packed(fields.iter().flat_map(Field::values).copied().collect()),
        solve_seconds: seconds,
        scene: surrogate.scene().unwrap_or_default().to_owned(),
        network: Some(surrogate.kind().name().to_owned()),
        intervals: intervals.map(Intervals::content),
        coverage: intervals.map(|_| COVERAGE.to_string()),
        calibration: intervals.map(Intervals::digest),
        basis: intervals.map(Intervals::basis),
        ..SolveFile::default()
    }
}

/// What is said of the errors of the predictions.
fn statement(intervals: Option<&Intervals>, table: Option<&Path>) -> Statement {
    Statement {
        key: "intervals",
        document: intervals.map(|intervals| intervals.document(table)),
        text: intervals.map_or_else(
            || {
                Text::from(
                    "nothing is said of the errors: the model has no calibration here; name one with --calibration",
                )
            },
            |intervals| intervals.text(table),
        ),
        tells_each: intervals.is_some(),
    }
}
