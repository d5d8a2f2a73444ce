//! Results of verify stages: displacements of designs, predicted and simulated, their gains over the intuitive design
//! at its own area and at equal area (a gain at a larger area only would be misleading), and their ratios to the
//! optimum.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use serde::Serialize;

use super::artifacts::ArtifactReader;
use super::designed_for;
use super::designs::{
    Compared, Comparison, Gain, Objective, Place, comparison, exceeds, prediction_error, small_islands,
    without_difference,
};
use super::error::ReportError;
use super::format::{counted, mm, percents, three};
use super::intervals::{self, NetworkInterval};
use super::presenter::Headline;
use deaflow_base::{four_digits, measured};
use deaflow_content::{
    DesignRank, Verification, VerificationView, best_design, best_of_targets, is_met, predicted_rows,
};
use deaflow_field::{NO_FIELD, OutcomeKind};
use deaflow_pattern::Role;
use deaflow_scene::Scene;
use deaflow_store::StoreError;

/// Above this relative difference between prediction and simulation, the evaluator is reported as inaccurate.
pub(super) const TRUSTED: f64 = 0.05;

/// The result of a verify stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VerificationSummary {
    /// Name of the stage.
    pub stage: String,
    /// The designs and the patterns that they are compared with.
    pub rows: Vec<RowSummary>,
    /// The largest difference between prediction and simulation of the found designs, as a fraction of the simulated
    /// value, or of a tenth of the largest one of the target.
    pub largest_difference: Option<f64>,
    /// Patterns with a prediction, but without a stable solution.
    pub not_stable: usize,
    /// The unit of the values: mm, or mN for forces of sides, where keys end with `_mN`.
    #[serde(skip_serializing_if = "is_mm")]
    pub unit: &'static str,
}

/// Whether a unit is that of displacements.
fn is_mm(unit: &&'static str) -> bool {
    *unit == "mm"
}

/// A verified pattern. Displacements are means over the points along the target directions; those of forces of sides
/// are in mN in place of mm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowSummary {
    /// Name of its design stage.
    pub case: String,
    /// Name of the target.
    pub name: String,
    /// `ga`, `refined`, `optimum`, `intuitive`, `intuitive-equal-area` or `own`.
    pub role: Role,
    /// Number of the design of the target, from 0.
    pub member: u64,
    /// Units along a side that the search could switch.
    pub units: u64,
    /// Electrode area, a share of the free membrane.
    pub area: f64,
    /// Electrode area on the prestretched membrane, mm².
    pub area_mm2: f64,
    /// By the evaluator, in mm; `None` if it has no field, or was not used.
    pub predicted_mm: Option<f64>,
    /// The value of a robust objective as predicted by the search, in mm; `None` of other objectives.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robust_mm: Option<f64>,
    /// The predicted angle in degrees, if values are arc lengths of rotations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted_deg: Option<f64>,
    /// The simulated angle in degrees, if values are arc lengths of rotations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulated_deg: Option<f64>,
    /// The predicted change of the volume in ml, if values are mean heights of volumes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted_ml: Option<f64>,
    /// The simulated change of the volume in ml, if values are mean heights of volumes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulated_ml: Option<f64>,
    /// Its estimated error in ml.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulated_error_ml: Option<f64>,
    /// By finite elements, in mm; `None` without a stable solution.
    pub simulated_mm: Option<f64>,
    /// Its estimated error, in mm.
    pub simulated_error_mm: Option<f64>,
    /// Predicted minus simulated, in mm; `None` if the prediction is for another scene.
    pub difference_mm: Option<f64>,
    /// Distance from the target displacement or angle, in mm, if there is one.
    pub distance_mm: Option<f64>,
    /// The prediction of a calibrated network, if there is one.
    pub interval: Option<NetworkInterval>,
    /// The outcome of the simulation.
    pub outcome: OutcomeKind,
    /// `met`, or the violated constraints.
    pub status: String,
    /// Whether it is the best design of its target.
    pub best: bool,
    /// Gain over the intuitive design at its own area, a fraction; `None` if a given displacement is to be reached, as
    /// a larger one is not better then, or if the intuitive design moves by less than its error or the other way.
    pub gain_own_area: Option<f64>,
    /// Gain over the intuitive design at the area of this design; `None` if there is none with that area.
    pub gain_equal_area: Option<f64>,
    /// Gain over the intuitive design at its own area in mm, if it is no fraction because that design moves by less
    /// than its error or the other way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_own_area_mm: Option<f64>,
    /// The same at the area of this design.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_equal_area_mm: Option<f64>,
    /// Ratio to the displacement of the optimum, the one on the same units if there is one; `None` if one of both moves
    /// the other way.
    pub ratio_to_optimum: Option<f64>,
    /// Its displacement minus that of the optimum in mm, if they move in opposite directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub difference_to_optimum_mm: Option<f64>,
    /// What the optimum is, if it is compared with it.
    pub optimum_is: Option<&'static str>,
    /// The comparison with the other patterns of its target.
    #[serde(skip)]
    pub(super) compared: Comparison,
    /// How the scene of the prediction differs from that of the simulation, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other_scene: Option<String>,
    /// The objective.
    #[serde(skip)]
    pub objective: Arc<Objective>,
    /// The constraints of the target in YAML.
    #[serde(skip)]
    pub constraints: String,
    /// The area of the target, as written in files.
    #[serde(skip)]
    pub area_target: String,
    /// How many of its electrodes are smaller than a unit of the genetic algorithm, in words; `None` if none is.
    #[serde(skip)]
    pub small_islands: Option<String>,
}

impl RowSummary {
    /// Its prediction in mm, if that is for the simulated scene.
    pub(super) fn comparable_prediction_mm(&self) -> Option<f64> {
        self.predicted_mm.filter(|_| self.other_scene.is_none())
    }

    /// Its prediction by a calibrated network, if that is for the simulated scene.
    fn comparable_interval(&self) -> Option<&NetworkInterval> {
        self.interval.as_ref().filter(|_| self.other_scene.is_none())
    }

    /// Whether it was searched, and not drawn for comparison.
    #[must_use]
    pub fn is_design(&self) -> bool {
        self.role.is_found()
    }

    /// Returns its title: case, target, number and role.
    #[must_use]
    pub fn title(&self) -> String {
        design_title(&self.case, &self.name, self.member, self.role)
    }

    /// Rounds a value of the simulation by its estimated error, if that is known; without its unit.
    fn rounded(&self, value: f64) -> String {
        self.objective.rounded(value, self.simulated_error_mm)
    }

    /// Writes the same with its unit.
    fn with_unit(&self, value: f64) -> String {
        let (unit, angle) = (self.objective.shown_unit(), self.objective.converted(value));
        format!("{} {unit}{angle}", self.rounded(value))
    }

    /// Says what the value of a robust objective is; `None` of other objectives.
    fn robust_text(&self) -> Option<String> {
        let text = self.objective.robust_text(self.robust_mm)?;
        Some(format!("{text} as predicted"))
    }

    /// The case and the name of its target.
    fn target(&self) -> [&str; 2] {
        [&self.case, &self.name]
    }

    fn same_target(&self, other: &Self) -> bool {
        self.target() == other.target()
    }

    /// Returns its rank among the designs of its target; `None` without a stable solution.
    fn rank(&self) -> Option<DesignRank> {
        let value = self.simulated_mm?;
        Some(DesignRank::simulated(self.role, &self.status, self.distance_mm, value))
    }

    /// Returns its place among the designs of its target; `None` of patterns for comparison, and without a stable
    /// solution.
    fn place(&self) -> Option<Place> {
        let values = (self.simulated_mm?, self.distance_mm);
        Place::of((self.role, &self.status), values, self.simulated_error_mm)
    }

    /// Says how near it comes to the optimum; `None` of the optimum itself and of intuitive designs.
    fn to_optimum(&self) -> Option<String> {
        let is_shown = self.role != Role::Optimum && self.role.is_compared();
        self.compared.to_optimum(&self.objective).filter(|_| is_shown)
    }

    fn to_compare(&self) -> Compared<'_> {
        Compared {
            role: self.role,
            units: self.units,
            area: self.area,
            simulated_mm: self.simulated_mm,
            error_mm: self.simulated_error_mm,
            value_mm: None,
            is_met: self.distance_mm.is_some(),
            area_target: &self.area_target,
            constraints: &self.constraints,
            status: &self.status,
        }
    }
}

/// Reads the result of a verify stage.
///
/// # Errors
/// If the artifact does not have the content of its kind.
pub fn read(source: &ArtifactReader<'_>) -> Result<VerificationSummary, ReportError> {
    let mut rows = rows(source)?;
    if rows.is_empty() {
        return Err(source.wrong("it has no designs"));
    }
    let verification = source.of(Verification::open(source.artifact))?;
    let (view, scene) = (verification.rows(), source.of(verification.scene().read())?);
    let intervals = intervals::of_rows(source, &view, rows.len())?;
    rows.iter_mut()
        .zip(intervals)
        .for_each(|(row, interval)| row.interval = interval);
    for (row, search) in rows.iter_mut().zip(designed_for::searched(source, &view, &scene)?) {
        let is_same = search.other_scene.is_none();
        row.difference_mm = row.difference_mm.filter(|_| is_same);
        let is_robust = row.objective.robust.is_some() && row.predicted_mm.is_some();
        row.robust_mm = search.robust.filter(|_| is_same && is_robust);
        row.other_scene = search.other_scene;
    }
    let mut compared: Vec<RowSummary> = rows.iter().map(|row| compared(row, &rows)).collect();
    for best in best_rows(&compared, Role::is_found) {
        compared[best].best = true;
    }
    Ok(VerificationSummary {
        unit: source.of(verification.unit())?,
        stage: source.stage.stage.clone(),
        largest_difference: largest_difference(found(&compared)),
        not_stable: compared
            .iter()
            .filter(|row| row.comparable_prediction_mm().is_some() && row.simulated_mm.is_none())
            .count(),
        rows: compared,
    })
}

impl VerificationSummary {
    /// Describes the best design of one target, or the range of the designs of several.
    #[must_use]
    pub fn result(&self) -> Headline {
        let stage = &self.stage;
        let designs: Vec<&RowSummary> = found(&self.rows).collect();
        let solved: Vec<(&RowSummary, f64)> = designs
            .iter()
            .filter_map(|row| Some((*row, row.simulated_mm?)))
            .collect();
        let ranked = solved.iter().filter_map(|design| Some((design.0.rank()?, *design)));
        let Some((best, best_mm)) = best_design(ranked) else {
            return Headline::bad(match designs.len() {
                0 => format!(
                    "{stage}: {} without a design of a search",
                    counted(self.rows.len(), "pattern", "patterns")
                ),
                _ => {
                    let drawn = self.rows.iter().find_map(|row| Some((row, row.simulated_mm?)));
                    let drawn = drawn.map_or_else(String::new, |(row, value)| {
                        format!("; {}: {}", role_name(row.role), row.with_unit(value))
                    });
                    format!("{stage}: no stable solution was found for any design that was searched{drawn}")
                }
            });
        };
        let violating = |of: &[&RowSummary]| of.iter().filter(|row| !is_met(&row.status)).count();
        if designs.iter().any(|row| !row.same_target(best)) {
            let [mut least, mut most] = [(best, best_mm); 2];
            for &design in &solved {
                least = if design.1 < least.1 { design } else { least };
                most = if design.1 > most.1 { design } else { most };
            }
            let angles = angles([least, most]);
            let units = [least, most].map(|(row, _)| row.objective.shown_unit());
            let first = match units[0] == units[1] {
                true => least.0.rounded(least.1),
                false => least.0.with_unit(least.1),
            };
            let text = format!(
                "{stage}: {} designs, simulated {first} to {} {}{angles}",
                designs.len(),
                most.0.rounded(most.1),
                units[1]
            );
            return match violating(&designs) {
                0 => Headline::good(text),
                n => Headline::bad(format!("{text}; {n} violate constraints")),
            };
        }
        let mut text = format!("{stage}: best design ({})", role_name(best.role));
        if let Some(predicted) = best.comparable_prediction_mm() {
            text += &format!(", predicted {}", best.objective.text(predicted));
        }
        let word = simulation_word(best.outcome);
        let estimated = best.simulated_error_mm.map_or("", |_| " (mesh)");
        let unit = best.objective.shown_unit();
        let simulated = best.objective.text_measured(best_mm, best.simulated_error_mm);
        let simulated = simulated.replacen(unit, &format!("{unit}{estimated}"), 1);
        text += &format!(", {word} {simulated}");
        if let Some(robust) = best.robust_text() {
            text += &format!(", {robust}");
        }
        if let Some(distance) = best.distance_mm {
            text += &format!(", {} from the target", best.objective.difference_text(distance));
        } else {
            let mut over = best.compared.over_intuitive(best.area, &best.objective);
            if !best.compared.has_two_gains() {
                over.truncate(1);
            }
            if over.is_empty() {
                over.extend(best.compared.without_intuitive().map(str::to_owned));
            }
            over.iter().for_each(|over| text += &format!(", {over}"));
        }
        if let Some(share) = best.to_optimum() {
            text += &format!(", {share}");
        }
        if let Some(alike) = self.without_difference(best) {
            text += &format!("; {alike}");
        }
        if let Some(small) = &best.small_islands {
            text += &format!("; {small}");
        }
        if best.status != "met" {
            return Headline::bad(format!("{text} ({})", best.status));
        }
        Headline::good(match violating(&designs) {
            0 => text,
            1 => format!("{text}; another design violates constraints"),
            n => format!("{text}; {n} other designs violate constraints"),
        })
    }

    /// Says how many of the best designs of the target of a row do not differ by more than their errors; `None` if the
    /// best one differs from all others.
    fn without_difference(&self, row: &RowSummary) -> Option<String> {
        let of_target = self.rows.iter().filter(|other| other.same_target(row));
        without_difference(&of_target.filter_map(RowSummary::place).collect::<Vec<_>>())
    }

    /// Returns it with the rows in the order of reports: by target in the order in which these appear, then by role and
    /// number.
    #[must_use]
    pub fn sorted(mut self) -> Self {
        let keyed = (0..self.rows.len()).map(|at| (self.rows[at].target().map(str::to_owned), at));
        let first: BTreeMap<[String; 2], usize> = keyed.rev().collect();
        self.rows.sort_by_key(|row| {
            let of_target = first.get(&row.target().map(str::to_owned)).copied();
            (of_target, row.role, row.member)
        });
        self
    }

    /// Describes the accuracy of the predictions; `None` without predictions.
    #[must_use]
    pub fn accuracy(&self) -> Option<Headline> {
        let stage = &self.stage;
        let difference = largest_difference(self.rows.iter());
        let unstable = match self.not_stable {
            0 => String::new(),
            1 => ", and 1 with a prediction has no stable solution".to_owned(),
            n => format!(", and {n} with a prediction have no stable solution"),
        };
        let text = match difference {
            Some(value) => format!(
                "{stage}: predicted and simulated differ by up to {}{unstable}",
                percents(value)
            ),
            None if self.not_stable > 0 => {
                format!("{stage}: {}", self.not_stable_text())
            }
            None => return None,
        };
        let flagged = found(&self.rows).filter_map(RowSummary::comparable_interval);
        let flagged = flagged.filter(|interval| interval.out_of_distribution).count();
        let text = match flagged {
            0 => text,
            n => format!("{text}; {n} out of distribution"),
        };
        let is_accurate = self.not_stable == 0 && difference.is_none_or(|value| value <= TRUSTED);
        Some(match is_accurate {
            true => Headline::good(text),
            false => Headline::bad(format!("{text}: the evaluator is not accurate here")),
        })
    }

    /// Describes the patterns that have a prediction, but no stable solution.
    fn not_stable_text(&self) -> String {
        let patterns = counted(
            self.not_stable,
            "pattern with a prediction",
            "patterns with a prediction",
        );
        format!("no stable solution was found for {patterns}")
    }
}

/// Returns the positions of the best design of each target among those of some roles, in the order of the rows; none
/// for targets without a design that has a stable solution.
pub(super) fn best_rows(rows: &[RowSummary], roles: impl Fn(Role) -> bool) -> Vec<usize> {
    let of_roles = rows.iter().enumerate().filter(|(_, row)| roles(row.role));
    let best = best_of_targets(of_roles.filter_map(|(at, row)| Some((row.target(), row.rank()?, at))));
    let mut positions: Vec<usize> = best.into_iter().map(|(_, at)| at).collect();
    positions.sort_unstable();
    positions
}

/// Reads the rows of a verify stage with their objectives, without comparisons.
fn rows(source: &ArtifactReader<'_>) -> Result<Vec<RowSummary>, ReportError> {
    let view = source.of(Verification::open(source.artifact))?;
    let scene = source.of(view.scene().read())?;
    let objectives = objectives(source, &source.of(view.rows().objective().read())?.0, &scene)?;
    source.of(rows_of(&view, &objectives, scene.free_area_mm2()))
}

/// Returns the objective of each row; rows with the same text share it.
fn objectives(
    source: &ArtifactReader<'_>,
    texts: &[String],
    scene: &Scene,
) -> Result<Vec<Arc<Objective>>, ReportError> {
    let mut known: BTreeMap<&str, Arc<Objective>> = BTreeMap::new();
    let mut objective = |text| match known.get(text) {
        Some(objective) => Ok(objective.clone()),
        None => {
            let read = Objective::read(text, scene).map_err(|error| source.wrong(error.to_string()))?;
            Ok(known.entry(text).or_insert(Arc::new(read)).clone())
        }
    };
    texts.iter().map(|text| objective(text.as_str())).collect()
}

fn rows_of(
    view: &VerificationView<'_>,
    objectives: &[Arc<Objective>],
    free_mm2: f64,
) -> Result<Vec<RowSummary>, StoreError> {
    let (rows, component) = (view.rows(), view.component().read()?);
    let (cases, names, roles) = (rows.case().read()?, rows.name().read()?, rows.role().read()?);
    let (members, units, areas) = (rows.member().read()?, rows.units().read()?, rows.area().read()?);
    let (outcomes, statuses) = (view.outcome().read()?, rows.status().read()?.0);
    let (constraints, area_targets) = (rows.constraints().read()?.0, rows.area_target().read()?);
    let patterns = rows.patterns().read()?;
    let (simulated, predictions) = (view.simulated_rows()?, predicted_rows(&roles));
    let row = |k: usize| {
        let objective = &objectives[k];
        let prediction = predictions[k].filter(|_| statuses[k] != NO_FIELD);
        let predicted_mm = prediction.map(|at| component.predicted[at]);
        let simulated_mm = simulated[k].map(|row| component.simulated[row]);
        let known = simulated[k].filter(|&row| component.error_known[row] == 1);
        let with_target = simulated[k].filter(|_| objective.is_met);
        RowSummary {
            case: cases[k].clone(),
            name: names[k].clone(),
            role: roles[k],
            member: members[k],
            units: units[k],
            area: areas[k],
            area_mm2: areas[k] * free_mm2,
            predicted_mm,
            robust_mm: None,
            predicted_deg: predicted_mm.and_then(|value| objective.degrees(value)),
            simulated_deg: simulated_mm.and_then(|value| objective.degrees(value)),
            predicted_ml: predicted_mm.and_then(|value| objective.millilitres(value)),
            simulated_ml: simulated_mm.and_then(|value| objective.millilitres(value)),
            simulated_error_ml: known.and_then(|row| objective.millilitres(component.error[row])),
            simulated_mm,
            simulated_error_mm: known.map(|row| component.error[row]),
            difference_mm: predicted_mm
                .zip(simulated_mm)
                .map(|(predicted, simulated)| predicted - simulated),
            distance_mm: with_target.map(|row| component.distance[row]),
            interval: None,
            outcome: outcomes[k],
            status: statuses[k].clone(),
            best: false,
            gain_own_area: None,
            gain_equal_area: None,
            gain_own_area_mm: None,
            gain_equal_area_mm: None,
            ratio_to_optimum: None,
            difference_to_optimum_mm: None,
            optimum_is: None,
            compared: Comparison::default(),
            other_scene: None,
            objective: objective.clone(),
            constraints: constraints[k].clone(),
            area_target: area_targets[k].clone(),
            small_islands: small_islands(&patterns[k]),
        }
    };
    Ok((0..names.len()).map(row).collect())
}

/// Adds the comparisons with the other patterns of the target to a row.
fn compared(row: &RowSummary, rows: &[RowSummary]) -> RowSummary {
    let mut found = row.clone();
    let same = rows.iter().filter(|other| other.same_target(row));
    let same: Vec<Compared<'_>> = same.map(RowSummary::to_compare).collect();
    let comparison = comparison(&row.to_compare(), &same);
    [found.gain_own_area, found.gain_equal_area] = comparison.gains().map(|gain| gain.and_then(Gain::fraction));
    [found.gain_own_area_mm, found.gain_equal_area_mm] = comparison.gains().map(|gain| gain.and_then(Gain::difference));
    found.ratio_to_optimum = comparison.ratio;
    found.difference_to_optimum_mm = comparison.difference_mm;
    found.optimum_is = comparison.optimum_is;
    found.compared = comparison;
    found
}

/// Returns the rows of found designs.
fn found(rows: &[RowSummary]) -> impl Iterator<Item = &RowSummary> {
    rows.iter().filter(|row| row.role.is_found())
}

fn largest_difference<'r>(rows: impl Iterator<Item = &'r RowSummary>) -> Option<f64> {
    let rows: Vec<&RowSummary> = rows.collect();
    let largest = |row: &RowSummary| {
        let of_target = rows.iter().filter(|other| other.same_target(row));
        let sizes = of_target.filter_map(|other| Some(other.simulated_mm?.abs()));
        sizes.fold(0.0, f64::max)
    };
    let relative = rows
        .iter()
        .filter_map(|row| prediction_error(row.difference_mm?, row.simulated_mm?, largest(row)));
    relative.reduce(f64::max)
}

impl fmt::Display for VerificationSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let quantity = self.rows.first().map_or("displacement", |row| row.objective.quantity());
        let has_one = self.rows.iter().all(|row| row.objective.quantity() == quantity);
        let what = match self.unit {
            "mm" if has_one && quantity != "displacement" => quantity,
            "mm" => "displacement along the target directions",
            _ => "change of the force of sides on the membrane along the target directions",
        };
        writeln!(f, "{}: {what}", self.stage)?;
        let width = self
            .rows
            .iter()
            .map(|row| row.title().chars().count())
            .max()
            .unwrap_or(0);
        for row in &self.rows {
            writeln!(f, "  {:<width$}  {}", row.title(), Line(row))?;
        }
        if self.rows.iter().any(|row| row.simulated_error_mm.is_some()) {
            writeln!(
                f,
                "  ±: error of the mesh, estimated from two meshes; the error of the model is not included"
            )?;
        }
        for at in best_rows(&self.rows, Role::is_found) {
            let best = &self.rows[at];
            let Some(alike) = self.without_difference(best) else {
                continue;
            };
            match self.rows.iter().all(|row| row.same_target(best)) {
                true => writeln!(f, "  {alike}")?,
                false => writeln!(f, "  {}: {alike}", target_title(&best.case, &best.name))?,
            }
        }
        if self.not_stable > 0 {
            let text = self.not_stable_text();
            writeln!(f, "  {text}: the evaluator is not accurate here")?;
        }
        let with_interval = found(&self.rows).filter_map(|row| Some((row.comparable_interval()?, row.simulated_mm)));
        if let Some(verdict) = intervals::verdict(with_interval) {
            writeln!(f, "  {verdict}")?;
        }
        if let Some(other) = self.rows.iter().find_map(|row| row.other_scene.as_ref()) {
            let difference = largest_difference(self.rows.iter());
            let others = if difference.is_some() {
                "some predictions are"
            } else {
                "the predictions are"
            };
            write!(f, "  {others} for another scene, and not compared: {other}")?;
            match difference {
                Some(_) => writeln!(f)?,
                None => return Ok(()),
            }
        }
        // Of all rows above, so that no row shows a larger difference.
        match largest_difference(self.rows.iter()) {
            Some(value) if value > TRUSTED => write!(
                f,
                "  predicted and simulated differ by up to {}: the evaluator is not accurate here",
                percents(value)
            ),
            Some(value) => write!(f, "  predicted and simulated differ by up to {}", percents(value)),
            None if self.unit == "mm" && self.rows.iter().any(|row| row.difference_mm.is_some()) => {
                write!(
                    f,
                    "  no pattern moves by more than a micrometre along the target directions"
                )
            }
            None if self.rows.iter().any(|row| row.difference_mm.is_some()) => {
                write!(f, "  no pattern changes a force by more than a micronewton")
            }
            None => write!(f, "  no pattern has both a prediction and a simulation"),
        }
    }
}

/// Returns the angles of two values, if both are arc lengths of rotations.
fn angles(ends: [(&RowSummary, f64); 2]) -> String {
    let [least, most] = ends.map(|(row, value)| row.objective.degrees(value));
    let both = least.zip(most);
    both.map_or_else(String::new, |(least, most)| {
        format!(" ({} to {}°)", four_digits(least), four_digits(most))
    })
}

/// How a simulated displacement is called.
fn simulation_word(outcome: OutcomeKind) -> &'static str {
    match outcome {
        OutcomeKind::Estimated => "estimated",
        _ => "simulated",
    }
}

/// The numbers of a row, with the unit of its values.
struct Line<'a>(&'a RowSummary);

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (row, objective) = (self.0, &self.0.objective);
        let unit = objective.shown_unit();
        write!(f, "area {:>5.1} %, {:>6} mm²", 100.0 * row.area, three(row.area_mm2))?;
        match row.predicted_mm {
            Some(value) => write!(
                f,
                "  predicted {:>7} {unit}{}",
                mm(objective.shown(value)),
                objective.converted(value)
            )?,
            None => write!(f, "  no prediction       ")?,
        }
        let word = simulation_word(row.outcome);
        match (row.simulated_mm, row.simulated_error_mm) {
            (Some(value), Some(error)) => {
                let number = measured(objective.shown(value), objective.shown(error));
                write!(f, "  {word} {number:>16} {unit}{}", objective.converted(value))?;
            }
            (Some(value), None) => {
                let number = mm(objective.shown(value));
                write!(f, "  {word} {number:>7} {unit}{}", objective.converted(value))?;
            }
            (None, _) => write!(f, "  no stable solution was found: {}", row.outcome)?,
        }
        if let Some(robust) = row.robust_text() {
            write!(f, "  {robust}")?;
        }
        if let Some(interval) = &row.interval {
            write!(f, "  {interval}")?;
        }
        if let Some(distance) = row.distance_mm {
            write!(f, "  {} from the target", objective.difference_text(distance))?;
        }
        match (row.compared.gains_text(objective), row.compared.without_intuitive()) {
            (Some(gains), _) => write!(f, "  {gains}")?,
            (None, Some(none)) => write!(f, "  {none}")?,
            (None, None) => {}
        }
        if let Some(share) = row.to_optimum() {
            write!(f, "  {share}")?;
        }
        match row.status.as_str() {
            // The search gives it no area, but a gain over it would break the limit.
            "met" if row.role == Role::Intuitive && exceeds(row.area, &row.area_target) => {
                write!(f, "  (area {:.4}, wanted {})", row.area, row.area_target)
            }
            "met" => Ok(()),
            status => write!(f, "  ({status})"),
        }
    }
}

fn role_name(role: Role) -> &'static str {
    match role {
        Role::Ga => "genetic algorithm",
        Role::Optimum => "gradient search",
        Role::IntuitiveEqualArea => "intuitive, equal area",
        other => other.name(),
    }
}

/// Returns the title of a design: case, target, number and role.
pub fn design_title(case: &str, name: &str, member: u64, role: Role) -> String {
    let mut title = target_title(case, name);
    if member > 0 {
        title += &format!(" {}", member + 1);
    }
    format!("{title}: {}", role_name(role))
}

/// Returns the title of a target: case and name.
fn target_title(case: &str, name: &str) -> String {
    match (case, name) {
        ("", _) => name.to_owned(),
        // A single objective has the name of the stage kind.
        (_, "design") => case.to_owned(),
        _ => format!("{case} {name}"),
    }
}
