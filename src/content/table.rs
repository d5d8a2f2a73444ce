//! The artifact of a table stage.

use super::attribute::Lines;
use super::macros::arrays;

arrays! {
    /// Results of many stages.
    pub struct Table, TableView {
        /// Names of the columns.
        columns: Vec<String> = array("columns", "", [column]),
        /// Units of the columns; empty for words.
        units: Vec<String> = array("units", "", [column]),
        /// Each cell as text for CSV; empty if a stage has no such result.
        text: Vec<String> = array("text", "", [row, column]),
        /// Each cell as a number; 0 if it is not a number.
        value: Vec<f64> = array("value", "1", [row, column]),
        /// 1 if a cell is a number, else 0.
        is_number: Vec<u8> = array("is_number", "1", [row, column]),
        /// The columns of the figure: x, y and, for several curves, their names.
        plot: Lines = attribute("plot"),
    }
}
