//! Known data of the material and the electrodes beyond the base model, for screening and for effects without
//! parameters.

use super::breakdown::Breakdown;
use super::electrode::Electrode;
use super::laws::Stiffening;
use super::permittivity::PermittivityDecay;
use super::viscoelasticity::{Branch, MOST_BRANCHES, Viscoelasticity};
use deaflow_base::{Density, Fields, Parameter, Resistance, Schema, parameters};

parameters! {
    /// Known data beyond the base model, for screening and for effects without parameters. Screening skips unknown
    /// data.
    #[derive(Default)]
    pub struct Properties as "`properties`" {
        /// How the elastomer stiffens.
        pub strain_stiffening: Option<Stiffening>,
        /// The electrodes.
        pub electrode_stiffness: Option<Electrode>,
        /// How the permittivity depends on stretch.
        pub stretch_dependent_permittivity: Option<PermittivityDecay>,
        /// The breakdown strength of the elastomer.
        pub dielectric_breakdown: Option<Breakdown>,
        /// How the elastomer creeps.
        pub viscoelasticity: Option<Viscoelasticity>,
        /// Density of the elastomer.
        pub density: Option<Density> [1.0..=1e5],
        /// Sheet resistance of the electrodes.
        pub sheet_resistance: Option<Resistance> [0.0..=1e15],
    }
    rules(or_branches)
}

/// Allows a list of branches, which stands for the linear law.
fn or_branches(fields: Fields) -> Fields {
    fields.map_schemas(|key, schema| match key {
        "viscoelasticity" => {
            let branches = Schema::list(Branch::schema(&()), 1, MOST_BRANCHES);
            Schema::any_of([schema, branches.description("The branches of the linear law.")])
        }
        _ => schema,
    })
}

impl Properties {
    /// Returns whether nothing is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
