//! Files of measurements as they were read, before they are placed on a device.

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::curve::{self, Measured};
use super::field::{Field, Series, SheetTable, read_field, read_series, read_sheet};
use super::file::{MeasuredFile, Measurement, Sheet, path_of};
use super::motion::{History, Response, read_history, read_response};
use crate::direct;
use deaflow_base::{InputError, Node, words};
use deaflow_fit::{Curve, HistoryCurve, Load, Sigma, Test};
use deaflow_pattern::{DrawingOptions, Edges, Pattern, PatternForm, form_of};

/// A file of measurements.
#[derive(Clone, Debug)]
pub struct MeasuredTable {
    /// Its name.
    pub name: String,
    /// What was measured.
    pub test: Measurement,
    /// What else is known about it.
    pub settings: Settings,
    /// The numbers.
    pub rows: Rows,
    /// The pattern of electrodes of a device.
    pub pattern: Option<Pattern>,
    /// Where its standard deviations are from; `None` in artifacts, which do not say it.
    pub sigma_source: Option<SigmaSource>,
    /// What the reader did that a user should know.
    pub notes: Vec<String>,
}

words! {
    /// Where standard deviations are from.
    pub enum SigmaSource {
        /// A column of the file.
        Column = "column",
        /// The key `sigma` of its entry.
        Entry = "entry",
        /// The noise of all files without one of their own.
        Usual = "usual",
        /// Nowhere: they are not known.
        Unknown = "unknown",
    }
}

/// Returns notes on a file with its name.
#[must_use]
pub fn named_notes(name: &str, notes: &[String]) -> Vec<String> {
    notes.iter().map(|note| format!("{name}: {note}")).collect()
}

/// The numbers of a file.
#[derive(Clone, Debug)]
pub enum Rows {
    /// Stresses against stretches.
    Curve(Curve),
    /// Stresses along a history of stretch.
    History(HistoryCurve),
    /// Stretches of a sheet against voltages or times.
    Sheet(SheetTable),
    /// Displacements of many points of a device.
    Field(Field),
    /// The displacement of a point of a device against the voltage.
    Series(Series),
    /// The displacement of a point of a device over time.
    Motion(History),
    /// The response of a point of a device to a small alternating voltage.
    Response(Response),
}

/// What is known about a file besides its numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// How a sheet stretches.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    sheet: Option<String>,
    /// The nominal stress of a dead load.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    load_pa: Option<f64>,
    /// The force of a dead load.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    force_n: Option<f64>,
    /// The undeformed width on which it acts.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    width_mm: Option<f64>,
    /// The voltage of a field, of creep or of a waveform, or the bias of a frequency response.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub voltage_v: Option<f64>,
    /// The amplitude of the alternating voltage of a frequency response.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub alternating_v: Option<f64>,
    /// The point of a device whose displacement was measured.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub point_mm: Option<[f64; 2]>,
    /// The direction in which it was measured, from the x axis anticlockwise.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub direction_deg: Option<f64>,
    /// The distance over which the noise of a field is correlated at most.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub correlated_within_mm: Option<f64>,
}

impl Settings {
    fn of(file: &MeasuredFile) -> Self {
        let is_sheet = matches!(file.test, Measurement::VoltageStretch | Measurement::Creep);
        Self {
            sheet: is_sheet.then(|| file.sheet.name().to_owned()),
            load_pa: file.load.map(|load| load.value()),
            force_n: file.force.map(|force| force.value()),
            width_mm: file.width.map(|width| width.value()),
            voltage_v: file.voltage.map(|voltage| voltage.value()),
            alternating_v: file.alternating.map(|voltage| voltage.value()),
            point_mm: file.point.map(|point| point.map(|at| at.value())),
            direction_deg: file.direction.map(|direction| direction.value()),
            correlated_within_mm: file.correlated_within.map(|within| within.value()),
        }
    }

    /// Returns the direction in which the displacement of a point was measured; along x if it is not given.
    #[must_use]
    pub fn direction(&self) -> [f64; 2] {
        let radians = self.direction_deg.unwrap_or(0.0).to_radians();
        [radians.cos(), radians.sin()]
    }

    /// Returns how a sheet stretches.
    #[must_use]
    pub fn sheet(&self) -> Test {
        let sheet = self.sheet.as_deref().and_then(Sheet::from_name);
        sheet.unwrap_or(Sheet::Equibiaxial).test()
    }

    /// Returns the load of a sheet that is held at a prestretch without a given one.
    #[must_use]
    pub fn sheet_load(&self, prestretch: f64) -> Load {
        match (self.load_pa, self.force_n, self.width_mm) {
            (Some(stress), ..) => Load::Stress(stress),
            (None, Some(force_n), Some(width_mm)) => Load::Force {
                force_n,
                width_m: 1e-3 * width_mm,
            },
            _ => Load::Prestretch(prestretch),
        }
    }
}

impl MeasuredTable {
    /// Reads a file of an entry, whose pattern has the form of a scene, or without one that of its file. Stresses without
    /// a stated noise have the `usual` one.
    ///
    /// # Errors
    /// If it or its pattern cannot be read.
    pub fn read(
        file: &MeasuredFile,
        node: &Node,
        form: Option<PatternForm>,
        usual: curve::Noise,
    ) -> Result<Self, InputError> {
        let path = path_of(node, file.file());
        let of_specimen = file.test.of_specimen();
        let (rows, has_column) = match file.test {
            Measurement::Uniaxial | Measurement::Equibiaxial | Measurement::PureShear => {
                let noise = file.noise_of_stress()?.unwrap_or(usual);
                match curve::read(&path.to_string_lossy(), of_specimen.unwrap_or(Test::Uniaxial), noise)? {
                    (Measured::Curve(curve), has_column) => (Rows::Curve(curve), has_column),
                    (Measured::History(curve), has_column) => (Rows::History(curve), has_column),
                }
            }
            Measurement::VoltageStretch | Measurement::Creep => with_rows(read_sheet(&path, file)?, Rows::Sheet),
            Measurement::Field => with_rows(read_field(&path, file)?, Rows::Field),
            Measurement::VoltageDisplacement => with_rows(read_series(&path, file)?, Rows::Series),
            Measurement::TimeDisplacement => with_rows(read_history(&path, file)?, Rows::Motion),
            Measurement::FrequencyResponse => with_rows(read_response(&path, file)?, Rows::Response),
        };
        let is_usual = of_specimen.is_some() && matches!(usual, curve::Noise::Share(_) | curve::Noise::Stress(_));
        let sigma_source = match (has_column, &file.sigma) {
            (true, _) => SigmaSource::Column,
            (false, Some(_)) => SigmaSource::Entry,
            (false, None) if is_usual => SigmaSource::Usual,
            (false, None) => SigmaSource::Unknown,
        };
        let (pattern, notes) = match file.pattern() {
            Some(_) => {
                let (pattern, notes) = one_pattern(file, node, form)?;
                (Some(pattern), notes)
            }
            None => (None, Vec::new()),
        };
        let mut table = Self {
            name: file.file().to_owned(),
            test: file.test,
            settings: Settings::of(file),
            rows,
            pattern,
            sigma_source: Some(sigma_source),
            notes,
        };
        table.check().map_err(|error| node.place(error))?;
        Ok(table)
    }

    /// Checks the numbers. Rows of a field may be empty, and are counted.
    fn check(&mut self) -> Result<(), InputError> {
        let refused = |why: String| InputError::new(format!("{}: {why}", self.name));
        let (all, rows) = (self.count(), self.finite_rows());
        if all == 0 {
            return Err(refused("the file has no rows".to_owned()));
        }
        if let Rows::Field(_) = self.rows {
            return match all - rows.len() {
                0 => Ok(()),
                empty if empty == all => Err(refused("no row has numbers".to_owned())),
                empty => {
                    let note = format!("{empty} of {all} rows have no numbers, and are not used");
                    self.notes.push(note);
                    Ok(())
                }
            };
        }
        let lost = (1..=all).find(|number| rows.iter().all(|row| row.number != *number));
        if let Some(number) = lost {
            return Err(refused(format!("row {number}: a number is not finite")));
        }
        let has_stretch = matches!(self.rows, Rows::Curve(_) | Rows::History(_) | Rows::Sheet(_));
        if let Some(row) = rows.iter().find(|row| has_stretch && row.stretch <= 0.0) {
            let (number, stretch) = (row.number, row.stretch);
            return Err(refused(format!("row {number}: the stretch {stretch} is not positive")));
        }
        let (_, _, sigma) = self.noise();
        let wrong = sigma
            .into_iter()
            .flatten()
            .position(|sigma| !(*sigma > 0.0 && sigma.is_finite()));
        match wrong {
            Some(at) => Err(refused(format!(
                "row {}: the standard deviation is not positive",
                at + 1
            ))),
            None => Ok(()),
        }
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn count(&self) -> usize {
        match &self.rows {
            Rows::Curve(curve) => curve.stretch.len(),
            Rows::History(curve) => curve.time_s.len(),
            Rows::Sheet(table) => table.at.len(),
            Rows::Series(series) => series.voltages_v.len(),
            Rows::Field(field) => field.points_mm.len(),
            Rows::Motion(history) => history.times_s.len(),
            Rows::Response(response) => response.frequencies_hz.len(),
        }
    }

    /// Reads the files of entries, as [`MeasuredTable::read`].
    ///
    /// # Errors
    /// If one cannot be read, or is listed twice.
    pub fn read_all(
        files: &[(MeasuredFile, Node)],
        form: Option<PatternForm>,
        usual: curve::Noise,
    ) -> Result<Vec<Self>, InputError> {
        let mut seen = BTreeSet::new();
        let found = |path: PathBuf| path.canonicalize().unwrap_or(path);
        let once = |(file, node): &(MeasuredFile, Node)| match seen.insert(found(path_of(node, file.file()))) {
            true => Self::read(file, node, form, usual),
            false => Err(node
                .error(format!("the file {} is listed twice", file.file()))
                .help("remove one")),
        };
        files.iter().map(once).collect()
    }

    /// Returns the curve or history of a specimen; `None` for others.
    #[must_use]
    pub fn of_specimen(&self) -> Option<Measured> {
        match &self.rows {
            Rows::Curve(curve) => Some(Measured::Curve(curve.clone())),
            Rows::History(curve) => Some(Measured::History(curve.clone())),
            Rows::Sheet(_) | Rows::Field(_) | Rows::Series(_) | Rows::Motion(_) | Rows::Response(_) => None,
        }
    }
}

fn with_rows<T>((numbers, has_column): (T, bool), rows: fn(T) -> Rows) -> (Rows, bool) {
    (rows(numbers), has_column)
}

/// What a user should know about a drawn pattern on cells.
const CELLS_FOR_SHAPES: &str = "elements follow cells in place of the drawn edges, and the intervals of a fit do not \
                                contain the error of that: add `edges: fitted` to the file";

fn one_pattern(
    file: &MeasuredFile,
    node: &Node,
    form: Option<PatternForm>,
) -> Result<(Pattern, Vec<String>), InputError> {
    let named = path_of(node, file.pattern().unwrap_or_default());
    let argument = named.to_string_lossy().into_owned();
    let form = form.map_or_else(|| form_of(&argument), Ok)?;
    let drawings = DrawingOptions {
        edges: file.edges,
        ..DrawingOptions::default()
    };
    let mut found = direct::patterns(&[argument], form, &drawings)?;
    if found.drawings != found.patterns && file.edges == Edges::Cells {
        found.notes.push(CELLS_FOR_SHAPES.to_owned());
    }
    match (found.patterns.pop(), found.patterns.is_empty()) {
        (Some(pattern), true) => Ok((pattern, found.notes)),
        _ => Err(node
            .peek("pattern")
            .unwrap_or(node)
            .error("the file has several patterns")
            .help("name one, as in `pattern: mine.npy[3]`")),
    }
}

/// How the noise of a file is known, as artifacts name it.
pub(super) const STATED: &str = "stated";
pub(super) const SHARE: &str = "share";
pub(super) const RELATIVE: &str = "relative";
pub(super) const ABSOLUTE: &str = "absolute";

/// The numbers of one row.
#[derive(Clone, Copy, Default)]
pub(super) struct Row {
    pub number: usize,
    pub time: f64,
    pub voltage: f64,
    pub stretch: f64,
    pub stress: f64,
    pub position: [f64; 2],
    pub displacement: [f64; 2],
    pub frequency: f64,
    pub phase: f64,
}

impl MeasuredTable {
    /// Returns the rows with finite numbers.
    pub(super) fn finite_rows(&self) -> Vec<Row> {
        let pairs = |x: &[f64], y: &[f64], row: &dyn Fn(f64, f64) -> Row| -> Vec<Row> {
            x.iter().zip(y).map(|(x, y)| row(*x, *y)).collect()
        };
        let rows: Vec<Row> = match &self.rows {
            Rows::Curve(curve) => pairs(&curve.stretch, &curve.stress_pa, &|stretch, stress| Row {
                stretch,
                stress,
                ..Row::default()
            }),
            Rows::History(curve) => {
                let mut rows = pairs(&curve.time_s, &curve.stress_pa, &|time, stress| Row {
                    time,
                    stress,
                    ..Row::default()
                });
                // A step is written as two points at time 0, a history as one before that of each row.
                let is_step = curve.history.len() != rows.len() + 1;
                for (at, row) in rows.iter_mut().enumerate() {
                    let point = curve.history.get(if is_step { 1 } else { at + 1 });
                    row.stretch = point.map_or(1.0, |(_, stretch)| *stretch);
                }
                rows
            }
            Rows::Sheet(table) => pairs(&table.at, &table.stretch, &|at, stretch| match self.test {
                Measurement::Creep => Row {
                    time: at,
                    stretch,
                    ..Row::default()
                },
                _ => Row {
                    voltage: at,
                    stretch,
                    ..Row::default()
                },
            }),
            Rows::Series(series) => pairs(&series.voltages_v, &series.displacements_mm, &|voltage, u| Row {
                voltage,
                displacement: [u, 0.0],
                ..Row::default()
            }),
            Rows::Motion(history) => {
                let mut rows = pairs(&history.times_s, &history.displacements_mm, &|time, u| Row {
                    time,
                    displacement: [u, 0.0],
                    ..Row::default()
                });
                for (row, voltage) in rows.iter_mut().zip(history.voltages_v.iter().flatten()) {
                    row.voltage = *voltage;
                }
                rows
            }
            Rows::Response(response) => {
                let pair = &|frequency, amplitude| Row {
                    frequency,
                    displacement: [amplitude, 0.0],
                    ..Row::default()
                };
                let mut rows = pairs(&response.frequencies_hz, &response.amplitudes_mm, pair);
                for (row, phase) in rows.iter_mut().zip(response.phases_deg.iter().flatten()) {
                    row.phase = *phase;
                }
                rows
            }
            Rows::Field(field) => {
                let pairs = field.points_mm.iter().zip(&field.displacements_mm);
                let row = |(position, displacement): (&[f64; 2], &[f64; 2])| Row {
                    position: *position,
                    displacement: *displacement,
                    ..Row::default()
                };
                pairs.map(row).collect()
            }
        };
        let numbered = rows
            .into_iter()
            .enumerate()
            .map(|(at, row)| Row { number: at + 1, ..row });
        let is_finite = |row: &Row| {
            let numbers = [row.time, row.voltage, row.stretch, row.stress, row.frequency, row.phase];
            let all = numbers.iter().chain(&row.position).chain(&row.displacement);
            all.into_iter().all(|number| number.is_finite())
        };
        numbered.filter(is_finite).collect()
    }

    /// Returns the noise by name, the share, and the standard deviation of each row of the file.
    pub(super) fn noise(&self) -> (&'static str, f64, Option<&[f64]>) {
        let sigma = match &self.rows {
            Rows::Curve(curve) => &curve.sigma,
            Rows::History(curve) => &curve.sigma,
            Rows::Sheet(table) => &table.sigma,
            Rows::Series(series) => &series.sigma,
            Rows::Motion(history) => &history.sigma,
            Rows::Response(response) => &response.sigma,
            Rows::Field(field) => {
                return match &field.sigma_mm {
                    Some(sigma) => (STATED, 0.0, Some(sigma)),
                    None => (ABSOLUTE, 0.0, None),
                };
            }
        };
        match sigma {
            Sigma::Stated(sigma) => (STATED, 0.0, Some(sigma)),
            Sigma::StatedFraction(share) => (SHARE, *share, None),
            Sigma::UnstatedRelative => (RELATIVE, 0.0, None),
            Sigma::UnstatedAbsolute => (ABSOLUTE, 0.0, None),
        }
    }
}
