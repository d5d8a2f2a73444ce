//! The fronts of design stages: their points, and what became of the others.

use std::fmt;

use serde::Serialize;

use crate::artifacts::ArtifactReader;
use crate::designs::{Objective, VOLUME_UNIT, in_nano, is_cost, ml_per_mm, objective_words, point_words, quantity};
use crate::drawing::{Background, Chart, Sheet};
use crate::error::ReportError;
use crate::figures::{FrontAxis, FrontDesign, FrontFigure, front_charts, front_sheet};
use crate::format::{counted, mm, percent};
use crate::presenter::Headline;
use deaflow_content::{Designs, FrontObjectives};
use deaflow_field::CHARGE_UNIT;
use deaflow_scene::Scene;

/// A front of designs.
#[derive(Clone, Debug, Serialize)]
pub struct FoundFront {
    /// The stage.
    stage: String,
    /// The points, by ascending area or charge.
    points: Vec<FoundPoint>,
    /// The limits without a point of their own.
    others: Vec<OtherLimit>,
    /// The hypervolume, in the product of the units of the objectives.
    hypervolume: f64,
    /// Area or charge of the reference of the hypervolume; none of the genetic algorithm.
    #[serde(skip_serializing_if = "Option::is_none")]
    reference: Option<f64>,
    /// The number of simulated patterns.
    simulations: u64,
    /// The unit of gains.
    unit: &'static str,
    /// Whether limits are charges in nC, and not areas.
    is_charge: bool,
    /// The objectives of the genetic algorithm.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    objectives: Vec<OneObjective>,
    /// The unit of the hypervolume.
    hypervolume_unit: String,
    /// What counts of the first objective, if it is robust.
    #[serde(skip_serializing_if = "Option::is_none")]
    robust: Option<String>,
    /// The first objective.
    #[serde(skip)]
    first: Objective,
}

/// One of the objectives of the genetic algorithm.
#[derive(Clone, Debug, Serialize)]
struct OneObjective {
    /// In YAML.
    objective: String,
    unit: String,
    /// Its value at the reference of the hypervolume.
    reference: f64,
    /// In words.
    #[serde(skip)]
    description: String,
    /// The volume in ml of a value of 1 mm, if values are mean heights of volumes.
    #[serde(skip)]
    ml_per_mm: Option<f64>,
}

impl OneObjective {
    /// Its unit for people: ml for volumes.
    fn shown_unit(&self) -> &str {
        self.ml_per_mm.map_or(&self.unit, |_| VOLUME_UNIT)
    }

    /// Converts a value to this unit.
    fn shown(&self, value: f64) -> f64 {
        self.ml_per_mm.unwrap_or(1.0) * value
    }
}

/// A point of a front.
#[derive(Clone, Debug, Serialize)]
struct FoundPoint {
    design: String,
    gain: f64,
    area: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    charge_nc: Option<f64>,
    /// The values of all objectives of the genetic algorithm.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    values: Vec<f64>,
}

/// A limit without a point of its own.
#[derive(Clone, Debug, Serialize)]
struct OtherLimit {
    limit: f64,
    why: String,
}

/// The outcome of a limit that has a point, and the beginning of that of one without any design.
const FOUND: &str = "found";
const NONE: &str = "no design";

impl FoundFront {
    /// Reads the front of a design stage; `None` if it has a single objective.
    pub fn read(source: &ArtifactReader<'_>) -> Result<Option<Self>, ReportError> {
        let view = source.of(Designs::open(source.artifact))?;
        if !source.of(view.front().is_there())? {
            return Ok(None);
        }
        let front = source.of(view.front().read())?;
        let (rows, simulations) = (view.rows(), source.of(view.evaluations().read())?);
        let (names, areas) = (source.of(rows.name().read())?, source.of(rows.area().read())?);
        let points = names.into_iter().zip(front.gain).zip(areas).enumerate();
        let charges = front.charge.as_ref();
        let outcomes = front.limit.into_iter().zip(front.outcome.0);
        let scene = source.of(view.scene().read())?;
        let (objectives, values) = objectives(front.objectives, &scene);
        let texts = source.of(rows.objective().read())?.0;
        let first = texts.first().map(|text| Objective::read(text, &scene)).transpose();
        let first = first
            .map_err(|error| source.wrong(error.to_string()))?
            .unwrap_or_default();
        let wide = objectives.len();
        Ok(Some(Self {
            stage: source.stage.stage.clone(),
            points: points
                .map(|(at, ((design, gain), area))| FoundPoint {
                    design,
                    gain,
                    area,
                    charge_nc: charges.map(|charges| charges[at]),
                    values: values[at * wide..(at + 1) * wide].to_vec(),
                })
                .collect(),
            others: outcomes
                .filter(|(_, outcome)| outcome != FOUND)
                .map(|(limit, why)| OtherLimit { limit, why })
                .collect(),
            hypervolume: front.hypervolume.last().copied().unwrap_or_default(),
            reference: front.reference.and_then(|reference| reference.first().copied()),
            simulations: simulations.first().copied().unwrap_or_default(),
            unit: source.of(view.unit())?,
            is_charge: charges.is_some(),
            objectives,
            hypervolume_unit: source.of(view.hypervolume_unit())?,
            robust: first.robust.clone(),
            first,
        }))
    }

    /// The limits without any design, as warnings.
    pub fn warnings(&self) -> Vec<String> {
        let none = self.others.iter().filter(|other| other.why.starts_with(NONE));
        none.map(|other| format!("{}: {}: {}", self.stage, self.limit(other.limit), other.why))
            .collect()
    }

    /// The main result.
    pub fn headline(&self) -> Headline {
        let none = self.warnings().len();
        let text = match (&self.points[..], self.others.len()) {
            ([only], others) if others > none => {
                format!("{}: the objectives agree: one point, {}", self.stage, self.point(only))
            }
            ([first, .., last], others) => format!(
                "{}: {} of {}, {} to {}, as predicted by the search, not verified",
                self.stage,
                self.points.len(),
                counted(self.points.len() + others, "point", "points"),
                self.point(first),
                self.point(last)
            ),
            (points, others) => {
                let listed: Vec<String> = points.iter().map(|point| self.point(point)).collect();
                let all = counted(points.len() + others, "point", "points");
                format!("{}: {} of {all}, {}", self.stage, points.len(), listed.join(", "))
            }
        };
        let text = format!("{text}{}", self.robust_note());
        match none {
            0 => Headline::good(text),
            none => Headline::bad(format!("{text}; no design within {none} of the limits")),
        }
    }

    /// Says which value counts, if the first objective is robust.
    fn robust_note(&self) -> String {
        let robust = self.robust.as_ref();
        robust.map_or_else(String::new, |words| format!("; each value is the {words}"))
    }

    fn point(&self, point: &FoundPoint) -> String {
        let values = self.objectives.iter().zip(&point.values).skip(1);
        let others = values.filter(|(objective, _)| !is_cost(&objective.unit));
        let others: Vec<String> = others
            .map(|(objective, value)| format!("{} {}", mm(objective.shown(*value)), objective.shown_unit()))
            .collect();
        let first = self.first.text(point.gain);
        point_words(&first, &others, point.area, point.charge_nc)
    }

    /// The reference of the hypervolume.
    fn reference_text(&self) -> String {
        match self.reference {
            Some(charge) if self.is_charge => format!("0 {}, {}", self.unit, in_nano(charge)),
            Some(area) => format!("0 {}, area {}", self.unit, percent(area, 1)),
            None => {
                let each = self
                    .objectives
                    .iter()
                    .map(|one| match (is_cost(&one.unit), one.unit.as_str()) {
                        (true, CHARGE_UNIT) => in_nano(one.reference),
                        (true, _) => format!("area {}", percent(one.reference, 1)),
                        (false, unit) => format!("{} {unit}", mm(one.reference)),
                    });
                each.collect::<Vec<_>>().join(", ")
            }
        }
    }

    fn limit(&self, limit: f64) -> String {
        match self.is_charge {
            true => format!("charge up to {}", in_nano(limit)),
            false => format!("area up to {}", percent(limit, 2)),
        }
    }

    /// What the figure shows of each objective: its name, unit and description.
    fn axes(&self) -> Vec<FrontAxis> {
        let axis = |name: &str, unit: &str, objective: &str| FrontAxis {
            name: name.to_owned(),
            unit: unit.to_owned(),
            objective: objective.to_owned(),
        };
        let cost = |is_charge| match is_charge {
            true => axis("charge", CHARGE_UNIT, "charge"),
            false => axis("area", "%", "area"),
        };
        let robust = self.robust.as_ref();
        let objective = robust.map_or_else(String::new, |words| format!(", {words}"));
        // Volumes are in ml.
        let unit = match self.first.ml_per_mm {
            Some(_) => VOLUME_UNIT,
            None => self.unit,
        };
        let objective = format!("{}{objective}", quantity(unit));
        let first = axis(quantity(unit), unit, &objective);
        let mut axes = vec![first];
        if self.objectives.is_empty() {
            axes.push(cost(self.is_charge));
        }
        for (at, one) in self.objectives.iter().enumerate().skip(1) {
            let number = if at == 1 { "second" } else { "third" };
            axes.push(match is_cost(&one.unit) {
                true => cost(one.unit == CHARGE_UNIT),
                false => axis(&format!("{number} objective"), one.shown_unit(), &one.description),
            });
        }
        axes
    }
}

/// The objectives of the genetic algorithm, and the values of all designs.
fn objectives(stored: Option<FrontObjectives>, scene: &Scene) -> (Vec<OneObjective>, Vec<f64>) {
    let Some(stored) = stored else {
        return (Vec::new(), Vec::new());
    };
    let texts = stored.objective.0.into_iter().zip(stored.unit).zip(stored.reference);
    let one = |((objective, unit), reference): ((String, String), f64)| OneObjective {
        description: objective_words(&objective, &unit, scene),
        ml_per_mm: ml_per_mm(&objective, scene),
        objective,
        unit,
        reference,
    };
    (texts.map(one).collect(), stored.values.0)
}

impl fmt::Display for FoundFront {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: front of {} in {} simulations, hypervolume {} {} (reference: {})",
            self.stage,
            counted(self.points.len(), "point", "points"),
            self.simulations,
            mm(self.hypervolume),
            self.hypervolume_unit,
            self.reference_text()
        )?;
        write!(f, "{}", self.robust_note())?;
        for point in &self.points {
            write!(f, "\n  {:<10} {}", point.design, self.point(point))?;
        }
        for other in &self.others {
            write!(f, "\n  {}: {}", self.limit(other.limit), other.why)?;
        }
        Ok(())
    }
}

/// Draws the front of a stage; `None` if it has a single objective.
pub fn front(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    match figure(source)? {
        Some(data) => source.drawn(front_sheet(&data)).map(Some),
        None => Ok(None),
    }
}

/// The charts of the front of a stage; none if it has a single objective.
pub fn charts(source: &ArtifactReader<'_>) -> Result<Vec<Chart>, ReportError> {
    match figure(source)? {
        Some(data) => source.drawn(front_charts(&data)),
        None => Ok(Vec::new()),
    }
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<FrontFigure>, ReportError> {
    let Some(found) = FoundFront::read(source)? else {
        return Ok(None);
    };
    let view = source.of(Designs::open(source.artifact))?;
    let patterns = source.of(view.rows().patterns().read())?;
    let front = source.of(view.front().read())?;
    let (axes, volume_unit) = (found.axes(), found.hypervolume_unit);
    let shown = |(at, value): (usize, &f64)| match found.objectives.get(at) {
        Some(one) if one.unit == "1" => 100.0 * value,
        Some(one) => one.shown(*value),
        None => *value,
    };
    let designs = found.points.into_iter().zip(patterns);
    Ok(Some(FrontFigure {
        designs: designs
            .map(|(point, pattern)| FrontDesign {
                name: point.design,
                values: match point.values.is_empty() {
                    true => vec![
                        found.first.shown(point.gain),
                        point.charge_nc.unwrap_or(100.0 * point.area),
                    ],
                    false => point.values.iter().enumerate().map(shown).collect(),
                },
                pattern,
            })
            .collect(),
        background: Background::of(&source.of(view.scene().read())?),
        axes,
        volume_unit,
        history: front.simulations.into_iter().zip(front.hypervolume).collect(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn front(points: usize) -> FoundFront {
        let point = |at: usize| FoundPoint {
            design: format!("front-{}", at + 1),
            gain: 1.0,
            area: 0.1,
            charge_nc: None,
            values: Vec::new(),
        };
        FoundFront {
            stage: "front".to_owned(),
            points: (0..points).map(point).collect(),
            others: Vec::new(),
            hypervolume: 0.5,
            reference: Some(0.2),
            simulations: 9,
            unit: "mm",
            is_charge: false,
            objectives: Vec::new(),
            hypervolume_unit: "mm".to_owned(),
            robust: None,
            first: Objective::default(),
        }
    }

    #[test]
    fn a_front_of_one_point_is_singular() {
        let text = |points: usize| front(points).to_string();
        assert!(
            text(1).starts_with("front: front of 1 point in 9 simulations"),
            "{}",
            text(1)
        );
        assert!(
            text(2).starts_with("front: front of 2 points in 9 simulations"),
            "{}",
            text(2)
        );
        assert_eq!(front(1).headline().text, "front: 1 of 1 point, 1.000 mm at area 10.0 %");
        assert!(front(2).headline().text.starts_with("front: 2 of 2 points, 1.000 mm"));
        assert!(!front(2).to_string().contains("worst"));
        let robust = FoundFront {
            robust: Some("worst of the masks".to_owned()),
            ..front(2)
        };
        for text in [robust.to_string(), robust.headline().text] {
            assert!(text.contains("each value is the worst of the masks"), "{text}");
        }
        assert_eq!(robust.axes()[0].objective, "displacement, worst of the masks");
    }
}
