//! Metadata of CSV files, in a separate file as defined by [CSV on the
//! Web](https://www.w3.org/TR/tabular-data-primer/): many programs would read a comment in the CSV file as a row.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::program::software;
use super::quantity::Dimension;

/// The description of a CSV file.
#[derive(Clone, Debug)]
pub struct CsvTable {
    /// Its path, relative to the metadata file.
    pub url: String,
    /// Its origin: pipeline and stage, or a command.
    pub title: String,
    /// Its sources: digests of artifacts, or files.
    pub source: String,
    /// Whether its first line contains the column names.
    pub header: bool,
    /// Its columns; empty if they are not described.
    pub columns: Vec<CsvColumn>,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CsvColumn {
    /// Its name in the first line.
    pub title: String,
    /// The unit of its numbers; 1 for pure numbers, `None` for texts or if it is not known.
    pub unit: Option<String>,
}

impl CsvColumn {
    /// Describes a column whose name ends with its unit, as in `voltage_V`, or that has none.
    #[must_use]
    pub fn of_title(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            unit: unit_of(title),
        }
    }

    fn described(&self) -> Value {
        let mut described = json!({ "name": uri(&self.title), "titles": self.title });
        if let Some(unit) = &self.unit {
            described["schema:unitText"] = json!(unit);
        }
        described
    }
}

/// Returns the unit at the end of a name, as in `voltage_V` and `amplitude_mm_per_V`.
fn unit_of(title: &str) -> Option<String> {
    let is_unit = |word: &str| {
        let is_known = Dimension::ALL.into_iter().any(|dimension| dimension.has_unit(word));
        is_known || ["mm2", "J"].contains(&word)
    };
    let (rest, unit) = title.rsplit_once('_').filter(|(_, unit)| is_unit(unit))?;
    match rest.strip_suffix("_per") {
        None => Some(unit.to_owned()),
        Some(rest) => {
            let (_, over) = rest.rsplit_once('_').filter(|(_, over)| is_unit(over))?;
            Some(format!("{over}/{unit}"))
        }
    }
}

/// Returns the metadata file of the table at `path`.
#[must_use]
pub fn csv_metadata_file(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push("-metadata.json");
    PathBuf::from(name)
}

/// Describes tables in JSON, with a line break at the end.
#[must_use]
pub fn csv_metadata(tables: &[CsvTable]) -> Vec<u8> {
    let table = |table: &CsvTable| {
        let mut described = json!({
            "url": uri(&table.url),
            "dc:title": table.title,
            "dc:source": table.source,
            "dc:creator": software(),
        });
        if !table.header {
            described["dialect"] = json!({ "header": false });
        }
        if !table.columns.is_empty() {
            let columns: Vec<Value> = table.columns.iter().map(CsvColumn::described).collect();
            described["tableSchema"] = json!({ "columns": columns });
        }
        described
    };
    let mut root = json!({ "@context": "http://www.w3.org/ns/csvw" });
    match tables {
        [one] => {
            if let (Value::Object(root), Value::Object(one)) = (&mut root, table(one)) {
                root.extend(one);
            }
        }
        several => root["tables"] = several.iter().map(table).collect(),
    }
    format!("{root:#}\n").into_bytes()
}

/// Returns a path as a relative reference (RFC 3986): all bytes except letters, digits and `-._~/` are escaped.
#[must_use]
pub fn uri(path: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte);
    let each = |byte: u8| match plain(byte) {
        true => char::from(byte).to_string(),
        false => format!("%{byte:02X}"),
    };
    path.bytes().map(each).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn about(url: &str, header: bool) -> CsvTable {
        CsvTable {
            url: url.to_owned(),
            title: "quickstart: design".to_owned(),
            source: "ab12".to_owned(),
            header,
            columns: Vec::new(),
        }
    }

    #[test]
    fn columns_have_the_units_of_their_names() {
        let units = [
            ("pattern", None),
            ("voltage_V", Some("V")),
            ("largest_displacement_mm", Some("mm")),
            ("area_mm2", Some("mm2")),
            ("stored_J", Some("J")),
            ("amplitude_mm_per_V", Some("mm/V")),
            ("elements_per_cell", None),
            ("pixels_per_mm", None),
            ("pattern_file", None),
            ("mm", None),
        ];
        for (title, unit) in units {
            assert_eq!(CsvColumn::of_title(title).unit.as_deref(), unit, "{title}");
        }
        let table = CsvTable {
            columns: ["pattern", "voltage_V"].map(CsvColumn::of_title).to_vec(),
            ..about("path.csv", true)
        };
        let read: Value = serde_json::from_slice(&csv_metadata(&[table])).unwrap();
        let wanted = json!([
            { "name": "pattern", "titles": "pattern" },
            { "name": "voltage_V", "titles": "voltage_V", "schema:unitText": "V" },
        ]);
        assert_eq!(read["tableSchema"]["columns"], wanted);
    }

    #[test]
    fn one_table_is_described_at_the_top_and_several_in_a_list() {
        let read = |tables: &[CsvTable]| serde_json::from_slice::<Value>(&csv_metadata(tables)).unwrap();
        let one = read(&[about("designs.csv", true)]);
        let wanted = json!({
            "@context": "http://www.w3.org/ns/csvw", "url": "designs.csv", "dc:title": "quickstart: design",
            "dc:source": "ab12", "dc:creator": software(),
        });
        assert_eq!(one, wanted);
        let two = read(&[about("designs.csv", true), about("patterns/a.csv", false)]);
        assert_eq!(two["tables"][0]["url"], "designs.csv");
        assert_eq!(two["tables"][1]["dialect"], json!({ "header": false }));
        assert_eq!(read(&[about("t ü,x.csv", true)])["url"], "t%20%C3%BC%2Cx.csv");
        assert_eq!(
            csv_metadata_file(Path::new("a/b.csv")),
            Path::new("a/b.csv-metadata.json")
        );
    }
}
