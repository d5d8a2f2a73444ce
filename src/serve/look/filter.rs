//! Which rows of a table are wanted: `max_displacement_mm > 1.5 and family = bezier`.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use crate::report::RowColumn;
use crate::serve::http::Refusal;
use crate::store::Data;

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

/// The rows, by their numbers, of which all conditions hold.
///
/// # Errors
/// When a condition is malformed, or there is no column of its name.
pub fn matching(columns: &[RowColumn], count: usize, filter: &str) -> Result<Vec<usize>, Refusal> {
    let mut rows: Vec<usize> = (0..count).collect();
    let conditions = conditions(filter)?;
    for (name, comparison, value) in conditions {
        let column = column(columns, name)?;
        match &column.values {
            Data::Text(texts) if comparison == Comparison::Contains => rows.retain(|&row| texts[row].contains(value)),
            Data::Text(texts) => rows.retain(|&row| comparison.holds(Some(texts[row].as_str().cmp(value)))),
            numbers => {
                let wanted: f64 = value.parse().map_err(|_| {
                    Refusal::bad(format!("{name} is a number, and {value:?} is none"))
                        .help("as in max_displacement_mm > 1.5")
                })?;
                if comparison == Comparison::Contains {
                    return Err(Refusal::bad(format!("{name} is a number: ~ looks into texts")));
                }
                rows.retain(|&row| comparison.holds(number(numbers, row).partial_cmp(&wanted)));
            }
        }
    }
    Ok(rows)
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
        Refusal::bad(format!("there is no column {name:?}")).help(format!("columns: {}", known.join(", ")))
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

fn conditions(filter: &str) -> Result<Vec<(&str, Comparison, &str)>, Refusal> {
    let mut found = Vec::new();
    for condition in filter
        .split(" and ")
        .map(str::trim)
        .filter(|condition| !condition.is_empty())
    {
        let first = COMPARISONS.iter().filter_map(|(sign, comparison)| {
            let at = condition.find(sign)?;
            Some((at, usize::MAX - sign.len(), *sign, *comparison))
        });
        let first = first.min_by_key(|(at, length, _, _)| (*at, *length));
        let Some((at, _, sign, comparison)) = first else {
            return Err(Refusal::bad(format!("{condition:?} compares nothing"))
                .help("conditions are COLUMN = VALUE, with = != < <= > >= or ~ (contains), joined by ` and `"));
        };
        let value = condition[at + sign.len()..].trim();
        let value = value
            .strip_prefix('"')
            .and_then(|value| value.strip_suffix('"'))
            .unwrap_or(value);
        found.push((condition[..at].trim(), comparison, value));
        if found.len() > MOST {
            return Err(Refusal::bad(format!("a filter has at most {MOST} conditions")));
        }
    }
    Ok(found)
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
