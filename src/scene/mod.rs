//! What is simulated: geometry, material, drive and effects of one membrane, validated and without numerics.

mod difference;
pub mod effects;
mod model;
mod properties;
mod read;
mod read_effects;
mod schema;

pub use difference::Difference;
pub use effects::{BreakdownLaw, Effects, Electrode, PermittivityDecay, PermittivityReference, Stiffening};
pub use model::{Drive, Geometry, Law, Material, Scene, VACUUM_PERMITTIVITY};
pub use properties::{Branch, Properties};
pub use read::SECTIONS;
