//! Measures the error of methods against a reference, and their time on one core.
//!
//! A candidate is a method with its settings, finite elements or a network; prepared for a scene it is an evaluator,
//! which is all that the benchmark uses.

mod benchmark;
mod bound;
mod candidate;
mod error;
mod families;
mod network;
mod reference;
mod timing;

pub use benchmark::{Benchmark, Comparison, FamilyError, Measured, measurement};
pub use candidate::Candidate;
pub use error::AccuracyError;
pub use families::{Families, drawn, given};
pub use network::Network;
pub use reference::Reference;
