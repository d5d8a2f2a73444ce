//! Design stages: their evaluators, and the progress of each search.

use serde::Serialize;

use super::front::{self, FoundFront};
use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::designs::{Design, Objective, Role, designs, membranes};
use crate::drawing::{Axis, Chart, Mark, Series, Sheet};
use crate::error::ReportError;
use crate::evaluators::{Evaluators, read};
use crate::figures::{Evolution, evolution_sheet, membrane_sheet};
use crate::format::{mm, three};
use crate::html::{Column, Page};
use crate::intervals::{StageIntervals, of_stage};
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_content::{DesignRank, Designs, DesignsView, best_of_targets};
use deaflow_store::StoreError;

/// Presents design stages.
pub struct DesignPresenter;

/// The largest number of searches with names in the legend.
const NAMED: usize = 8;

/// The curve of a target or start.
struct SearchCurve {
    name: String,
    points: Vec<(f64, f64)>,
}

impl Presenter for DesignPresenter {
    fn kind(&self) -> &'static str {
        "design"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let evaluators = run.each(self.kind(), read)?.concat();
        let intervals = run.each(self.kind(), of_stage)?;
        let intervals: Vec<StageIntervals> = intervals.into_iter().flatten().collect();
        let fronts = run.each(self.kind(), FoundFront::read)?;
        let fronts: Vec<FoundFront> = fronts.into_iter().flatten().collect();
        let found = Results::new("fronts", &fronts, fronts.iter().map(ToString::to_string))
            .with_warnings(fronts.iter().flat_map(FoundFront::warnings).collect());
        let found_designs = run.each(self.kind(), designs_found)?.concat();
        let mut results = vec![
            Results::new("designs", &found_designs, None),
            Results::new("evaluators", &evaluators, evaluators.iter().map(ToString::to_string)),
            Results::new(
                "design_intervals",
                &intervals,
                intervals.iter().map(ToString::to_string),
            ),
        ];
        // Results without fronts are as before.
        results.extend((!fronts.is_empty()).then_some(found));
        Ok(results)
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        // Those that were simulated have lines of their own.
        let all = match run.stages.iter().any(|made| made.kind == "verify") {
            true => Some(designs(run, &run.superseded())?),
            false => None,
        };
        let is_in = |all: &Vec<Design>, stage: &str| all.iter().any(|design| design.made.stage == stage);
        let is_open = |stage: &str| all.as_ref().is_none_or(|all| is_in(all, stage));
        let headlines = run.each(self.kind(), |source| {
            if !is_open(&source.stage.stage) {
                return Ok(None);
            }
            if let Some(front) = FoundFront::read(source)? {
                return Ok(Some(front.headline()));
            }
            let view = source.of(Designs::open(source.artifact))?;
            let best_rows = source.of(best_rows(&view))?;
            let values = source.of(view.value().read())?;
            let best: Vec<f64> = best_rows.iter().filter_map(|row| values.get(*row)).copied().collect();
            let (stage, unit) = (&source.stage.stage, source.of(view.unit())?);
            let objective = objective(source, &view)?;
            let written = |value: f64| match &objective {
                Some(objective) => objective.text(value),
                None => format!("{} {unit}", mm(value)),
            };
            let number = |value: f64| mm(objective.as_ref().map_or(value, |objective| objective.shown(value)));
            let shown_unit = objective.as_ref().map_or(unit, Objective::shown_unit);
            let robust = source.of(view.robust().read())?;
            let robust = match (&best_rows[..], &robust) {
                ([row], Some(values)) => values.get(*row).copied(),
                _ => None,
            };
            let robust = objective.as_ref().and_then(|read| read.robust_text(robust));
            let robust = robust.map_or_else(String::new, |robust| format!(" as drawn, {robust}"));
            let ends = [f64::min, f64::max].map(|end| best.iter().copied().reduce(end));
            let text = match (&best[..], ends) {
                ([value], _) => format!(
                    "{stage}: best design {}{robust}, as predicted by the search, not verified",
                    written(*value)
                ),
                (several, [Some(least), Some(most)]) => format!(
                    "{stage}: best designs of {} targets, {} to {} {shown_unit}, as predicted by the search, not \
                     verified",
                    several.len(),
                    number(least),
                    number(most)
                ),
                _ => format!("{stage}: designs, not verified"),
            };
            let statuses = source.of(view.rows().status().read())?.0;
            let counted = best_rows.iter().filter_map(|row| statuses.get(*row));
            let unmet: Vec<&str> = counted.map(String::as_str).filter(|status| *status != "met").collect();
            Ok(Some(match &unmet[..] {
                [] => Headline::good(text),
                [status] => Headline::bad(format!("{text} ({status})")),
                several => Headline::bad(format!("{text}; {} designs violate constraints", several.len())),
            }))
        })?;
        Ok(headlines.into_iter().flatten().collect())
    }

    fn figures(&self) -> Figures {
        &[("evolution", evolution), ("best", best), ("front", front::front)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let fronts = run.each(self.kind(), front::charts)?.concat();
        if !fronts.is_empty() {
            page.section("Front");
            page.line(
                "The best design found for each area or charge, as predicted by the search, and the hypervolume of all \
                 of them over the simulated patterns. With a target, the gain is by how much it is nearer than at rest.",
            );
            page.charts(&fronts);
        }
        let charts = run.each(self.kind(), |source| {
            let view = source.of(Designs::open(source.artifact))?;
            let (mut generations, mut steps) = (source.of(generations(&view))?, source.of(steps(&view))?);
            let stage = source.stage.stage.as_str();
            let (factor, unit) = shown_in(source, &view)?;
            let curves = generations.iter_mut().chain(&mut steps);
            curves
                .flat_map(|curve| &mut curve.points)
                .for_each(|(_, value)| *value *= factor);
            let by_generation = chart([stage, "genetic algorithm", "Generation"], unit, &generations);
            Ok([
                by_generation,
                chart([stage, "gradient search by finite elements", "Step"], unit, &steps),
            ])
        })?;
        let charts: Vec<Chart> = charts.into_iter().flatten().flatten().collect();
        if charts.is_empty() {
            return Ok(());
        }
        page.section("Search");
        evaluators_table(page, &run.each(self.kind(), read)?.concat());
        page.line(
            "Difference between the best pattern of each generation or step and the result of the search, in percent \
             of its displacement. Generations of the genetic algorithm use the evaluator in the table, steps of the \
             gradient search use one biquadratic element per cell; so the ends of both searches differ by the error \
             of the evaluator. A curve ends at the last improvement.",
        );
        page.charts(&charts);
        Ok(())
    }
}

/// A design of a search, before it is verified.
#[derive(Clone, Debug, Serialize)]
struct FoundDesign {
    stage: String,
    case: String,
    name: String,
    role: Role,
    member: u64,
    units: u64,
    area: f64,
    /// As predicted by the search.
    predicted: f64,
    /// The unit of predicted values: mm or mN.
    unit: &'static str,
    status: String,
}

/// Returns the designs of a stage that its search has found.
fn designs_found(source: &ArtifactReader<'_>) -> Result<Vec<FoundDesign>, ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    source.of(designs_of(&view, &source.stage.stage))
}

fn designs_of(view: &DesignsView<'_>, stage: &str) -> Result<Vec<FoundDesign>, StoreError> {
    let (rows, values, unit) = (view.rows(), view.value().read()?, view.unit()?);
    let (cases, names, roles) = (rows.case().read()?, rows.name().read()?, rows.role().read()?);
    let (members, units, areas) = (rows.member().read()?, rows.units().read()?, rows.area().read()?);
    let statuses = rows.status().read()?.0;
    let design = |row: usize| FoundDesign {
        stage: stage.to_owned(),
        case: cases[row].clone(),
        name: names[row].clone(),
        role: roles[row],
        member: members[row],
        units: units[row],
        area: areas[row],
        predicted: values[row],
        unit,
        status: statuses[row].clone(),
    };
    let found = (0..names.len()).filter(|row| roles[*row].is_found());
    Ok(found.map(design).collect())
}

/// Draws the history of a stage that has one search; the page has those of all.
fn evolution(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    let history = view.history();
    let mut names = source.of(history.name().read())?;
    names.dedup();
    if names.len() != 1 {
        return Ok(None);
    }
    let (factor, unit) = shown_in(source, &view)?;
    let values = source.of(history.value().read())?;
    let data = Evolution {
        best: source.of(history.best().read())?,
        mean: source.of(history.mean().read())?,
        value: values.into_iter().map(|value| factor * value).collect(),
        area: source.of(history.area().read())?,
        unit,
    };
    source.drawn(evolution_sheet(&data)).map(Some)
}

/// Draws the best design of a stage that has one target.
fn best(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    let rows = view.rows();
    let [row] = source.of(best_rows(&view))?[..] else {
        return Ok(None);
    };
    let predicted = source.of(rows.predicted().read())?;
    let selected = std::iter::once((row, &predicted[row]));
    let membranes = membranes(source, &rows, &view.scene(), selected)?;
    Ok(membranes
        .first()
        .map(|data| membrane_sheet("Best design, as predicted", data)))
}

/// Adds the evaluators, a row for each stage and evaluator.
fn evaluators_table(page: &mut Page, evaluators: &[Evaluators]) {
    let mut rows: Vec<Vec<String>> = Vec::new();
    for evaluator in evaluators {
        let own = evaluator.candidates.iter().find(|c| c.settings == evaluator.used);
        let error = own.and_then(|candidate| candidate.rmse_mm);
        let row = vec![
            evaluator.stage.clone(),
            evaluator.used.clone(),
            match evaluator.candidates.len() {
                0 => "named in the stage, or the default".to_owned(),
                n => format!("the cheapest of {n} that is accurate enough"),
            },
            error.map_or_else(String::new, three),
            evaluator.name.clone(),
        ];
        // The error depends on the patterns of the target: targets with the same evaluator may differ in it.
        match rows.last_mut().filter(|last| last[..4] == row[..4]) {
            Some(last) => last[4] = format!("{}, {}", last[4], evaluator.name),
            None => rows.push(row),
        }
    }
    let columns = [
        ("stage", Column::Key),
        ("evaluator", Column::Key),
        ("reason", Column::Key),
        ("RMS error, mm", Column::Number),
        ("targets", Column::Wide),
    ];
    page.columns("Evaluators", &columns, &rows);
}

/// Returns the row of the best found design of each target.
fn best_rows(view: &DesignsView<'_>) -> Result<Vec<usize>, StoreError> {
    let rows = view.rows();
    let (names, roles, statuses) = (rows.name().read()?, rows.role().read()?, rows.status().read()?.0);
    let values = view.value().read()?;
    let rank = |row: usize| DesignRank::predicted(roles[row], &statuses[row], values[row]);
    let found = (0..names.len()).filter(|row| roles[*row].is_found());
    let best = best_of_targets(found.map(|row| (&names[row], rank(row), row)));
    Ok(best.into_iter().map(|(_, row)| row).collect())
}

/// Returns the objective of a single target; `None` if there are several.
fn objective(source: &ArtifactReader<'_>, view: &DesignsView<'_>) -> Result<Option<Objective>, ReportError> {
    let mut texts = source.of(view.rows().objective().read())?.0;
    texts.dedup();
    let [text] = &texts[..] else { return Ok(None) };
    let scene = source.of(view.scene().read())?;
    Objective::read(text, &scene)
        .map(Some)
        .map_err(|error| source.wrong(error.to_string()))
}

/// Returns the unit in which values of searches are shown, and the factor from that of files.
fn shown_in(source: &ArtifactReader<'_>, view: &DesignsView<'_>) -> Result<(f64, &'static str), ReportError> {
    Ok(match objective(source, view)? {
        Some(objective) => (objective.shown(1.0), objective.shown_unit()),
        None => (1.0, source.of(view.unit())?),
    })
}

/// Returns the displacement of the best pattern of each generation.
fn generations(view: &DesignsView<'_>) -> Result<Vec<SearchCurve>, StoreError> {
    let history = view.history();
    let labels = history.name().read()?;
    Ok(searches(
        labels,
        &history.generation().read()?,
        &history.value().read()?,
    ))
}

/// Returns the displacement after each step along the gradient.
fn steps(view: &DesignsView<'_>) -> Result<Vec<SearchCurve>, StoreError> {
    let steps = view.steps();
    let (mut labels, members) = (steps.name().read()?, steps.member().read()?);
    // A single design needs no number.
    let several = members.iter().any(|member| *member > 0);
    for (label, member) in labels.iter_mut().zip(members).filter(|_| several) {
        *label += &format!(" {}", member + 1);
    }
    Ok(searches(labels, &steps.step().read()?, &steps.value().read()?))
}

/// Groups points by their labels.
fn searches(labels: Vec<String>, counts: &[u64], values: &[f64]) -> Vec<SearchCurve> {
    let mut searches: Vec<SearchCurve> = Vec::new();
    for ((label, count), value) in labels.into_iter().zip(counts).zip(values) {
        let point = (*count as f64, *value);
        match searches.last_mut().filter(|search| search.name == label) {
            Some(search) => search.points.push(point),
            None => searches.push(SearchCurve {
                name: label,
                points: vec![point],
            }),
        }
    }
    searches
}

/// Draws the distance of each search from its result on a logarithmic axis, which shows searches of all sizes and their
/// last steps; `None` without any improvement.
fn chart([stage, what, count]: [&str; 3], unit: &str, searches: &[SearchCurve]) -> Option<Chart> {
    let moving: Vec<(&SearchCurve, Vec<(f64, f64)>)> = searches
        .iter()
        .map(|search| (search, search.shortfalls()))
        .filter(|(_, points)| !points.is_empty())
        .collect();
    let few = (2..=NAMED).contains(&moving.len());
    let last = searches.iter().flat_map(|search| &search.points);
    let last = last.fold(0.0, |a: f64, (n, _)| a.max(*n));
    let note = match searches {
        [one] => one.points.last().map_or(what.to_owned(), |(_, end)| {
            format!("{what}, ends at {} {unit}", mm(*end))
        }),
        several => format!("{what}, {} searches", several.len()),
    };
    let axes = [
        Axis::counting(count, 0.0, last.max(1.0)),
        Axis::logarithmic(
            "Difference from the result of the search [%]",
            moving.iter().flat_map(|(_, points)| points).map(|(_, gap)| gap),
        ),
    ];
    let series = Series::coloured(&moving).map(|((search, points), colour)| {
        let name = if few { search.name.as_str() } else { "" };
        Series::new(name, colour, Mark::LineAndDots, points.clone())
    });
    let series = series.collect();
    (!moving.is_empty()).then(|| Chart::new(stage, axes, series).with_note(note))
}

impl SearchCurve {
    /// Returns the difference from the last value in percent of it, as long as it is not negligible.
    fn shortfalls(&self) -> Vec<(f64, f64)> {
        const NEGLIGIBLE: f64 = 1e-3;
        let Some((_, end)) = self.points.last().filter(|(_, end)| end.abs() > 0.0) else {
            return Vec::new();
        };
        let gap = |(n, value): &(f64, f64)| (*n, 100.0 * ((end - value) / end).abs());
        self.points
            .iter()
            .map(gap)
            .filter(|(_, gap)| *gap > NEGLIGIBLE)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_is_drawn_by_its_distance_from_the_result() {
        let search = SearchCurve {
            name: "a".into(),
            points: vec![(0.0, 1.0), (1.0, 1.9), (2.0, 2.0), (3.0, 2.0)],
        };
        let gaps = search.shortfalls();
        assert_eq!(gaps.len(), 2, "{gaps:?}");
        assert!((gaps[0].1 - 50.0).abs() < 1e-9 && (gaps[1].1 - 5.0).abs() < 1e-9);
        let still = SearchCurve {
            name: "b".into(),
            points: vec![(0.0, 0.0), (1.0, 0.0)],
        };
        assert!(chart(["s", "by gradients", "Step"], "mm", &[still]).is_none());
        let drawn = chart(["s", "by gradients", "Step"], "mm", &[search]).unwrap();
        assert_eq!(drawn.note, "by gradients, ends at 2.000 mm");
        assert!(drawn.legend().next().is_none(), "one curve needs no legend");
    }
}
