//! The critical voltage with an error, extrapolated from two meshes.
//!
//! A mesh makes a membrane too stiff, so the critical voltage is too high: hardly for smooth displacements, by some per
//! cent around the corners of electrodes, where the solution is singular and the error decreases only about linearly
//! with the element size. The remaining change, relative to that between two meshes, therefore depends on the pattern,
//! from a hundredth to nearly one. The estimate subtracts a middle share, and its error covers the rest;
//! `docs/effects.md` names some of the 50 patterns from which the shares were determined, on eight biquadratic elements
//! per cell.

use deaflow_field::{MESH_OVERESTIMATE, Mesh};

/// Remaining decrease of the critical voltage in units of that from the coarser to the finer mesh: middle value and
/// half-width.
const REMAINING: f64 = 0.45;
const REMAINING_ERROR: f64 = 0.5;
/// Share of a voltage that is also subtracted and added to the error if the two meshes differ: along the steps of a
/// thin curve the difference of two coarse meshes is too small.
const SLOW_CONVERGENCE: f64 = 3e-3;
/// Share of a voltage left open by the searches, and by meshes if the critical voltage hardly changes.
const SEARCH_ERROR: f64 = 2e-3;

/// A critical voltage with its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalVoltage {
    /// The estimate in V.
    pub voltage: f64,
    /// Error on either side in V; `None` without a result on a finer mesh.
    pub error: Option<f64>,
    /// The critical voltage on the coarser mesh.
    pub coarse: MeshLimit,
    /// That on the finer mesh; `None` if it was not found.
    pub fine: Option<MeshLimit>,
}

/// The critical voltage on one mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshLimit {
    /// The mesh.
    pub mesh: Mesh,
    /// Middle of the bracket in V.
    pub voltage: f64,
}

impl CriticalVoltage {
    /// Extrapolates from two meshes, the finer of half the element size.
    pub(super) fn new(coarse: MeshLimit, fine: Option<MeshLimit>) -> Self {
        let estimate = |fine: MeshLimit| {
            let fall = coarse.voltage - fine.voltage;
            let slow = (SLOW_CONVERGENCE * fine.voltage).min(fall.abs());
            let error = REMAINING_ERROR * fall.abs() + slow + SEARCH_ERROR * fine.voltage;
            (fine.voltage - REMAINING * fall - slow, error)
        };
        let (voltage, error) = fine
            .map(estimate)
            .map_or((coarse.voltage, None), |(voltage, error)| (voltage, Some(error)));
        Self {
            voltage,
            error,
            coarse,
            fine,
        }
    }

    /// Adds a further error in V; `None` if it is unknown.
    pub(super) fn with_error(self, further: Option<f64>) -> Self {
        Self {
            error: self.error.zip(further).map(|(error, further)| error + further),
            ..self
        }
    }

    /// Returns the voltages in V that bracket the true critical voltage. Without an error the lower one is that of the
    /// worst known pattern.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        match self.error {
            Some(error) => [self.voltage - error, self.voltage + error],
            None => [
                (1.0 - MESH_OVERESTIMATE) * self.voltage,
                (1.0 + SEARCH_ERROR) * self.voltage,
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(on_one: f64, on_two: Option<f64>) -> CriticalVoltage {
        let limit = |elements, voltage| MeshLimit {
            mesh: Mesh::biquadratic(elements),
            voltage,
        };
        CriticalVoltage::new(limit(1, on_one), on_two.map(|voltage| limit(2, voltage)))
    }

    #[test]
    fn the_estimate_and_its_error_are_those_of_the_formula() {
        // V₂ − 0.45 (V₁ − V₂) − s and 0.5 |V₁ − V₂| + s + 0.002 V₂ by hand, with s = 0.003 V₂ if the meshes differ by
        // more than that, else the whole difference.
        for (on_one, on_two, voltage, error) in [
            (7100.0, 7000.0, 6934.0, 85.0),
            (7010.0, 7000.0, 6985.5, 29.0),
            (6990.0, 7000.0, 6994.5, 29.0),
        ] {
            let limit = found(on_one, Some(on_two));
            assert!((limit.voltage - voltage).abs() < 1e-9, "{limit:?}");
            assert!((limit.error.unwrap() - error).abs() < 1e-9, "{limit:?}");
            let [low, high] = limit.interval();
            assert!((low - voltage + error).abs() < 1e-9 && (high - voltage - error).abs() < 1e-9);
        }
        // One mesh only: up to 12 % too high.
        let alone = found(5000.0, None);
        let [low, high] = alone.interval();
        assert_eq!((alone.voltage, alone.error), (5000.0, None));
        assert!((low - 4400.0).abs() < 1e-9 && (high - 5010.0).abs() < 1e-9);
    }
}
