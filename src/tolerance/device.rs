//! The scene and the pattern of one device.

use deaflow_base::{Decimal, Length, Stress, words};
use deaflow_pattern::MaskOffsets;
use deaflow_scene::{Distribution, Scene, Spread, Tolerances};

use crate::error::ToleranceError;

/// Number of normally distributed deviations of a device.
pub(crate) const SOURCES: usize = Source::ALL.len();

words! {
    /// A cause of differences between devices.
    pub enum Source {
        /// The voltage.
        Voltage = "voltage",
        /// The shear modulus.
        ShearModulus = "shear_modulus",
        /// The thickness.
        Thickness = "thickness",
        /// The permittivity.
        Permittivity = "permittivity",
        /// The prestretch.
        Prestretch = "prestretch",
        /// The width of electrodes.
        Mask = "mask",
        /// Where the upper electrode lies, along x.
        MisregistrationX = "misregistration_x",
        /// The same along y.
        MisregistrationY = "misregistration_y",
    }
}

impl Source {
    /// Returns its name in a sentence.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Voltage => "voltage",
            Self::ShearModulus => "shear modulus",
            Self::Thickness => "thickness",
            Self::Permittivity => "permittivity",
            Self::Prestretch => "prestretch",
            Self::Mask => "mask",
            Self::MisregistrationX => "misregistration along x",
            Self::MisregistrationY => "misregistration along y",
        }
    }

    /// Returns by what devices differ under tolerances, besides lost cells.
    #[must_use]
    pub fn varying(tolerances: &Tolerances) -> Vec<Self> {
        let all = Self::ALL.into_iter();
        all.filter(|source| source.varies(tolerances)).collect()
    }

    /// Returns whether devices differ by it.
    pub(crate) fn varies(self, tolerances: &Tolerances) -> bool {
        let factor = |spread: &Option<Spread>| spread.as_ref().is_some_and(|spread| spread.0.relative.to_f64() > 0.0);
        let shift = |axis: usize| {
            let both = tolerances.misregistration.as_ref();
            both.is_some_and(|both| both.0[axis].value() > 0.0)
        };
        match self {
            Self::Voltage => factor(&tolerances.voltage),
            Self::ShearModulus => factor(&tolerances.shear_modulus),
            Self::Thickness => factor(&tolerances.thickness),
            Self::Permittivity => factor(&tolerances.permittivity),
            Self::Prestretch => factor(&tolerances.prestretch),
            Self::Mask => tolerances.mask.is_some_and(|mask| mask.value() > 0.0),
            Self::MisregistrationX => shift(0),
            Self::MisregistrationY => shift(1),
        }
    }
}

/// Returns the factor of a quantity at a deviation.
fn factor(spread: Option<&Spread>, deviation: f64) -> f64 {
    let Some(Spread(factor)) = spread else {
        return 1.0;
    };
    let sigma = factor.relative.to_f64();
    match factor.distribution {
        Distribution::Normal => 1.0 + sigma * deviation,
        Distribution::Lognormal => {
            let variance = (sigma * sigma).ln_1p();
            (variance.sqrt() * deviation - 0.5 * variance).exp()
        }
    }
}

/// Returns the standard deviation of the [drive] of devices.
pub(crate) fn deviation_of_drive(tolerances: &Tolerances) -> f64 {
    let of = |spread: &Option<Spread>| spread.as_ref().map_or(0.0, |Spread(factor)| factor.relative.to_f64());
    let squares = [&tolerances.voltage, &tolerances.thickness, &tolerances.prestretch].map(of);
    let others = [&tolerances.shear_modulus, &tolerances.permittivity].map(of);
    let squares = squares.into_iter().map(|deviation| 2.0 * deviation);
    squares
        .chain(others)
        .map(|deviation| deviation.powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Returns the logarithm of the electrostatic stress V²ε λ²/H² of the membrane in units of its shear modulus μ. On one
/// mesh, the displacements of a pattern depend on little else.
pub(crate) fn drive(scene: &Scene) -> f64 {
    let field = scene.voltage_v() * scene.mean_prestretch() / scene.thickness_mm();
    (field.powi(2) * scene.permittivity() / scene.shear_modulus_pa()).ln()
}

/// Refuses tolerances that a scene does not allow.
pub(crate) fn check(scene: &Scene, tolerances: &Tolerances) -> Result<(), ToleranceError> {
    let refused = |tolerance, with| Err(ToleranceError::Setting { tolerance, with });
    if scene.drive.charge.is_some() && Source::Voltage.varies(tolerances) {
        return refused("voltage", "a `charge`");
    }
    let law = scene.effects.strain_stiffening.as_ref();
    if law.is_some_and(|law| law.law().has_moduli()) && Source::ShearModulus.varies(tolerances) {
        return refused("shear_modulus", "a law that has moduli of its own");
    }
    Ok(())
}

/// Returns the scene of a device; `None` if its membrane is slack, or a number is not finite.
pub(crate) fn scene(scene: &Scene, tolerances: &Tolerances, deviations: &[f64; SOURCES]) -> Option<Scene> {
    let [voltage, modulus, thickness, permittivity, prestretch, ..] = *deviations;
    let varies = |source: Source| source.varies(tolerances);
    let mut device = scene.clone();
    if varies(Source::Voltage) {
        device = scene.at_voltage(scene.voltage_v() * factor(tolerances.voltage.as_ref(), voltage));
    }
    if varies(Source::ShearModulus) {
        let factor = factor(tolerances.shear_modulus.as_ref(), modulus);
        device.material.shear_modulus = Stress::from_f64(scene.material.shear_modulus.value() * factor)?;
    }
    if varies(Source::Permittivity) {
        let factor = factor(tolerances.permittivity.as_ref(), permittivity);
        let value = scene.material.relative_permittivity.to_f64() * factor;
        device.material.relative_permittivity = Decimal::from_f64(value)?;
    }
    if varies(Source::Thickness) {
        let factor = factor(tolerances.thickness.as_ref(), thickness);
        device.geometry.thickness = Length::from_f64(scene.geometry.thickness.value() * factor)?;
    }
    if varies(Source::Prestretch) {
        let factor = factor(tolerances.prestretch.as_ref(), prestretch);
        for axis in 0..2 {
            let value = scene.geometry.prestretch.0[axis].to_f64() * factor;
            // Below 1 the membrane is slack on its frame.
            if value < 1.0 {
                return None;
            }
            device.geometry.prestretch.0[axis] = Decimal::from_f64(value)?;
        }
    }
    Some(device)
}

/// Returns how the electrodes of a device differ from those drawn.
pub(crate) fn offsets(tolerances: &Tolerances, deviations: &[f64; SOURCES]) -> MaskOffsets {
    let [.., deviation, x, y] = *deviations;
    let shift = |axis: usize, deviation: f64| {
        let both = tolerances.misregistration.as_ref();
        both.map_or(0.0, |both| both.0[axis].value() * deviation)
    };
    MaskOffsets {
        wider_mm: tolerances.mask.map_or(0.0, |mask| mask.value() * deviation),
        shift_mm: [shift(0, x), shift(1, y)],
    }
}
