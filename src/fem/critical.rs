//! Where stability is lost, with an error: the losses on two meshes, extrapolated.
//!
//! A mesh makes a membrane too stiff, and it loses stability too late: smooth displacements by next to nothing, those around
//! the corners of electrodes by some per cent, because a corner is singular and the error there falls hardly faster than the
//! side of an element. How much of the difference of two meshes is still to come therefore depends on the pattern, from a
//! hundredth to nearly all of it. The estimate takes a middle share of it away, and its error spans the rest; `docs/effects.md` has the
//! patterns that the shares were found with, on eight biquadratic elements per cell.

use deaflow_field::Mesh;

/// What a mesh of half the side takes away from the voltage of the finer mesh, in units of what it took from the coarser one:
/// the middle, and how far the truth may lie on either side of it.
const STILL_TO_COME: f64 = 0.45;
const EITHER_SIDE: f64 = 0.5;
/// The part of a voltage that is taken away beside, and spanned, where the two differ at all: along the steps of a thin curve the
/// difference of two coarse meshes tells too little.
const SLOW: f64 = 3e-3;
/// The part of a voltage that the searches leave open, and what meshes do to a limit that hardly changes.
const SEARCHED: f64 = 2e-3;
/// The part of a voltage by which the loss on a coarse mesh alone may lie too high.
pub(super) const COARSE: f64 = 0.12;

/// The voltage at which stability is lost, and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalVoltage {
    /// The estimate in V.
    pub voltage: f64,
    /// How far the truth may lie on either side, in V; `None` where no finer mesh says anything.
    pub error: Option<f64>,
    /// The loss on the coarser mesh, in V.
    pub coarse: MeshLimit,
    /// That on the finer one; `None` where it was not found.
    pub fine: Option<MeshLimit>,
}

/// The loss of stability on one mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshLimit {
    /// The mesh.
    pub mesh: Mesh,
    /// In V, the middle of the two voltages between which it lies.
    pub voltage: f64,
}

impl CriticalVoltage {
    /// The estimate from the losses on two meshes, the finer of half the side.
    pub(super) fn new(coarse: MeshLimit, fine: Option<MeshLimit>) -> Self {
        let estimate = |fine: MeshLimit| {
            let fall = coarse.voltage - fine.voltage;
            let slow = (SLOW * fine.voltage).min(fall.abs());
            let error = EITHER_SIDE * fall.abs() + slow + SEARCHED * fine.voltage;
            (fine.voltage - STILL_TO_COME * fall - slow, error)
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

    /// The voltages in V between which the truth is expected. Where the error is not known the lower one is that of the
    /// worst pattern that is known.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        match self.error {
            Some(error) => [self.voltage - error, self.voltage + error],
            None => [(1.0 - COARSE) * self.voltage, (1.0 + SEARCHED) * self.voltage],
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
        // V₂ − 0.45 (V₁ − V₂) − s and 0.5 |V₁ − V₂| + s + 0.002 V₂ by hand, with s = 0.003 V₂ where the meshes differ by more
        // than that, else all of the difference.
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
        // One mesh alone: 12 % too high at the worst.
        let alone = found(5000.0, None);
        let [low, high] = alone.interval();
        assert_eq!((alone.voltage, alone.error), (5000.0, None));
        assert!((low - 4400.0).abs() < 1e-9 && (high - 5010.0).abs() < 1e-9);
    }
}
