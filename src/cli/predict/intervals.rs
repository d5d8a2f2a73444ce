//! What a calibration says of predictions: in the file, as rows of a table, for programs and for people.

use std::path::Path;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::calibration::NamedCalibration;
use crate::error::CliError;
use crate::outcomes::FEW as SHOWN;
use crate::table::{Cell, Table, table};
use crate::text::Text;
use crate::tone::Tone;
use crate::write;
use deaflow_base::Document;
use deaflow_content::{LongTexts, ObjectiveIntervals, PredictionIntervals};
use deaflow_design::{Goal, Objective};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_surrogate::{COVERAGE, Interval};

/// A number that is asked for beside the field.
struct Wanted {
    text: String,
    goal: Goal,
}

/// Intervals of some predictions.
pub struct Intervals {
    calibration: NamedCalibration,
    objectives: Vec<String>,
    rows: Vec<Row>,
}

/// What is said of one prediction; numbers with the lower and the upper end of their interval.
struct Row {
    interval: Interval,
    /// The largest displacement magnitude, mm.
    largest: [f64; 3],
    /// By objective, mm.
    objectives: Vec<[f64; 3]>,
}

impl Intervals {
    /// Of predictions of the calibrated model, with objectives in YAML.
    ///
    /// # Errors
    /// When an objective cannot be read, or lies outside the membrane.
    pub fn of(
        calibration: NamedCalibration,
        objectives: &[String],
        patterns: &[Pattern],
        fields: &[Field],
    ) -> Result<Self, CliError> {
        let scene = &calibration.of.scene;
        let wanted = objectives
            .iter()
            .map(|text| wanted(text, scene))
            .collect::<Result<Vec<_>, _>>()?;
        let own = &calibration.of.calibration;
        let half_widths: Vec<_> = wanted
            .iter()
            .map(|wanted| own.objective(&|field| wanted.goal.value_mm(std::slice::from_ref(field))))
            .collect();
        let row = |(pattern, field): (&Pattern, &Field)| {
            let interval = own.interval(pattern, field);
            // A vector whose components are off by at most r is off by at most √2 r.
            let off = std::f64::consts::SQRT_2 * interval.radius_mm;
            let largest = field.max_magnitude();
            let objectives = wanted.iter().zip(&half_widths).map(|(wanted, intervals)| {
                let (value, off) = (
                    wanted.goal.value_mm(std::slice::from_ref(field)),
                    intervals.half_width(pattern, field),
                );
                [value, value - off, value + off]
            });
            Row {
                interval,
                largest: [largest, (largest - off).max(0.0), largest + off],
                objectives: objectives.collect(),
            }
        };
        let rows = patterns.par_iter().zip(fields).map(row).collect();
        drop(half_widths);
        Ok(Self {
            calibration,
            objectives: wanted.into_iter().map(|wanted| wanted.text).collect(),
            rows,
        })
    }

    /// Digest of the calibration.
    pub fn digest(&self) -> String {
        self.calibration.digest.clone()
    }

    /// The families that it was made from.
    pub fn basis(&self) -> String {
        self.calibration.of.basis()
    }

    /// As arrays.
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

    /// As comma-separated values with a header, one row for each prediction.
    ///
    /// # Errors
    /// When a row cannot be written.
    pub fn csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let mut header: Vec<String> = [
            "pattern",
            "max_displacement_mm",
            "max_displacement_lower_mm",
            "max_displacement_upper_mm",
            "radius_mm",
            "coverage",
            "novelty",
            "out_of_distribution",
        ]
        .map(str::to_owned)
        .into();
        for k in 1..=self.objectives.len() {
            let names = ["", "_lower", "_upper"].map(|end| format!("objective_{k}{end}_mm"));
            header.extend(names);
        }
        writer.write_record(&header)?;
        for (index, row) in self.rows.iter().enumerate() {
            let numbers = row.largest.into_iter().chain([row.interval.radius_mm]);
            let mut cells = vec![index.to_string()];
            cells.extend(numbers.map(|mm| mm.to_string()));
            cells.push(COVERAGE.to_string());
            cells.push(row.interval.novelty.to_string());
            cells.push(u8::from(row.interval.out_of_distribution).to_string());
            cells.extend(row.objectives.iter().flatten().map(|mm| mm.to_string()));
            writer.write_record(&cells)?;
        }
        Ok(writer.into_inner().map_err(|e| e.into_error())?)
    }

    /// For programs.
    pub fn document(&self, table: Option<&Path>) -> Value {
        let ends =
            |[value, lower, upper]: [f64; 3]| json!({ "predicted_mm": value, "lower_mm": lower, "upper_mm": upper });
        let row = |(index, row): (usize, &Row)| {
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

    /// For people.
    pub fn text(&self, table: Option<&Path>) -> Text {
        let mut text = Text::of(self.overview());
        let more = self.rows.len().saturating_sub(SHOWN);
        if more > 0 {
            text.line(match table {
                Some(table) => format!("and {more} more in {}", table.display()),
                None => format!("and {more} more: --json has all, and -o OUT.h5 writes them"),
            });
        }
        for (k, objective) in self.objectives.iter().enumerate() {
            text.line(format!("objective {}: {objective}", k + 1));
        }
        let (name, digest) = (&self.calibration.name, &self.calibration.digest);
        text.line(format!(
            "{:.0} % of patterns like those of the calibration lie wholly within the radius, each component at each corner; the \
             interval of an objective covers as often",
            100.0 * COVERAGE
        ));
        text.line(format!("calibration {name} ({digest:.12}), on {}", self.basis()));
        let tone = match self.flagged() {
            0 => Tone::Plain,
            _ => Tone::Caution,
        };
        let verdict = match self.flagged() {
            0 => "no pattern is out of distribution".to_owned(),
            n => format!(
                "{n} of {} patterns are out of distribution (novelty above 1): of these nothing is promised; simulate them with \
                 `deaflow solve`",
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
        // What was asked for stands below a line before it leaves.
        let asked_for = header[3..header.len() - 2].to_vec();
        let mut table = table(&header, &header[..header.len() - 1])
            .flowing(&asked_for)
            .dispensable(&["radius mm"]);
        for (index, row) in self.rows.iter().enumerate().take(SHOWN) {
            let ends = |[value, lower, upper]: [f64; 3]| format!("{value:.4} [{lower:.4}, {upper:.4}]");
            let mut cells: Vec<Cell> = vec![index.into(), ends(row.largest).into()];
            cells.push(format!("{:.4}", row.interval.radius_mm).into());
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

/// An objective in the syntax of a design stage, in a scene.
fn wanted(text: &str, scene: &Scene) -> Result<Wanted, CliError> {
    let document = Document::from_text(Path::new("--objective"), text)?;
    let objective = Objective::read(&document.root)?;
    let goal = objective.goal(scene, None, 0.0);
    Ok(Wanted {
        text: objective.to_text(),
        goal: goal.map_err(|e| document.root.error(e.to_string()))?,
    })
}
