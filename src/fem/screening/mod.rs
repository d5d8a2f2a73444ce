//! Which effects a scene calls for.
//!
//! An effect that moves the membrane is judged by how much: solutions with it are compared with solutions without it, for a few
//! patterns, between them as extreme as patterns are. Those that cannot be simulated yet are judged by the scene alone, and stability and breakdown
//! by the solutions.

mod bench;
mod comparison;
mod document;
mod row;
mod screen;
mod screened;
mod solution;
#[cfg(test)]
mod tests;
mod trial;

pub use comparison::{Comparison, Displacement};
pub use row::{NOT_EACH, Row, Status};
pub use screen::{Screening, screen, screen_for, screen_within};
pub use screened::{Screened, decided_states, resolve, resolve_states};
pub use trial::{Trial, reference_patterns, watch_patterns, watch_patterns_with};
