//! Which effects are significant in a scene.
//!
//! An effect that changes the displacement is judged by solutions with and without it for a few patterns, including
//! extreme ones. Effects in time are judged by the scene alone, stability and breakdown by the solutions.

mod comparer;
mod comparison;
mod document;
mod examine;
mod resolve;
mod row;
mod screen;
mod test_pattern;
#[cfg(test)]
mod tests;

pub use comparison::{Comparison, Displacement};
pub use examine::{examined, observing_breakdown};
pub use resolve::{ScreenedScene, remember, resolve, resolve_states, resolved_states};
pub use row::{Row, Status};
pub use screen::{NO_DATA, Screening, screen, screen_for, screen_within};
pub use test_pattern::{TestPattern, reference_patterns};
