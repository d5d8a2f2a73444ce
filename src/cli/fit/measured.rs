//! Reads measured curves: tables with the columns `stretch` and `nominal_stress_UNIT`, and for relaxation `time_s`.

use std::path::Path;

use deaflow_base::{InputError, Table, TableError, listed};
use deaflow_fit::{Curve, Relaxation, Sigma, Test};

/// The largest file in bytes.
const MOST_BYTES: u64 = 64 << 20;

/// Units of stress, with their size in Pa.
const UNITS: [(&str, f64); 5] = [("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9), ("N/mm2", 1e6)];

/// What the noise of files without a column of standard deviations is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// Its standard deviation is a share of the stress.
    Share(f64),
    /// Its standard deviation in Pa.
    Stress(f64),
    /// Unknown, in proportion to the stress.
    Relative,
    /// Unknown, the same for all points.
    Absolute,
}

/// A measured curve.
pub enum Measured {
    /// Stresses at stretches.
    Curve(Curve),
    /// Stresses at times after a step to a stretch.
    Relaxation(Relaxation),
}

/// The columns of a file.
struct Columns {
    stretch: (usize, Deformation),
    stress: (usize, f64, bool),
    sigma: Option<(usize, f64)>,
    time: Option<usize>,
}

/// How the deformation is given.
#[derive(Clone, Copy)]
enum Deformation {
    Stretch,
    Strain,
    Percent,
}

impl Deformation {
    fn stretch(self, value: f64) -> f64 {
        match self {
            Self::Stretch => value,
            Self::Strain => 1.0 + value,
            Self::Percent => 1.0 + 0.01 * value,
        }
    }
}

/// Reads a file.
///
/// # Errors
/// When it cannot be read, lacks a column or a unit, or is not of one stretch after a step.
pub fn read(name: &str, test: Test, noise: Noise) -> Result<Measured, InputError> {
    let refused = |why: &str| InputError::new(format!("{name}: {why}")).help(COLUMNS);
    let wrong = |error: TableError| refused(&error.to_string());
    let mut table = Table::open(Path::new(name), MOST_BYTES).map_err(wrong)?;
    let header = table.header().map_err(wrong)?;
    let columns = columns(&header).map_err(|why| refused(&why))?;
    let (mut time_s, mut stretch, mut stress_pa, mut sigma) = (vec![], vec![], vec![], vec![]);
    while let Some(row) = table.next_row().map_err(wrong)? {
        let number = |at: usize| row.number(at).map_err(wrong);
        let (at, strain) = columns.stretch;
        let own = strain.stretch(number(at)?);
        let (at, unit, is_true) = columns.stress;
        // The true stress acts on the area that is left: λ₂λ₃ = 1/λ of it.
        let per_area = if is_true { own } else { 1.0 };
        stress_pa.push(number(at)? * unit / per_area);
        stretch.push(own);
        if let Some((at, unit)) = columns.sigma {
            sigma.push(number(at)? * unit);
        }
        if let Some(at) = columns.time {
            time_s.push(number(at)?);
        }
    }
    let sigma = match (columns.sigma, noise) {
        (Some(_), _) => Sigma::Stated(sigma),
        (None, Noise::Share(share)) => Sigma::StatedFraction(share),
        (None, Noise::Stress(pa)) => Sigma::Stated(vec![pa; stretch.len()]),
        (None, Noise::Relative) => Sigma::UnstatedRelative,
        (None, Noise::Absolute) => Sigma::UnstatedAbsolute,
    };
    let name = name.to_owned();
    if columns.time.is_none() {
        return Ok(Measured::Curve(Curve {
            name,
            test,
            stretch,
            stress_pa,
            sigma,
        }));
    }
    let Some(step) = stretch.first().copied() else {
        return Err(refused("the file has no rows"));
    };
    if let Some(other) = stretch.iter().find(|other| (**other - step).abs() > 1e-6 * step) {
        let why = format!("with `time_s` the stretch is that after a sudden step, but there are {step} and {other}");
        return Err(refused(&why));
    }
    Ok(Measured::Relaxation(Relaxation {
        name,
        test,
        stretch: step,
        time_s,
        stress_pa,
        sigma,
    }))
}

const COLUMNS: &str = "a file needs the columns `stretch` (or `strain`, `strain_%`) and `nominal_stress_kPa` (or \
                       `true_stress_…`; Pa, kPa, MPa, GPa, N/mm2), and may have `sigma_kPa`; with `time_s` it is the \
                       relaxation after a step";

/// Finds the columns in a header.
fn columns(header: &[String]) -> Result<Columns, String> {
    let find = |name: &str| header.iter().position(|own| own.eq_ignore_ascii_case(name));
    let with_unit = |name: &str| -> Result<Option<(usize, f64)>, String> {
        let prefix = format!("{name}_");
        let is_named = |own: &String| {
            own.get(..prefix.len())
                .is_some_and(|start| start.eq_ignore_ascii_case(&prefix))
        };
        let Some(at) = header.iter().position(is_named) else {
            return match find(name) {
                Some(_) => Err(format!("the column `{name}` has no unit")),
                None => Ok(None),
            };
        };
        let unit = &header[at][prefix.len()..];
        match UNITS.iter().find(|(known, _)| *known == unit) {
            Some((_, pa)) => Ok(Some((at, *pa))),
            None => Err(format!("the column `{}` has an unknown unit", header[at])),
        }
    };
    let strains = [
        ("stretch", Deformation::Stretch),
        ("strain", Deformation::Strain),
        ("strain_%", Deformation::Percent),
    ];
    let stretch = strains
        .into_iter()
        .find_map(|(name, strain)| Some((find(name)?, strain)));
    let (nominal, from_true) = (with_unit("nominal_stress")?, with_unit("true_stress")?);
    let stress = match (nominal, from_true) {
        (Some(_), Some(_)) => return Err("the file has two columns of stresses".to_owned()),
        (Some((at, unit)), None) => Some((at, unit, false)),
        (None, Some((at, unit))) => Some((at, unit, true)),
        (None, None) => None,
    };
    let found = || listed(header);
    Ok(Columns {
        stretch: stretch.ok_or_else(|| format!("there is no column `stretch`; the columns are {}", found()))?,
        stress: stress
            .ok_or_else(|| format!("there is no column `nominal_stress_kPa`; the columns are {}", found()))?,
        sigma: with_unit("sigma")?,
        time: find("time_s"),
    })
}
