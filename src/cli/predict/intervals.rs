//! Intervals of predictions: as arrays, as rows of a table, for programs and for people.

use std::path::Path;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::calibration::NamedCalibration;
use crate::pipeline::note_on_units;
use crate::results::FEW;
use crate::table::{Cell, Table, table};
use crate::text::Text;
use crate::tone::Tone;
use crate::{CliError, csv, write};
use deaflow_base::{Document, error_digits, rounded_by};
use deaflow_content::{LongTexts, ObjectiveIntervals, PredictionIntervals};
use deaflow_design::{Goal, Objective};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_surrogate::{COVERAGE, Interval};

/// A displacement whose interval is requested.
struct RequestedObjective {
    text: String,
    goal: Goal,
    /// How numbers without a unit were read.
    note: Option<String>,
}

/// The intervals of predictions.
pub struct Intervals {
    calibration: NamedCalibration,
    objectives: Vec<String>,
    notes: Vec<String>,
    rows: Vec<PredictionRow>,
}

/// The intervals of one prediction; numbers with the lower and the upper end of their interval.
struct PredictionRow {
    interval: Interval,
    /// The largest displacement magnitude, mm.
    largest: [f64; 3],
    /// By objective, mm.
    objectives: Vec<[f64; 3]>,
}

impl Intervals {
    /// Computes the intervals of predictions of the calibrated model, with objectives in YAML.
    ///
    /// # Errors
    /// When an objective cannot be read, or is outside the membrane.
    pub fn of(
        calibration: NamedCalibration,
        objectives: &[String],
        patterns: &[Pattern],
        fields: &[Field],
    ) -> Result<Self, CliError> {
        let scene = &calibration.calibrated.scene;
        let requested = objectives
            .iter()
            .map(|text| requested_objective(text, scene))
            .collect::<Result<Vec<_>, _>>()?;
        let model = &calibration.calibrated.calibration;
        let half_widths: Vec<_> = requested
            .iter()
            .map(|objective| model.objective(&|field| objective.goal.value_mm(std::slice::from_ref(field))))
            .collect();
        let row = |(pattern, field): (&Pattern, &Field)| {
            let interval = model.interval(pattern, field);
            // An error of at most r in each component is an error of at most √2 r of the vector.
            let off = std::f64::consts::SQRT_2 * interval.radius_mm;
            let largest = field.max_magnitude();
            let objectives = requested.iter().zip(&half_widths).map(|(objective, intervals)| {
                let (value, off) = (
                    objective.goal.value_mm(std::slice::from_ref(field)),
                    intervals.half_width(pattern, field),
                );
                [value, value - off, value + off]
            });
            PredictionRow {
                interval,
                largest: [largest, (largest - off).max(0.0), largest + off],
                objectives: objectives.collect(),
            }
        };
        let rows = patterns.par_iter().zip(fields).map(row).collect();
        drop(half_widths);
        Ok(Self {
            calibration,
            notes: requested
                .iter()
                .filter_map(|objective| objective.note.clone())
                .collect(),
            objectives: requested.into_iter().map(|objective| objective.text).collect(),
            rows,
        })
    }

    /// Returns how numbers without a unit in the objectives were read.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the digest of the calibration.
    pub fn digest(&self) -> String {
        self.calibration.digest.clone()
    }

    /// Returns the families of patterns that it was made from.
    pub fn basis(&self) -> String {
        self.calibration.calibrated.basis()
    }

    /// Returns the arrays for the file.
    pub fn content(&self) -> PredictionIntervals {
        let rows = || self.rows.iter();
        let of_objectives = |end: usize| {
            let each = (0..self.objectives.len()).flat_map(|k| rows().map(move |row| row.objectives[k][end]));
            each.collect::<Vec<f64>>()
        };
        PredictionIntervals {
            radius: rows().map(|row| row.interval.radius_mm).collect(),
            max_displacement_lower: rows().map(|row| row.largest[1]).collect(),
            max_displacement_upper: rows().map(|row| row.largest[2]).collect(),
            novelty: rows().map(|row| row.interval.novelty).collect(),
            out_of_distribution: rows().map(|row| u8::from(row.interval.out_of_distribution)).collect(),
            objective: (!self.objectives.is_empty()).then(|| ObjectiveIntervals {
                text: LongTexts(self.objectives.clone()),
                predicted: of_objectives(0),
                lower: of_objectives(1),
                upper: of_objectives(2),
            }),
        }
    }

    /// Returns comma-separated values with a header, one row per prediction.
    ///
    /// # Errors
    /// When memory is short.
    pub fn csv(&self) -> Result<String, CliError> {
        let fixed = [
            "pattern",
            "max_displacement_mm",
            "max_displacement_lower_mm",
            "max_displacement_upper_mm",
            "radius_mm",
            "coverage",
            "novelty",
            "out_of_distribution",
        ];
        let mut header: Vec<String> = fixed.map(str::to_owned).into();
        for k in 1..=self.objectives.len() {
            header.extend(["", "_lower", "_upper"].map(|end| format!("objective_{k}{end}_mm")));
        }
        let row = |(index, row): (usize, &PredictionRow)| {
            let PredictionRow {
                interval,
                largest,
                objectives,
            } = row;
            let mut cells = vec![index.to_string()];
            cells.extend(largest.map(|mm| mm.to_string()));
            cells.push(interval.radius_mm.to_string());
            cells.push(COVERAGE.to_string());
            cells.push(interval.novelty.to_string());
            cells.push(u8::from(interval.out_of_distribution).to_string());
            cells.extend(objectives.iter().flatten().map(|mm| mm.to_string()));
            cells
        };
        csv::text(&header, self.rows.iter().enumerate().map(row))
    }

    /// Describes the intervals for programs.
    pub fn document(&self, table: Option<&Path>) -> Value {
        let ends =
            |[value, lower, upper]: [f64; 3]| json!({ "predicted_mm": value, "lower_mm": lower, "upper_mm": upper });
        let row = |(index, row): (usize, &PredictionRow)| {
            json!({
                "index": index,
                "max_displacement": ends(row.largest),
                "radius_mm": row.interval.radius_mm,
                "novelty": row.interval.novelty,
                "out_of_distribution": row.interval.out_of_distribution,
                "objectives": row.objectives.iter().copied().map(ends).collect::<Vec<_>>(),
            })
        };
        json!({
            "coverage": COVERAGE,
            "calibration": self.calibration.digest,
            "calibrated_on": self.basis(),
            "objectives": self.objectives,
            "out_of_distribution": self.flagged(),
            "table": table,
            "predictions": self.rows.iter().enumerate().map(row).collect::<Vec<_>>(),
        })
    }

    /// Describes the intervals for people.
    pub fn text(&self, table: Option<&Path>) -> Text {
        let mut text = Text::of(self.overview());
        let more = self.rows.len().saturating_sub(FEW);
        if more > 0 {
            text.line(match table {
                Some(table) => format!("and {more} more in {}", table.display()),
                None => format!("and {more} more: use --json, or write all with -o OUT.h5"),
            });
        }
        for (k, objective) in self.objectives.iter().enumerate() {
            text.line(format!("objective {}: {objective}", k + 1));
        }
        let (name, digest) = (&self.calibration.name, &self.calibration.digest);
        text.line(format!(
            "for {:.0} % of patterns like those of the calibration, each component of the displacement at each corner \
             is within the radius; intervals of objectives have the same coverage",
            100.0 * COVERAGE
        ));
        text.line(format!("calibration {name} ({digest:.12}), made from {}", self.basis()));
        let tone = match self.flagged() {
            0 => Tone::Plain,
            _ => Tone::Caution,
        };
        let verdict = match self.flagged() {
            0 => "all patterns are like those of the calibration".to_owned(),
            n => format!(
                "{n} of {} patterns are out of distribution (novelty above 1): their intervals are not reliable; \
                 simulate them with `deaflow solve`",
                self.rows.len()
            ),
        };
        text.toned(tone, verdict);
        if let Some(table) = table {
            text.line(write::with_metadata(table));
        }
        text
    }

    fn flagged(&self) -> usize {
        self.rows.iter().filter(|row| row.interval.out_of_distribution).count()
    }

    fn overview(&self) -> Table {
        let objectives: Vec<String> = (1..=self.objectives.len())
            .map(|k| format!("objective {k} mm"))
            .collect();
        let mut header = vec!["pattern", "largest mm", "radius mm"];
        header.extend(objectives.iter().map(String::as_str));
        header.extend(["novelty", ""]);
        // Objectives are placed below a row before columns are dropped.
        let objectives = header[3..header.len() - 2].to_vec();
        let mut table = table(&header, &header[..header.len() - 1])
            .flowing(&objectives)
            .dispensable(&["radius mm"]);
        for (index, row) in self.rows.iter().enumerate().take(FEW) {
            let ends = |numbers: [f64; 3]| {
                let half = 0.5 * (numbers[2] - numbers[1]);
                let [value, lower, upper] = numbers.map(|number| rounded_by(number, half));
                format!("{value} [{lower}, {upper}]")
            };
            let mut cells: Vec<Cell> = vec![index.into(), ends(row.largest).into()];
            cells.push(error_digits(row.interval.radius_mm).into());
            cells.extend(row.objectives.iter().copied().map(ends).map(Cell::from));
            cells.push(format!("{:.2}", row.interval.novelty).into());
            let flagged = row.interval.out_of_distribution;
            cells.push(Cell::toned(
                if flagged { "out of distribution" } else { "" },
                Tone::Caution,
            ));
            table.add_row(cells);
        }
        table
    }
}

/// Reads an objective in the syntax of a design stage.
fn requested_objective(text: &str, scene: &Scene) -> Result<RequestedObjective, CliError> {
    let document = Document::from_text(Path::new("--objective"), text)?;
    let objective = Objective::read(&document.root)?;
    let goal = objective.goal(scene, None, 0.0);
    Ok(RequestedObjective {
        text: objective.to_text(),
        note: note_on_units(&document),
        goal: goal.map_err(|e| document.root.error(e.to_string()))?,
    })
}
