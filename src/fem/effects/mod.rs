//! What is simulated beyond the base model, one effect per file.
//!
//! A [`Model`] is the only place where effects are put together: it picks, once per pattern, a law whose type is made of
//! the effects that the scene names. What is not named is not in the type, so it costs no branch and no arithmetic at
//! the quadrature points.

mod breakdown;
mod model;
pub mod screening;

pub use breakdown::breakdown_ratio;
pub use model::{Model, WithLaw};
