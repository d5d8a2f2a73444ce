//! Files of measurements as they were read, before they are placed on a device: what a `measure` stage stores.

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::curve::{self, Measured, history};
use super::field::{Field, Series, SheetTable, read_field, read_series, read_sheet};
use super::file::{MeasuredFile, Measurement, Sheet, path_of};
use crate::direct;
use deaflow_base::{InputError, Node};
use deaflow_content::{LongTexts, MeasuredFiles, MeasuredRows, Measurements};
use deaflow_fit::{Curve, HistoryCurve, Load, Sigma, Test};
use deaflow_pattern::{DrawingOptions, Pattern, PatternForm};

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
    /// What the reader did that a user should know.
    pub notes: Vec<String>,
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
    /// The voltage of a field or of creep.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub voltage_v: Option<f64>,
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
            point_mm: file.point.map(|point| point.map(|at| at.value())),
            direction_deg: file.direction.map(|direction| direction.value()),
            correlated_within_mm: file.correlated_within.map(|within| within.value()),
        }
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
    /// Reads a file of an entry. Stresses without a stated noise have the `usual` one.
    ///
    /// # Errors
    /// If it or its pattern cannot be read.
    pub fn read(file: &MeasuredFile, node: &Node, form: PatternForm, usual: curve::Noise) -> Result<Self, InputError> {
        let path = path_of(node, file.file());
        let rows = match file.test {
            Measurement::Uniaxial | Measurement::Equibiaxial | Measurement::PureShear => {
                let test = file.test.of_specimen().unwrap_or(Test::Uniaxial);
                let noise = file.noise_of_stress()?.unwrap_or(usual);
                match curve::read(&path.to_string_lossy(), test, noise)? {
                    Measured::Curve(curve) => Rows::Curve(curve),
                    Measured::History(curve) => Rows::History(curve),
                }
            }
            Measurement::VoltageStretch | Measurement::Creep => Rows::Sheet(read_sheet(&path, file)?),
            Measurement::Field => Rows::Field(read_field(&path, file)?),
            Measurement::VoltageDisplacement => Rows::Series(read_series(&path, file)?),
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
        let has_stretch = !matches!(self.rows, Rows::Series(_));
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
    fn count(&self) -> usize {
        match &self.rows {
            Rows::Curve(curve) => curve.stretch.len(),
            Rows::History(curve) => curve.time_s.len(),
            Rows::Sheet(table) => table.at.len(),
            Rows::Series(series) => series.voltages_v.len(),
            Rows::Field(field) => field.points_mm.len(),
        }
    }

    /// Reads the files of entries.
    ///
    /// # Errors
    /// If one cannot be read, or is listed twice.
    pub fn read_all(
        files: &[(MeasuredFile, Node)],
        form: PatternForm,
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
            Rows::Sheet(_) | Rows::Field(_) | Rows::Series(_) => None,
        }
    }
}

fn one_pattern(file: &MeasuredFile, node: &Node, form: PatternForm) -> Result<(Pattern, Vec<String>), InputError> {
    let named = path_of(node, file.pattern().unwrap_or_default());
    let argument = named.to_string_lossy().into_owned();
    let mut found = direct::patterns(&[argument], form, &DrawingOptions::default())?;
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
const STATED: &str = "stated";
const SHARE: &str = "share";
const RELATIVE: &str = "relative";
const ABSOLUTE: &str = "absolute";

/// The numbers of one row.
#[derive(Clone, Copy, Default)]
struct Row {
    number: usize,
    time: f64,
    voltage: f64,
    stretch: f64,
    stress: f64,
    position: [f64; 2],
    displacement: [f64; 2],
}

impl MeasuredTable {
    /// Returns the rows with finite numbers.
    fn finite_rows(&self) -> Vec<Row> {
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
            let numbers = [row.time, row.voltage, row.stretch, row.stress];
            let all = numbers.iter().chain(&row.position).chain(&row.displacement);
            all.into_iter().all(|number| number.is_finite())
        };
        numbered.filter(is_finite).collect()
    }

    /// Returns the noise by name, the share, and the standard deviation of each row of the file.
    fn noise(&self) -> (&'static str, f64, Option<&[f64]>) {
        let sigma = match &self.rows {
            Rows::Curve(curve) => &curve.sigma,
            Rows::History(curve) => &curve.sigma,
            Rows::Sheet(table) => &table.sigma,
            Rows::Series(series) => &series.sigma,
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

    /// Returns the content of a `measure` stage.
    ///
    /// # Errors
    /// If the settings cannot be written.
    pub fn content(tables: &[Self]) -> Result<Measurements, serde_json::Error> {
        let (mut files, mut rows, mut patterns) = (MeasuredFiles::default(), MeasuredRows::default(), Vec::new());
        let (mut names, mut settings) = (Vec::new(), Vec::new());
        for (at, table) in tables.iter().enumerate() {
            let (noise, share, sigma) = table.noise();
            names.push(table.name.clone());
            settings.push(serde_json::to_string(&table.settings)?);
            files.test.push(table.test.name().to_owned());
            files.noise.push(noise.to_owned());
            files.share.push(share);
            patterns.extend(table.pattern.clone());
            files.pattern.push(match table.pattern {
                Some(_) => patterns.len() as u64,
                None => 0,
            });
            for row in table.finite_rows() {
                rows.file.push(at as u64);
                rows.number.push(row.number as u64);
                rows.time.push(row.time);
                rows.voltage.push(row.voltage);
                rows.stretch.push(row.stretch);
                rows.stress.push(row.stress);
                rows.position.push(row.position);
                rows.displacement.push(row.displacement);
                let sigma = sigma.and_then(|sigma| sigma.get(row.number - 1)).copied();
                rows.sigma
                    .push(sigma.filter(|sigma| sigma.is_finite()).unwrap_or_default());
            }
        }
        files.name = LongTexts(names);
        files.settings = LongTexts(settings);
        Ok(Measurements {
            files,
            rows,
            patterns: (!patterns.is_empty()).then_some(patterns),
        })
    }

    /// Returns the files of the content of a `measure` stage.
    ///
    /// # Errors
    /// If it is not consistent, with the reason.
    pub fn of_content(content: &Measurements) -> Result<Vec<Self>, String> {
        let Measurements { files, rows, patterns } = content;
        let mut all = Vec::with_capacity(files.test.len());
        for at in 0..files.test.len() {
            let name = files.name.0[at].clone();
            let wrong = |why: &str| format!("{name}: {why}");
            let test = Measurement::from_name(&files.test[at]).ok_or_else(|| wrong("its test is unknown"))?;
            let settings = serde_json::from_str(&files.settings.0[at]).map_err(|error| wrong(&error.to_string()))?;
            let own: Vec<usize> = (0..rows.file.len())
                .filter(|row| rows.file[*row] == at as u64)
                .collect();
            let sigma = |fit: &dyn Fn(usize) -> f64| own.iter().map(|row| fit(*row)).collect::<Vec<f64>>();
            let noise = match files.noise[at].as_str() {
                STATED => Sigma::Stated(sigma(&|row| rows.sigma[row])),
                SHARE => Sigma::StatedFraction(files.share[at]),
                RELATIVE => Sigma::UnstatedRelative,
                ABSOLUTE => Sigma::UnstatedAbsolute,
                _ => return Err(wrong("its noise is unknown")),
            };
            let column = |of: &[f64]| own.iter().map(|row| of[*row]).collect::<Vec<f64>>();
            let pattern = match files.pattern[at] {
                0 => None,
                number => {
                    let found = patterns.iter().flatten().nth(number as usize - 1);
                    Some(found.cloned().ok_or_else(|| wrong("its pattern is missing"))?)
                }
            };
            let numbers = Numbers {
                own: &own,
                rows,
                noise,
                column: &column,
            };
            all.push(Self {
                rows: numbers.rows(&name, test),
                name,
                test,
                settings,
                pattern,
                notes: Vec::new(),
            });
        }
        Ok(all)
    }
}

/// The numbers of a file in an artifact.
struct Numbers<'a> {
    /// Its rows.
    own: &'a [usize],
    rows: &'a MeasuredRows,
    noise: Sigma,
    column: &'a dyn Fn(&[f64]) -> Vec<f64>,
}

impl Numbers<'_> {
    fn rows(self, name: &str, test: Measurement) -> Rows {
        let Self {
            own,
            rows,
            noise,
            column,
        } = self;
        match (test, test.of_specimen()) {
            (_, Some(how)) => {
                let times = column(&rows.time);
                let (stretch, stress_pa) = (column(&rows.stretch), column(&rows.stress));
                // Curves have no times.
                match times.iter().any(|time| *time != 0.0) {
                    false => Rows::Curve(Curve {
                        name: name.to_owned(),
                        test: how,
                        stretch,
                        stress_pa,
                        sigma: noise,
                    }),
                    true => Rows::History(history(name, how, (times, stretch), stress_pa, noise)),
                }
            }
            (Measurement::Field, None) => Rows::Field(field(own, rows, &noise)),
            (Measurement::VoltageDisplacement, None) => Rows::Series(Series {
                voltages_v: column(&rows.voltage),
                displacements_mm: own.iter().map(|row| rows.displacement[*row][0]).collect(),
                sigma: noise,
            }),
            (Measurement::Creep, None) => Rows::Sheet(SheetTable {
                at: column(&rows.time),
                stretch: column(&rows.stretch),
                sigma: noise,
            }),
            (_, None) => Rows::Sheet(SheetTable {
                at: column(&rows.voltage),
                stretch: column(&rows.stretch),
                sigma: noise,
            }),
        }
    }
}

/// Returns a field; rows that are missing have no numbers, so that rows keep their places.
fn field(own: &[usize], rows: &MeasuredRows, noise: &Sigma) -> Field {
    let last = own.iter().map(|row| rows.number[*row] as usize).max().unwrap_or(0);
    let mut field = Field {
        points_mm: vec![[f64::NAN; 2]; last],
        displacements_mm: vec![[f64::NAN; 2]; last],
        sigma_mm: matches!(noise, Sigma::Stated(_)).then(|| vec![f64::NAN; last]),
    };
    for &row in own {
        let at = (rows.number[row] as usize).saturating_sub(1);
        field.points_mm[at] = rows.position[row];
        field.displacements_mm[at] = rows.displacement[row];
        if let Some(sigma) = &mut field.sigma_mm {
            sigma[at] = rows.sigma[row];
        }
    }
    field
}
