//! A YAML document in which every value has its position.
//!
//! Scenes and pipelines are read from this tree and not by derived deserialisation: an error names file, line and
//! field, underlines the value, and reports what was found and what is allowed, also for values of `--set` on the
//! command line.

mod beside;
mod error;
mod node;
mod overrides;
mod parse;
mod read;
mod source;

pub use error::{InputError, nearest};
pub use node::{Node, NodeValue};
pub use overrides::Override;
pub use parse::Document;
pub use read::Map;
pub use source::Source;

#[cfg(test)]
mod tests;
