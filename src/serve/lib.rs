//! The local web server and its page, with the sketchpad: `deaflow serve` and `deaflow sketch`.
//!
//! The server listens only on the loopback address, and every request needs the token that it prints. It reads: only
//! `deaflow run`, which it starts if that was allowed, changes anything. `docs/serve.md` describes its paths, which
//! scripts may use as well. `http` has the protocol and access control, `sketch` simulates drawn patterns, `browse`
//! answers queries about the store and its pipelines, `jobs` starts and watches runs, `cache` holds what stays in
//! memory between requests, `compute` ends simulations that nobody waits for, and `page` holds the files of the page.

mod artifact_data;
mod browse;
mod cache;
mod compute;
mod examples;
mod http;
mod jobs;
mod left_out;
mod routes;
mod sketch;
mod state;

pub use http::{ServeError, Server, Token};
pub use routes::Routes;
pub use state::{Options, ServerState, StartView};
