//! What the searches of the designs of a verify stage knew: the scenes that the designs were made for, as a prediction
//! for another scene says nothing about the accuracy of the evaluator, and the values of robust objectives.

use std::collections::BTreeMap;

use super::artifacts::ArtifactReader;
use super::error::ReportError;
use deaflow_content::{DesignRowsView, Designs};
use deaflow_pattern::Role;
use deaflow_scene::{Difference, Scene};
use deaflow_store::StoreError;

/// What a row has in the design stage and in the verify stage: case, target, role, number and units.
type Identity = (String, String, Role, u64, u64);

/// What the design stage of a row knew.
#[derive(Clone, Debug, Default)]
pub struct Searched {
    /// How its scene differs from that of the verify stage, `there` and `here`; `None` if it does not.
    pub other_scene: Option<String>,
    /// The value of a `robust` objective, as predicted by the search; that as drawn of other objectives. `None` if no
    /// objective of the stage is robust.
    pub robust: Option<f64>,
}

/// Returns for each row of a verify stage with a scene what its design stage knew; nothing if the design is no longer
/// in the store.
///
/// # Errors
/// If an artifact is damaged or does not have the content of its kind.
pub fn searched(
    source: &ArtifactReader<'_>,
    rows: &DesignRowsView<'_>,
    scene: &Scene,
) -> Result<Vec<Searched>, ReportError> {
    // Stages keep only as much of the time of the drive, and of the properties, as they need.
    let here = scene.without_time();
    let provenance = source.artifact.provenance()?;
    let inputs = provenance.get("inputs").map_or("", String::as_str).lines();
    let mut known: BTreeMap<Identity, Searched> = BTreeMap::new();
    for digest in inputs.filter_map(|input| input.parse().ok()) {
        let input = match source.artifact.sibling(&digest) {
            Ok(input) => input,
            Err(StoreError::Missing { .. }) => continue,
            Err(error) => return Err(error.into()),
        };
        if input.kind() != "design" {
            continue;
        }
        let view = source.of(Designs::open(&input))?;
        let there = source.of(view.scene().read())?.without_time();
        let found = there.differences(&here);
        let found = (!found.is_empty()).then(|| Difference::listed(&found));
        let robust = source.of(view.robust().read())?;
        for (row, identity) in source.of(identities(&view.rows()))?.into_iter().enumerate() {
            // Of repeated rows, a verify stage keeps the first.
            known.entry(identity).or_insert_with(|| Searched {
                other_scene: found.clone(),
                robust: robust.as_ref().and_then(|values| values.get(row).copied()),
            });
        }
    }
    let of_row = |identity| known.get(&identity).cloned().unwrap_or_default();
    Ok(source.of(identities(rows))?.into_iter().map(of_row).collect())
}

fn identities(rows: &DesignRowsView<'_>) -> Result<Vec<Identity>, StoreError> {
    let (cases, names, roles) = (rows.case().read()?, rows.name().read()?, rows.role().read()?);
    let (members, units) = (rows.member().read()?, rows.units().read()?);
    let words = cases.into_iter().zip(names).zip(roles);
    let all = words.zip(members).zip(units);
    Ok(all
        .map(|((((case, name), role), member), units)| (case, name, role, member, units))
        .collect())
}
