//! The protocol: connections, who may ask, what an answer is.

mod answer;
mod assets;
mod frame;
mod guard;
mod refusal;
mod request;
mod server;

pub use answer::{Answer, Lines};
pub use assets::asset;
pub use frame::{Array, frame};
pub use guard::Token;
pub use refusal::Refusal;
pub use request::{Method, Request};
pub use server::{Handler, Lane, ServeError, Served};
