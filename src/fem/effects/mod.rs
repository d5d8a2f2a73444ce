//! The effects beyond the base model, one per file: their evaluation of a solution, and their screening. Energies are
//! in [`super::energy`].
//!
//! Only [`Model`] combines effects: once per pattern it selects the law for the effects of the scene. Without any it is
//! the base law, whose kernels are independent of effects.

mod breakdown;
mod charge;
mod effect;
mod electrode;
mod fringe;
mod inclusion;
mod inertia;
mod model;
mod permittivity;
mod pull_in;
mod resistance;
mod stiffening;
mod strip;
mod viscoelasticity;
mod wrinkling;

pub(super) use breakdown::largest_ratio;
pub use breakdown::{breakdown_ratio, breakdown_ratio_at_rest, breakdown_strength, breakdown_strength_or_default};
pub use effect::{DISPLACED, Effect, Examined, SMALL, Significance, Solutions, StableRange, Verdict};
pub use fringe::Fringe;
pub use model::{Model, WithMaterial};
pub(super) use pull_in::NEAR;

/// The effects in the order of the screening table.
pub static EFFECTS: [&dyn Effect; 12] = [
    &stiffening::StrainStiffening,
    &electrode::ElectrodeStiffness,
    &permittivity::StretchDependentPermittivity,
    &fringe::FringeField,
    &viscoelasticity::Viscoelasticity,
    &inertia::Inertia,
    &resistance::ElectrodeResistance,
    &charge::ChargeControl,
    &inclusion::RigidInclusion,
    &wrinkling::Wrinkling,
    &pull_in::ElectromechanicalStability,
    &breakdown::DielectricBreakdown,
];
