//! Reads measured curves: tables with the columns `stretch` and `nominal_stress_UNIT`, and for relaxation `time_s`.

use std::path::Path;

use super::columns::{Column, Header, STRESS};
use deaflow_base::{InputError, Table, TableError};
use deaflow_fit::{Curve, Elastomer, HistoryCurve, LawKind, Sigma, Test};

/// The largest file in bytes.
const MOST_BYTES: u64 = 64 << 20;

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
    /// Stresses along a history of stretch, such as a sudden step; the law of the elastomer is a placeholder.
    History(HistoryCurve),
}

/// The columns of a file.
struct Columns {
    stretch: (usize, Deformation),
    /// The column, and whether it has true stresses.
    stress: (Column, bool),
    sigma: Option<Column>,
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
            Self::Percent => 1.0 + value / 100.0,
        }
    }
}

/// Reads a file; returns too whether it has a column of standard deviations.
///
/// # Errors
/// When it cannot be read, lacks a column or a unit, or its times fall.
pub fn read(name: &str, test: Test, noise: Noise) -> Result<(Measured, bool), InputError> {
    let refused = |why: &str| InputError::new(format!("{name}: {why}")).help(COLUMNS);
    let wrong = |error: TableError| refused(&error.to_string());
    let mut table = Table::open(Path::new(name), MOST_BYTES).map_err(wrong)?;
    let header = Header::new(table.header().map_err(wrong)?);
    let columns = columns(&header).map_err(|why| refused(&why))?;
    let (mut time_s, mut stretch, mut stress_pa, mut sigma) = (vec![], vec![], vec![], vec![]);
    while let Some(row) = table.next_row().map_err(wrong)? {
        let number = |at: usize| row.number(at).map_err(wrong);
        let (at, strain) = columns.stretch;
        let own = strain.stretch(number(at)?);
        let (column, is_true) = columns.stress;
        // The true stress acts on the area that is left: λ₂λ₃ = 1/λ of it.
        let per_area = if is_true { own } else { 1.0 };
        stress_pa.push(number(column.at)? * column.factor / per_area);
        stretch.push(own);
        if let Some(column) = columns.sigma {
            sigma.push(number(column.at)? * column.factor);
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
        let curve = Curve {
            name,
            test,
            stretch,
            stress_pa,
            sigma,
        };
        return Ok((Measured::Curve(curve), columns.sigma.is_some()));
    }
    if stretch.is_empty() {
        return Err(refused("the file has no rows"));
    }
    if let Some(row) = (1..time_s.len()).find(|row| time_s[*row] < time_s[*row - 1]) {
        return Err(refused(&format!(
            "row {}: the time is before that of the row above",
            row + 1
        )));
    }
    let history = history(&name, test, (time_s, stretch), stress_pa, sigma);
    Ok((Measured::History(history), columns.sigma.is_some()))
}

/// Returns stresses along the stretches of a specimen that is at rest until time 0: a sudden step if all stretches are
/// equal.
pub(super) fn history(
    name: &str,
    test: Test,
    (time_s, stretch): (Vec<f64>, Vec<f64>),
    stress_pa: Vec<f64>,
    sigma: Sigma,
) -> HistoryCurve {
    let first = stretch.first().copied().unwrap_or(1.0);
    let history = match stretch.iter().all(|other| (other - first).abs() <= 1e-6 * first) {
        true => vec![(0.0, 1.0), (0.0, first)],
        false => std::iter::once((0.0, 1.0))
            .chain(time_s.iter().copied().zip(stretch))
            .collect(),
    };
    HistoryCurve {
        name: name.to_owned(),
        elastomer: Elastomer::elastic(LawKind::NeoHookean),
        test,
        history,
        time_s,
        stress_pa,
        sigma,
    }
}

const COLUMNS: &str = "a file needs the columns `stretch` (or `strain`, `strain_%`) and `nominal_stress_kPa` (or \
                       `true_stress_…`; Pa, kPa, MPa, GPa, N/mm2), and may have `sigma_kPa`; with `time_s` it is the \
                       stress along that history of stretch, after a sudden step if all stretches are equal";

/// Finds the columns in a header.
fn columns(header: &Header) -> Result<Columns, String> {
    let strains = [
        ("stretch", Deformation::Stretch),
        ("strain", Deformation::Strain),
        ("strain_%", Deformation::Percent),
    ];
    let mut stretch = None;
    for (name, strain) in strains {
        if let (None, Some(at)) = (stretch, header.plain(name)?) {
            stretch = Some((at, strain));
        }
    }
    let stress = |name| header.with_unit(name, STRESS, None);
    let stress = match (stress("nominal_stress")?, stress("true_stress")?) {
        (Some(_), Some(_)) => return Err("the file has two columns of stresses".to_owned()),
        (Some(column), None) => Some((column, false)),
        (None, Some(column)) => Some((column, true)),
        (None, None) => None,
    };
    let missing = |name: &str| format!("there is no column `{name}`; the columns are {}", header.listed());
    Ok(Columns {
        stretch: stretch.ok_or_else(|| missing("stretch"))?,
        stress: stress.ok_or_else(|| missing("nominal_stress_kPa"))?,
        sigma: header.with_unit("sigma", STRESS, None)?,
        time: header.plain("time_s")?,
    })
}
