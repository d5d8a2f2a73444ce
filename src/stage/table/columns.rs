//! What stands in the columns of a table, and which stages belong to a row.

use std::collections::BTreeMap;

use crate::base::{InputError, Node, NodeValue};

use super::MOST_COLUMNS;

/// A row: one combination of values.
pub struct Row {
    /// The axes with their values.
    pub axes: BTreeMap<String, Node>,
    /// Places of the stages among the needs, by their names in the file.
    pub needs: Vec<(String, usize)>,
}

/// A column.
pub struct Column {
    /// Its name.
    pub name: String,
    /// What stands in it.
    pub what: What,
}

/// What stands in a column.
pub enum What {
    /// The value of an axis.
    Axis,
    /// A result of the stage of this name, or of the one stage that has it.
    Result {
        /// Name of the stage in the file.
        stage: Option<String>,
        /// Name of the result.
        result: String,
    },
}

/// The rows as the sweep gives them.
///
/// # Errors
/// When they have another form.
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
                .map(|(key, place)| {
                    Ok((
                        key.text("a stage")?.to_owned(),
                        place.integer("a place", 0, u64::MAX)? as usize,
                    ))
                })
                .collect::<Result<_, InputError>>()?,
        })
    };
    rows.list("rows")?.iter().map(row).collect()
}

/// The columns of a list of names.
///
/// # Errors
/// When a name is there twice, or an axis has values that are no words or numbers.
pub fn columns(node: &Node, rows: &[Row]) -> Result<Vec<Column>, InputError> {
    let names = node.list("columns")?;
    if !(1..=MOST_COLUMNS).contains(&names.len()) {
        return Err(node
            .error(format!("`columns` has {} names", names.len()))
            .help(format!("allowed: 1 to {MOST_COLUMNS}")));
    }
    let mut columns: Vec<Column> = Vec::with_capacity(names.len());
    for node in names {
        let name = node.text("a column")?;
        if columns.iter().any(|column| column.name == name) {
            return Err(node.error(format!("`columns` names {name} twice")));
        }
        columns.push(Column {
            name: name.to_owned(),
            what: what(node, name, rows)?,
        });
    }
    Ok(columns)
}

/// An axis, or else a result. A word before a dot that is the name of a need says whose.
fn what(node: &Node, name: &str, rows: &[Row]) -> Result<What, InputError> {
    let mut values = rows.iter().filter_map(|row| row.axes.get(name)).peekable();
    if values.peek().is_some() {
        return match values.find(|value| matches!(value.value(), NodeValue::List(_) | NodeValue::Map(_))) {
            Some(_) => Err(node
                .error(format!("the values of `{name}` are lists or mappings"))
                .help("zip them with an axis of words or numbers, and name that")),
            None => Ok(What::Axis),
        };
    }
    let is_need = |stage: &str| rows.iter().flat_map(|row| &row.needs).any(|(need, _)| need == stage);
    Ok(match name.split_once('.').filter(|(stage, _)| is_need(stage)) {
        Some((stage, result)) => What::Result {
            stage: Some(stage.to_owned()),
            result: result.to_owned(),
        },
        None => What::Result {
            stage: None,
            result: name.to_owned(),
        },
    })
}
