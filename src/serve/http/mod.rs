//! The HTTP layer: connections, access control, requests and responses.

mod assets;
mod error;
mod frame;
mod guard;
mod request;
mod response;
mod server;

pub use assets::asset;
pub use error::ApiError;
pub use frame::{Array, frame};
pub use guard::Token;
pub use request::{Method, Request};
pub use response::{LineSender, Response};
pub use server::{Handler, Lane, ServeError, Server};
