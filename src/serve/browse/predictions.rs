//! What a network predicts of patterns whose fields are known: those of a part of its own set, and any row that is asked for.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde_json::{Value, json};

use super::artifacts::named;
use super::neighbours::{cells_of, patterns};
use super::pick::elements;
use crate::http::{Answer, Array, Refusal, Request, frame};
use crate::state::ServedState;
use deaflow_base::ArtifactId;
use deaflow_content::{ALL_FAMILIES, Balanced, Training};
use deaflow_dataset::Split;
use deaflow_field::{Field, Predictor};
use deaflow_pattern::{Pattern, PatternForm};
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_store::{Artifact, Content, Data, Store, StoreError};
use deaflow_surrogate::{PatternScore, Score, Surrogate};

/// Patterns of a set that are predicted: beyond them an `evaluate` stage takes its time.
const MOST: usize = 20_000;

/// Patterns in one answer.
const MOST_SHOWN: usize = 1000;

/// Rows of each family that are told of those with the least errors: with them one compares what seems to explain the largest.
const MOST_BEST: usize = 3;

/// Rows of a set that are read at a time: 42 MB of fields on 50 × 50 cells.
const BLOCK: usize = 1024;

/// What a network says of the rows of a part of its own sets.
pub struct Judgement {
    network: &'static str,
    split: Split,
    sets: Vec<ArtifactId>,
    /// From the largest error.
    rows: Vec<JudgedRow>,
    /// Rows of that part, of which those beyond [`MOST`] are not judged.
    total: usize,
    /// The largest displacements in mm that were learned from, from the least.
    learned: Vec<f64>,
    /// Rows of each family that were learned from.
    families: BTreeMap<String, usize>,
}

/// One of these rows.
struct JudgedRow {
    set: ArtifactId,
    row: usize,
    family: String,
    area: f64,
    score: PatternScore,
}

/// The errors of a model on the rows that its own sets kept for tests, or with `?split=` on another part of them: by family, and the patterns
/// of the largest errors; `?limit=`.
///
/// # Errors
/// When it is no model, or has learned from no balanced set, or that is not in the store.
pub fn judged(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&["limit", "split"])?;
    let limit = request.number("limit", 8, MOST_SHOWN)?;
    let split = split(request.word("split").unwrap_or(Split::Test.name()))?;
    let (store, model) = named(state, digits)?;
    let key = (model.digest(), split.name());
    let judgement = match state.judgements.get(&key) {
        Some(known) => known,
        None => {
            let network = network(state, &model)?;
            let found = Arc::new(Judgement::of(&store, &model, &network, split)?);
            state.judgements.put(key, &found);
            found
        }
    };
    Ok(judgement.document(limit).into())
}

/// A part of a set by its name.
fn split(name: &str) -> Result<Split, Refusal> {
    let known = Split::ALL.into_iter().find(|split| split.name() == name);
    known.ok_or_else(|| {
        let names = Split::ALL.map(Split::name).join(", ");
        Refusal::bad(format!("a set has no part {name:?}")).help(format!("parts: {names}"))
    })
}

/// What a model says of one row beside its label, as a frame: `?row=`, and `?of=DIGEST` of the set, else the first that it has learned from.
///
/// # Errors
/// When there is no such row, or it is of another scene.
pub fn prediction(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&["row", "of"])?;
    let (store, model) = named(state, digits)?;
    let network = network(state, &model)?;
    let set = match request.word("of").filter(|of| !of.is_empty()) {
        Some(of) => named(state, of)?.1,
        None => sets(&store, &model)?.swap_remove(0),
    };
    same_scene(&network, &set)?;
    let (path, [rows, _, _]) = patterns(&set)?;
    let row = request.word("row").and_then(|row| row.parse().ok());
    let row: usize = row
        .filter(|row| *row < rows)
        .ok_or_else(|| Refusal::absent(format!("{path} has no such row")).help(format!("rows 0 to {}", rows - 1)))?;
    let pattern = pattern(network.form(), &cells_of(&set, &path, row..row + 1)?)?;
    let label = labels(&set, &path, network.form(), row..row + 1)?.swap_remove(0);
    let predicted = network.predict(std::slice::from_ref(&pattern))?.swap_remove(0);
    let score = PatternScore::of(&predicted, &label);
    let raster = pattern.raster();
    let [columns, rows] = raster.sides();
    let of = |field: &Field| {
        let values = field.values().iter().map(|value| *value as f32).collect();
        Array::Numbers(vec![rows + 1, columns + 1, 2], values)
    };
    let mut document = told(&score);
    document["model"] = json!(model.digest().to_string());
    document["set"] = json!(set.digest().to_string());
    document["row"] = json!(row);
    document["network"] = json!(network.kind().name());
    let arrays = [
        (
            "pattern".to_owned(),
            Array::Bytes(vec![rows, columns], pattern.cells().to_vec()),
        ),
        ("label".to_owned(), of(&label)),
        ("predicted".to_owned(), of(&predicted)),
    ];
    Ok(Answer::frame(frame(document, &arrays)))
}

impl Judgement {
    fn of(store: &Store, model: &Artifact, network: &Surrogate, split: Split) -> Result<Self, Refusal> {
        let mut found = Self {
            network: network.kind().name(),
            split,
            sets: Vec::new(),
            rows: Vec::new(),
            total: 0,
            learned: Vec::new(),
            families: BTreeMap::new(),
        };
        for set in sets(store, model)? {
            found.add(&set, network)?;
        }
        found.learned.sort_by(f64::total_cmp);
        let error = |row: &JudgedRow| row.score.max_error_mm;
        found.rows.sort_by(|a, b| error(b).total_cmp(&error(a)));
        Ok(found)
    }

    fn add(&mut self, set: &Artifact, network: &Surrogate) -> Result<(), Refusal> {
        let view = Balanced::open(set)?;
        let (families, splits, moved) = (
            view.family().read()?,
            view.split().read()?,
            view.max_displacement().read()?,
        );
        self.sets.push(set.digest());
        for (row, split) in splits.iter().enumerate() {
            if split == Split::Train.name() {
                self.learned.push(moved[row]);
                *self.families.entry(families[row].clone()).or_default() += 1;
            }
        }
        let (path, [count, _, _]) = patterns(set)?;
        let cells = network.form().raster.cells();
        for start in (0..count).step_by(BLOCK) {
            let block = start..(start + BLOCK).min(count);
            let mut rows: Vec<usize> = block.clone().filter(|&row| splits[row] == self.split.name()).collect();
            self.total += rows.len();
            rows.truncate(MOST - self.rows.len());
            if rows.is_empty() {
                continue;
            }
            let read = cells_of(set, &path, block.clone())?;
            let labels = labels(set, &path, network.form(), block)?;
            let of_row = |&row: &usize| pattern(network.form(), &read[(row - start) * cells..][..cells]);
            let asked: Vec<Pattern> = rows.iter().map(of_row).collect::<Result<_, _>>()?;
            let predicted = network.predict(&asked)?;
            for ((row, pattern), field) in rows.into_iter().zip(&asked).zip(&predicted) {
                self.rows.push(JudgedRow {
                    set: set.digest(),
                    row,
                    family: families[row].clone(),
                    area: pattern.area_fraction(),
                    score: PatternScore::of(field, &labels[row - start]),
                });
            }
        }
        Ok(())
    }

    fn document(&self, limit: usize) -> Value {
        let named: BTreeSet<&str> = self.rows.iter().map(|row| row.family.as_str()).collect();
        let family = |family: &str| {
            let is_own = |own: &str| family == ALL_FAMILIES || own == family;
            let scores = self.rows.iter().filter(|row| is_own(&row.family)).map(|row| &row.score);
            let learned = self
                .families
                .iter()
                .filter(|(own, _)| is_own(own))
                .map(|(_, count)| count);
            Score::of(scores).map(|score| {
                json!({
                    "family": family,
                    "samples": score.samples,
                    "learned": learned.sum::<usize>(),
                    "rmse_mm": score.rmse_mm,
                    "max_error_mm": score.max_error_mm,
                })
            })
        };
        let best = |family: &&str| -> Vec<Value> {
            let own = self.rows.iter().rev().filter(|row| row.family == **family);
            own.take(MOST_BEST)
                .map(|row| json!({ "set": row.set.to_string(), "row": row.row, "family": row.family }))
                .collect()
        };
        let row = |row: &JudgedRow| {
            let mut document = told(&row.score);
            document["set"] = json!(row.set.to_string());
            document["row"] = json!(row.row);
            document["family"] = json!(row.family);
            document["area"] = json!(row.area);
            let below = self
                .learned
                .partition_point(|moved| *moved < row.score.simulated_max_mm);
            document["moves_more_than"] =
                json!((!self.learned.is_empty()).then(|| below as f64 / self.learned.len() as f64));
            document
        };
        json!({
            "network": self.network,
            "split": self.split.name(),
            "best": named.iter().flat_map(best).collect::<Vec<_>>(),
            "sets": self.sets.iter().map(ArtifactId::to_string).collect::<Vec<_>>(),
            "judged": self.rows.len(),
            "total": self.total,
            "learned": self.learned.len(),
            "families": named.into_iter().chain([ALL_FAMILIES]).filter_map(family).collect::<Vec<_>>(),
            "rows": self.rows.iter().take(limit).map(row).collect::<Vec<_>>(),
        })
    }
}

fn told(score: &PatternScore) -> Value {
    json!({
        "rms_mm": score.rms_mm,
        "max_error_mm": score.max_error_mm,
        "predicted_max_mm": score.predicted_max_mm,
        "simulated_max_mm": score.simulated_max_mm,
    })
}

/// The network of a train stage, read once.
fn network(state: &ServedState, model: &Artifact) -> Result<Arc<Surrogate>, Refusal> {
    if model.kind() != "train" {
        return Err(Refusal::bad("the artifact is no trained network").help("GET /api/artifacts?kind=train lists them"));
    }
    if let Some(known) = state.networks.get(&model.digest()) {
        return Ok(known);
    }
    let weights = Training::open(model)?.weights().read()?;
    let network = Surrogate::load(&weights).map_err(|error| Refusal::new(409, error.to_string()))?;
    let network = Arc::new(network);
    state.networks.put(model.digest(), &network);
    Ok(network)
}

/// The balanced sets that a model has learned from; at least one.
fn sets(store: &Store, model: &Artifact) -> Result<Vec<Artifact>, Refusal> {
    let provenance = model.provenance()?;
    let inputs = provenance.get("inputs").map_or("", String::as_str).lines();
    let mut found = Vec::new();
    for digest in inputs.filter_map(|input| input.parse().ok()) {
        match store.artifact(&digest) {
            Ok(input) if input.kind() == "balance" => found.push(input),
            Ok(_) => {}
            Err(StoreError::Missing { .. }) => {
                let missing = format!(
                    "{}, which the model has learned from, is not in the store",
                    digest.short()
                );
                return Err(Refusal::absent(missing).help("`deaflow run` builds it again"));
            }
            Err(error) => return Err(error.into()),
        }
    }
    match found.is_empty() {
        false => Ok(found),
        true => Err(Refusal::absent(
            "the model has learned from no balanced set, which alone names rows that are kept for tests",
        )
        .help("an `evaluate` stage judges it by other patterns")),
    }
}

/// Refuses rows of another scene than the model's: what it says of them means nothing.
fn same_scene(network: &Surrogate, set: &Artifact) -> Result<(), Refusal> {
    network
        .check_scene(&scene_of(set)?)
        .map_err(|why| Refusal::bad(why.to_string()))
}

/// The scene of a set, which its first chunk says where it does not.
///
/// # Errors
/// When neither says one, or it cannot be simulated.
pub fn scene_of(set: &Artifact) -> Result<Scene, Refusal> {
    let first = set.first_chunk()?;
    let scene = set
        .attribute("scene")
        .or_else(|| first.as_ref().and_then(|chunk| chunk.attribute("scene")));
    let scene = scene.ok_or_else(|| Refusal::bad(format!("{} says no scene", set.digest().short())))?;
    Ok(direct::scene_of_text(scene)?)
}

/// A pattern from its cells.
///
/// # Errors
/// When they are none of that form.
pub fn pattern(form: PatternForm, cells: &[u8]) -> Result<Pattern, Refusal> {
    Pattern::of_form(form, cells).map_err(|why| Refusal::new(409, why.to_string()))
}

/// The fields of some rows in mm, as they were simulated.
///
/// # Errors
/// When the patterns have none, or they cannot be read.
pub fn labels(
    set: &Artifact,
    patterns: &str,
    form: PatternForm,
    rows: std::ops::Range<usize>,
) -> Result<Vec<Field>, Refusal> {
    let none = || Refusal::absent("the patterns have no fields to be compared with");
    let axis = &set.content(patterns)?.axes[0];
    let is_field = |content: &&Content| content.axes.len() == 4 && content.axes[0] == *axis && content.axes[3] == "xy";
    let path = &set.contents()?.iter().find(is_field).ok_or_else(none)?.path;
    let values: Vec<f64> = match elements(set, path, rows)? {
        Data::F32(values) => values.into_iter().map(f64::from).collect(),
        Data::F64(values) => values,
        _ => return Err(none()),
    };
    let each = values.chunks(2 * form.raster.corners());
    each.map(|values| {
        Field::from_values(form.raster, values.to_vec()).map_err(|why| Refusal::new(409, why.to_string()))
    })
    .collect()
}
