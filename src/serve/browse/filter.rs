//! Filters of table rows: `max_displacement_mm > 1.5 and family = bezier`.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use crate::http::ApiError;
use deaflow_base::{Dimension, Quantity, nearest};
use deaflow_report::RowColumn;
use deaflow_store::Data;

/// Conditions in one filter.
const MAX_CONDITIONS: usize = 32;

/// Texts of a column that are listed in a hint.
const MAX_LISTED: usize = 30;

/// Comparisons, the longer signs first, so that `<=` is not read as `<`.
const COMPARISONS: [(&str, Comparison); 7] = [
    ("!=", Comparison::Differs),
    ("<=", Comparison::AtMost),
    (">=", Comparison::AtLeast),
    ("=", Comparison::Equals),
    ("<", Comparison::Below),
    (">", Comparison::Above),
    ("~", Comparison::Contains),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Comparison {
    Equals,
    Differs,
    Below,
    AtMost,
    Above,
    AtLeast,
    Contains,
}

impl Comparison {
    fn holds(self, order: Option<Ordering>) -> bool {
        match self {
            Self::Equals => order == Some(Ordering::Equal),
            Self::Differs => order != Some(Ordering::Equal),
            Self::Below => order == Some(Ordering::Less),
            Self::AtMost => matches!(order, Some(Ordering::Less | Ordering::Equal)),
            Self::Above => order == Some(Ordering::Greater),
            Self::AtLeast => matches!(order, Some(Ordering::Greater | Ordering::Equal)),
            Self::Contains => false,
        }
    }
}

/// The name of the row number in a filter, if no column has it.
const ROW: &str = "row";

/// Returns the numbers of the rows that satisfy all conditions.
///
/// # Errors
/// If a condition is malformed, or names an unknown column.
pub fn matching(columns: &[RowColumn], count: usize, filter: &str) -> Result<Vec<usize>, ApiError> {
    let mut rows: Vec<usize> = (0..count).collect();
    let conditions = conditions(filter)?;
    for (name, comparison, value) in conditions {
        if is_row(columns, name) {
            let number = parse_number(name, comparison, value)?;
            rows.retain(|&row| comparison.holds((row as f64).partial_cmp(&number)));
            continue;
        }
        let column = column(columns, name)?;
        match &column.values {
            Data::Text(texts) if comparison == Comparison::Contains => rows.retain(|&row| texts[row].contains(value)),
            Data::Text(texts) => rows.retain(|&row| comparison.holds(Some(texts[row].as_str().cmp(value)))),
            numbers => {
                let number = parse_number(name, comparison, value)?;
                rows.retain(|&row| comparison.holds(number_at(numbers, row).partial_cmp(&number)));
            }
        }
    }
    Ok(rows)
}

fn is_row(columns: &[RowColumn], name: &str) -> bool {
    name == ROW && columns.iter().all(|column| column.name != ROW)
}

/// The column of the area fraction, which may be given in percent.
const AREA: &str = "area";

/// Parses the number that a column is compared with; in a column in mm it may have a unit, and an area may be in
/// percent.
fn parse_number(name: &str, comparison: Comparison, value: &str) -> Result<f64, ApiError> {
    if comparison == Comparison::Contains {
        return Err(ApiError::bad_request(format!(
            "{name} has numbers; `~` works only with texts"
        )));
    }
    let last = name.rsplit('/').next().unwrap_or(name);
    let (number, help) = if name.ends_with("_mm") {
        let length = || Some(Quantity::parse(value, Dimension::Length).ok()?.value());
        (
            value.parse().ok().or_else(length),
            "give a length: 1.5, 1.5 mm or 250 um",
        )
    } else if last == AREA {
        let fraction = || Some(value.strip_suffix('%')?.trim_end().parse::<f64>().ok()? / 100.0);
        (
            value.parse().ok().or_else(fraction),
            "give an area, a share of the free membrane: 0.4 or 40 %",
        )
    } else {
        (value.parse().ok(), "give a number without a unit")
    };
    number.ok_or_else(|| ApiError::bad_request(format!("{name} has numbers; {value:?} is not a number")).help(help))
}

/// A text that the filter asks for and no row has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownText {
    /// The column.
    pub column: String,
    /// The text.
    pub value: String,
    /// Texts of the column.
    pub known: Vec<String>,
}

/// Finds the texts in a filter that no row has.
///
/// # Errors
/// As [`matching`].
pub fn unknown_texts(columns: &[RowColumn], filter: &str) -> Result<Vec<UnknownText>, ApiError> {
    let mut found = Vec::new();
    for (name, comparison, value) in conditions(filter)? {
        if is_row(columns, name) {
            continue;
        }
        let Data::Text(texts) = &column(columns, name)?.values else {
            continue;
        };
        if comparison == Comparison::Equals && texts.iter().all(|text| text != value) {
            let known: BTreeSet<&String> = texts.iter().collect();
            found.push(UnknownText {
                column: name.to_owned(),
                value: value.to_owned(),
                known: known.into_iter().take(MAX_LISTED).cloned().collect(),
            });
        }
    }
    Ok(found)
}

/// Returns the column with a name.
///
/// # Errors
/// If there is none.
pub fn column<'c>(columns: &'c [RowColumn], name: &str) -> Result<&'c RowColumn, ApiError> {
    columns.iter().find(|column| column.name == name).ok_or_else(|| {
        let known: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        let list = known.join(", ");
        // Names are in lower case, and a column of a group has the name of the group before its own.
        let lower = name.to_ascii_lowercase();
        let last: Vec<&str> = known
            .iter()
            .map(|name| name.rsplit('/').next().unwrap_or(name))
            .collect();
        let near = nearest(&lower, &known).or_else(|| {
            let near = nearest(&lower, &last)?;
            last.iter().position(|name| *name == near).map(|at| known[at])
        });
        ApiError::bad_request(format!("unknown column {name:?}")).help(match near {
            Some(near) => format!("did you mean {near}? columns: {list}"),
            None => format!("columns: {list}"),
        })
    })
}

/// Returns a number of a column; NaN for texts.
#[must_use]
pub fn number_at(data: &Data, row: usize) -> f64 {
    match data {
        Data::U8(v) => f64::from(v[row]),
        Data::U32(v) => f64::from(v[row]),
        Data::U64(v) => v[row] as f64,
        Data::F32(v) => f64::from(v[row]),
        Data::F64(v) => v[row],
        Data::Text(_) => f64::NAN,
    }
}

/// Syntax of a filter.
const HELP: &str = "conditions are COLUMN = VALUE, with = != < <= > >= or ~ (contains), joined by `and`; put a value \
                    that has such a sign or word into quotes: family = \"this or that\"";

fn conditions(filter: &str) -> Result<Vec<(&str, Comparison, &str)>, ApiError> {
    let mut found = Vec::new();
    for condition in parts(filter)? {
        let first = COMPARISONS.iter().filter_map(|(sign, comparison)| {
            let at = condition.find(sign)?;
            Some((at, usize::MAX - sign.len(), *sign, *comparison))
        });
        let first = first.min_by_key(|(at, length, _, _)| (*at, *length));
        let Some((at, _, sign, comparison)) = first else {
            return Err(ApiError::bad_request(format!("{condition:?} has no comparison")).help(HELP));
        };
        let written = condition[at + sign.len()..].trim();
        let quoted = written.strip_prefix('"').and_then(|value| value.strip_suffix('"'));
        if quoted.is_none() && written.starts_with('"') {
            return Err(ApiError::bad_request(format!("{written} has no closing quote")).help(HELP));
        }
        if quoted.is_none() && written.contains(['=', '<', '>', '~', '&', '|']) {
            return Err(ApiError::bad_request(format!("{written:?} is not a valid value")).help(HELP));
        }
        found.push((condition[..at].trim(), comparison, quoted.unwrap_or(written)));
        if found.len() > MAX_CONDITIONS {
            return Err(ApiError::bad_request(format!(
                "a filter has at most {MAX_CONDITIONS} conditions"
            )));
        }
    }
    Ok(found)
}

/// Splits a filter at the words `and`, in upper or lower case, outside of quotes.
fn parts(filter: &str) -> Result<Vec<&str>, ApiError> {
    let (mut found, mut start) = (Vec::new(), 0);
    for (at, word) in words(filter) {
        match word.to_ascii_lowercase().as_str() {
            "and" => {
                found.push(filter[start..at].trim());
                start = at + word.len();
            }
            "or" => {
                return Err(ApiError::bad_request("filters do not support `or`: all conditions must hold").help(HELP));
            }
            _ => {}
        }
    }
    found.push(filter[start..].trim());
    found.retain(|condition| !condition.is_empty());
    Ok(found)
}

/// Returns the words outside of quotes with their positions.
fn words(text: &str) -> Vec<(usize, &str)> {
    let (mut found, mut start, mut is_quoted) = (Vec::new(), None, false);
    for (at, character) in text.char_indices() {
        if character == '"' {
            is_quoted = !is_quoted;
        }
        match (character.is_whitespace() && !is_quoted, start) {
            (true, Some(from)) => {
                found.push((from, &text[from..at]));
                start = None;
            }
            (false, None) => start = Some(at),
            _ => {}
        }
    }
    found.extend(start.map(|from| (from, &text[from..])));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<RowColumn> {
        let column = |name: &str, values: Data| RowColumn {
            name: name.to_owned(),
            description: String::new(),
            values,
        };
        vec![
            column("u_mm", Data::F64(vec![0.5, 1.5, 2.5, f64::NAN])),
            column("family", Data::Text(["a", "ab", "b", "a"].map(str::to_owned).into())),
            column("units", Data::U64(vec![2, 3, 2, 2])),
            column("area", Data::F64(vec![0.1, 0.4, 0.5, 0.9])),
        ]
    }

    #[test]
    fn conditions_select_rows() {
        let rows = |filter: &str| matching(&columns(), 4, filter).unwrap();
        assert_eq!(rows(""), [0, 1, 2, 3]);
        assert_eq!(rows("u_mm > 1"), [1, 2]);
        assert_eq!(rows("u_mm>=1.5 and family=b"), [2]);
        assert_eq!(rows("u_mm <= 1.5"), [0, 1]);
        assert_eq!(rows("u_mm != 0.5"), [1, 2, 3]);
        assert_eq!(rows("family ~ a and units = 2"), [0, 3]);
        assert_eq!(rows("family = \"ab\""), [1]);
        // `row` is the row number, and a column in mm may be compared with a length.
        assert_eq!(rows("row >= 2"), [2, 3]);
        assert_eq!(rows("u_mm > 0.1 cm and row < 2"), [1]);
        // An area may be in percent, other columns may not.
        assert_eq!(rows("area >= 40 % and area < 50%"), [1]);
        let refused = |filter: &str| matching(&columns(), 4, filter).unwrap_err().message_with_help();
        assert!(refused("units = 2 %").ends_with("a number without a unit"));
        assert!(refused("u_mm > 2 V").contains("250 um"));
        assert!(refused("AREA > 0.4").contains("did you mean area?"));
        assert!(refused("famly = a").contains("did you mean family?"));
        assert!(!refused("nothing = 1").contains("did you mean"));
    }

    #[test]
    fn conditions_are_joined_by_and_in_upper_or_lower_case_only() {
        let rows = |filter: &str| matching(&columns(), 4, filter).unwrap();
        for filter in [
            "u_mm > 1 and family = b",
            "u_mm > 1 AND family = b",
            "u_mm > 1\tAnd family = b and ",
        ] {
            assert_eq!(rows(filter), [2], "{filter}");
        }
        let refused = |filter: &str| matching(&columns(), 4, filter).unwrap_err().message_with_help();
        for filter in ["family = a or family = b", "family = a OR u_mm > 1", "u_mm > 1 or"] {
            let message = refused(filter);
            assert!(
                message.contains("`or`") && message.contains("`and`"),
                "{filter}: {message}"
            );
        }
        for filter in [
            "family = a && u_mm > 1",
            "family = a || family = b",
            "family = a family = b",
        ] {
            assert!(refused(filter).contains("not a valid value"), "{filter}");
        }
        assert!(refused("family = \"bez").contains("no closing quote"));
        // In quotes they belong to the value.
        let found = unknown_texts(&columns(), "family = \"this or that and more\" and units = 2").unwrap();
        assert_eq!((found.len(), &*found[0].value), (1, "this or that and more"));
    }

    #[test]
    fn a_text_that_no_row_has_is_reported_with_those_of_the_column() {
        let unknown = |filter: &str| unknown_texts(&columns(), filter).unwrap();
        let known = ["a", "ab", "b"].map(str::to_owned).to_vec();
        let found = unknown("family = nope and units = 2");
        assert_eq!(found.len(), 1);
        assert_eq!((&*found[0].column, &*found[0].value), ("family", "nope"));
        assert_eq!(found[0].known, known);
        for filter in ["", "family = a", "family != nope", "family ~ nope", "u_mm = 7"] {
            assert!(unknown(filter).is_empty(), "{filter}");
        }
    }

    #[test]
    fn invalid_conditions_are_refused() {
        for filter in [
            "u_mm",
            "nothing = 1",
            "u_mm = many",
            "units ~ 2",
            "= 3",
            &"units = 2 and ".repeat(40),
        ] {
            assert!(matching(&columns(), 4, filter).is_err(), "{filter}");
        }
    }
}
