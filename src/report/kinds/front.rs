//! The fronts of design stages: their points, and what became of the others.

use std::fmt;

use serde::Serialize;

use crate::artifacts::ArtifactReader;
use crate::drawing::{Background, Chart, Sheet};
use crate::error::ReportError;
use crate::figures::{FrontDesign, FrontFigure, front_charts, front_sheet};
use crate::format::{mm, percent};
use crate::presenter::Headline;
use deaflow_content::Designs;
use deaflow_field::CHARGE_UNIT;

/// A front of designs.
#[derive(Clone, Debug, Serialize)]
pub struct FoundFront {
    /// The stage.
    stage: String,
    /// The points, by ascending area or charge.
    points: Vec<FoundPoint>,
    /// The limits without a point of their own.
    others: Vec<OtherLimit>,
    /// The hypervolume, in the unit of gains times area fraction or nC.
    hypervolume: f64,
    /// Area or charge of the reference of the hypervolume.
    reference: f64,
    /// The number of simulated patterns.
    simulations: u64,
    /// The unit of gains.
    unit: &'static str,
    /// Whether limits are charges in nC, and not areas.
    is_charge: bool,
}

/// A point of a front.
#[derive(Clone, Debug, Serialize)]
struct FoundPoint {
    design: String,
    gain: f64,
    area: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    charge_nc: Option<f64>,
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
        let rows = view.rows();
        let (names, areas) = (source.of(rows.name().read())?, source.of(rows.area().read())?);
        let points = names.into_iter().zip(front.gain).zip(areas).enumerate();
        let charges = front.charge.as_ref();
        let outcomes = front.limit.into_iter().zip(front.outcome.0);
        Ok(Some(Self {
            stage: source.stage.stage.clone(),
            points: points
                .map(|(at, ((design, gain), area))| FoundPoint {
                    design,
                    gain,
                    area,
                    charge_nc: charges.map(|charges| charges[at]),
                })
                .collect(),
            others: outcomes
                .filter(|(_, outcome)| outcome != FOUND)
                .map(|(limit, why)| OtherLimit { limit, why })
                .collect(),
            hypervolume: front.hypervolume.last().copied().unwrap_or_default(),
            reference: front.reference.first().copied().unwrap_or_default(),
            simulations: front.simulations.last().copied().unwrap_or_default(),
            unit: source.of(view.unit())?,
            is_charge: charges.is_some(),
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
                "{}: {} of {} points, {} to {}, as predicted by the search, not verified",
                self.stage,
                self.points.len(),
                self.points.len() + others,
                self.point(first),
                self.point(last)
            ),
            (points, others) => format!("{}: {} of {} points", self.stage, points.len(), points.len() + others),
        };
        match none {
            0 => Headline::good(text),
            none => Headline::bad(format!("{text}; no design within {none} of the limits")),
        }
    }

    fn point(&self, point: &FoundPoint) -> String {
        let charge = point.charge_nc.map(|charge| format!(", charge {}", in_nano(charge)));
        let area = percent(point.area, 1);
        format!(
            "{} {} at area {area}{}",
            mm(point.gain),
            self.unit,
            charge.unwrap_or_default()
        )
    }

    fn limit(&self, limit: f64) -> String {
        match self.is_charge {
            true => format!("charge up to {}", in_nano(limit)),
            false => format!("area up to {}", percent(limit, 2)),
        }
    }

    fn volume_unit(&self) -> String {
        match self.is_charge {
            true => format!("{} {CHARGE_UNIT}", self.unit),
            false => self.unit.to_owned(),
        }
    }
}

impl fmt::Display for FoundFront {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: front of {} points in {} simulations, hypervolume {} {} (reference: 0 {}, {})",
            self.stage,
            self.points.len(),
            self.simulations,
            mm(self.hypervolume),
            self.volume_unit(),
            self.unit,
            match self.is_charge {
                true => in_nano(self.reference),
                false => format!("area {}", percent(self.reference, 1)),
            }
        )?;
        for point in &self.points {
            write!(f, "\n  {:<10} {}", point.design, self.point(point))?;
        }
        for other in &self.others {
            write!(f, "\n  {}: {}", self.limit(other.limit), other.why)?;
        }
        Ok(())
    }
}

/// Writes a charge.
fn in_nano(charge: f64) -> String {
    format!("{charge:.0} {CHARGE_UNIT}")
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
    let volume_unit = found.volume_unit();
    let designs = found.points.into_iter().zip(patterns);
    Ok(Some(FrontFigure {
        designs: designs
            .map(|(point, pattern)| FrontDesign {
                name: point.design,
                gain: point.gain,
                cost: point.charge_nc.unwrap_or(100.0 * point.area),
                pattern,
            })
            .collect(),
        background: Background::of(&source.of(view.scene().read())?),
        taken: if found.is_charge { "charge" } else { "area" },
        taken_unit: if found.is_charge { CHARGE_UNIT } else { "%" },
        volume_unit,
        unit: found.unit,
        history: front.simulations.into_iter().zip(front.hypervolume).collect(),
    }))
}
