//! The cells of a table: values of axes, and results of stages.

use std::collections::{BTreeMap, BTreeSet};

use super::columns::{Column, Content, Row};
use crate::results::unit;
use deaflow_base::{Canonical, Decimal, Dimension, InputError, Node, NodeValue, Quantity};
use deaflow_orchestrator::StageError;

/// The longest word in a cell, in bytes: that of texts in artifacts.
const LONGEST: usize = deaflow_store::TEXT_WIDTH;

/// The source of each cell: rows of columns.
pub struct Cells(Vec<Vec<Cell>>);

enum Cell {
    /// The value of an axis as written in the file; empty if the row does not have it.
    Axis(String),
    /// The result of one of these needs.
    Needs(Vec<usize>),
}

/// The value of a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum CellValue {
    /// Nothing.
    Empty,
    /// A number.
    Number(f64),
    /// A word.
    Word(String),
}

impl CellValue {
    /// Returns the text for CSV.
    pub fn text(&self) -> String {
        match self {
            Self::Empty => String::new(),
            Self::Number(number) => number.to_string(),
            Self::Word(word) => word.clone(),
        }
    }

    /// Returns the number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }
}

impl Cells {
    pub fn new(columns: &[Column], rows: &[Row]) -> Self {
        let cells = |column: &Column| -> Vec<Cell> {
            match &column.content {
                Content::Axis => axis_texts(&column.name, rows).into_iter().map(Cell::Axis).collect(),
                Content::Result { stage, .. } => {
                    let is_own = |name: &String| stage.as_ref().is_none_or(|stage| stage == name);
                    let needs = |row: &Row| {
                        let own = row.needs.iter().filter(|(name, _)| is_own(name));
                        Cell::Needs(own.map(|(_, index)| *index).collect())
                    };
                    rows.iter().map(needs).collect()
                }
            }
        };
        let mut columns: Vec<_> = columns.iter().map(|column| cells(column).into_iter()).collect();
        let row = |_: &Row| columns.iter_mut().filter_map(Iterator::next).collect();
        Self(rows.iter().map(row).collect())
    }

    /// Checks that cells can hold the values of the axes.
    ///
    /// # Errors
    /// If one cannot, with its position.
    pub fn check(columns: &[Column], rows: &[Row]) -> Result<(), InputError> {
        for column in columns.iter().filter(|column| matches!(column.content, Content::Axis)) {
            let nodes: Vec<&Node> = rows.iter().filter_map(|row| row.axes.get(&column.name)).collect();
            let texts: Vec<String> = nodes.iter().map(|node| text_of(node)).collect();
            let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
            axis_values(&texts).map_err(|at| nodes[at].error(unfit(&column.name, texts[at])).help(ZIP))?;
        }
        Ok(())
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.0.len()
    }

    /// Returns the canonical form of the sources, without names of stages.
    pub fn canonical(&self) -> Canonical {
        let cell = |cell: &Cell| match cell {
            Cell::Axis(text) => Canonical::from(text.as_str()),
            Cell::Needs(needs) => needs.iter().map(|&need| Canonical::from(need as u64)).collect(),
        };
        self.0
            .iter()
            .map(|row| row.iter().map(cell).collect::<Canonical>())
            .collect()
    }

    /// Returns a column with its unit, given the results of each need.
    ///
    /// # Errors
    /// If no stage has the result, or several stages of a row have it.
    pub fn column(
        &self,
        at: usize,
        column: &Column,
        results: &[BTreeMap<String, f64>],
    ) -> Result<(Vec<CellValue>, &'static str), StageError> {
        let Content::Result { result, .. } = &column.content else {
            let texts = self.0.iter().filter_map(|row| match row.get(at) {
                Some(Cell::Axis(text)) => Some(text.as_str()),
                _ => None,
            });
            let texts: Vec<&str> = texts.collect();
            return axis_values(&texts).map_err(|at| StageError::input(unfit(&column.name, texts[at])));
        };
        let mut cells = Vec::with_capacity(self.rows());
        for row in &self.0 {
            let Some(Cell::Needs(needs)) = row.get(at) else {
                continue;
            };
            let mut values = needs.iter().filter_map(|&need| results.get(need)?.get(result));
            let value = values.next();
            if values.next().is_some() {
                return Err(StageError::input(format!(
                    "`{}` is a result of several needed stages: write STAGE.{result}",
                    column.name
                )));
            }
            cells.push(value.map_or(CellValue::Empty, |value| CellValue::Number(*value)));
        }
        match cells.iter().any(|cell| *cell != CellValue::Empty) {
            true => Ok((cells, unit(result))),
            false => Err(self.no_such_result(at, column, results)),
        }
    }

    fn no_such_result(&self, at: usize, column: &Column, results: &[BTreeMap<String, f64>]) -> StageError {
        let needs = self.0.iter().filter_map(|row| match row.get(at) {
            Some(Cell::Needs(needs)) => Some(needs),
            _ => None,
        });
        let names: BTreeSet<&str> = needs
            .flatten()
            .filter_map(|&need| results.get(need))
            .flat_map(|results| results.keys().map(String::as_str))
            .collect();
        let names: Vec<&str> = names.into_iter().take(40).collect();
        StageError::input(format!(
            "`{}` is neither an axis nor a result of a needed stage; results: {}",
            column.name,
            names.join(", ")
        ))
    }
}

/// What to do about values of an axis that no cell can hold.
const ZIP: &str = "zip the axis with one of short words, and use that one as the column";

/// Says that no cell can hold a value of an axis.
fn unfit(column: &str, text: &str) -> String {
    match text.len() {
        long if long > LONGEST => {
            format!("the column `{column}`: {text:?} has {long} bytes; a cell of a table holds at most {LONGEST}")
        }
        _ => format!("the column `{column}`: {text:?} contains NUL"),
    }
}

/// Returns the text of an axis in each row, empty if the row does not have it. Percentages are written as fractions,
/// which are numbers, unless other values are neither.
fn axis_texts(name: &str, rows: &[Row]) -> Vec<String> {
    let nodes = || rows.iter().map(|row| row.axes.get(name));
    let is_number = |node: &Node| node.percentage().is_some() || text_of(node).parse::<Decimal>().is_ok();
    let are_numbers = nodes().flatten().all(is_number);
    let text = |node: &Node| match node.percentage().filter(|_| are_numbers) {
        Some(fraction) => fraction.to_f64().to_string(),
        None => text_of(node),
    };
    nodes().map(|node| node.map(text).unwrap_or_default()).collect()
}

/// Returns the text of a value of an axis.
fn text_of(node: &Node) -> String {
    match node.value() {
        NodeValue::Number(text) | NodeValue::Text(text) => text.clone(),
        NodeValue::Bool(value) => value.to_string(),
        _ => String::new(),
    }
}

/// Converts the values of an axis to numbers in one unit if possible, else to words.
///
/// # Errors
/// If a cell cannot hold one of the words: its index.
fn axis_values(texts: &[&str]) -> Result<(Vec<CellValue>, &'static str), usize> {
    for dimension in Dimension::ALL {
        let number = |text: &&str| match text.is_empty() {
            true => Some(CellValue::Empty),
            false => Some(CellValue::Number(Quantity::parse(text, dimension).ok()?.value())),
        };
        if let Some(cells) = texts.iter().map(number).collect::<Option<Vec<_>>>() {
            let unit = match dimension.base_unit() {
                "" => "1",
                unit => unit,
            };
            return Ok((cells, unit));
        }
    }
    let unfit = texts
        .iter()
        .position(|text| text.len() > LONGEST || text.contains('\0'));
    if let Some(at) = unfit {
        return Err(at);
    }
    let word = |text: &&str| match text.is_empty() {
        true => CellValue::Empty,
        false => CellValue::Word((*text).to_owned()),
    };
    Ok((texts.iter().map(word).collect(), ""))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    #[test]
    fn percentages_of_an_axis_are_numbers() {
        let texts = |values: &str| {
            let document = Document::from_text(Path::new("p.yaml"), &format!("area: [{values}]")).unwrap();
            let values = document.root.peek("area").unwrap().list("area").unwrap().to_vec();
            let row = |value: Node| Row {
                axes: [("area".to_owned(), value)].into(),
                needs: Vec::new(),
            };
            axis_texts("area", &values.into_iter().map(row).collect::<Vec<_>>())
        };
        assert_eq!(texts("10 %, '12.5%', 0.3"), ["0.1", "0.125", "0.3"]);
        assert_eq!(texts("10 %, free"), ["10 %", "free"]);
        assert_eq!(texts("0.30, 1"), ["0.30", "1"]);
    }

    #[test]
    fn the_values_of_an_axis_have_one_unit() {
        let numbers = |texts: &[&str]| {
            let (cells, unit) = axis_values(texts).unwrap();
            (cells.iter().map(CellValue::number).collect::<Vec<_>>(), unit)
        };
        assert_eq!(numbers(&["3 kV", "500 V"]), (vec![Some(3000.0), Some(500.0)], "V"));
        assert_eq!(numbers(&["0.5 N", "200 mN"]), (vec![Some(0.5), Some(0.2)], "N"));
        assert_eq!(numbers(&["0.3", "1"]), (vec![Some(0.3), Some(1.0)], "1"));
        assert_eq!(numbers(&["0.3", ""]), (vec![Some(0.3), None], "1"));
        assert_eq!(numbers(&["3 kV", "4 mm"]), (vec![None, None], ""));
        assert_eq!(axis_values(&["a", &"a".repeat(64), &"a".repeat(65)]), Err(2));
        assert_eq!(axis_values(&["a\0"]), Err(0));
    }
}
