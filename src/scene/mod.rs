//! What to simulate: geometry, material, drive and effects. Validated here, once; no numerics.

mod difference;
pub mod effects;
mod model;
mod properties;
#[cfg(test)]
mod tests;

pub use difference::Difference;
pub use effects::{
    ArrudaBoyce, Breakdown, ConstantStrength, Effects, Electrode, Gent, HuangStrength, Ogden, OgdenTerm, On,
    PermittivityDecay, PermittivityReference, Stiffening, Yeoh,
};
pub use model::{Drive, ElasticModel, Geometry, Material, Scene, VACUUM_PERMITTIVITY};
pub use properties::{Branch, Properties};
