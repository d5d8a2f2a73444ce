//! `deaflow export model`: a trained model as a safetensors or an ONNX file.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::format_of;
use crate::arguments::StoreArguments;
use crate::{CliError, Exit, Output, model, write};
use deaflow_field::PredictError;
use deaflow_surrogate::{LoadError, Surrogate};

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export model pipeline.yaml:surrogate -o model.onnx"))]
pub struct ExportModelArguments {
    /// The model: a stage of the last run, PIPELINE.yaml:STAGE, a digest or its first digits, or a file
    pub model: String,
    /// The output: a file, which is replaced, or a folder
    #[arg(short, long, value_name = "FILE|DIR")]
    pub output: PathBuf,
    /// The format [default: from the file extension]
    #[arg(long, value_enum)]
    pub format: Option<ModelFormat>,
    #[command(flatten)]
    pub store: StoreArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ModelFormat {
    /// Tensors, with a header that describes their use
    Safetensors,
    /// The network as a graph
    Onnx,
}

impl ModelFormat {
    const ALL: [(Self, &[&str]); 2] = [(Self::Safetensors, &["safetensors"]), (Self::Onnx, &["onnx"])];

    /// The extension of files of the format.
    fn extension(self) -> &'static str {
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
    let format = format_of(arguments.format, &arguments.output, &ModelFormat::ALL)?;
    let path = path(arguments, surrogate.kind().name(), format);
    write::check_not_read(&path, &[&arguments.model])?;
    let bytes = match format {
        ModelFormat::Safetensors => weights,
        ModelFormat::Onnx => surrogate.to_onnx().map_err(failed)?,
    };
    write::file(&path, &bytes)?;
    let [columns, rows] = surrogate.form().raster.sides();
    let header: Value = serde_json::from_str(&surrogate.header().map_err(failed)?).unwrap_or_default();
    let document = || json!({ "file": path, "format": format.extension(), "bytes": bytes.len(), "header": header });
    output.result(document, || {
        format!(
            "{}: {}, {:.1} MB; patterns (n, {rows}, {columns}) to displacements (n, {}, {}, 2) in mm",
            path.display(),
            surrogate.kind().name(),
            bytes.len() as f64 * 1e-6,
            rows + 1,
            columns + 1
        )
    })
}

/// Returns the file to write: in a folder, it is named after the network.
fn path(arguments: &ExportModelArguments, network: &str, format: ModelFormat) -> PathBuf {
    if arguments.output.is_dir() {
        arguments.output.join(format!("{network}.{}", format.extension()))
    } else {
        arguments.output.clone()
    }
}
