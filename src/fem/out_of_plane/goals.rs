//! When forces count as none.

use super::surface::Totals;
use crate::newton::norm;

/// Rounding of a sum of forces, in units of [`Totals::uncancelled`], and of the energy, in units of the square.
const ROUNDED: f64 = 16.0 * f64::EPSILON;

/// Norms of forces in the plane and out of it that count as none.
///
/// They are two since those in the plane have the rounding of the prestress, which a small pressure is far below, and
/// those out of it that of the slopes alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Goals {
    planar: f64,
    height: f64,
}

impl Goals {
    /// Of forces of which none is known to be small.
    pub const EQUAL: Self = Self {
        planar: 1.0,
        height: 1.0,
    };

    /// Returns the goals of a state: this size, or the rounding of the forces.
    pub fn new(size: f64, at: &Totals) -> Self {
        let [planar, height] = at.uncancelled.map(|own| size.max(ROUNDED * own));
        Self {
            planar,
            height: height.max(f64::MIN_POSITIVE),
        }
    }

    /// Returns the size of forces in units of the goals.
    pub fn size(&self, forces: &[f64]) -> f64 {
        let (planar, height) = forces.split_at(2 * (forces.len() / 3));
        (norm(planar) / self.planar).hypot(norm(height) / self.height)
    }

    /// Returns the rounding of the energy of a state.
    pub fn of_energy(at: &Totals) -> f64 {
        ROUNDED * at.uncancelled[0].powi(2)
    }
}
