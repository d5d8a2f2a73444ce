//! Reads measured displacements of a device: fields of points, and one point against the voltage.

use std::path::Path;

use super::columns::{Column, Header, LENGTH, TIME, VOLTAGE};
use super::file::{Coordinates, MeasuredFile, Measurement, Noise, Upward};
use deaflow_base::{Dimension, InputError, Row, Table, TableError};
use deaflow_fit::Sigma;

/// The largest file in bytes.
pub const MOST_BYTES: u64 = 1 << 28;

/// A measured field on the membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The points on the membrane at rest, in mm from its lower left corner; NaN where a row has none.
    pub points_mm: Vec<[f64; 2]>,
    /// The measured displacements in mm along the axes of the membrane.
    pub displacements_mm: Vec<[f64; 2]>,
    /// The standard deviation of each component in mm, if it is known.
    pub sigma_mm: Option<Vec<f64>>,
}

/// A measured displacement of a point against the voltage.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The voltages in V.
    pub voltages_v: Vec<f64>,
    /// The displacements in mm.
    pub displacements_mm: Vec<f64>,
    /// The noise, in mm.
    pub sigma: Sigma,
}

/// Returns a number of a row; NaN if the field is empty, as programs of image correlation leave points without a match.
fn number(row: &Row<'_>, column: Column) -> Result<f64, TableError> {
    match row.field(column.at) {
        "" => Ok(f64::NAN),
        _ => Ok(column.factor * row.number(column.at)?),
    }
}

/// Reads a field; returns too whether it has a column of standard deviations.
///
/// # Errors
/// When it cannot be read, or a column or a unit is missing.
pub fn read_field(path: &Path, file: &MeasuredFile) -> Result<(Field, bool), InputError> {
    const COLUMNS: &str = "a field needs the columns `x_mm`, `y_mm`, `ux_mm` and `uy_mm`, and may have `sigma_mm`; \
                           units are mm, um, cm, m, or px with `scale`";
    let refused = |why: &str| InputError::new(format!("{}: {why}", path.display())).help(COLUMNS);
    let wrong = |error: TableError| refused(&error.to_string());
    let mut table = Table::open(path, MOST_BYTES).map_err(wrong)?;
    let header = Header::new(table.header().map_err(wrong)?);
    let pixel = file.scale.map(|scale| ("px", scale.mm()));
    let units: Vec<(&str, f64)> = LENGTH.iter().copied().chain(pixel).collect();
    let find = |name: &str| {
        header
            .with_unit(name, &units, None)
            .map_err(|why| match why.contains("_px`") {
                true => refused(&format!("{why}; state the size of a pixel, as in `scale: 21.3 um/px`")),
                false => refused(&why),
            })
    };
    let needed = |name: &str| {
        find(name)?.ok_or_else(|| {
            refused(&format!(
                "there is no column `{name}_mm`; the columns are {}",
                header.listed()
            ))
        })
    };
    let columns = [needed("x")?, needed("y")?, needed("ux")?, needed("uy")?];
    let sigma = find("sigma")?;
    let stated = match (&file.sigma, sigma) {
        (Some(noise), None) => Some(length(noise).ok_or_else(|| {
            InputError::new(format!(
                "{}: the standard deviation of a field is a length",
                path.display()
            ))
            .help("write it as in `sigma: 0.005 mm`")
        })?),
        _ => None,
    };
    let to_membrane = Placement::new(file);
    let mut field = Field {
        points_mm: Vec::new(),
        displacements_mm: Vec::new(),
        sigma_mm: (sigma.is_some() || stated.is_some()).then(Vec::new),
    };
    while let Some(row) = table.next_row().map_err(wrong)? {
        let at = |column| number(&row, column).map_err(wrong);
        let (point, u) = ([at(columns[0])?, at(columns[1])?], [at(columns[2])?, at(columns[3])?]);
        let (point, u) = (to_membrane.point(point), to_membrane.vector(u));
        field.points_mm.push(match file.coordinates {
            Coordinates::Reference => point,
            Coordinates::Deformed => [point[0] - u[0], point[1] - u[1]],
        });
        field.displacements_mm.push(u);
        if let Some(all) = &mut field.sigma_mm {
            all.push(match (sigma, stated) {
                (Some(column), _) => at(column)?,
                (None, own) => own.unwrap_or(f64::NAN),
            });
        }
    }
    match field.points_mm.is_empty() {
        true => Err(refused("the file has no rows")),
        false => Ok((field, sigma.is_some())),
    }
}

/// Reads a series; returns too whether it has a column of standard deviations.
///
/// # Errors
/// When it cannot be read, a column or a unit is missing, or a value is not a number.
pub fn read_series(path: &Path, file: &MeasuredFile) -> Result<(Series, bool), InputError> {
    const COLUMNS: &str = "the file needs the columns `voltage_kV` and `displacement_mm`, and may have `sigma_mm`";
    let refused = |why: &str| InputError::new(format!("{}: {why}", path.display())).help(COLUMNS);
    let wrong = |error: TableError| refused(&error.to_string());
    let mut table = Table::open(path, MOST_BYTES).map_err(wrong)?;
    let header = Header::new(table.header().map_err(wrong)?);
    let find = |name: &str, units| header.with_unit(name, units, None).map_err(|why| refused(&why));
    let missing = |name: &str| {
        refused(&format!(
            "there is no column `{name}`; the columns are {}",
            header.listed()
        ))
    };
    let voltage = find("voltage", VOLTAGE)?.ok_or_else(|| missing("voltage_kV"))?;
    let displacement = find("displacement", LENGTH)?.ok_or_else(|| missing("displacement_mm"))?;
    let sigma = find("sigma", LENGTH)?;
    let (mut voltages_v, mut displacements_mm, mut sigmas) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(row) = table.next_row().map_err(wrong)? {
        let at = |column: Column| row.number(column.at).map(|value| value * column.factor).map_err(wrong);
        voltages_v.push(at(voltage)?);
        displacements_mm.push(at(displacement)?);
        if let Some(column) = sigma {
            sigmas.push(at(column)?);
        }
    }
    if voltages_v.is_empty() {
        return Err(refused("the file has no rows"));
    }
    let noise = sigma_of_lengths(path, file, sigma.map(|_| sigmas), voltages_v.len())?;
    let series = Series {
        voltages_v,
        displacements_mm,
        sigma: noise,
    };
    Ok((series, sigma.is_some()))
}

/// Returns the noise of measured lengths, from a column or from the entry of the file.
///
/// # Errors
/// When the entry states neither a share nor a length.
pub(super) fn sigma_of_lengths(
    path: &Path,
    file: &MeasuredFile,
    column: Option<Vec<f64>>,
    rows: usize,
) -> Result<Sigma, InputError> {
    match (column, &file.sigma) {
        (Some(sigmas), _) => Ok(Sigma::Stated(sigmas)),
        (None, None) => Ok(Sigma::UnstatedAbsolute),
        (None, Some(noise)) => match (noise.share(), length(noise)) {
            (Some(share), _) => Ok(Sigma::StatedFraction(share)),
            (None, Some(mm)) => Ok(Sigma::Stated(vec![mm; rows])),
            (None, None) => Err(InputError::new(format!(
                "{}: the standard deviation is a share or a length",
                path.display()
            ))
            .help("write it as in `sigma: 3 %` or `sigma: 0.01 mm`")),
        },
    }
}

/// A measured stretch of a sheet against the voltage in V, or the time in s.
#[derive(Clone, Debug, PartialEq)]
pub struct SheetTable {
    /// The voltages or times.
    pub at: Vec<f64>,
    /// The stretches.
    pub stretch: Vec<f64>,
    /// The noise of the stretches.
    pub sigma: Sigma,
}

/// Reads the stretches of a sheet; returns too whether there is a column of standard deviations.
///
/// # Errors
/// When it cannot be read, a column or a unit is missing, or a value is not a number.
pub fn read_sheet(path: &Path, file: &MeasuredFile) -> Result<(SheetTable, bool), InputError> {
    const COLUMNS: &str = "the file needs the columns `voltage_kV`, or for creep `time_s`, and `stretch`, and may have \
                           `sigma`";
    let refused = |why: &str| InputError::new(format!("{}: {why}", path.display())).help(COLUMNS);
    let wrong = |error: TableError| refused(&error.to_string());
    let mut table = Table::open(path, MOST_BYTES).map_err(wrong)?;
    let header = Header::new(table.header().map_err(wrong)?);
    let find = |name: &str, units| header.with_unit(name, units, None).map_err(|why| refused(&why));
    let plain = |name: &str| header.plain(name).map_err(|why| refused(&why));
    let missing = |name: &str| {
        refused(&format!(
            "there is no column `{name}`; the columns are {}",
            header.listed()
        ))
    };
    let at = match file.test {
        Measurement::Creep => find("time", TIME)?.ok_or_else(|| missing("time_s"))?,
        _ => find("voltage", VOLTAGE)?.ok_or_else(|| missing("voltage_kV"))?,
    };
    let (stretch, sigma) = (plain("stretch")?.ok_or_else(|| missing("stretch"))?, plain("sigma")?);
    let (mut places, mut stretches, mut sigmas) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(row) = table.next_row().map_err(wrong)? {
        places.push(at.factor * row.number(at.at).map_err(wrong)?);
        stretches.push(row.number(stretch).map_err(wrong)?);
        if let Some(column) = sigma {
            sigmas.push(row.number(column).map_err(wrong)?);
        }
    }
    if places.is_empty() {
        return Err(refused("the file has no rows"));
    }
    let noise = match (sigma, &file.sigma) {
        (Some(_), _) => Sigma::Stated(sigmas),
        (None, None) => Sigma::UnstatedAbsolute,
        (None, Some(noise)) => match (noise.share(), noise.quantity(Dimension::Number)) {
            (Some(share), _) => Sigma::StatedFraction(share),
            (None, Some(number)) => Sigma::Stated(vec![number; places.len()]),
            (None, None) => return Err(refused("the standard deviation of stretches is a share or a number")),
        },
    };
    let table = SheetTable {
        at: places,
        stretch: stretches,
        sigma: noise,
    };
    Ok((table, sigma.is_some()))
}

fn length(noise: &Noise) -> Option<f64> {
    noise.quantity(Dimension::Length)
}

/// How coordinates of a table lie on the membrane: mirrored if its y grows downwards, then turned, then moved.
struct Placement {
    origin: [f64; 2],
    /// Cosine and sine of the angle.
    turn: [f64; 2],
    up: f64,
}

impl Placement {
    fn new(file: &MeasuredFile) -> Self {
        let degrees = file.turn.map_or(0.0, |turn| turn.value());
        // Quarters of a turn are exact.
        let (sine, cosine) = match degrees.rem_euclid(360.0) {
            0.0 => (0.0, 1.0),
            90.0 => (1.0, 0.0),
            180.0 => (0.0, -1.0),
            270.0 => (-1.0, 0.0),
            other => other.to_radians().sin_cos(),
        };
        Self {
            origin: file.origin.map_or([0.0; 2], |origin| origin.map(|at| at.value())),
            turn: [cosine, sine],
            up: if file.y == Upward::Up { 1.0 } else { -1.0 },
        }
    }

    fn vector(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let ([cosine, sine], y) = (self.turn, self.up * y);
        [cosine * x - sine * y, sine * x + cosine * y]
    }

    fn point(&self, at: [f64; 2]) -> [f64; 2] {
        let turned = self.vector(at);
        [0, 1].map(|axis| self.origin[axis] + turned[axis])
    }
}
