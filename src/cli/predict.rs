//! `deaflow predict`: predicts the displacement of patterns with a trained model, with intervals of the error.

mod calibration;
mod intervals;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::arguments::{PatternArguments, StateArguments, StoreArguments};
use super::job::{Job, JobResult, attached_files, extend, seconds_each};
use super::pipeline::read_scene;
use super::point::{PointArguments, Probe};
use super::results::{self, FEW, Peak, SampleId, SampleResult};
use super::text::Text;
use super::{CliError, Exit, Output, model, write};
use deaflow_base::{Digest, Progress};
use deaflow_content::{Packed, SolveFile};
use deaflow_field::{Field, OutcomeKind, Predictor};
use deaflow_pattern::{Edges, Pattern};
use deaflow_scene::Scene;
use deaflow_stage::direct::NamedPatterns;
use deaflow_surrogate::{COVERAGE, Surrogate};

use intervals::Intervals;

/// Predict displacements with a trained model, with intervals if it is calibrated
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow predict pipeline.yaml:surrogate mine.csv -o predicted.h5"))]
pub struct PredictArguments {
    /// The model: a stage of the last run, PIPELINE.yaml:STAGE, a digest or its first digits, or a file
    pub model: String,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// Refuse a model that was trained for another scene than that of this YAML file: a scene, or a pipeline that has
    /// one
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    #[command(flatten)]
    pub point: PointArguments,
    #[command(flatten)]
    pub state: StateArguments,
    /// The result of a stage of kind `calibrate`, named like a model [default: for a model in the store, the
    /// calibration
    /// of the last run, from the most patterns]; intervals are also written to OUT.csv next to OUT.h5
    #[arg(long, value_name = "CALIBRATION")]
    pub calibration: Option<String>,
    /// Also report the interval of a displacement, as in "{ point: [25 mm, 25 mm], direction: 0 deg }"; can be repeated
    #[arg(long, value_name = "YAML")]
    pub objective: Vec<String>,
    #[command(flatten)]
    pub store: StoreArguments,
}

impl PredictArguments {
    /// The folder of the store of the model and the calibration.
    fn store_folder(&self) -> PathBuf {
        self.store
            .folder_of_any([&self.model].into_iter().chain(&self.calibration))
    }

    /// The files that are read: patterns, model and calibration.
    fn inputs(&self) -> Vec<String> {
        let others = [&self.model].into_iter().chain(&self.calibration);
        self.patterns.patterns.iter().chain(others).cloned().collect()
    }
}

pub fn execute(arguments: &PredictArguments, output: &Output) -> Result<Exit, CliError> {
    let file = arguments.patterns.output.as_deref();
    if let Some(file) = file {
        write::check_output(file, &arguments.inputs())?;
    }
    arguments.patterns.check_ending()?;
    if arguments.state.state.is_some() && arguments.scene.is_none() {
        return Err(CliError::bad_input("--state needs a scene").help("add --scene SCENE.yaml"));
    }
    let scene = arguments
        .scene
        .as_deref()
        .map(|path| read_scene(path, output))
        .transpose()?;
    let scene = scene.map(|scene| arguments.state.of(scene)).transpose()?;
    let weights = model::weights(&arguments.model, &arguments.store_folder())?;
    let surrogate = surrogate(&weights, scene.as_ref())?;
    let NamedPatterns {
        patterns, names, notes, ..
    } = arguments.patterns.read(surrogate.form(), Edges::Cells)?;
    notes.iter().for_each(|note| output.warn(note));
    let calibration = calibration::find(arguments, &weights)?;
    let table = file.map(|file| attached_files(file)[0].clone());
    match (&calibration, &table) {
        (Some(_), Some(table)) => {
            write::check_csv(table)?;
            write::check_not_read(table, &arguments.inputs())?;
        }
        (None, _) if !arguments.objective.is_empty() => {
            return Err(
                CliError::bad_input("--objective needs a calibration, and this model has none")
                    .help("name the result of a stage of kind `calibrate` with --calibration"),
            );
        }
        _ => {}
    }
    let scene = surrogate.scene().and_then(|text| Scene::from_text(text).ok());
    let probe = match &scene {
        Some(scene) => arguments.point.on(scene)?,
        None if arguments.point.is_given() => {
            return Err(CliError::bad_input(
                "--point cannot be used: the model does not contain the size of its membrane",
            ));
        }
        None => None,
    };
    let job = Job::start("predict", file, "predict", patterns.len());
    let (fields, seconds) = predict(&surrogate, &patterns, &job.bar)?;
    let of = |calibration| Intervals::of(calibration, &arguments.objective, &patterns, &fields, output);
    let intervals = calibration.map(of).transpose()?;
    let parameters = format!("model {}", arguments.model);
    if let (Some(intervals), Some(table)) = (&intervals, &table) {
        let source = format!("{parameters}, {}", Digest::of(&weights));
        write::csv(table, intervals.csv()?.as_bytes(), "deaflow predict", &source)?;
    }
    let cell_mm = scene.map(|scene| scene.membrane().cell_mm());
    let result = |(index, field): (usize, &Field)| SampleResult {
        file: names[index].clone(),
        peak: Some(Peak::of(field, cell_mm)),
        along_mm: probe.map(|probe| probe.of(field)),
        ..SampleResult::new(SampleId { index, state: None }, OutcomeKind::Predicted)
    };
    let results: Vec<SampleResult> = fields.iter().enumerate().map(result).collect();
    let mut document = results::document(&results, patterns.len(), probe.as_ref());
    let intervals_document = intervals.as_ref().map(|intervals| intervals.document(table.as_deref()));
    extend(
        &mut document,
        json!({ "intervals": intervals_document, "notes": notes }),
    );
    let mut text = Text::new();
    // The table of intervals lists the patterns too, without the point.
    if intervals.is_none() || results.len() > FEW || probe.is_some() {
        text.append(results::text(&results, file, probe.as_ref()));
    }
    match &intervals {
        Some(intervals) => text.append(intervals.text(table.as_deref())),
        None => text.line("the errors are not known: the model has no calibration; name one with --calibration"),
    };
    let content = content(&surrogate, &patterns, &fields, seconds, intervals.as_ref(), probe);
    let result = JobResult {
        patterns: patterns.len(),
        arrays: content.object(),
        parameters,
        attachments: None,
        warnings: Vec::new(),
        document,
        text,
        exit: Exit::Done,
    };
    job.finish(result, output)
}

/// Reads the network of a safetensors file, which must have been trained for the scene, if one is given.
fn surrogate(weights: &[u8], scene: Option<&Scene>) -> Result<Surrogate, CliError> {
    let refused = |e: &dyn std::fmt::Display| CliError::bad_input(format!("cannot use the model: {e}"));
    let surrogate = Surrogate::load(weights).map_err(|e| refused(&e))?;
    if let Some(scene) = scene {
        surrogate.check_scene(scene).map_err(|e| refused(&e))?;
    }
    Ok(surrogate)
}

/// Predicts the fields of patterns; returns them with the computing time of each, s.
fn predict(
    surrogate: &Surrogate,
    patterns: &[Pattern],
    progress: &dyn Progress,
) -> Result<(Vec<Field>, Vec<f64>), CliError> {
    let (mut fields, mut seconds) = (Vec::with_capacity(patterns.len()), Vec::with_capacity(patterns.len()));
    for batch in patterns.chunks(256) {
        let start = Instant::now();
        fields.extend(surrogate.predict(batch)?);
        seconds.extend(seconds_each(start, batch.len()));
        progress.advance(batch.len() as u64);
    }
    Ok((fields, seconds))
}

fn content(
    surrogate: &Surrogate,
    patterns: &[Pattern],
    fields: &[Field],
    seconds: Vec<f64>,
    intervals: Option<&Intervals>,
    probe: Option<Probe>,
) -> SolveFile {
    let (at_point, point) = probe
        .map(|probe| probe.of_all(fields.iter().map(|field| Some(probe.of(field)))))
        .unzip();
    SolveFile {
        patterns: patterns.to_vec(),
        outcome: vec![OutcomeKind::Predicted; patterns.len()],
        max_displacement: fields.iter().map(Field::max_magnitude).collect(),
        displacement: Packed(fields.iter().flat_map(Field::values).copied().collect()),
        at_point,
        point,
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
