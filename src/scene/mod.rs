//! What to simulate: geometry, material, drive and effects. Validated here, once; no numerics.

mod difference;
mod drive;
pub mod effects;
mod geometry;
mod mask;
mod model;
mod properties;
mod shape;
#[cfg(test)]
mod tests;

pub use difference::Difference;
pub use drive::{Drive, MOST_STATES, State, States, UnknownState, Voltages};
pub use effects::{
    Breakdown, ConstantStrength, Effects, Electrode, HuangStrength, On, PermittivityDecay, PermittivityReference,
    Stiffening, laws,
};
pub use geometry::{Body, Both, Frame, Geometry, MOST_BODIES, Outline};
pub use mask::{Islands, Mask, Point, Size};
pub use model::{ElasticModel, Material, Scene, VACUUM_PERMITTIVITY};
pub use properties::{Branch, Properties};
pub use shape::{Cells, Circle, Disc, Drawing, Place, Polygon, Rectangle, Shape, mask_files};
