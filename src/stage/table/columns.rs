//! The columns of a table, and the stages of each row.

use std::collections::{BTreeMap, BTreeSet};

use deaflow_base::{InputError, Node, NodeValue};

use crate::results::words_of;
use deaflow_orchestrator::suggestion;

/// The largest number of columns.
pub const MOST_COLUMNS: usize = 100;

/// The largest number of cells, which are in memory at once.
const MOST_CELLS: usize = 1_000_000;

/// A row: one combination of values.
pub struct Row {
    /// The axes with their values.
    pub axes: BTreeMap<String, Node>,
    /// Names of its stages in the file, with their indices in `needs`.
    pub needs: Vec<(String, usize)>,
}

/// A column.
pub struct Column {
    /// Its name.
    pub name: String,
    /// Its content.
    pub content: Content,
}

/// The content of a column.
pub enum Content {
    /// The value of an axis.
    Axis,
    /// A result of the stage of this name, or of the only stage that has it.
    Result {
        /// Name of the stage in the file.
        stage: Option<String>,
        /// Name of the result.
        result: String,
    },
}

/// Reads the rows that the orchestrator adds for a sweep.
///
/// # Errors
/// If they have another form.
pub fn rows(rows: Option<&Node>) -> Result<Vec<Row>, InputError> {
    let Some(rows) = rows else {
        return Ok(Vec::new());
    };
    let row = |node: &Node| {
        let [axes, needs] = node.list("a row")? else {
            return Err(node.error("a row has axes and needs"));
        };
        let axes = axes.entries("axes")?.iter();
        let needs = needs.entries("needs")?.iter();
        Ok(Row {
            axes: axes
                .map(|(key, value)| Ok((key.text("an axis")?.to_owned(), value.clone())))
                .collect::<Result<_, InputError>>()?,
            needs: needs
                .map(|(key, index)| {
                    Ok((
                        key.text("a stage")?.to_owned(),
                        index.integer("an index", 0, u64::MAX)? as usize,
                    ))
                })
                .collect::<Result<_, InputError>>()?,
        })
    };
    rows.list("rows")?.iter().map(row).collect()
}

/// Reads the kinds of the needs by stage name.
///
/// # Errors
/// If they have another form.
pub fn kinds(kinds: Option<&Node>) -> Result<BTreeMap<String, String>, InputError> {
    let entries = kinds.map(|kinds| kinds.entries("kinds")).transpose()?;
    let entries = entries.unwrap_or_default().iter();
    entries
        .map(|(name, kind)| Ok((name.text("a stage")?.to_owned(), kind.text("a kind")?.to_owned())))
        .collect()
}

/// Reads the columns from a list of names.
///
/// # Errors
/// If there are too many, a name is repeated or is neither an axis nor a result, or the values of an axis are lists or
/// mappings.
pub fn columns(node: &Node, rows: &[Row], kinds: &BTreeMap<String, String>) -> Result<Vec<Column>, InputError> {
    let names = node.list("columns")?;
    if !(1..=MOST_COLUMNS).contains(&names.len()) {
        return Err(node
            .error(format!("`columns` has {} names", names.len()))
            .help(format!("allowed: 1 to {MOST_COLUMNS}")));
    }
    let cells = rows.len() * names.len();
    if cells > MOST_CELLS {
        let message = format!(
            "the table has {} rows and {} columns: {cells} cells",
            rows.len(),
            names.len()
        );
        let help = format!("allowed: at most {MOST_CELLS} cells; name fewer columns, or use a table for each part");
        return Err(node.error(message).help(help));
    }
    let mut columns: Vec<Column> = Vec::with_capacity(names.len());
    for node in names {
        let name = node.text("a column")?;
        if columns.iter().any(|column| column.name == name) {
            return Err(node.error(format!("`columns` names {name} twice")));
        }
        columns.push(Column {
            name: name.to_owned(),
            content: content(node, name, rows, kinds)?,
        });
    }
    Ok(columns)
}

/// Finds the axis or the result of a name. If the part before the first dot is the name of a need, the result is of
/// that stage.
fn content(node: &Node, name: &str, rows: &[Row], kinds: &BTreeMap<String, String>) -> Result<Content, InputError> {
    let mut values = rows.iter().filter_map(|row| row.axes.get(name)).peekable();
    if values.peek().is_some() {
        return match values.find(|value| matches!(value.value(), NodeValue::List(_) | NodeValue::Map(_))) {
            Some(_) => Err(node
                .error(format!("the values of `{name}` are lists or mappings"))
                .help("zip them with an axis of words or numbers, and use that one as the column")),
            None => Ok(Content::Axis),
        };
    }
    let is_need = |stage: &str| rows.iter().flat_map(|row| &row.needs).any(|(need, _)| need == stage);
    let named = name.split_once('.').filter(|(stage, _)| is_need(stage));
    let (stage, result) = named.map_or((None, name), |(stage, result)| (Some(stage), result));
    let of = kinds
        .iter()
        .filter(|(need, _)| stage.is_none_or(|stage| stage == *need));
    let of: Vec<(&str, &[&str])> = of.map(|(need, kind)| (need.as_str(), words_of(kind))).collect();
    let word = result.split('.').next().unwrap_or(result);
    let having: Vec<&str> = of
        .iter()
        .filter(|(_, words)| words.contains(&word))
        .map(|(need, _)| *need)
        .collect();
    match &having[..] {
        // The results of a kind without words are not known.
        [] if !of.is_empty() && of.iter().all(|(_, words)| !words.is_empty()) => {
            let axes = rows.iter().flat_map(|row| row.axes.keys().map(String::as_str));
            let words = of.iter().flat_map(|(_, words)| words.iter().copied());
            let known: BTreeSet<&str> = match stage {
                None => axes.chain(words).collect(),
                Some(_) => words.collect(),
            };
            let known: Vec<&str> = known.into_iter().collect();
            let message = format!("`{name}` is neither an axis nor a result of a needed stage");
            Err(node.error(message).help(suggestion(result, &known)))
        }
        [_, _, ..] => {
            let names: Vec<String> = having.iter().map(|need| format!("{need}.{result}")).collect();
            let message = format!("`{name}` is a result of {}", having.join(" and "));
            Err(node.error(message).help(format!("write {}", names.join(" or "))))
        }
        _ => Ok(Content::Result {
            stage: stage.map(str::to_owned),
            result: result.to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    #[test]
    fn a_table_of_too_many_cells_is_refused_with_its_position() {
        let names: Vec<String> = (0..MOST_COLUMNS).map(|at| format!("axis{at}")).collect();
        let text = format!("columns: [{}]\n", names.join(", "));
        let document = Document::from_text(Path::new("p.yaml"), &text).unwrap();
        let node = document.root.peek("columns").unwrap();
        let rows = |count: usize| -> Vec<Row> {
            let axes: BTreeMap<String, Node> = names
                .iter()
                .map(|name| (name.clone(), node.list("columns").unwrap()[0].clone()))
                .collect();
            let row = |_| Row {
                axes: axes.clone(),
                needs: Vec::new(),
            };
            (0..count).map(row).collect()
        };
        assert_eq!(columns(node, &rows(10), &BTreeMap::new()).unwrap().len(), MOST_COLUMNS);
        let mut many = rows(1);
        many.resize_with(MOST_CELLS / MOST_COLUMNS + 1, || Row {
            axes: BTreeMap::new(),
            needs: Vec::new(),
        });
        let refused = columns(node, &many, &BTreeMap::new()).err().unwrap().to_string();
        assert!(
            refused.contains("the table has 10001 rows and 100 columns: 1000100 cells"),
            "{refused}"
        );
    }
}
