//! Reads measured motions of a point of a device: its displacement over time, and its frequency response.

use std::path::Path;

use super::columns::{Column, FREQUENCY, Header, LENGTH, PHASE, TIME, Units, VOLTAGE};
use super::field::{MOST_BYTES, sigma_of_lengths};
use super::file::MeasuredFile;
use deaflow_base::{InputError, Table, TableError};
use deaflow_fit::Sigma;

/// A measured displacement of a point over time.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// The times in s.
    pub times_s: Vec<f64>,
    /// The voltage in V at each time, between which it is linear, if it was measured.
    pub voltages_v: Option<Vec<f64>>,
    /// The displacements in mm.
    pub displacements_mm: Vec<f64>,
    /// The noise, in mm.
    pub sigma: Sigma,
}

/// A measured response of a point to a small alternating voltage.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// The frequencies in Hz.
    pub frequencies_hz: Vec<f64>,
    /// The amplitudes in mm.
    pub amplitudes_mm: Vec<f64>,
    /// The phases relative to the voltage in degrees, if they were measured; a lag is negative.
    pub phases_deg: Option<Vec<f64>>,
    /// The noise of the amplitudes, in mm.
    pub sigma: Sigma,
}

/// Numbers of columns, in base units.
struct Columns {
    /// Of the needed columns.
    needed: [Vec<f64>; 2],
    /// Of the column that a file may have.
    possible: Option<Vec<f64>>,
    sigma: Option<Vec<f64>>,
}

/// Reads two needed columns, one that a file may have, and standard deviations, which are lengths.
fn read(path: &Path, needed: [(&str, Units<'_>); 2], possible: (&str, Units<'_>)) -> Result<Columns, InputError> {
    let written = |(name, units): (&str, Units<'_>)| format!("`{name}_{}`", units[0].0);
    let help = format!(
        "the file needs the columns {} and {}, and may have {} and `sigma_mm`",
        written(needed[0]),
        written(needed[1]),
        written(possible)
    );
    let refused = |why: &str| InputError::new(format!("{}: {why}", path.display())).help(help.as_str());
    let wrong = |error: TableError| refused(&error.to_string());
    let mut table = Table::open(path, MOST_BYTES).map_err(wrong)?;
    let header = Header::new(table.header().map_err(wrong)?);
    let find = |(name, units)| header.with_unit(name, units, None).map_err(|why| refused(&why));
    let column = |named| {
        let missing = || {
            let (name, listed) = (written(named), header.listed());
            refused(&format!("there is no column {name}; the columns are {listed}"))
        };
        find(named)?.ok_or_else(missing)
    };
    let [first, second] = [column(needed[0])?, column(needed[1])?];
    let mut all: Vec<(Column, Vec<f64>)> = vec![(first, Vec::new()), (second, Vec::new())];
    let optional = [find(possible)?, find(("sigma", LENGTH))?];
    all.extend(optional.into_iter().flatten().map(|column| (column, Vec::new())));
    while let Some(row) = table.next_row().map_err(wrong)? {
        for (column, numbers) in &mut all {
            numbers.push(column.factor * row.number(column.at).map_err(wrong)?);
        }
    }
    if all[0].1.is_empty() {
        return Err(refused("the file has no rows"));
    }
    let mut numbers = all.into_iter().map(|(_, numbers)| numbers);
    let mut next = || numbers.next().unwrap_or_default();
    Ok(Columns {
        needed: [next(), next()],
        possible: optional[0].is_some().then(&mut next),
        sigma: optional[1].is_some().then(&mut next),
    })
}

/// Reads a displacement over time; returns too whether it has a column of standard deviations.
///
/// # Errors
/// When it cannot be read, a column or a unit is missing, or the times are negative or do not increase.
pub fn read_history(path: &Path, file: &MeasuredFile) -> Result<(History, bool), InputError> {
    let Columns {
        needed: [times_s, displacements_mm],
        possible: voltages_v,
        sigma,
    } = read(path, [("time", TIME), ("displacement", LENGTH)], ("voltage", VOLTAGE))?;
    let refused = |why: &str| InputError::new(format!("{}: {why}", path.display()));
    if let Some(row) = times_s.iter().position(|time| *time < 0.0) {
        return Err(refused(&format!("row {}: the time is negative", row + 1))
            .help("the membrane is at rest, without a voltage, until time 0"));
    }
    if let Some(row) = (1..times_s.len()).find(|row| times_s[*row] <= times_s[*row - 1]) {
        return Err(refused(&format!(
            "row {}: the time is not after that of the row above",
            row + 1
        )));
    }
    if let (Some(_), Some(_)) = (&voltages_v, file.voltage) {
        return Err(refused("the file has a column of voltages, and its entry has a `voltage` too").help("remove one"));
    }
    let has_column = sigma.is_some();
    let sigma = sigma_of_lengths(path, file, sigma, times_s.len())?;
    let history = History {
        times_s,
        voltages_v,
        displacements_mm,
        sigma,
    };
    Ok((history, has_column))
}

/// Reads a frequency response; returns too whether it has a column of standard deviations.
///
/// # Errors
/// When it cannot be read, a column or a unit is missing, or a frequency or an amplitude is not positive.
pub fn read_response(path: &Path, file: &MeasuredFile) -> Result<(Response, bool), InputError> {
    let Columns {
        needed: [frequencies_hz, amplitudes_mm],
        possible: phases_deg,
        sigma,
    } = read(
        path,
        [("frequency", FREQUENCY), ("amplitude", LENGTH)],
        ("phase", PHASE),
    )?;
    for (name, numbers) in [("frequency", &frequencies_hz), ("amplitude", &amplitudes_mm)] {
        if let Some(row) = numbers.iter().position(|number| *number <= 0.0) {
            let why = format!("{}: row {}: the {name} is not positive", path.display(), row + 1);
            return Err(InputError::new(why));
        }
    }
    let has_column = sigma.is_some();
    let sigma = sigma_of_lengths(path, file, sigma, frequencies_hz.len())?;
    let response = Response {
        frequencies_hz,
        amplitudes_mm,
        phases_deg,
        sigma,
    };
    Ok((response, has_column))
}
