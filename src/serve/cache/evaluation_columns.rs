//! What an evaluation says of each pattern: the errors of each predictor, and in which set the pattern stands.

use crate::http::Refusal;
use deaflow_content::SOLVED;
use deaflow_dataset::Split;
use deaflow_report::{RowColumn, Rows};
use deaflow_store::{Artifact, Content, Data, Store, StoreError};

/// Predictors that have columns.
const MOST: usize = 16;

/// Columns of the arrays that have a value for each of a few things and each row: `pattern/rms.0_mm` is that of the first predictor.
///
/// # Errors
/// When one cannot be read.
pub fn by_predictor(artifact: &Artifact, rows: &Rows) -> Result<Vec<RowColumn>, Refusal> {
    let contents = artifact.contents()?;
    let is_meant = |content: &&Content| {
        matches!(content.axes.as_slice(), [first, second] if *first != rows.axis && *second == rows.axis)
            && content.shape[1] == rows.len()
            && content.shape[0] <= MOST
    };
    let mut found = Vec::new();
    for content in contents.iter().filter(is_meant) {
        // Texts that name the places of the first axis have its name.
        let of_axis = contents
            .iter()
            .any(|other| other.path == content.axes[0] && other.shape == content.shape[..1]);
        let names = match of_axis {
            true => match artifact.read(&content.axes[0])?.data {
                Data::Text(names) => names,
                _ => Vec::new(),
            },
            false => Vec::new(),
        };
        let data = artifact.read(&content.path)?.data;
        let unit = match content.units.as_str() {
            "" | "1" => String::new(),
            unit => format!("_{unit}"),
        };
        for at in 0..content.shape[0] {
            let of = names.get(at).map_or_else(String::new, |name| format!(" Of {name}."));
            found.push(RowColumn {
                name: format!("{}.{at}{unit}", content.path),
                description: format!("{}{of}", content.description),
                values: slice(&data, at * rows.len(), rows.len()),
            });
        }
    }
    Ok(found)
}

fn slice(data: &Data, from: usize, count: usize) -> Data {
    let range = from..from + count;
    match data {
        Data::U8(v) => Data::U8(v[range].to_vec()),
        Data::U32(v) => Data::U32(v[range].to_vec()),
        Data::U64(v) => Data::U64(v[range].to_vec()),
        Data::F32(v) => Data::F32(v[range].to_vec()),
        Data::F64(v) => Data::F64(v[range].to_vec()),
        Data::Text(v) => Data::Text(v[range].to_vec()),
    }
}

/// The set that each pattern of an evaluation stands in, and its row there; none where that is not known.
///
/// # Errors
/// When a set is damaged.
pub fn sources(store: &Store, artifact: &Artifact, rows: &Rows) -> Result<Vec<RowColumn>, Refusal> {
    let families = rows.columns.iter().find(|column| column.name == "pattern/family");
    let (Some(families), "evaluate") = (families, artifact.kind()) else {
        return Ok(Vec::new());
    };
    let (mut sets, mut places, mut known) = (Vec::new(), Vec::new(), Vec::new());
    let provenance = artifact.provenance()?;
    let inputs = provenance.get("inputs").map_or("", String::as_str).lines();
    for digest in inputs.filter_map(|input| input.parse().ok()) {
        let input = match store.artifact(&digest) {
            Ok(input) => input,
            Err(StoreError::Missing { .. }) => return Ok(Vec::new()),
            Err(error) => return Err(error.into()),
        };
        let is_balanced = input.kind() == "balance";
        if !is_balanced && !SOLVED.contains(&input.kind()) {
            continue;
        }
        let own = texts(&input, "family")?;
        let splits = if is_balanced {
            texts(&input, "split")?
        } else {
            Vec::new()
        };
        // Of a balanced set the rows are judged that were kept for tests.
        let judged = own
            .into_iter()
            .enumerate()
            .filter(|(row, _)| !is_balanced || splits.get(*row).is_some_and(|split| split == Split::Test.name()));
        for (row, family) in judged {
            sets.push(digest.short().to_string());
            places.push(row as u64);
            known.push(family);
        }
    }
    // Sets are judged in their order, so that families tell whether these are they.
    if Data::Text(known) != families.values {
        return Ok(Vec::new());
    }
    let column = |name: &str, description: &str, values| RowColumn {
        name: name.to_owned(),
        description: description.to_owned(),
        values,
    };
    Ok(vec![
        column("set", "The set that the pattern stands in.", Data::Text(sets)),
        column("set_row", "Its row there.", Data::U64(places)),
    ])
}

fn texts(artifact: &Artifact, path: &str) -> Result<Vec<String>, Refusal> {
    match artifact.read(path)?.data {
        Data::Text(texts) => Ok(texts),
        _ => Ok(Vec::new()),
    }
}
