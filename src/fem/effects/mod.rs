//! What is simulated beyond the base model, one effect per file.
//!
//! A [`Model`] is the only place where effects are put together: it picks, once per pattern, the law that the effects of the
//! scene call for. Without any it is the base law, whose kernels know of no effect. Elastic laws that stiffen stand beside
//! the base one in [`super::energy`].

mod breakdown;
mod electrode;
mod fringe;
mod model;
mod permittivity;
mod wrinkling;

pub use breakdown::breakdown_ratio;
pub use electrode::Stiff;
pub use fringe::Fringe;
pub use model::{Model, WithMaterial};
pub use permittivity::Decaying;
pub use wrinkling::{RESIDUAL, TensionField};
