//! The prestretched sheet before its division into elements.

use std::sync::Arc;

use deaflow_pattern::{Borders, Membrane, Parts, Raster};
use deaflow_scene::Scene;

/// Forces on a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Force on its centroid over μH, along x and y in mm.
    pub load: [f64; 2],
    /// Stiffness of a spring on its centroid over μH.
    pub spring: f64,
}

impl Mount {
    /// Converts the force over μH from mm to a unit of length.
    #[must_use]
    pub fn in_units(self, unit_mm: f64) -> Self {
        Self {
            load: self.load.map(|force| force / unit_mm),
            ..self
        }
    }
}

/// A prestretched rectangle of cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Cells and sides.
    pub membrane: Membrane,
    /// λ₁ along x and λ₂ along y.
    pub prestretch: [f64; 2],
    /// Parts of the sheet; `None` if all cells are membrane.
    pub parts: Option<Arc<Parts>>,
    /// Their exact borders, where elements follow them.
    pub borders: Option<Arc<Borders>>,
    /// Forces on each body.
    pub mounts: Vec<Mount>,
}

/// Returns the forces on the bodies of a scene: N over μH in N/m is a length in m.
fn mounts(scene: &Scene) -> Vec<Mount> {
    let stiffness = scene.shear_modulus_pa() * scene.thickness_mm() * 1e-3;
    let bodies = scene.geometry.bodies.iter().flatten().map(|body| Mount {
        load: body.load_n().map(|force| 1e3 * force / stiffness),
        spring: body.spring_n_per_m() / stiffness,
    });
    bodies.collect()
}

impl Sheet {
    /// Returns the sheet of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        Self {
            membrane: scene.membrane(),
            prestretch: scene.prestretch(),
            parts: scene.parts(),
            borders: scene.borders(),
            mounts: mounts(scene),
        }
    }

    /// Returns its raster.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.membrane.raster
    }

    /// Returns D = diag(λ₁, λ₂)/√(λ₁λ₂), the identity for equal prestretch.
    #[must_use]
    pub fn distortion(&self) -> [f64; 2] {
        let [along, across] = self.prestretch;
        let ratio = (along / across).sqrt();
        [ratio, 1.0 / ratio]
    }
}

#[cfg(test)]
impl Sheet {
    /// The sheet of the source paper.
    pub fn paper() -> Self {
        Self {
            membrane: Membrane::square(50.0),
            prestretch: [3.0; 2],
            parts: None,
            borders: None,
            mounts: Vec::new(),
        }
    }
}
