//! The prestretched sheet that elements divide.

use crate::pattern::{Membrane, Raster};
use crate::scene::Scene;

/// A rectangle with its cells, prestretched along its sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Its cells and sides.
    pub membrane: Membrane,
    /// λ₁ along x and λ₂ along y.
    pub prestretch: [f64; 2],
}

impl Sheet {
    /// That of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        Self {
            membrane: scene.membrane(),
            prestretch: scene.prestretch(),
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
        }
    }
}
