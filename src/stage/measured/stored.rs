//! Files of measurements as a `measure` stage stores them.

use super::curve::history;
use super::field::{Field, Series, SheetTable};
use super::file::Measurement;
use super::motion::{History, Response};
use super::table::{ABSOLUTE, MeasuredTable, RELATIVE, Rows, SHARE, STATED};
use deaflow_content::{CoveredCells, DrawnElectrodes, LongTexts, MeasuredFiles, MeasuredRows, Measurements};
use deaflow_fit::{Curve, Sigma};

impl MeasuredTable {
    /// Returns the content of a `measure` stage.
    ///
    /// # Errors
    /// If the settings cannot be written.
    pub fn content(tables: &[Self]) -> Result<Measurements, serde_json::Error> {
        let (mut files, mut rows, mut patterns) = (MeasuredFiles::default(), MeasuredRows::default(), Vec::new());
        let (mut names, mut settings) = (Vec::new(), Vec::new());
        let has_response = tables.iter().any(|table| matches!(table.rows, Rows::Response(_)));
        let [mut frequency, mut phase] = [(); 2].map(|()| has_response.then(Vec::new));
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
                frequency.iter_mut().for_each(|all| all.push(row.frequency));
                phase.iter_mut().for_each(|all| all.push(row.phase));
                let sigma = sigma.and_then(|sigma| sigma.get(row.number - 1)).copied();
                rows.sigma
                    .push(sigma.filter(|sigma| sigma.is_finite()).unwrap_or_default());
            }
        }
        (rows.frequency, rows.phase) = (frequency, phase);
        files.name = LongTexts(names);
        files.settings = LongTexts(settings);
        Ok(Measurements {
            files,
            rows,
            electrodes: DrawnElectrodes::of(&patterns),
            covered: CoveredCells::of(&patterns),
            patterns: (!patterns.is_empty()).then_some(patterns),
        })
    }

    /// Returns the files of the content of a `measure` stage.
    ///
    /// # Errors
    /// If it is not consistent, with the reason.
    pub fn of_content(content: &Measurements) -> Result<Vec<Self>, String> {
        let Measurements { files, rows, .. } = content;
        let patterns = content.drawn_patterns().map_err(|error| error.to_string())?;
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
            let column = |of: &[f64]| own.iter().filter_map(|row| of.get(*row)).copied().collect::<Vec<f64>>();
            let pattern = match files.pattern[at] {
                0 => None,
                number => {
                    let found = patterns.get(number as usize - 1);
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
                sigma_source: None,
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
        let along = own.iter().map(|row| rows.displacement[*row][0]).collect();
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
                displacements_mm: along,
                sigma: noise,
            }),
            (Measurement::TimeDisplacement, None) => {
                let voltages = column(&rows.voltage);
                Rows::Motion(History {
                    times_s: column(&rows.time),
                    // A measured history has a voltage.
                    voltages_v: voltages.iter().any(|voltage| *voltage != 0.0).then_some(voltages),
                    displacements_mm: along,
                    sigma: noise,
                })
            }
            (Measurement::FrequencyResponse, None) => {
                let phases = column(rows.phase.as_deref().unwrap_or_default());
                Rows::Response(Response {
                    frequencies_hz: column(rows.frequency.as_deref().unwrap_or_default()),
                    amplitudes_mm: along,
                    phases_deg: phases.iter().any(|phase| *phase != 0.0).then_some(phases),
                    sigma: noise,
                })
            }
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
