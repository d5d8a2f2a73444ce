//! Which path is answered by what. Scripts may use them as the page does: `docs/serve.md` has all of them.

use std::sync::Arc;

use super::http::{Answer, Handler, Lane, Method, Refusal, Request, asset};
use super::state::ServedState;
use super::{look, sketch};

/// Answers requests by what a server knows.
pub struct Routes(pub Arc<ServedState>);

impl Handler for Routes {
    fn lane(&self, path: &[String]) -> Lane {
        let step = |at: usize| path.get(at).map(String::as_str);
        match (step(1), step(2), step(3)) {
            (Some("sketch"), Some("reproduce"), _) => Lane::Reading,
            (Some("sketch"), _, _) | (Some("artifacts"), _, Some("again" | "judged" | "prediction")) => {
                Lane::Simulating
            }
            _ => Lane::Reading,
        }
    }

    fn answer(&self, request: &Request) -> Result<Answer, Refusal> {
        answer(&self.0, request)
    }
}

fn answer(state: &Arc<ServedState>, request: &Request) -> Result<Answer, Refusal> {
    let path: Vec<&str> = request.path.iter().map(String::as_str).collect();
    let (get, post) = (request.method == Method::Get, request.method == Method::Post);
    match path.as_slice() {
        ["api", rest @ ..] => match rest {
            ["sketch", rest @ ..] => match rest {
                [] if post => sketch::solve(state, request),
                ["improve"] if post => sketch::improve(state, request),
                ["screen"] if post => sketch::screen(state, request),
                ["reproduce"] if post => sketch::reproduce(state, request),
                ["export"] if post => sketch::export(state, request),
                ["import"] if post => sketch::import(state, request),
                [] | ["improve" | "screen" | "reproduce" | "export" | "import"] => Err(Refusal::not_allowed("POST")),
                _ => Err(unknown()),
            },
            ["plan"] if post => look::plan(state, request),
            ["plan"] => Err(Refusal::not_allowed("POST")),
            ["run"] => look::run(state, request),
            // All that follows is read alone.
            _ if !get => match is_known(rest) {
                true => Err(Refusal::not_allowed("GET")),
                false => Err(unknown()),
            },
            ["start"] => Ok(state.beginning().into()),
            ["scenes"] => sketch::scenes(state, request),
            ["status"] => look::status(state, request),
            ["pipelines"] => look::pipelines(state, request),
            ["pipelines", number] => look::pipeline(state, request, number),
            ["runs"] => look::runs(state, request),
            ["runs", id] => look::one_run(state, request, id),
            ["artifacts"] => look::artifacts(state, request),
            ["artifacts", digest] => look::artifact(state, request, digest),
            ["artifacts", digest, "rows"] => look::rows(state, request, digest),
            ["events"] => look::events(state, request),
            ["artifacts", digest, "neighbours"] => look::neighbours(state, request, digest),
            ["artifacts", digest, "again"] => look::again(state, request, digest),
            ["artifacts", digest, "judged"] => look::judged(state, request, digest),
            ["artifacts", digest, "prediction"] => look::prediction(state, request, digest),
            ["artifacts", digest, "arrays"] => look::arrays(state, request, digest),
            ["artifacts", digest, "page"] => look::page(state, request, digest),
            _ => Err(unknown()),
        },
        [name] if get => {
            let (media, text) = asset(name).ok_or_else(unknown)?;
            Ok(Answer::Bytes {
                media,
                bytes: text.as_bytes().to_vec(),
                file: None,
            })
        }
        _ => Err(unknown()),
    }
}

/// Whether a path below `/api` is one that can be read.
fn is_known(path: &[&str]) -> bool {
    matches!(
        path,
        ["start" | "scenes" | "status" | "events" | "pipelines" | "runs" | "artifacts"]
            | ["pipelines" | "runs" | "artifacts", _]
            | [
                "artifacts",
                _,
                "rows" | "arrays" | "neighbours" | "again" | "judged" | "prediction" | "page"
            ]
    )
}

fn unknown() -> Refusal {
    Refusal::absent("there is nothing under this path").help("docs/serve.md lists the paths")
}
