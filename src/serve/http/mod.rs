//! The HTTP layer: connections, access control, requests and responses.

mod assets;
mod connections;
mod error;
mod frame;
mod guard;
mod places;
mod request;
mod response;
mod server;

pub use assets::asset;
pub use error::ApiError;
pub use frame::{Array, frame};
pub use guard::Token;
pub use places::Lane;
pub use request::{Method, Request};
pub use response::{LineSender, Response};
pub use server::{Handler, ServeError, Server};

#[cfg(test)]
mod tests;
