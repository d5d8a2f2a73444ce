//! `deaflow sketch`: draws patterns and simulates them in a browser.

use std::path::PathBuf;

use clap::Args;

use super::arguments::StoreArguments;
use super::serve::serve;
use super::{CliError, Exit, Output};
use deaflow_serve::{Options, StartView};

/// Draw a pattern in a browser and see the simulated displacement
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow sketch scene.yaml", "deaflow sketch scene.yaml mine.csv"))]
pub struct SketchArguments {
    /// The scene: a YAML file of a scene, or of a pipeline that has one
    scene: PathBuf,
    /// The first pattern: that of FILE.npy, FILE.csv, FILE.png, FILE.dxf, FILE.svg or FILE.h5:/dataset [default: an empty one]
    #[arg(value_name = "PATTERN")]
    pattern: Option<String>,
    /// The port; 0 chooses a free one
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
