//! Stretch-dependent permittivity: ε ∝ J^(−s).

use deaflow_base::{Decimal, parameters, words};

parameters! {
    /// The permittivity decreases with stretch: ε ∝ J^(−s).
    pub struct PermittivityDecay as "`stretch_dependent_permittivity`" {
        /// The exponent s.
        pub exponent: Decimal [-0.5..=0.9],
        /// The state in which the permittivity was measured.
        pub reference: PermittivityReference = PermittivityReference::Prestretched,
    }
}

words! {
    /// The state in which a permittivity was measured.
    pub enum PermittivityReference {
        /// On the prestretched membrane.
        Prestretched = "prestretched",
        /// On the undeformed elastomer.
        Undeformed = "undeformed",
    }
}
