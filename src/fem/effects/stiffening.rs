//! Strain stiffening: from a scene to the elastic law of its elastomer.

use crate::fem::energy::{FirstInvariant, MOST_TERMS, Ogden, Response, Stiffening as Law, arruda_boyce, gent, yeoh};
use crate::fem::error::SetupError;
use crate::scene::{Scene, Stiffening};

/// The elastic law of a scene whose elastomer stiffens, normalised by its shear modulus.
///
/// # Errors
/// When the prestretch is beyond a limiting stretch, or Ogden's terms are none.
pub fn stiffened(scene: &Scene, stiffening: &Stiffening) -> Result<Law, SetupError> {
    let (prestretch, modulus) = (scene.prestretch(), scene.shear_modulus_pa());
    let limited = |response: Response| {
        FirstInvariant::new(response, prestretch)
            .map(Law::FirstInvariant)
            .ok_or(SetupError::LimitingStretch { prestretch })
    };
    match stiffening {
        Stiffening::Gent(law) => limited(gent(law.jm.to_f64())),
        Stiffening::Yeoh(law) => limited(yeoh(law.c2.value() / modulus, law.c3.value() / modulus)),
        Stiffening::ArrudaBoyce(law) => limited(arruda_boyce(law.locking_stretch.to_f64())),
        Stiffening::Ogden(law) => {
            let terms: Vec<(f64, f64)> = law
                .terms
                .iter()
                .map(|term| (term.mu.value() / modulus, term.alpha.to_f64()))
                .collect();
            let some = (1..=MOST_TERMS).contains(&terms.len());
            if some && terms.iter().all(|(_, exponent)| *exponent != 0.0) {
                Ok(Law::Ogden(Ogden::new(&terms, prestretch)))
            } else {
                Err(SetupError::OgdenTerms)
            }
        }
    }
}
