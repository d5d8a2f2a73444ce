//! The prestretched sheet that elements divide.

use std::sync::Arc;

use deaflow_pattern::{Membrane, Parts, Raster};
use deaflow_scene::Scene;

/// What pulls a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// The force on its centroid over μH, along x and y in mm.
    pub load: [f64; 2],
    /// The stiffness of a spring that draws the centroid back, over μH.
    pub spring: f64,
}

impl Mount {
    /// The same in units of a length in mm, to which forces over μH are in proportion.
    #[must_use]
    pub fn in_units(self, unit_mm: f64) -> Self {
        Self {
            load: self.load.map(|force| force / unit_mm),
            ..self
        }
    }
}

/// A rectangle with its cells, prestretched along its sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Its cells and sides.
    pub membrane: Membrane,
    /// λ₁ along x and λ₂ along y.
    pub prestretch: [f64; 2],
    /// What its cells are; nothing where all of them are membrane.
    pub parts: Option<Arc<Parts>>,
    /// What pulls each body.
    pub mounts: Vec<Mount>,
}

/// What pulls the bodies of a scene: forces in N over μH in N/m are lengths in m.
fn mounts(scene: &Scene) -> Vec<Mount> {
    let stiffness = scene.shear_modulus_pa() * scene.thickness_mm() * 1e-3;
    let bodies = scene.geometry.bodies.iter().flatten().map(|body| Mount {
        load: body.load_n().map(|force| 1e3 * force / stiffness),
        spring: body.spring_n_per_m() / stiffness,
    });
    bodies.collect()
}

impl Sheet {
    /// That of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        Self {
            membrane: scene.membrane(),
            prestretch: scene.prestretch(),
            parts: scene.parts(),
            mounts: mounts(scene),
        }
    }

    /// Its cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.membrane.raster
    }

    /// D = diag(λ₁, λ₂)/√(λ₁λ₂), the identity where both are equal.
    #[must_use]
    pub fn distortion(&self) -> [f64; 2] {
        let [along, across] = self.prestretch;
        let ratio = (along / across).sqrt();
        [ratio, 1.0 / ratio]
    }
}

#[cfg(test)]
impl Sheet {
    /// That of the source paper.
    pub fn paper() -> Self {
        Self {
            membrane: Membrane::square(50.0),
            prestretch: [3.0; 2],
            parts: None,
            mounts: Vec::new(),
        }
    }
}
