//! The shapes of drawn electrodes of rows, for drawings.

use serde_json::{Value, json};

use super::artifacts::find_artifact;
use crate::artifact_data::elements;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_store::{Artifact, Data};

/// Rows in one response.
const MAX_ROWS: usize = 200;

/// Vertices in one response.
const MAX_VERTICES: u64 = 1 << 20;

/// Returns the shapes of the electrodes of rows, `?rows=3,5,7`: for each row its polygons, each with its group and its
/// vertices as fractions of the sides of the membrane. A row has none if its electrodes are the cells.
///
/// # Errors
/// If a row does not exist, or the artifact has no such shapes.
pub fn shapes(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["rows"])?;
    let words = request.parameter("rows").unwrap_or_default().split(',');
    let rows: Option<Vec<usize>> = words
        .filter(|word| !word.is_empty())
        .map(|row| row.trim().parse().ok())
        .collect();
    let rows = rows.ok_or_else(|| ApiError::bad_request("`rows` must be integers separated by commas"))?;
    if rows.len() > MAX_ROWS {
        return Err(
            ApiError::bad_request(format!("too many: {} rows", rows.len())).help(format!("allowed: {MAX_ROWS} rows"))
        );
    }
    let (_, artifact) = find_artifact(state, digest)?;
    let all = Shapes::read(&artifact)?;
    let mut vertices = 0;
    let shapes = rows.iter().map(|&row| {
        let own = all.of_row(row)?;
        vertices += own.iter().map(|polygon| polygon.length).sum::<u64>();
        if vertices > MAX_VERTICES {
            return Err(ApiError::bad_request("the shapes have too many vertices").help("ask for fewer rows"));
        }
        all.drawn(&artifact, row, &own)
    });
    let shapes: Vec<Value> = shapes.collect::<Result<_, ApiError>>()?;
    Ok(json!({ "rows": rows, "shapes": shapes }).into())
}

/// How many polygons each row has, and how many vertices each polygon has.
struct Shapes {
    polygons: Vec<u64>,
    groups: Vec<u64>,
    lengths: Vec<u64>,
}

struct Polygon {
    group: u64,
    start: u64,
    length: u64,
}

impl Shapes {
    fn read(artifact: &Artifact) -> Result<Self, ApiError> {
        let integers = |path: &str| match whole(artifact, path)? {
            Data::U64(values) => Ok(values),
            _ => Err(none()),
        };
        Ok(Self {
            polygons: integers("electrodes/polygons")?,
            groups: integers("electrodes/group")?,
            lengths: integers("electrodes/vertices")?,
        })
    }

    fn of_row(&self, row: usize) -> Result<Vec<Polygon>, ApiError> {
        let &count = self.polygons.get(row).ok_or_else(|| {
            ApiError::not_found(format!("the artifact has no row {row}"))
                .help(format!("allowed: rows 0 to {}", self.polygons.len().saturating_sub(1)))
        })?;
        let first = self.polygons[..row].iter().sum::<u64>() as usize;
        let before: u64 = self.lengths.iter().take(first).sum();
        let own = self.groups.iter().zip(&self.lengths).skip(first).take(count as usize);
        let mut start = before;
        let polygon = |(&group, &length): (&u64, &u64)| {
            let polygon = Polygon { group, start, length };
            start += length;
            polygon
        };
        Ok(own.map(polygon).collect())
    }

    fn drawn(&self, artifact: &Artifact, row: usize, polygons: &[Polygon]) -> Result<Value, ApiError> {
        let (Some(first), Some(last)) = (polygons.first(), polygons.last()) else {
            return Ok(json!([]));
        };
        let pairs = |path: &str, from: usize, to: usize| match elements(artifact, path, from..to)? {
            Data::F64(values) => Ok(values),
            _ => Err(none()),
        };
        let size = pairs("electrodes/size", row, row + 1)?;
        let end = last.start + last.length;
        let vertices = pairs("electrodes/vertex", first.start as usize, end as usize)?;
        let ring = |polygon: &Polygon| {
            let skipped = (polygon.start - first.start) as usize;
            let own = vertices.chunks_exact(2).skip(skipped).take(polygon.length as usize);
            let ring: Vec<[f64; 2]> = own.map(|at| [at[0] / size[0], at[1] / size[1]]).collect();
            json!({ "group": polygon.group, "ring": ring })
        };
        match size.len() == 2 && size.iter().all(|side| *side > 0.0) {
            true => Ok(polygons.iter().map(ring).collect()),
            false => Err(none()),
        }
    }
}

fn whole(artifact: &Artifact, path: &str) -> Result<Data, ApiError> {
    let content = artifact.content(path).map_err(|_| none())?;
    let count = content.shape.first().copied().unwrap_or(0);
    elements(artifact, path, 0..count)
}

fn none() -> ApiError {
    ApiError::not_found("the electrodes of the artifact are cells").help("GET /api/artifacts/DIGEST lists its arrays")
}
