//! Rows that a stage was told to leave out.

use super::macros::arrays;

arrays! {
    /// Rows that `without` dropped.
    #[derive(Default)]
    pub struct DroppedRows, DroppedRowsView {
        /// Input with the row, from 0.
        input: Vec<u64> = array("input", "1", [dropped_row]),
        /// Row of that input, from 0.
        row: Vec<u64> = array("row", "1", [dropped_row]),
        /// The checks of the audit that found it, or `marked`.
        why: Vec<String> = array("why", "", [dropped_row]),
    }
}
