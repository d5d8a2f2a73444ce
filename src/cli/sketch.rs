//! `deaflow sketch`: draws a pattern and shows what it does.

use std::path::PathBuf;

use clap::Args;

use super::arguments::StoreArguments;
use super::serve::serve;
use super::{CliError, Exit, Output};
use deaflow_serve::{Options, StartView};

/// Draw a pattern in a browser on this machine, and see the membrane move meanwhile
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow sketch scene.yaml", "deaflow sketch scene.yaml mine.csv"))]
pub struct SketchArguments {
    /// A scene, or a pipeline whose scene is meant; a YAML file
    scene: PathBuf,
    /// What to begin with: FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset, of which the first pattern is taken [default: nothing]
    #[arg(value_name = "PATTERN")]
    pattern: Option<String>,
    /// The port; 0 takes one that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    #[command(flatten)]
    store: StoreArguments,
}

pub fn execute(arguments: &SketchArguments, output: &Output) -> Result<Exit, CliError> {
    let options = Options {
        store: arguments.store.folder_of(&arguments.scene),
        scene: Some(arguments.scene.clone()),
        pattern: arguments.pattern.clone(),
        ..Options::default()
    };
    serve(options, StartView::Sketch, arguments.port, output)
}
