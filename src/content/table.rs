//! The artifact of a table stage.

use super::attribute::Lines;
use super::macros::arrays;

arrays! {
    /// Named numbers of many stages.
    pub struct Table, TableView {
        /// Names of the columns.
        columns: Vec<String> = array("columns", "", [column]),
        /// Units of the columns; empty for words.
        units: Vec<String> = array("units", "", [column]),
        /// Each cell as CSV has it; empty where a stage has no such result.
        text: Vec<String> = array("text", "", [row, column]),
        /// Each cell as a number, 0 where it is none.
        value: Vec<f64> = array("value", "1", [row, column]),
        /// 1 where a cell is a number, else 0.
        is_number: Vec<u8> = array("is_number", "1", [row, column]),
        /// What is drawn: the columns of x, of y and, where there are several curves, of their names.
        plot: Lines = attribute("plot"),
    }
}
