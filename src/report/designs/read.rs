//! Reads the designs in the artifacts of design and verify stages.

use std::sync::Arc;

use super::compare::compare;
use super::design::{Comparison, Design, StateField};
use super::front::places;
use super::names::name;
use super::objective::Objective;
use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::designed_for;
use crate::drawing::Background;
use crate::error::ReportError;
use crate::intervals;
use deaflow_content::{DesignRowsView, Designs, Packed, StoredAttribute, Verification, predicted_rows};
use deaflow_field::{Field, NO_FIELD};
use deaflow_scene::Scene;

/// Returns the designs of a run, each once, named and compared: the verified ones, and the others as predicted. Designs
/// that were verified only by stages in `superseded`, the earlier rounds, are left out.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn designs(run: &RunArtifacts<'_>, superseded: &[&str]) -> Result<Vec<Design>, ReportError> {
    let (mut all, mut earlier): (Vec<Design>, Vec<Design>) = Default::default();
    let verified = run.each("verify", |source| Ok((source.stage.stage.clone(), verified(source)?)))?;
    for (stage, designs) in verified {
        if superseded.contains(&stage.as_str()) {
            earlier.extend(designs);
            continue;
        }
        for design in designs {
            match all.iter_mut().find(|known| is_same(known, &design)) {
                Some(known) if is_more_accurate(&design, known) => *known = design,
                Some(_) => {}
                None => all.push(design),
            }
        }
    }
    let searched: Vec<Design> = run.each("design", searched)?.into_iter().flatten().collect();
    for design in &mut all {
        let own = searched.iter().find(|own| is_same_pattern(own, design));
        design.front = own.and_then(|own| own.front.clone());
    }
    for design in searched {
        if !all.iter().chain(&earlier).any(|known| is_same(known, &design)) {
            all.push(design);
        }
    }
    sort(&mut all);
    name(&mut all);
    compare(&mut all);
    Ok(all)
}

/// Whether both are the same design: the more accurate of two verifications is kept.
fn is_same(a: &Design, b: &Design) -> bool {
    a.has_same_target(b) && is_same_pattern(a, b)
}

/// Whether both are the same pattern of a target, maybe in other scenes.
fn is_same_pattern(a: &Design, b: &Design) -> bool {
    let is_same_target = (&a.case, &a.target) == (&b.case, &b.target);
    is_same_target && (a.role, a.member, a.units) == (b.role, b.member, b.units) && a.pattern == b.pattern
}

/// Whether one verification has a smaller estimated error than another.
fn is_more_accurate(new: &Design, known: &Design) -> bool {
    match (new.error_mm, known.error_mm) {
        (Some(new), Some(known)) => new < known,
        (new, known) => new.is_some() && known.is_none(),
    }
}

/// Sorts cases and targets by their first appearance, and their designs by role.
fn sort(designs: &mut [Design]) {
    let mut order: Vec<(String, String)> = Vec::new();
    let mut cases: Vec<String> = Vec::new();
    for design in designs.iter() {
        let key = (design.case.clone(), design.target.clone());
        if !cases.contains(&key.0) {
            cases.push(key.0.clone());
        }
        if !order.contains(&key) {
            order.push(key);
        }
    }
    let place = |design: &Design| {
        let case = cases.iter().position(|case| *case == design.case);
        let target = order.iter().position(|(c, t)| (c, t) == (&design.case, &design.target));
        (case, target, design.role, design.member)
    };
    designs.sort_by_key(place);
}

/// Reads the designs of a verify stage.
fn verified(source: &ArtifactReader<'_>) -> Result<Vec<Design>, ReportError> {
    let view = source.of(Verification::open(source.artifact))?;
    let predicted = source.of(view.component().predicted().read())?;
    let mut designs = read(source, &view.rows(), &view.scene(), &predicted)?;
    let (rows, outcomes) = (source.of(view.simulated_rows())?, source.of(view.outcome().read())?);
    let (fields, component) = (
        source.of(view.displacement().read())?,
        source.of(view.component().read())?,
    );
    let scene = source.of(view.scene().read())?;
    let states = source.of(view.states().displacement().read_if_there())?;
    let heights = source.of(view.space().height().read_if_there())?;
    for (design, search) in designs
        .iter_mut()
        .zip(designed_for::searched(source, &view.rows(), &scene)?)
    {
        if search.other_scene.is_some() {
            // The design stage has its own row, with the prediction for its scene.
            (design.predicted, design.predicted_mm, design.interval) = (None, None, None);
            design.states.clear();
        } else {
            design.set_robust(search.robust);
        }
    }
    for ((design, row), outcome) in designs.iter_mut().zip(rows).zip(outcomes) {
        design.outcome = Some(outcome);
        let Some(row) = row else { continue };
        if let Some(states) = &states {
            let each = states.len() / fields.len();
            design.states = in_states(&scene, &states[row * each..][..each]);
        }
        design.simulated = Some(fields[row].values().to_vec());
        design.heights = heights.as_ref().and_then(|Packed(heights)| {
            let of_row = heights.chunks(heights.len() / fields.len().max(1)).nth(row)?;
            Some(of_row[..fields[row].raster().corners().min(of_row.len())].to_vec())
        });
        design.simulated_mm = Some(component.simulated[row]);
        // An unknown error is not zero.
        design.error_mm = (component.error_known[row] == 1).then_some(component.error[row]);
        design.distance_mm = design.objective.is_met.then_some(component.distance[row]);
    }
    Ok(designs)
}

/// Reads the designs of a design stage.
fn searched(source: &ArtifactReader<'_>) -> Result<Vec<Design>, ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    let predicted = source.of(view.value().read())?;
    let mut designs = read(source, &view.rows(), &view.scene(), &predicted)?;
    if let Some(robust) = source.of(view.robust().read())? {
        let both = designs.iter_mut().zip(robust);
        both.for_each(|(design, value)| design.set_robust(Some(value)));
    }
    if let Some(first) = designs.first() {
        let places = places(source, &view, &first.scene.clone())?;
        for (design, place) in designs.iter_mut().zip(places) {
            design.front = Some(place);
        }
    }
    Ok(designs)
}

/// Reads the rows of an artifact with their predicted displacements, without simulations.
fn read(
    source: &ArtifactReader<'_>,
    rows: &DesignRowsView<'_>,
    scene: &StoredAttribute<'_, Scene>,
    predicted_mm: &[f64],
) -> Result<Vec<Design>, ReportError> {
    let view = rows;
    let rows = source.of(view.read())?;
    let intervals = intervals::of_rows(source, view, rows.len())?;
    // Stages keep only as much of the time of the drive as they need.
    let scene = Arc::new(source.of(scene.read())?.without_time());
    let background = Background::of(&scene);
    let predictions = predicted_rows(&rows.role);
    let design = |k: usize| {
        let prediction = predictions[k].filter(|_| rows.status.0[k] != NO_FIELD);
        Ok(Design {
            name: String::new(),
            made: source.stage.clone(),
            case: rows.case[k].clone(),
            target: rows.name[k].clone(),
            role: rows.role[k],
            member: rows.member[k],
            units: rows.units[k],
            setting: setting(&source.stage.stage),
            objective: Objective::read(&rows.objective.0[k], &scene).map_err(|e| source.wrong(e.to_string()))?,
            area_target: area_target(&rows.area_target[k]),
            area: rows.area[k],
            constraints: rows.constraints.0[k].clone(),
            status: rows.status.0[k].clone(),
            scene: scene.clone(),
            background: background.clone(),
            pattern: rows.patterns[k].clone(),
            predicted: predictions[k].map(|at| rows.predicted[at].values().to_vec()),
            simulated: None,
            heights: None,
            states: match (prediction, &rows.states) {
                (Some(at), Some(_)) => in_states(&scene, rows.predicted_in_states(at)),
                _ => Vec::new(),
            },
            predicted_mm: prediction.map(|at| predicted_mm[at]),
            robust_mm: None,
            simulated_mm: None,
            error_mm: None,
            distance_mm: None,
            interval: intervals[k].clone(),
            outcome: None,
            compared: Comparison::default(),
            front: None,
        })
    };
    (0..rows.len()).map(design).collect()
}

/// Returns the values of the axes in the name of a stage of a sweep.
fn setting(stage: &str) -> String {
    stage
        .split_once('@')
        .map_or(String::new(), |(_, values)| values.to_owned())
}

/// Returns fields with the names of their states.
fn in_states(scene: &Scene, fields: &[Field]) -> Vec<StateField> {
    let names = scene.states.iter().map(|(name, _)| name.to_owned());
    let both = names.zip(fields);
    both.map(|(name, field)| StateField {
        name,
        field: field.values().to_vec(),
    })
    .collect()
}

/// Shortens a number; words stay.
fn area_target(text: &str) -> String {
    text.parse::<f64>()
        .map_or_else(|_| text.to_owned(), |area| area.to_string())
}
