//! Results of a solution other than the displacement.

use crate::displacement::{Field, Reactions};

/// Largest share by which the critical voltage on one mesh may be too high.
pub const MESH_OVERESTIMATE: f64 = 0.12;

/// Results of effects and the motion of rigid bodies; an entry is only computed if the effect is on or there are
/// bodies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// Dielectric breakdown: the largest E/E_B of all cells; the membrane fails at 1.
    pub breakdown_ratio: Option<f64>,
    /// Wrinkling: the state of each cell, `[y][x]`: 0 taut, 1 wrinkled, 2 slack.
    pub tension: Option<Vec<u8>>,
    /// Electromechanical stability: the smallest eigenvalue of the tangent relative to the Laplacian, which is zero at
    /// the loss of stability.
    pub smallest_eigenvalue: Option<f64>,
    /// Electromechanical stability: the voltages in V between which stability is lost, if they were found.
    pub critical_voltage: Option<[f64; 2]>,
    /// The motion of each rigid body.
    pub bodies: Option<Vec<Motion>>,
    /// The motion of each bar, in the order of the sides.
    pub bars: Option<Vec<Motion>>,
    /// If a side is not held: the force in N of the left, right, lower and upper side on the membrane; 0 along
    /// components that a side does not hold.
    pub reactions: Option<[[f64; 2]; 4]>,
    /// The change of these forces by the voltage in mN.
    pub reaction_changes: Option<Reactions>,
    /// If a side is not held: the displacement at 0 V, with all loads.
    pub rest: Option<Field>,
    /// Charge control: charge, voltage and stability.
    pub charged: Option<Charged>,
    /// If it is asked for: the charge on the electrodes at the voltage in nC.
    pub charge: Option<f64>,
}

/// An equilibrium at a given charge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Charged {
    /// Charge on all electrodes in C.
    pub charge: f64,
    /// Voltage between the electrodes in V; `None` for immobile charge, which has no single voltage.
    pub voltage: Option<f64>,
    /// The number of negative eigenvalues of the tangent at constant voltage.
    pub negative_at_voltage: usize,
    /// The number of negative eigenvalues of the tangent at constant charge.
    pub negative_at_charge: usize,
}

/// The motion of a rigid body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// The displacement of the centroid in mm.
    pub translation: [f64; 2],
    /// The rotation in degrees from −180 to 180, counterclockwise.
    pub rotation: f64,
}

impl Observation {
    /// Returns the displacement from rest, without voltage if not all sides are held, of the mount otherwise; with the
    /// change of the forces of the sides.
    #[must_use]
    pub fn displacement_from_rest(&self, field: &Field) -> Field {
        let moved = match &self.rest {
            Some(rest) => field.plus(-1.0, rest),
            None => field.clone(),
        };
        let moved = moved.with_reactions(self.reaction_changes.unwrap_or_default());
        moved.with_charge(self.charge.unwrap_or_default())
    }

    /// Returns whether there are no results.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Wrinkling: returns the fraction of cells that are wrinkled or slack.
    #[must_use]
    pub fn wrinkled_fraction(&self) -> Option<f64> {
        let tension = self.tension.as_ref()?;
        Some(tension.iter().filter(|&&state| state > 0).count() as f64 / tension.len() as f64)
    }
}
