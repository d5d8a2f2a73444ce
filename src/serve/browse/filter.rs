//! Which rows of a table are wanted: `max_displacement_mm > 1.5 and family = bezier`.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use crate::http::Refusal;
use deaflow_base::{Dimension, Quantity, nearest};
use deaflow_report::RowColumn;
use deaflow_store::Data;

/// Conditions in one filter.
const MOST: usize = 32;

/// Texts of a column that are told where one is not among them.
const MOST_KNOWN: usize = 30;

/// Comparisons, the longer ones first, so that none is taken for another.
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

/// The name by which the number of a row is compared, where no column has it.
const ROW: &str = "row";

/// The rows, by their numbers, of which all conditions hold.
///
/// # Errors
/// When a condition is malformed, or there is no column of its name.
pub fn matching(columns: &[RowColumn], count: usize, filter: &str) -> Result<Vec<usize>, Refusal> {
    let mut rows: Vec<usize> = (0..count).collect();
    let conditions = conditions(filter)?;
    for (name, comparison, value) in conditions {
        if is_row(columns, name) {
            let wanted = wanted(name, comparison, value)?;
            rows.retain(|&row| comparison.holds((row as f64).partial_cmp(&wanted)));
            continue;
        }
        let column = column(columns, name)?;
        match &column.values {
            Data::Text(texts) if comparison == Comparison::Contains => rows.retain(|&row| texts[row].contains(value)),
            Data::Text(texts) => rows.retain(|&row| comparison.holds(Some(texts[row].as_str().cmp(value)))),
            numbers => {
                let wanted = wanted(name, comparison, value)?;
                rows.retain(|&row| comparison.holds(number(numbers, row).partial_cmp(&wanted)));
            }
        }
    }
    Ok(rows)
}

fn is_row(columns: &[RowColumn], name: &str) -> bool {
    name == ROW && columns.iter().all(|column| column.name != ROW)
}

/// The column of the area fraction, which may be written in per cent.
const AREA: &str = "area";

/// The number that a column is compared with; of a column in mm it may have a unit, and an area may be in per cent.
fn wanted(name: &str, comparison: Comparison, value: &str) -> Result<f64, Refusal> {
    if comparison == Comparison::Contains {
        return Err(Refusal::bad(format!("{name} is a number: ~ looks into texts")));
    }
    let last = name.rsplit('/').next().unwrap_or(name);
    let (found, help) = if name.ends_with("_mm") {
        let length = || Some(Quantity::parse(value, Dimension::Length).ok()?.value());
        (
            value.parse().ok().or_else(length),
            "a length, as in 1.5, 1.5 mm or 250 um",
        )
    } else if last == AREA {
        let share = || Some(value.strip_suffix('%')?.trim_end().parse::<f64>().ok()? / 100.0);
        (value.parse().ok().or_else(share), "a share, as in 0.4 or 40 %")
    } else {
        (value.parse().ok(), "a number without a unit")
    };
    found.ok_or_else(|| Refusal::bad(format!("{name} is a number, and {value:?} is none")).help(help))
}

/// A text that a column is to equal, and which no row has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unknown {
    /// The column.
    pub column: String,
    /// The text.
    pub value: String,
    /// Texts that there are.
    pub known: Vec<String>,
}

/// The texts in a filter that no row has.
///
/// # Errors
/// As [`matching`].
pub fn unknown(columns: &[RowColumn], filter: &str) -> Result<Vec<Unknown>, Refusal> {
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
            found.push(Unknown {
                column: name.to_owned(),
                value: value.to_owned(),
                known: known.into_iter().take(MOST_KNOWN).cloned().collect(),
            });
        }
    }
    Ok(found)
}

/// The column of a name.
///
/// # Errors
/// When there is none.
pub fn column<'c>(columns: &'c [RowColumn], name: &str) -> Result<&'c RowColumn, Refusal> {
    columns.iter().find(|column| column.name == name).ok_or_else(|| {
        let known: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        let list = known.join(", ");
        // Columns are named by small letters, and those of a group have its name before their own.
        let lower = name.to_ascii_lowercase();
        let last: Vec<&str> = known
            .iter()
            .map(|name| name.rsplit('/').next().unwrap_or(name))
            .collect();
        let near = nearest(&lower, &known).or_else(|| {
            let near = nearest(&lower, &last)?;
            last.iter().position(|name| *name == near).map(|at| known[at])
        });
        Refusal::bad(format!("there is no column {name:?}")).help(match near {
            Some(near) => format!("did you mean {near}? columns: {list}"),
            None => format!("columns: {list}"),
        })
    })
}

/// A number in a column of numbers.
#[must_use]
pub fn number(data: &Data, row: usize) -> f64 {
    match data {
        Data::U8(v) => f64::from(v[row]),
        Data::U32(v) => f64::from(v[row]),
        Data::U64(v) => v[row] as f64,
        Data::F32(v) => f64::from(v[row]),
        Data::F64(v) => v[row],
        Data::Text(_) => f64::NAN,
    }
}

/// What joins conditions, and what a condition is, for who has written another.
const HELP: &str = "conditions are COLUMN = VALUE, with = != < <= > >= or ~ (contains), joined by `and`; a value with such a sign or word in it \
                    stands in quotes: family = \"this or that\"";

fn conditions(filter: &str) -> Result<Vec<(&str, Comparison, &str)>, Refusal> {
    let mut found = Vec::new();
    for condition in parts(filter)? {
        let first = COMPARISONS.iter().filter_map(|(sign, comparison)| {
            let at = condition.find(sign)?;
            Some((at, usize::MAX - sign.len(), *sign, *comparison))
        });
        let first = first.min_by_key(|(at, length, _, _)| (*at, *length));
        let Some((at, _, sign, comparison)) = first else {
            return Err(Refusal::bad(format!("{condition:?} compares nothing")).help(HELP));
        };
        let written = condition[at + sign.len()..].trim();
        let quoted = written.strip_prefix('"').and_then(|value| value.strip_suffix('"'));
        if quoted.is_none() && written.starts_with('"') {
            return Err(Refusal::bad(format!("{written} has no closing quote")).help(HELP));
        }
        if quoted.is_none() && written.contains(['=', '<', '>', '~', '&', '|']) {
            return Err(Refusal::bad(format!("{written:?} is no value")).help(HELP));
        }
        found.push((condition[..at].trim(), comparison, quoted.unwrap_or(written)));
        if found.len() > MOST {
            return Err(Refusal::bad(format!("a filter has at most {MOST} conditions")));
        }
    }
    Ok(found)
}

/// The texts between the words `and`, in capitals or not; what stands in quotes is no such word.
fn parts(filter: &str) -> Result<Vec<&str>, Refusal> {
    let (mut found, mut start) = (Vec::new(), 0);
    for (at, word) in words(filter) {
        match word.to_ascii_lowercase().as_str() {
            "and" => {
                found.push(filter[start..at].trim());
                start = at + word.len();
            }
            "or" => return Err(Refusal::bad("`or` is no word of a filter: all conditions have to hold").help(HELP)),
            _ => {}
        }
    }
    found.push(filter[start..].trim());
    found.retain(|condition| !condition.is_empty());
    Ok(found)
}

/// The words outside of quotes, between white space, with their places.
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
        // The number of a row is no column, and a column in mm may be compared with a length.
        assert_eq!(rows("row >= 2"), [2, 3]);
        assert_eq!(rows("u_mm > 0.1 cm and row < 2"), [1]);
        // An area may be in per cent, and nothing else.
        assert_eq!(rows("area >= 40 % and area < 50%"), [1]);
        let refused = |filter: &str| matching(&columns(), 4, filter).unwrap_err().words();
        assert!(refused("units = 2 %").ends_with("a number without a unit"));
        assert!(refused("u_mm > 2 V").contains("250 um"));
        assert!(refused("AREA > 0.4").contains("did you mean area?"));
        assert!(refused("famly = a").contains("did you mean family?"));
        assert!(!refused("nothing = 1").contains("did you mean"));
    }

    #[test]
    fn the_word_that_joins_may_be_in_capitals_and_no_other_is_taken_for_a_value() {
        let rows = |filter: &str| matching(&columns(), 4, filter).unwrap();
        for filter in [
            "u_mm > 1 and family = b",
            "u_mm > 1 AND family = b",
            "u_mm > 1\tAnd family = b and ",
        ] {
            assert_eq!(rows(filter), [2], "{filter}");
        }
        let refused = |filter: &str| matching(&columns(), 4, filter).unwrap_err().words();
        for filter in ["family = a or family = b", "family = a OR u_mm > 1", "u_mm > 1 or"] {
            let told = refused(filter);
            assert!(
                told.contains("`or` is no word") && told.contains("`and`"),
                "{filter}: {told}"
            );
        }
        for filter in [
            "family = a && u_mm > 1",
            "family = a || family = b",
            "family = a family = b",
        ] {
            assert!(refused(filter).contains("is no value"), "{filter}");
        }
        assert!(refused("family = \"bez").contains("no closing quote"));
        // In quotes they are of the value.
        let found = unknown(&columns(), "family = \"this or that and more\" and units = 2").unwrap();
        assert_eq!((found.len(), &*found[0].value), (1, "this or that and more"));
    }

    #[test]
    fn a_text_that_no_row_has_is_told_with_those_that_there_are() {
        let told = |filter: &str| unknown(&columns(), filter).unwrap();
        let known = ["a", "ab", "b"].map(str::to_owned).to_vec();
        let found = told("family = nope and units = 2");
        assert_eq!(found.len(), 1);
        assert_eq!((&*found[0].column, &*found[0].value), ("family", "nope"));
        assert_eq!(found[0].known, known);
        for filter in ["", "family = a", "family != nope", "family ~ nope", "u_mm = 7"] {
            assert!(told(filter).is_empty(), "{filter}");
        }
    }

    #[test]
    fn what_is_no_condition_is_refused() {
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
