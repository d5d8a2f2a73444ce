//! The table of a table stage: for people, for other programs, and as curves.

use comfy_table::{CellAlignment, Table, TableComponent, presets::UTF8_HORIZONTAL_ONLY};
use serde_json::{Value, json};

use super::figures::{Curve, Curves};
use deaflow_content as content;

/// Letters of a number that is shown as it is.
const SHORT: usize = 8;

/// A table that was collected.
#[derive(Clone, Debug)]
pub struct Collected {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Their units; "1" for pure numbers, empty for words.
    pub units: Vec<String>,
    /// The cells, row by row: a text, and the number that it is.
    pub rows: Vec<Vec<(String, Option<f64>)>>,
    /// The columns that are drawn: x, y and series.
    pub plot: Vec<String>,
}

impl Collected {
    /// The table of an artifact.
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

    /// Names of the columns with their units.
    #[must_use]
    pub fn header(&self) -> Vec<String> {
        let columns = self.columns.iter().zip(&self.units);
        columns.map(|(column, unit)| labelled(column, unit)).collect()
    }

    /// The cells for people.
    #[must_use]
    pub fn shown(&self) -> Vec<Vec<String>> {
        let shown = |(text, number): &(String, Option<f64>)| match number {
            Some(number) if text.len() > SHORT => super::format::number(*number),
            _ => text.clone(),
        };
        self.rows.iter().map(|row| row.iter().map(shown).collect()).collect()
    }

    /// The first rows as a table for a terminal.
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

    /// Columns with units, and rows of numbers, words and, where there is nothing, null.
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

    /// What is to be drawn: a curve for each value of the series, where there are numbers.
    #[must_use]
    pub fn curves(&self) -> Option<Curves> {
        let place = |name: &String| self.columns.iter().position(|column| column == name);
        let places: Vec<usize> = self.plot.iter().filter_map(place).collect();
        let (&[x, y], series) = places.split_first_chunk::<2>()?;
        let series = series.first().copied();
        let words = self.words(x);
        let mut curves: Vec<Curve> = Vec::new();
        for row in &self.rows {
            let at = match &words {
                Some(words) => words
                    .iter()
                    .position(|word| *word == row[x].0)
                    .map(|place| place as f64),
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
            words: words.unwrap_or_default(),
            curves,
        })
    }

    /// The words of a column that holds words, in their order.
    fn words(&self, column: usize) -> Option<Vec<String>> {
        if !self.units[column].is_empty() {
            return None;
        }
        let mut words: Vec<String> = Vec::new();
        for (text, _) in self.rows.iter().map(|row| &row[column]) {
            if !words.contains(text) {
                words.push(text.clone());
            }
        }
        Some(words)
    }

    fn series_name(&self, column: usize, text: &str) -> String {
        let unit = match self.units[column].as_str() {
            "" | "1" => String::new(),
            unit => format!(" {unit}"),
        };
        format!("{} {text}{unit}", self.columns[column])
    }
}

/// An empty table with a header; the columns named in `numbers` are flush right.
pub fn table(header: &[&str], numbers: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(UTF8_HORIZONTAL_ONLY).set_header(header);
    // Between rows a line is one too many.
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

/// A name with its unit, where it has one.
fn labelled(name: &str, unit: &str) -> String {
    match unit {
        "" | "1" => name.to_owned(),
        unit => format!("{name} [{unit}]"),
    }
}
