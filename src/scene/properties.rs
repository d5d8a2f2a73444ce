//! What is known of a material and its electrodes beyond the base model: what screening compares, and what effects that are named without
//! parameters of their own use.

use super::effects::{Branch, Breakdown, Electrode, MOST_BRANCHES, PermittivityDecay, Stiffening, Viscoelasticity};
use deaflow_base::{Density, Fields, Parameter, Resistance, Schema, parameters};

parameters! {
    /// What is known beyond the base model: for screening, and for effects without parameters of their own. What is not known is not screened.
    #[derive(Default)]
    pub struct Properties as "`properties`" {
        /// How the elastomer stiffens.
        pub strain_stiffening: Option<Stiffening>,
        /// The electrodes.
        pub electrode_stiffness: Option<Electrode>,
        /// How the permittivity depends on stretch.
        pub stretch_dependent_permittivity: Option<PermittivityDecay>,
        /// Where the elastomer breaks down.
        pub dielectric_breakdown: Option<Breakdown>,
        /// How the elastomer creeps.
        pub viscoelasticity: Option<Viscoelasticity>,
        /// Density of the elastomer.
        pub density: Option<Density> [1.0..=1e5],
        /// Resistance of a square of electrode.
        pub sheet_resistance: Option<Resistance> [0.0..=1e15],
    }
    rules(or_branches)
}

/// A list of branches is one of the linear law.
fn or_branches(fields: Fields) -> Fields {
    fields.map_schemas(|key, schema| match key {
        "viscoelasticity" => {
            let branches = Schema::list(Branch::schema(&()), 1, MOST_BRANCHES);
            Schema::any_of([schema, branches.description("The branches, of the linear law.")])
        }
        _ => schema,
    })
}

impl Properties {
    /// Whether nothing is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
