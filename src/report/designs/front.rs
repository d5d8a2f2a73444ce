//! The place of a design in a front: several designs, of which no other is better in all objectives.

use super::objective::{Objective, VOLUME_UNIT};
use crate::artifacts::ArtifactReader;
use crate::error::ReportError;
use crate::format::{mm, percent};
use deaflow_content::DesignsView;
use deaflow_field::CHARGE_UNIT;
use deaflow_scene::Scene;

/// The unit of areas, which are shares of the membrane.
const SHARE: &str = "1";

/// The place of a design in a front.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontPlace {
    /// The stage that searched the front.
    pub stage: String,
    /// The objectives after the first, which is the one of the design.
    pub others: Vec<OtherObjective>,
}

/// An objective after the first.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherObjective {
    /// In the syntax of pipelines.
    pub text: String,
    /// In words.
    pub description: String,
    /// The unit of the value; `1` of areas.
    pub unit: String,
    /// The value of the design, as predicted by the search.
    pub value: f64,
    /// The volume in ml of a value of 1 mm, if values are mean heights of volumes.
    pub ml_per_mm: Option<f64>,
}

impl OtherObjective {
    /// Whether it is what designs use: the area or the charge.
    #[must_use]
    pub fn is_cost(&self) -> bool {
        is_cost(&self.unit)
    }

    /// Whether it is the area, which is told of every design.
    #[must_use]
    pub fn is_area(&self) -> bool {
        self.unit == SHARE
    }

    /// Returns the value with its unit.
    #[must_use]
    pub fn value_text(&self) -> String {
        match (self.unit.as_str(), self.ml_per_mm) {
            (SHARE, _) => percent(self.value, 1),
            (CHARGE_UNIT, _) => in_nano(self.value),
            (_, Some(ml_per_mm)) => format!("{} {VOLUME_UNIT}", mm(ml_per_mm * self.value)),
            (unit, None) => format!("{} {unit}", mm(self.value)),
        }
    }
}

/// Whether the values of an objective of this unit are what designs use: area or charge.
pub(crate) fn is_cost(unit: &str) -> bool {
    [SHARE, CHARGE_UNIT].contains(&unit)
}

/// Writes a charge.
pub(crate) fn in_nano(charge: f64) -> String {
    format!("{charge:.0} {CHARGE_UNIT}")
}

/// Describes an objective of a front in words: its text and the unit of its values are given.
pub(crate) fn objective_words(text: &str, unit: &str, scene: &Scene) -> String {
    match unit {
        SHARE => "area".to_owned(),
        CHARGE_UNIT => "charge".to_owned(),
        _ => Objective::read(text, scene).map_or_else(|_| text.to_owned(), |read| read.words()),
    }
}

/// Returns the volume in ml of a mean height of 1 mm, if an objective is a volume.
pub(crate) fn ml_per_mm(text: &str, scene: &Scene) -> Option<f64> {
    Objective::read(text, scene).ok()?.ml_per_mm
}

/// Describes a point of a front: the value of its first objective, those of others that are no area or charge, its
/// area, and its charge if that is an objective.
pub(crate) fn point_words(first: &str, others: &[String], area: f64, charge_nc: Option<f64>) -> String {
    let others: String = others.iter().map(|other| format!(" and {other}")).collect();
    let charge = charge_nc.map_or_else(String::new, |charge| format!(", charge {}", in_nano(charge)));
    format!("{first}{others} at area {}{charge}", percent(area, 1))
}

/// Returns the place of each row of a design stage; none if it has a single objective.
pub(super) fn places(
    source: &ArtifactReader<'_>,
    view: &DesignsView<'_>,
    scene: &Scene,
) -> Result<Vec<FrontPlace>, ReportError> {
    if !source.of(view.front().is_there())? {
        return Ok(Vec::new());
    }
    let front = source.of(view.front().read())?;
    let areas = source.of(view.rows().area().read())?;
    let place = |others| FrontPlace {
        stage: source.stage.stage.clone(),
        others,
    };
    let Some(objectives) = front.objectives else {
        let cost = |(row, area): (usize, f64)| {
            let charge = front.charge.as_ref().and_then(|charges| charges.get(row));
            let (text, unit, value) = match charge {
                Some(charge) => ("{ charge: least }", CHARGE_UNIT, *charge),
                None => ("{ area: least }", SHARE, area),
            };
            place(vec![OtherObjective {
                text: text.to_owned(),
                description: objective_words(text, unit, scene),
                unit: unit.to_owned(),
                value,
                ml_per_mm: None,
            }])
        };
        return Ok(areas.into_iter().enumerate().map(cost).collect());
    };
    let wide = objectives.unit.len();
    let texts = objectives.objective.0.iter().zip(&objectives.unit);
    let rows = objectives.values.0.chunks_exact(wide.max(1)).map(|values| {
        let others = texts.clone().zip(values).skip(1);
        let others = others.map(|((text, unit), value)| OtherObjective {
            text: text.clone(),
            description: objective_words(text, unit, scene),
            unit: unit.clone(),
            value: *value,
            ml_per_mm: ml_per_mm(text, scene),
        });
        place(others.collect())
    });
    Ok(rows.collect())
}
