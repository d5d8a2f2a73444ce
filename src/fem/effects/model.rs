//! From a scene to the law of a point of its membrane.

use crate::fem::energy::{Law, NeoHookean};
use crate::fem::mesh::Mesh;
use crate::fem::operator::Activity;
use crate::fem::solver::SetupError;
use crate::pattern::Pattern;
use crate::scene::Scene;

/// The physics of a scene, ready for any pattern.
#[derive(Clone, Debug)]
pub struct Model {
    prestretch: f64,
    kappa: f64,
}

/// Work that is the same under every law.
pub trait WithLaw {
    /// What comes of it.
    type Output;
    /// Does it. `law` is the law at a share of the full load, which is proportional to V².
    fn run<L: Law, F: Fn(f64) -> L + Sync>(self, law: F) -> Self::Output;
}

impl Model {
    /// The physics of a scene.
    ///
    /// # Errors
    /// When its effects cannot be simulated together, or not at its measures.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        Ok(Self {
            prestretch: scene.prestretch(),
            kappa: scene.kappa(),
        })
    }

    /// Does work under the law of the scene.
    pub fn with<W: WithLaw>(&self, work: W) -> W::Output {
        let (prestretch, kappa) = (self.prestretch, self.kappa);
        work.run(|share: f64| NeoHookean::new(prestretch, share * kappa))
    }

    /// Where a pattern is active on a mesh.
    #[must_use]
    pub fn activity(&self, mesh: Mesh, pattern: &Pattern) -> Activity {
        Activity::new(mesh, pattern)
    }
}
