//! A YAML document that remembers where every word stands.
//!
//! Scenes and pipelines are read through this tree and not through derived deserialisation: a refusal must name
//! file, line and field, put a caret under the word, say what was found and what is allowed, and the same must hold for
//! values given on the command line with `--set`.

mod error;
mod node;
mod overrides;
mod parse;
mod read;

pub use error::{InputError, nearest};
pub use node::{Node, NodeValue, Source};
pub use overrides::Override;
pub use parse::Document;
pub use read::Map;

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;
