//! The effects that benchmarks switch on, with the same numbers in each.

use deaflow::base::{Decimal, Length, Stress};
use deaflow::scene::laws::{Gent, Ogden, OgdenTerm};
use deaflow::scene::{Effects, Electrode, On, PermittivityDecay, PermittivityReference, Stiffening};

/// Ogden's terms, μ in Pa and α, of a law with three.
pub const THREE_TERMS: [(f64, f64); 3] = [(40e3, 1.9), (50.0, 5.0), (-3e3, -2.0)];

pub fn decimal(value: f64) -> Decimal {
    Decimal::from_f64(value).expect("a finite number")
}

pub fn stress(value: f64) -> Stress {
    Stress::from_f64(value).expect("a finite number")
}

pub fn gent() -> Stiffening {
    Stiffening::Gent(Gent { jm: decimal(100.0) })
}

pub fn ogden(terms: &[(f64, f64)]) -> Stiffening {
    let term = |&(mu, alpha): &(f64, f64)| OgdenTerm {
        mu: stress(mu),
        alpha: decimal(alpha),
    };
    Stiffening::Ogden(Ogden {
        terms: terms.iter().map(term).collect(),
    })
}

pub fn electrode() -> Electrode {
    Electrode {
        shear_modulus: stress(50e3),
        thickness: Length::from_f64(0.05).expect("a finite number"),
    }
}

pub fn decay() -> PermittivityDecay {
    PermittivityDecay {
        exponent: decimal(0.1),
        reference: PermittivityReference::Prestretched,
    }
}

/// All effects that move a membrane, with a law that stiffens.
pub fn all_with(law: Stiffening) -> Effects {
    Effects {
        strain_stiffening: Some(law),
        electrode_stiffness: Some(electrode()),
        stretch_dependent_permittivity: Some(decay()),
        fringe_field: Some(On {}),
        wrinkling: Some(On {}),
        ..Effects::default()
    }
}
