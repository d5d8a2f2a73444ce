//! What is simulated: geometry, material, drive and effects of one membrane, validated and without numerics.

mod effects;
mod model;
mod read;

pub use effects::{BreakdownLaw, Effects, Electrode, PermittivityDecay, PermittivityReference, Stiffening};
pub use model::{Drive, Geometry, Law, Material, Scene, VACUUM_PERMITTIVITY};
pub use read::SECTIONS;
