//! `deaflow export model`: a trained model as a safetensors or an ONNX file.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::arguments::StoreArguments;
use crate::error::CliError;
use crate::examples::examples;
use crate::output::{Exit, Output};
use crate::{model, solve, write};
use deaflow_field::PredictError;
use deaflow_surrogate::{LoadError, Surrogate};

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export model pipeline.yaml:surrogate -o model.onnx"))]
pub struct ExportModelArguments {
    /// A digest or its beginning, a stage of the last run, PIPELINE.yaml:STAGE, or a file
    pub model: String,
    /// Where it goes: a file, which is replaced, or a folder
    #[arg(short, long, value_name = "FILE|DIR")]
    pub output: PathBuf,
    /// The format [default: by the end of the file's name]
    #[arg(long, value_enum)]
    pub format: Option<ModelFormat>,
    #[command(flatten)]
    pub store: StoreArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ModelFormat {
    /// Tensors, with a header that says everything needed to use them
    Safetensors,
    /// The whole network as a graph
    Onnx,
}

impl ModelFormat {
    /// How files of the format end.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Safetensors => "safetensors",
            Self::Onnx => "onnx",
        }
    }
}

pub fn execute(arguments: &ExportModelArguments, output: &Output) -> Result<Exit, CliError> {
    let weights = model::weights(&arguments.model, &arguments.store.folder_of_any([&arguments.model]))?;
    let refused = |e: LoadError| CliError::bad_input(format!("cannot use the model: {e}"));
    let failed = |e: PredictError| CliError::failure(e.to_string());
    let surrogate = Surrogate::load(&weights).map_err(refused)?;
    let format = format(arguments)?;
    let path = path(arguments, surrogate.kind().name(), format);
    if solve::is_same_file(Path::new(&arguments.model), &path) {
        return Err(
            CliError::bad_input(format!("{} is read here: writing it would lose it", path.display()))
                .help("-o must name another file"),
        );
    }
    let bytes = match format {
        ModelFormat::Safetensors => weights,
        ModelFormat::Onnx => surrogate.to_onnx().map_err(failed)?,
    };
    write::file(&path, &bytes)?;
    let [columns, rows] = surrogate.form().raster.sides();
    if output.is_json() {
        let header: Value = serde_json::from_str(&surrogate.header().map_err(failed)?).unwrap_or_default();
        output.document(&json!({
            "file": path,
            "format": format.extension(),
            "bytes": bytes.len(),
            "header": header,
        }))?;
    } else {
        output.text(format!(
            "{}: {}, {:.1} MB; patterns (n, {rows}, {columns}) to displacements (n, {}, {}, 2) in mm",
            path.display(),
            surrogate.kind().name(),
            bytes.len() as f64 * 1e-6,
            rows + 1,
            columns + 1
        ))?;
    }
    Ok(Exit::Done)
}

/// The format that is asked for: by name, or by the end of the file's name.
fn format(arguments: &ExportModelArguments) -> Result<ModelFormat, CliError> {
    let extension = arguments.output.extension().and_then(|e| e.to_str());
    let known = [ModelFormat::Safetensors, ModelFormat::Onnx];
    let named = known.into_iter().find(|format| Some(format.extension()) == extension);
    match (arguments.format, named) {
        (Some(format), Some(other)) if format != other => Err(CliError::bad_input(format!(
            "--format {} cannot stand beside a file called .{}",
            format.extension(),
            other.extension()
        ))),
        (Some(format), _) | (None, Some(format)) => Ok(format),
        (None, None) => Err(CliError::bad_input("the format of the model is not said")
            .help("give --format safetensors or --format onnx, or a file that ends so")),
    }
}

/// The file to write: in a folder, one called after the network.
fn path(arguments: &ExportModelArguments, network: &str, format: ModelFormat) -> PathBuf {
    if arguments.output.is_dir() {
        arguments.output.join(format!("{network}.{}", format.extension()))
    } else {
        arguments.output.clone()
    }
}
