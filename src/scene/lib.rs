//! What to simulate: geometry, material, drive and effects. Validated here, once; no numerics.

mod charge;
mod difference;
mod drive;
pub mod effects;
mod geometry;
mod leads;
mod mask;
mod model;
mod properties;
mod shape;
mod source;
#[cfg(test)]
mod tests;
mod waveform;

pub use charge::Charge;
pub use difference::Difference;
pub use drive::{Drive, MOST_STATES, State, States, UnknownState, Voltages};
pub use effects::{
    Branch, Breakdown, ConstantStrength, Effects, Electrode, ElectrodeResistance, HuangStrength, Inertia, On,
    PermittivityDecay, PermittivityReference, Stiffening, Viscoelasticity, ViscousLaw, laws,
};
pub use geometry::{Body, Both, Frame, Geometry, MOST_BODIES, Outline};
pub use leads::{Edge, Leads, Unreached};
pub use mask::{Islands, Mask, Point, Size};
pub(crate) use model::AUTO;
pub use model::{ElasticModel, Material, Scene, VACUUM_PERMITTIVITY};
pub use properties::Properties;
pub use shape::{Cells, Circle, Disc, Drawing, Place, Polygon, Rectangle, Shape, scene_files};
pub use source::Source;
pub use waveform::{Knot, Ramp, Side, Sine, Step, Table, Waveform};
