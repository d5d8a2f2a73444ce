//! What to simulate: geometry, material, drive and effects. Validated here, once; no numerics.

mod difference;
pub mod effects;
mod geometry;
mod mask;
mod model;
mod properties;
mod shape;
#[cfg(test)]
mod tests;

pub use difference::Difference;
pub use effects::{
    Breakdown, ConstantStrength, Effects, Electrode, HuangStrength, On, PermittivityDecay, PermittivityReference,
    Stiffening, laws,
};
pub use geometry::{Body, Both, Frame, Geometry, Outline};
pub use mask::{Mask, Point, Size};
pub use model::{Drive, ElasticModel, Material, Scene, VACUUM_PERMITTIVITY};
pub use properties::{Branch, Properties};
pub use shape::{Circle, Disc, Place, Polygon, Rectangle, Shape};
