//! `deaflow predict`: predicts the displacement of patterns with a trained model, with intervals of the error.

mod calibration;
mod intervals;
mod model;

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::arguments::{PatternArguments, StateArguments, StoreArguments};
use super::job::{Job, JobResult, attached_files, extend};
use super::pipeline::read_scene;
use super::point::PointArguments;
use super::results::{self, FEW, Peak, SampleId, SampleResult};
use super::text::Text;
use super::{CliError, Exit, Output, write};
use deaflow_content::SolveFile;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::Edges;
use deaflow_scene::Scene;
use deaflow_stage::direct::NamedPatterns;

use intervals::Intervals;
pub use model::{Model, Predictions};

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
    let model = Model::read_from(
        &arguments.model,
        arguments.calibration.clone(),
        arguments.store_folder(),
    )?;
    if let Some(scene) = &scene {
        model.check_scene(scene)?;
    }
    let NamedPatterns {
        patterns, names, notes, ..
    } = arguments.patterns.read(model.form(), Edges::Cells)?;
    notes.iter().for_each(|note| output.warn(note));
    let calibration = model.calibration(&arguments.objective)?;
    let table = file.map(|file| attached_files(file)[0].clone());
    if let (Some(_), Some(table)) = (&calibration, &table) {
        write::check_csv(table)?;
        write::check_not_read(table, &arguments.inputs())?;
    }
    let scene = model.scene().and_then(|text| Scene::from_text(text).ok());
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
    let predictions = model.predict_with(&patterns, calibration, &arguments.objective, &job.bar)?;
    let (fields, intervals) = (&predictions.fields, &predictions.intervals);
    for note in intervals.iter().flat_map(Intervals::notes) {
        output.warn_of_units(note);
    }
    let parameters = format!("model {}", arguments.model);
    if let (Some(intervals), Some(table)) = (intervals, &table) {
        let source = format!("{parameters}, {}", model.weights());
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
    match intervals {
        Some(intervals) => text.append(intervals.text(table.as_deref())),
        None => text.line("the errors are not known: the model has no calibration; name one with --calibration"),
    };
    let (at_point, point) = probe
        .map(|probe| probe.of_all(fields.iter().map(|field| Some(probe.of(field)))))
        .unzip();
    let content = SolveFile {
        at_point,
        point,
        ..model.content(&patterns, &predictions)
    };
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
