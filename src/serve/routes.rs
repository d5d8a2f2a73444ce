//! The paths of the server; `docs/serve.md` describes them.

use std::sync::Arc;

use super::compute::{TIME_LIMIT, limited};
use super::http::{ApiError, Handler, Lane, Method, Request, Response, asset};
use super::state::ServerState;
use super::{browse, sketch};
use deaflow_base::Interrupt;

/// Handles requests with the state of a server.
pub struct Routes(pub Arc<ServerState>);

impl Handler for Routes {
    fn lane(&self, request: &Request) -> Lane {
        let step = |at: usize| request.path.get(at).map(String::as_str);
        match (step(1), step(2), step(3)) {
            (Some("sketch"), None, _) if sketch::is_quick(&request.body) => Lane::Quick,
            // A search runs on a thread of its own.
            (Some("sketch"), Some("improve"), _) => Lane::Quick,
            // A plan screens a scene with `effects: auto`.
            (Some("plan"), _, _) | (Some("pipelines"), Some(_), _) => Lane::Quick,
            (Some("sketch"), None | Some("screen" | "sweep"), _)
            | (Some("artifacts"), _, Some("again" | "judged" | "prediction")) => Lane::Simulating,
            _ => Lane::Reading,
        }
    }

    fn handle(&self, request: &Request, lane: Lane, left: &Interrupt) -> Result<Response, ApiError> {
        match lane {
            Lane::Reading => route(&self.0, request),
            Lane::Quick | Lane::Simulating => limited(left, TIME_LIMIT, || route(&self.0, request)),
        }
    }
}

fn route(state: &Arc<ServerState>, request: &Request) -> Result<Response, ApiError> {
    let path: Vec<&str> = request.path.iter().map(String::as_str).collect();
    let (get, post) = (request.method == Method::Get, request.method == Method::Post);
    match path.as_slice() {
        ["api", rest @ ..] => match rest {
            ["sketch", rest @ ..] => match rest {
                [] if post => sketch::solve(state, request),
                ["improve"] if post => sketch::improve(state, request),
                ["sweep"] if post => sketch::sweep(state, request),
                ["screen"] if post => sketch::screen(state, request),
                ["reproduce"] if post => sketch::reproduce(state, request),
                ["export"] if post => sketch::export(state, request),
                ["import"] if post => sketch::import(state, request),
                [] | ["improve" | "sweep" | "screen" | "reproduce" | "export" | "import"] => {
                    Err(ApiError::method_not_allowed("POST"))
                }
                _ => Err(unknown_path()),
            },
            ["plan"] if post => browse::plan(state, request),
            ["plan"] => Err(ApiError::method_not_allowed("POST")),
            ["run"] => browse::run(state, request),
            // The following paths can only be read.
            _ if !get => match is_known(rest) {
                true => Err(ApiError::method_not_allowed("GET")),
                false => Err(unknown_path()),
            },
            ["start"] => Ok(state.start_document().into()),
            ["scenes"] => sketch::scenes(state, request),
            ["status"] => browse::status(state, request),
            ["pipelines"] => browse::pipelines(state, request),
            ["pipelines", number] => browse::pipeline(state, request, number),
            ["pipelines", number, "summary"] => browse::summary(state, request, number),
            ["runs"] => browse::runs(state, request),
            ["runs", id] => browse::one_run(state, request, id),
            ["runs", id, "opening"] => browse::opening(state, request, id),
            ["artifacts"] => browse::artifacts(state, request),
            ["artifacts", digest] => browse::artifact(state, request, digest),
            ["artifacts", digest, "opening"] => browse::artifact_opening(state, request, digest),
            ["artifacts", digest, "rows"] => browse::rows(state, request, digest),
            ["events"] => browse::events(state, request),
            ["artifacts", digest, "neighbours"] => browse::neighbours(state, request, digest),
            ["artifacts", digest, "again"] => browse::resimulate(state, request, digest),
            ["artifacts", digest, "judged"] => browse::model_errors(state, request, digest),
            ["artifacts", digest, "prediction"] => browse::prediction(state, request, digest),
            ["artifacts", digest, "arrays"] => browse::arrays(state, request, digest),
            ["artifacts", digest, "shapes"] => browse::shapes(state, request, digest),
            ["artifacts", digest, "page"] => browse::figures(state, request, digest),
            _ => Err(unknown_path()),
        },
        [name] if get => {
            let (media, text) = asset(name).ok_or_else(unknown_path)?;
            Ok(Response::Bytes {
                media,
                bytes: text.as_bytes().to_vec(),
                file: None,
            })
        }
        _ => Err(unknown_path()),
    }
}

/// Whether a path below `/api` can be read.
fn is_known(path: &[&str]) -> bool {
    matches!(
        path,
        ["start" | "scenes" | "status" | "events" | "pipelines" | "runs" | "artifacts"]
            | ["pipelines" | "runs" | "artifacts", _]
            | ["pipelines", _, "summary"]
            | ["runs", _, "opening"]
            | [
                "artifacts",
                _,
                "opening" | "rows" | "arrays" | "shapes" | "neighbours" | "again" | "judged" | "prediction" | "page"
            ]
    )
}

fn unknown_path() -> ApiError {
    ApiError::not_found("unknown path").help("docs/serve.md lists the paths")
}
