//! The half-active strip in closed form, to first order: the values above which missing material data would be
//! significant.
//!
//! Half of a membrane is active and moves along one direction only. In units of μ per prestretched area, and with a =
//! λp⁻⁶, each half has the stiffness C = 1 + 3a, and the voltage subtracts b = κλp² from that of the active one: the
//! displacement is proportional to b/(2C − b).

use super::effect::SMALL;
use deaflow_scene::Scene;

/// The strip of a scene.
pub struct Strip {
    /// λp.
    prestretch: f64,
    /// C.
    stiffness: f64,
    /// b.
    load: f64,
}

impl Strip {
    pub fn new(scene: &Scene) -> Self {
        let prestretch = scene.mean_prestretch();
        Self {
            prestretch,
            stiffness: 1.0 + 3.0 * prestretch.powi(-6),
            load: scene.kappa() * prestretch.powi(2),
        }
    }

    /// Returns 2C − b, with a lower bound where the strip is unstable.
    fn remaining(&self) -> f64 {
        let both = 2.0 * self.stiffness;
        (both - self.load).max(0.1 * both)
    }

    /// Returns Jm of Gent's law below which strain stiffening is significant. With I₁ along the strip, I′ = 2λp² −
    /// 2λp⁻⁴ and I″ = 2λp² + 6λp⁻⁴, both halves are stiffer by C (I₁ − 3 + I′²/I″)/Jm.
    pub fn significant_jm(&self) -> f64 {
        let (square, fourth) = (self.prestretch.powi(2), self.prestretch.powi(-4));
        let invariant = 2.0 * square + fourth - 3.0;
        let (first, second) = (2.0 * (square - fourth), 2.0 * square + 6.0 * fourth);
        let rise = 2.0 * self.stiffness * (invariant + first * first / second);
        rise / (SMALL * self.remaining())
    }

    /// Returns χ above which stiff electrodes are significant: the active half is stiffer by 4χ.
    pub fn significant_electrode(&self) -> f64 {
        SMALL * self.remaining() / 4.0
    }

    /// Returns s above which a decreasing permittivity is significant, if it was measured on the prestretched membrane:
    /// b decreases by s/2, and what it subtracts from the stiffness by 3s/2.
    pub fn significant_decay(&self) -> f64 {
        SMALL / (0.5 + 1.5 * self.load / self.remaining())
    }
}
