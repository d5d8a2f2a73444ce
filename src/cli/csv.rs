//! Formats tables as CSV.

use super::CliError;
use deaflow_report::ResultTable;

/// Formats the table of a table stage.
///
/// # Errors
/// When memory is short.
pub fn of_table(table: &ResultTable) -> Result<String, CliError> {
    let rows = table
        .rows
        .iter()
        .map(|row| row.iter().map(|(text, _)| text.clone()).collect());
    text(&table.columns, rows)
}

/// Formats a header and rows.
///
/// # Errors
/// When memory is short.
pub fn text(header: &[String], rows: impl Iterator<Item = Vec<String>>) -> Result<String, CliError> {
    let failed = |e: String| CliError::failure(format!("cannot format CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header).map_err(|e| failed(e.to_string()))?;
    for row in rows {
        writer.write_record(row).map_err(|e| failed(e.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|e| failed(e.to_string()))?;
    String::from_utf8(bytes).map_err(|e| failed(e.to_string()))
}
