//! What is simulated beyond the base model, one effect per file: what it adds to the energy or reads off a solution, and how
//! screening tells whether a scene calls for it.
//!
//! A [`Model`] is the only place where effects are put together: it picks, once per pattern, the law that the effects of the
//! scene call for. Without any it is the base law, whose kernels know of no effect. Elastic laws that stiffen stand beside
//! the base one in [`super::energy`].

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

pub use breakdown::{breakdown_ratio, breakdown_ratio_at_rest, breakdown_strength, breakdown_strength_or_usual};
pub use effect::{DISPLACED, Effect, Examined, SMALL, Significance, Solutions, Stability, Verdict};
pub use electrode::Stiff;
pub use fringe::Fringe;
pub use model::{Model, WithMaterial};
pub use permittivity::Decaying;
pub(super) use pull_in::NEAR;
pub use wrinkling::{RESIDUAL, TensionField};

/// The effects in the order in which screening lists them.
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
