//! What is simulated: geometry, material, drive and effects. A scene is checked once, on reading. This crate has no
//! numerics.

mod body;
mod canonical;
mod charge;
mod components;
mod difference;
mod drawing;
mod drive;
pub mod effects;
mod floating;
mod geometry;
mod leads;
mod library;
mod loads;
mod mask;
mod model;
mod named_files;
mod outline;
mod read;
mod shape;
mod sides;
mod source;
#[cfg(test)]
mod tests;
mod tolerances;
mod waveform;

pub use body::BodyCorners;
pub use charge::Charge;
pub use components::{Components, Springs, Untilted};
pub use difference::Difference;
pub use drawing::{Drawing, Placement, Text};
pub use drive::{Drive, MOST_STATES, State, States, UnknownState, Voltages};
pub use effects::{
    Branch, Breakdown, ConstantStrength, Effects, Electrode, ElectrodeResistance, HuangStrength, Inertia, On,
    PermittivityDecay, PermittivityReference, Properties, Stiffening, Viscoelasticity, ViscousLaw, laws,
};
pub use floating::{Floating, Pivot};
pub use geometry::{Body, Both, Curves, Frame, Geometry, MOST_BODIES};
pub use leads::{Edge, Leads, Unreached};
pub use library::splice_material;
pub use loads::{Loads, Pressurised};
pub use mask::{Islands, Mask, Point, Size};
pub use model::{ElasticModel, Material, Scene, VACUUM_PERMITTIVITY};
pub use named_files::{material_file, scene_files};
pub use outline::Outline;
pub use shape::{Cells, Circle, Position, Shape, Shapes};
pub use sides::{Bar, BarMotion, SideSupport, Sides};
pub use source::Source;
pub use tolerances::{Distribution, Factor, Spread, Tolerances};
pub use waveform::{Knot, Ramp, Side, Sine, Step, Table, Waveform};
