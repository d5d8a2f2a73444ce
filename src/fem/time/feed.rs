//! The supply of the electrodes of a moving membrane: a voltage, a charge on disconnected electrodes, or a source.
//!
//! The field of conducting electrodes has the energy Q²/2C(u). In a step it changes by the supplied energy and by the
//! work done on the moving membrane,
//!
//! ```text
//! Q₁²/2C₁ − Q₀²/2C₀ = ½(Q₀ + Q₁) ½(1/C₀ + 1/C₁) (Q₁ − Q₀) + ¼(Q₀² + Q₁²) (1/C₁ − 1/C₀)
//! ```
//!
//! where the second term is the work of the mean force of a step at the voltage whose square is ½(Q₀² + Q₁²)/(C₀C₁). So
//! the energies of a step balance to rounding for any rule for the charge.

use super::supply::Supply;
use super::transient::{FixedCharge, TransientProblem};
use crate::operator::Activity;

/// The supply of electrodes.
#[derive(Clone, Copy, Debug)]
pub enum Feed<'a> {
    /// The voltage of the drive.
    Voltage,
    /// Conducting electrodes with a charge.
    Conducting {
        /// The source, if they are connected.
        supply: Option<Supply>,
        /// In C.
        charge: f64,
    },
    /// Sprayed charge that does not move.
    Sprayed {
        /// In C.
        charge: f64,
        /// The membrane without the charge.
        uncharged: &'a Activity,
    },
}

impl<'a> Feed<'a> {
    /// Returns the supply of a transient problem at the start of its drive.
    #[must_use]
    pub fn of<F>(transient: &TransientProblem<'a, F>) -> Self {
        match (transient.held, transient.supply) {
            (
                Some(FixedCharge {
                    charge,
                    uncharged: Some(uncharged),
                }),
                _,
            ) => Self::Sprayed { charge, uncharged },
            (Some(FixedCharge { charge, .. }), _) => Self::Conducting { supply: None, charge },
            (None, Some(supply)) => Self::Conducting {
                supply: Some(supply),
                charge: 0.0,
            },
            (None, None) => Self::Voltage,
        }
    }
}

/// The change of conducting electrodes in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// The squared voltage, in V², whose force does the work of the field on the moving membrane.
    pub square: f64,
    /// The charge at the end in C.
    pub charge: f64,
    /// The work in J that supplies the charge.
    pub work: f64,
}

impl Passage {
    /// Computes the change from one charge in C to another, while the capacitance in F changes; zero without
    /// electrodes.
    #[must_use]
    pub fn new([first, last]: [f64; 2], [before, after]: [f64; 2]) -> Self {
        if before <= 0.0 || after <= 0.0 {
            return Self {
                square: 0.0,
                charge: 0.0,
                work: 0.0,
            };
        }
        Self {
            square: 0.5 * (first * first + last * last) / (before * after),
            charge: last,
            work: 0.25 * (first + last) * (before.recip() + after.recip()) * (last - first),
        }
    }
}

/// Returns the energy in J of a charge in C on a capacitance in F; 0 without electrodes.
#[must_use]
pub fn energy(charge: f64, capacitance: f64) -> f64 {
    match capacitance > 0.0 {
        true => 0.5 * charge * charge / capacitance,
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_energy_of_a_charge_is_balanced_whatever_it_and_the_capacitance_do() {
        for (charges, capacitances) in [
            ([2.0, 2.0], [1.0, 3.0]),
            ([0.0, 4.0], [2.0, 2.0]),
            ([3.0, 1.0], [5.0, 2.0]),
        ] {
            let Passage { square, charge, work } = Passage::new(charges, capacitances);
            let change = energy(charges[1], capacitances[1]) - energy(charges[0], capacitances[0]);
            // A force at a voltage does the work ½V²ΔC.
            let gained = 0.5 * square * (capacitances[1] - capacitances[0]);
            assert!((change - work + gained).abs() < 1e-15, "{charges:?} {capacitances:?}");
            assert_eq!(charge, charges[1]);
        }
        assert_eq!(Passage::new([1.0, 2.0], [0.0, 0.0]).work, 0.0);
        assert_eq!(energy(0.0, 0.0), 0.0);
    }
}
