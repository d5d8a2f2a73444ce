//! Metadata of CSV files, in a separate file as defined by [CSV on the
//! Web](https://www.w3.org/TR/tabular-data-primer/): many programs would read a comment in the CSV file as a row.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::program::software;

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
        }
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
