//! Viscoelasticity: Maxwell branches parallel to the equilibrium law.

use deaflow_base::{Stress, Time, parameters, words};

/// The largest number of branches: more than two per decade of fourteen decades.
pub const MOST_BRANCHES: usize = 32;

parameters! {
    /// The elastomer creeps: Maxwell branches parallel to the equilibrium law, whose modulus is `shear_modulus`.
    pub struct Viscoelasticity as "`viscoelasticity`" {
        /// The flow law of a branch. Published parameters are for one law.
        pub law: ViscousLaw = ViscousLaw::Linear,
        /// The branches.
        pub branches: Vec<Branch> [((), 1..=MOST_BRANCHES)],
    }
}

words! {
    /// The flow law of a branch.
    pub enum ViscousLaw {
        /// Ȧ = (C⁻¹ − A)/τ with the inverse viscous metric A (Linder, Tkachuk, Miehe, J. Mech. Phys. Solids 59 (2011)
        /// 2134).
        Linear = "linear",
        /// L_v be = −dev(be) be/τ with the elastic strain be of a neo-Hookean spring (Reese, Govindjee, Int. J. Solids
        /// Struct. 35 (1998) 3455).
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
