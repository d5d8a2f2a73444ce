//! `deaflow serve` and `deaflow sketch`: a local server for a browser.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::arguments::StoreArguments;
use super::{CliError, Exit, Output, signals};
use deaflow_serve::{Options, Routes, Server, ServerState, StartView};
use deaflow_store::Store;

/// Show pipelines, runs and artifacts in a browser, and draw patterns
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow serve pipeline.yaml", "deaflow serve --store store --port 8080"))]
pub struct ServeArguments {
    /// The pipelines [default: those of the last runs]
    #[arg(value_name = "PIPELINE")]
    pipelines: Vec<PathBuf>,
    #[command(flatten)]
    store: StoreArguments,
    /// The port; 0 chooses a free one
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Allow the page to run pipelines; without this, the server is read-only
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

/// Serves until a signal.
///
/// # Errors
/// When no store can be at the folder, a file that is shown cannot be read, or the port is taken.
pub fn serve(options: Options, start: StartView, port: u16, output: &Output) -> Result<Exit, CliError> {
    Store::check_folder(&options.store)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signals::set_on(signal, &stop)?;
    }
    let (store, allow_run) = (options.store.clone(), options.allow_run);
    let state = Arc::new(ServerState::new(options)?);
    state.notes().iter().for_each(|note| output.warn(note));
    let served = Server::listen(port)?;
    let view = match start {
        StartView::Overview => "",
        StartView::Sketch => "#/sketch",
    };
    let url = format!("{}{view}", served.url());
    let document = || json!({ "url": url, "address": served.base(), "token": served.token().text(), "store": store });
    output.result(document, || {
        let may = match allow_run {
            true => "see all its content, and run and stop pipelines with any values",
            false => "see all its content",
        };
        format!(
            "{url}\nopen this URL in a browser on this machine; anyone with the URL can {may}. Press Ctrl-C to stop"
        )
    })?;
    let ended = served.run(Arc::new(Routes(state.clone())), &stop);
    state.runner.end();
    state.leave();
    ended?;
    Ok(Exit::Done)
}
