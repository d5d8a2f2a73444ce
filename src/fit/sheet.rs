//! The stretch of a homogeneous sheet under voltage at equilibrium.

use crate::balance::{Electric, Load, first_balance, squeeze};
use crate::curve::{FitError, Sigma};
use crate::deformation::Test;
use crate::elastomer::{Elastomer, Need, Number, Response};
use crate::law::{Law, LawKind};

/// The stretch of a sheet at voltages: stretched equally along both directions or in pure shear.
#[derive(Clone, Debug, PartialEq)]
pub struct SheetCurve {
    /// The name, such as the file.
    pub name: String,
    /// The law of the elastomer.
    pub law: LawKind,
    /// How the sheet stretches: [`Test::Equibiaxial`] or [`Test::PureShear`].
    pub test: Test,
    /// The load.
    pub load: Load,
    /// The undeformed thickness in m.
    pub thickness_m: f64,
    /// The voltages in V.
    pub voltage_v: Vec<f64>,
    /// The stretches.
    pub stretch: Vec<f64>,
    /// The noise of the stretches; standard deviations are numbers without a unit.
    pub sigma: Sigma,
}

/// Returns the parameters of a sheet under voltage beside those of its elastomer.
pub(crate) fn electric_needs() -> [Need; 2] {
    let need = |name: &str, default| Need {
        name: name.to_owned(),
        default,
    };
    [need("relative_permittivity", None), need("voltage_offset", Some(0.0))]
}

/// Checks the thickness, the load and the way in which a sheet stretches.
///
/// # Errors
/// When one is not possible.
pub(crate) fn check_sheet(set: &str, thickness: f64, load: Load, test: Test, electric: bool) -> Result<(), FitError> {
    let set_name = || set.to_owned();
    if !(thickness.is_finite() && thickness > 0.0) {
        let (what, value) = ("thickness", thickness);
        return Err(FitError::Setting {
            set: set_name(),
            what,
            value,
        });
    }
    if electric && test == Test::Uniaxial {
        return Err(FitError::UniaxialVoltage { set: set_name() });
    }
    load.check(set)
}

/// Checks measured stretches.
///
/// # Errors
/// When one is not positive.
pub(crate) fn check_stretches(set: &str, stretches: &[f64]) -> Result<(), FitError> {
    match stretches.iter().position(|stretch| *stretch <= 0.0) {
        Some(at) => Err(FitError::Stretch {
            curve: set.to_owned(),
            row: at + 1,
            stretch: stretches[at],
        }),
        None => Ok(()),
    }
}

impl SheetCurve {
    /// Checks the sheet.
    ///
    /// # Errors
    /// When a column or a setting is not valid.
    pub(crate) fn response(&self) -> Result<Charged<'_>, FitError> {
        check_sheet(&self.name, self.thickness_m, self.load, self.test, true)?;
        check_stretches(&self.name, &self.stretch)?;
        let (first, second) = ((self.stretch.len(), "stretches"), (self.voltage_v.len(), "voltages"));
        let curve = || self.name.clone();
        if first.0 != second.0 {
            return Err(FitError::Lengths {
                curve: curve(),
                first,
                second,
            });
        }
        if let Some(at) = self.voltage_v.iter().position(|voltage| !voltage.is_finite()) {
            let (row, column) = (at + 1, "voltage");
            return Err(FitError::NotFinite {
                curve: curve(),
                row,
                column,
            });
        }
        Ok(Charged { curve: self })
    }
}

/// A sheet that has been checked.
pub(crate) struct Charged<'a> {
    curve: &'a SheetCurve,
}

impl Charged<'_> {
    /// Returns the stretch at a voltage, with its derivatives: dλ/dp = −∂F/∂p / ∂F/∂λ.
    fn stretch(&self, law: &Law, load: &(f64, Vec<f64>), electric: Electric) -> Option<Number> {
        let SheetCurve { test, load: kind, .. } = *self.curve;
        let excess = |stretch: f64| {
            let (squeeze, squeeze_slope) = squeeze(test, stretch);
            let stress = law.nominal_stress(test, stretch)? - electric.kappa * squeeze - load.0;
            Some((stress, law.slope(test, stretch)? - electric.kappa * squeeze_slope))
        };
        let stretch = first_balance(&excess, kind.rest())?;
        let slope = excess(stretch)?.1;
        let squeeze = squeeze(test, stretch).0;
        let own = law.stress_and_gradient(test, stretch)?.1.into_iter().zip(&load.1);
        let own = own.map(|(stress, load)| stress - load);
        let electric = [electric.by_permittivity, electric.by_voltage].map(|by| -by * squeeze);
        let gradient = own.chain(electric).map(|by| -by / slope).collect();
        (slope > 0.0).then_some((stretch, gradient))
    }
}

impl Response for Charged<'_> {
    fn needs(&self) -> Vec<Need> {
        let mut needs = Need::all(self.curve.law.parameters());
        needs.extend(electric_needs());
        needs
    }

    fn respond(&self, values: &[f64]) -> Option<Vec<Number>> {
        let (law, _) = Elastomer::elastic(self.curve.law).with(values)?;
        let &[.., permittivity, offset] = values else {
            return None;
        };
        let load = self.curve.load.stress(&law, self.curve.test, self.curve.thickness_m)?;
        let voltages = self.curve.voltage_v.iter();
        let electric = voltages.map(|voltage| Electric::new(permittivity, voltage + offset, self.curve.thickness_m));
        electric.map(|electric| self.stretch(&law, &load, electric)).collect()
    }
}
