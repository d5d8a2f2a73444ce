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
        Stiffening::Gent { jm } => limited(gent(jm.to_f64())),
        Stiffening::Yeoh { c2, c3 } => limited(yeoh(c2.value() / modulus, c3.value() / modulus)),
        Stiffening::ArrudaBoyce { locking_stretch } => limited(arruda_boyce(locking_stretch.to_f64())),
        Stiffening::Ogden { terms } => {
            let terms: Vec<(f64, f64)> = terms
                .iter()
                .map(|(stress, exponent)| (stress.value() / modulus, exponent.value()))
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
