//! Viscoelasticity: Maxwell branches beside the equilibrium law.

use deaflow_base::{Stress, Time, parameters, words};

/// Most branches: one for each of fourteen decades, and some.
pub const MOST_BRANCHES: usize = 32;

parameters! {
    /// The elastomer creeps: Maxwell branches beside the equilibrium law, whose modulus `shear_modulus` is.
    pub struct Viscoelasticity as "`viscoelasticity`" {
        /// How a branch flows. Published parameters belong to one law.
        pub law: ViscousLaw = ViscousLaw::Linear,
        /// Its branches.
        pub branches: Vec<Branch> [((), 1..=MOST_BRANCHES)],
    }
}

words! {
    /// How a branch flows.
    pub enum ViscousLaw {
        /// Ȧ = (C⁻¹ − A)/τ with the inverse viscous metric A (Linder, Tkachuk, Miehe, J. Mech. Phys. Solids 59 (2011) 2134).
        Linear = "linear",
        /// L_v be = −dev(be) be/τ with the elastic strain be of a neo-Hookean spring (Reese, Govindjee, Int. J. Solids Struct. 35 (1998) 3455).
        Finite = "finite",
    }
}

parameters! {
    /// A spring and a dashpot in series.
    pub struct Branch as "a branch" {
        /// Shear modulus of the spring.
        pub modulus: Stress [0.0..=1e12],
        /// Relaxation time.
        pub time: Time [1e-12..=1e12],
    }
}
