//! A window on a store, and a sketchpad, in a browser on this machine: `deaflow serve` and `deaflow sketch`.
//!
//! The server listens on the loopback address alone, for whoever knows the token that it prints. It reads: what changes anything is `deaflow
//! run`, which it starts only where that was allowed. `docs/serve.md` has its routes, which scripts may use as the page does. `http` speaks
//! the protocol and lets nobody else in; `sketch` simulates what is drawn; `look` answers questions about the store and its pipelines; `held` is what
//! stays in memory between requests; `page` holds what the browser runs, compiled in.

mod held;
mod http;
mod look;
mod routes;
mod sketch;
mod state;

pub use http::{ServeError, Served, Token};
pub use routes::Routes;
pub use state::{Options, ServedState, Start};
