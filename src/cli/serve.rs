//! `deaflow serve` and `deaflow sketch`: the store and the sketchpad in a browser on this machine.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::arguments::StoreArguments;
use super::{CliError, Exit, Output, signals};
use deaflow_serve::{Options, Routes, Server, ServerState, StartView};

/// Look at pipelines, runs and artifacts in a browser, and draw patterns
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow serve pipeline.yaml", "deaflow serve --store store --port 8080"))]
pub struct ServeArguments {
    /// Pipelines to look at [default: those of the last runs]
    #[arg(value_name = "PIPELINE")]
    pipelines: Vec<PathBuf>,
    #[command(flatten)]
    store: StoreArguments,
    /// The port; 0 takes one that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Let the page run pipelines; without this nothing is changed from there
    #[arg(long)]
    allow_run: bool,
}

pub fn execute(arguments: &ServeArguments, output: &Output) -> Result<Exit, CliError> {
    let options = Options {
        store: arguments
            .store
            .folder_for(arguments.pipelines.first().map(PathBuf::as_path)),
        pipelines: arguments.pipelines.clone(),
        allow_run: arguments.allow_run,
        ..Options::default()
    };
    serve(options, StartView::Overview, arguments.port, output)
}

/// Serves until a signal ends it.
pub fn serve(options: Options, start: StartView, port: u16, output: &Output) -> Result<Exit, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signals::set_on(signal, &stop)?;
    }
    let (store, allow_run) = (options.store.clone(), options.allow_run);
    let state = Arc::new(ServerState::new(options)?);
    let served = Server::listen(port)?;
    let view = match start {
        StartView::Overview => "",
        StartView::Sketch => "#/sketch",
    };
    let url = format!("{}{view}", served.url());
    if output.is_json() {
        output.document(&json!({
            "url": url,
            "address": served.base(),
            "token": served.token().text(),
            "store": store,
        }))?;
    } else {
        let may = if allow_run {
            "look at everything that is served, and run and stop its pipelines with any values"
        } else {
            "look at everything that is served"
        };
        output.text(format!(
            "{url}\nopen this address in a browser on this machine; whoever has it can {may}. Ctrl-C ends it"
        ))?;
    }
    let ended = served.run(Arc::new(Routes(state.clone())), &stop);
    state.runner.end();
    state.leave();
    ended?;
    Ok(Exit::Done)
}
