//! Formats tables as CSV.

use super::CliError;
use deaflow_report::ResultTable;

/// Returns the names of the columns of a table with their units at the end, as in `voltage_V`.
pub fn titles(table: &ResultTable) -> Vec<String> {
    let title = |(name, unit): (&String, &String)| match unit.as_str() {
        "" | "1" => name.clone(),
        unit => format!("{name}_{}", unit.replace(' ', "_")),
    };
    table.columns.iter().zip(&table.units).map(title).collect()
}

/// Formats the table of a table stage.
///
/// # Errors
/// When memory is short.
pub fn of_table(table: &ResultTable) -> Result<String, CliError> {
    let rows = table
        .rows
        .iter()
        .map(|row| row.iter().map(|(text, _)| text.clone()).collect());
    text(&titles(table), rows)
}

/// Writes a number without the rounding errors of its last digit: 0.4 in place of 0.39999999999999997.
pub fn number(value: f64) -> String {
    let rounded = format!("{value:.14e}").parse().unwrap_or(value);
    rounded.to_string()
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

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn numbers_have_no_rounding_errors() {
        let some = [0.4 - 1e-17 - 5e-17, 0.1 + 0.2, 1e-300, -2.5, 1_234_567.0].map(number);
        assert_eq!(some[..2], ["0.4", "0.3"]);
        assert_eq!(some[3..], ["-2.5", "1234567"]);
        assert_eq!(number(f64::NAN), "NaN");
    }
}
