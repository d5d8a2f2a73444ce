//! Scenes with effects, and their laws.

use super::*;
use crate::effects::{Model, WithMaterial};
use crate::kinematics::{Tensor, deformation};
use deaflow_base::{Decimal, Length, Stress};
use deaflow_scene::laws::{ArrudaBoyce, Gent, Ogden, OgdenTerm, Yeoh};
use deaflow_scene::{Effects, Electrode, On, PermittivityDecay, PermittivityReference, Stiffening};

pub fn decimal(value: f64) -> Decimal {
    Decimal::from_f64(value).unwrap()
}

pub fn stress(value: f64) -> Stress {
    Stress::from_f64(value).unwrap()
}

pub fn gent(jm: f64) -> Stiffening {
    Stiffening::Gent(Gent { jm: decimal(jm) })
}

pub fn yeoh(c2: f64, c3: f64) -> Stiffening {
    Stiffening::Yeoh(Yeoh {
        c2: stress(c2),
        c3: stress(c3),
    })
}

pub fn arruda_boyce(locking: f64) -> Stiffening {
    Stiffening::ArrudaBoyce(ArrudaBoyce {
        locking_stretch: decimal(locking),
    })
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

pub fn electrode(ratio: f64) -> Electrode {
    Electrode {
        shear_modulus: stress(45e4 * ratio),
        thickness: Length::from_f64(0.1).unwrap(),
    }
}

pub fn decay(exponent: f64, reference: PermittivityReference) -> PermittivityDecay {
    PermittivityDecay {
        exponent: decimal(exponent),
        reference,
    }
}

/// 45 kPa, 1 mm, at a prestretch and a voltage in V.
pub fn scene(prestretch: f64, voltage: f64, effects: Effects) -> Scene {
    Scene {
        effects,
        ..Scene::with_values(50.0, 1.0, prestretch, 45e3, 4.7, voltage)
    }
}

/// Elastic laws, without and with electrodes and decaying permittivity, without and with wrinkling.
pub fn combinations() -> Vec<Effects> {
    // Ogden's own three terms for rubber, scaled to 45 kPa.
    let rubber = [(0.63e6, 1.3), (0.0012e6, 5.0), (-0.01e6, -2.0)].map(|(m, a)| (m * 45e3 / 0.4225e6, a));
    let elastic = [
        None,
        Some(gent(60.0)),
        Some(yeoh(-150.0, 4.0)),
        Some(arruda_boyce(4.0)),
        Some(ogden(&rubber)),
    ];
    let dressed = [false, true];
    let all = elastic
        .iter()
        .flat_map(|e| dressed.map(|d| (e, d)))
        .flat_map(|(e, d)| [false, true].map(|w| (e, d, w)));
    all.map(|(elastic, dressed, wrinkling)| Effects {
        strain_stiffening: elastic.clone(),
        electrode_stiffness: dressed.then(|| electrode(0.3)),
        stretch_dependent_permittivity: dressed.then(|| decay(0.4, PermittivityReference::Prestretched)),
        wrinkling: wrinkling.then_some(On {}),
        ..Effects::default()
    })
    .collect()
}

/// Runs a function with the law of a scene at full load.
pub fn with_law<T>(scene: &Scene, work: impl PointWork<Output = T>) -> T {
    struct AtFullLoad<W>(W);
    impl<W: PointWork> WithMaterial for AtFullLoad<W> {
        type Output = W::Output;
        fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> W::Output {
            self.0.run(&material(1.0))
        }
    }
    Model::new(scene).unwrap().with(AtFullLoad(work))
}

pub trait PointWork {
    type Output;
    fn run<L: Material>(self, material: &L) -> Self::Output;
}

/// p at a gradient.
pub struct Piola(pub Tensor<f64>, pub f64);

impl PointWork for Piola {
    type Output = Tensor<f64>;
    fn run<L: Material>(self, material: &L) -> Tensor<f64> {
        let (stress, rest) = (
            material.stress(self.0, self.1),
            material.self_stress(deformation(self.0)),
        );
        std::array::from_fn(|i| std::array::from_fn(|k| stress[i][k] + rest[i][k]))
    }
}
