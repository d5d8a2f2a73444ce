//! The table of a table stage: for people, for programs, and as curves.

use comfy_table::{CellAlignment, Table, TableComponent, presets::UTF8_HORIZONTAL_ONLY};
use serde_json::{Value, json};

use super::figures::{Curve, Curves};
use deaflow_base::with_minus;
use deaflow_content as content;

/// Longer numbers are rounded for people.
const MAX_LETTERS: usize = 8;

/// The table of a table stage.
#[derive(Clone, Debug)]
pub struct ResultTable {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Their units; "1" for pure numbers, empty for texts.
    pub units: Vec<String>,
    /// The cells, row by row: a text, and its value if it is a number.
    pub rows: Vec<Vec<(String, Option<f64>)>>,
    /// The columns of the plot: x, y and series.
    pub plot: Vec<String>,
}

impl ResultTable {
    /// Creates it from the content of an artifact.
    #[must_use]
    pub fn new(table: content::Table) -> Self {
        let width = table.columns.len().max(1);
        let numbers = table.value.iter().zip(&table.is_number);
        let numbers = numbers.map(|(value, is_number)| (*is_number == 1).then_some(*value));
        let cells: Vec<_> = table.text.into_iter().zip(numbers).collect();
        Self {
            columns: table.columns,
            units: table.units,
            rows: cells.chunks(width).map(<[_]>::to_vec).collect(),
            plot: table.plot.0,
        }
    }

    /// Returns the names of the columns with their units.
    #[must_use]
    pub fn header(&self) -> Vec<String> {
        let columns = self.columns.iter().zip(&self.units);
        columns.map(|(column, unit)| labelled(column, unit)).collect()
    }

    /// Returns the cells for people.
    #[must_use]
    pub fn shown(&self) -> Vec<Vec<String>> {
        let shown = |(text, number): &(String, Option<f64>)| match number {
            Some(number) if text.len() > MAX_LETTERS => super::format::number(*number),
            Some(_) => with_minus(text),
            None => text.clone(),
        };
        self.rows.iter().map(|row| row.iter().map(shown).collect()).collect()
    }

    /// Writes the first rows as a table for a terminal.
    #[must_use]
    pub fn text(&self, most: usize) -> String {
        let header = self.header();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let numbers = header.iter().zip(&self.units).filter(|(_, unit)| !unit.is_empty());
        let numbers: Vec<&str> = numbers.map(|(title, _)| *title).collect();
        let mut table = table(&header, &numbers);
        self.shown().into_iter().take(most).for_each(|row| {
            table.add_row(row);
        });
        table.trim_fmt()
    }

    /// Returns the columns with units, and the rows of numbers, texts and null.
    #[must_use]
    pub fn document(&self) -> Value {
        let columns = self.columns.iter().zip(&self.units);
        let columns = columns.map(|(name, unit)| json!({ "name": name, "unit": unit }));
        let cell = |(text, number): &(String, Option<f64>)| match number {
            Some(number) => json!(number),
            None if text.is_empty() => Value::Null,
            None => json!(text),
        };
        let rows = self.rows.iter().map(|row| row.iter().map(cell).collect::<Value>());
        json!({ "columns": columns.collect::<Value>(), "rows": rows.collect::<Value>() })
    }

    /// Says how many rows are not in the figure because they have no value, as those of unstable patterns; `None` if
    /// all are, or without a figure.
    #[must_use]
    pub fn missing(&self) -> Option<String> {
        let name = self.plot.get(1)?;
        let column = self.columns.iter().position(|column| column == name)?;
        let without = self.rows.iter().filter(|row| row[column].1.is_none()).count();
        let rows = self.rows.len();
        (without > 0).then(|| format!("no {} in {without} of {rows} rows", name.replace('_', " ")))
    }

    /// Returns the curves, one for each value of the series; `None` without numbers.
    #[must_use]
    pub fn curves(&self) -> Option<Curves> {
        let column = |name: &String| self.columns.iter().position(|column| column == name);
        let columns: Vec<usize> = self.plot.iter().filter_map(column).collect();
        let (&[x, y], series) = columns.split_first_chunk::<2>()?;
        let series = series.first().copied();
        let names = self.names(x);
        let mut curves: Vec<Curve> = Vec::new();
        for row in &self.rows {
            let at = match &names {
                Some(names) => names.iter().position(|name| *name == row[x].0).map(|at| at as f64),
                None => row[x].1,
            };
            let (Some(at), Some(value)) = (at, row[y].1) else {
                continue;
            };
            let name = series.map_or_else(String::new, |series| self.series_name(series, &row[series].0));
            match curves.iter_mut().find(|curve| curve.name == name) {
                Some(curve) => curve.points.push((at, value)),
                None => curves.push(Curve {
                    name,
                    points: vec![(at, value)],
                }),
            }
        }
        curves
            .iter_mut()
            .for_each(|curve| curve.points.sort_by(|a, b| a.0.total_cmp(&b.0)));
        (!curves.is_empty()).then(|| Curves {
            labels: [x, y].map(|at| labelled(&self.columns[at].replace('_', " "), &self.units[at])),
            names: names.unwrap_or_default(),
            missing: self.missing(),
            curves,
        })
    }

    /// Returns the different texts of a column of texts, in their order.
    fn names(&self, column: usize) -> Option<Vec<String>> {
        if !self.units[column].is_empty() {
            return None;
        }
        let mut names: Vec<String> = Vec::new();
        for (text, _) in self.rows.iter().map(|row| &row[column]) {
            if !names.contains(text) {
                names.push(text.clone());
            }
        }
        Some(names)
    }

    fn series_name(&self, column: usize, text: &str) -> String {
        let unit = match self.units[column].as_str() {
            "" | "1" => String::new(),
            unit => format!(" {unit}"),
        };
        format!("{} {text}{unit}", self.columns[column])
    }
}

/// Creates an empty table with a header; the columns in `numbers` are aligned to the right.
pub fn table(header: &[&str], numbers: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(UTF8_HORIZONTAL_ONLY).set_header(header);
    // No lines between rows.
    table
        .remove_style(TableComponent::HorizontalLines)
        .remove_style(TableComponent::MiddleIntersections);
    for (column, title) in table.column_iter_mut().zip(header) {
        if numbers.contains(title) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// Returns a name with its unit, if it has one.
fn labelled(name: &str, unit: &str) -> String {
    match unit {
        "" | "1" => name.to_owned(),
        unit => format!("{name} [{unit}]"),
    }
}
