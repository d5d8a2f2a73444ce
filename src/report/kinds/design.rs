//! Design stages: what judged the patterns, and how each search went.

use std::path::Path;

use serde_json::json;

use crate::artifacts::{RunArtifacts, Source};
use crate::designs::membranes;
use crate::drawing::{Axis, Chart, Colour, Mark, Series};
use crate::error::ReportError;
use crate::evaluators::{Evaluators, read};
use crate::figures::{Evolution, draw_evolution, draw_membrane};
use crate::format::{mm, three};
use crate::headline::Headline;
use crate::html::{Column, Page};
use crate::intervals::{StageIntervals, of_stage};
use crate::presenter::{DrawFigure, Presenter, Results};
use deaflow_content::{ContentError, Designs, DesignsView};

/// Shows design stages.
pub struct Design;

/// Targets that a legend can tell apart.
const NAMED: usize = 8;

/// A line for each target or start.
struct Search {
    name: String,
    points: Vec<(f64, f64)>,
}

impl Presenter for Design {
    fn kind(&self) -> &'static str {
        "design"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let evaluators = run.each(self.kind(), read)?.concat();
        let intervals = run.each(self.kind(), of_stage)?;
        let intervals: Vec<StageIntervals> = intervals.into_iter().flatten().collect();
        let results = |key: &str, value, text| Results {
            key: key.to_owned(),
            value,
            text,
            warnings: Vec::new(),
        };
        Ok(vec![
            results(
                "evaluators",
                json!(evaluators),
                evaluators.iter().map(ToString::to_string).collect(),
            ),
            results(
                "design_intervals",
                json!(intervals),
                intervals.iter().map(ToString::to_string).collect(),
            ),
        ])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        run.each(self.kind(), |source| {
            let view = source.of(Designs::open(source.artifact))?;
            let searches = [source.of(generations(&view))?, source.of(steps(&view))?];
            let best = searches
                .iter()
                .flatten()
                .filter_map(|search| search.points.last())
                .map(|(_, mm)| *mm);
            let stage = &source.stage.stage;
            Ok(match best.reduce(f64::max) {
                Some(mm) => Headline::good(format!(
                    "{stage}: best design {mm:.3} mm as the search judged it, not verified"
                )),
                None => Headline::good(format!("{stage}: designs that are not verified")),
            })
        })
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("evolution", evolution), ("best", best)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let charts = run.each(self.kind(), |source| {
            let view = source.of(Designs::open(source.artifact))?;
            let (generations, steps) = (source.of(generations(&view))?, source.of(steps(&view))?);
            let stage = &source.stage.stage;
            let by_generation = chart(stage, "genetic algorithm", "Generation", &generations);
            Ok([
                by_generation,
                chart(stage, "by gradients of finite elements", "Step", &steps),
            ])
        })?;
        let charts: Vec<Chart> = charts.into_iter().flatten().flatten().collect();
        if charts.is_empty() {
            return Ok(());
        }
        page.section("Search");
        evaluators_table(page, &run.each(self.kind(), read)?.concat());
        page.line(
            "How far the best pattern of each generation or step still was from the one that the search ended with, in percent of its \
             displacement as what judged it says: of a generation what stands in the table, of a step along the gradient finite elements, one \
             biquadratic to a cell. The ends of both searches of a design therefore differ by the error of the first. A line ends where nothing \
             more was gained.",
        );
        page.charts(&charts);
        Ok(())
    }
}

/// How a search went, where the stage has one alone; a page tells of all.
fn evolution(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let history = source.of(Designs::open(source.artifact))?.history();
    let mut names = source.of(history.name().read())?;
    names.dedup();
    if names.len() != 1 {
        return Ok(());
    }
    let data = Evolution {
        best: source.of(history.best().read())?,
        mean: source.of(history.mean().read())?,
        value: source.of(history.value().read())?,
        area: source.of(history.area().read())?,
    };
    source.drawn(draw_evolution(path, &data))
}

/// The last design of a stage that has one target: the refined one where there is one.
fn best(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    let rows = view.rows();
    let (names, roles) = (source.of(rows.name().read())?, source.of(rows.role().read())?);
    let last = roles.iter().rposition(|role| role.is_found());
    let Some(last) = last.filter(|_| names.iter().all(|name| *name == names[0])) else {
        return Ok(());
    };
    let predicted = source.of(rows.predicted().read())?;
    for data in membranes(source, &rows, &view.scene(), std::iter::once((last, &predicted[last])))? {
        source.drawn(draw_membrane(path, "Best design, as predicted", &data))?;
    }
    Ok(())
}

/// What judged the patterns, a row for each stage and judge.
fn evaluators_table(page: &mut Page, evaluators: &[Evaluators]) {
    let mut rows: Vec<Vec<String>> = Vec::new();
    for judge in evaluators {
        let own = judge.candidates.iter().find(|c| c.settings == judge.used);
        let error = own.and_then(|candidate| candidate.rmse_mm);
        let row = vec![
            judge.stage.clone(),
            judge.used.clone(),
            match judge.candidates.len() {
                0 => "as named, or the reference".to_owned(),
                n => format!("the cheapest of {n} that suffices"),
            },
            error.map_or_else(String::new, three),
            judge.name.clone(),
        ];
        // The error is of each target's own patterns: with the same judge, targets still differ in it.
        match rows.last_mut().filter(|last| last[..4] == row[..4]) {
            Some(last) => last[4] = format!("{}, {}", last[4], judge.name),
            None => rows.push(row),
        }
    }
    let columns = [
        ("stage", Column::Key),
        ("patterns judged by", Column::Key),
        ("why", Column::Key),
        ("RMS error, mm", Column::Number),
        ("targets", Column::Wide),
    ];
    page.columns("What judged the patterns", &columns, &rows);
}

/// The displacement of the best of each generation.
fn generations(view: &DesignsView<'_>) -> Result<Vec<Search>, ContentError> {
    let history = view.history();
    let labels = history.name().read()?;
    Ok(searches(
        labels,
        &history.generation().read()?,
        &history.value().read()?,
    ))
}

/// The displacement after each step along the gradient.
fn steps(view: &DesignsView<'_>) -> Result<Vec<Search>, ContentError> {
    let steps = view.steps();
    let (mut labels, members) = (steps.name().read()?, steps.member().read()?);
    // Of one design the number says nothing.
    let several = members.iter().any(|member| *member > 0);
    for (label, member) in labels.iter_mut().zip(members).filter(|_| several) {
        *label += &format!(" {}", member + 1);
    }
    Ok(searches(labels, &steps.step().read()?, &steps.value().read()?))
}

/// A line for each label.
fn searches(labels: Vec<String>, counts: &[u64], values: &[f64]) -> Vec<Search> {
    let mut searches: Vec<Search> = Vec::new();
    for ((label, count), value) in labels.into_iter().zip(counts).zip(values) {
        let point = (*count as f64, *value);
        match searches.last_mut().filter(|search| search.name == label) {
            Some(search) => search.points.push(point),
            None => searches.push(Search {
                name: label,
                points: vec![point],
            }),
        }
    }
    searches
}

/// How far each search still was from where it ended, a line for each on a logarithmic axis, so that searches of all sizes can be compared
/// and late steps be seen; none where nothing was gained.
fn chart(stage: &str, what: &str, count: &str, searches: &[Search]) -> Option<Chart> {
    let moving: Vec<(&Search, Vec<(f64, f64)>)> = searches
        .iter()
        .map(|search| (search, search.shortfalls()))
        .filter(|(_, points)| !points.is_empty())
        .collect();
    let few = (2..=NAMED).contains(&moving.len());
    let last = searches.iter().flat_map(|search| &search.points);
    let last = last.fold(0.0, |a: f64, (n, _)| a.max(*n));
    let note = match searches {
        [one] => one
            .points
            .last()
            .map_or(what.to_owned(), |(_, end)| format!("{what}, ends at {} mm", mm(*end))),
        several => format!("{what}, {} searches", several.len()),
    };
    let axes = [
        Axis::counting(count, 0.0, last.max(1.0)),
        Axis::logarithmic(
            "Displacement short of the end of the search [%]",
            moving.iter().flat_map(|(_, points)| points).map(|(_, gap)| gap),
        ),
    ];
    let series = moving
        .iter()
        .zip(Colour::ALL.into_iter().cycle())
        .map(|((search, points), colour)| {
            let name = if few { search.name.as_str() } else { "" };
            Series::new(name, colour, Mark::LineAndDots, points.clone())
        })
        .collect();
    (!moving.is_empty()).then(|| Chart::new(stage, axes, series).with_note(note))
}

impl Search {
    /// The difference to the last value in percent of it, where it is more than nothing.
    fn shortfalls(&self) -> Vec<(f64, f64)> {
        const NOTHING: f64 = 1e-3;
        let Some((_, end)) = self.points.last().filter(|(_, end)| end.abs() > 0.0) else {
            return Vec::new();
        };
        let gap = |(n, value): &(f64, f64)| (*n, 100.0 * ((end - value) / end).abs());
        self.points.iter().map(gap).filter(|(_, gap)| *gap > NOTHING).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_climb_is_drawn_as_what_was_still_missing() {
        let search = Search {
            name: "a".into(),
            points: vec![(0.0, 1.0), (1.0, 1.9), (2.0, 2.0), (3.0, 2.0)],
        };
        let gaps = search.shortfalls();
        assert_eq!(gaps.len(), 2, "{gaps:?}");
        assert!((gaps[0].1 - 50.0).abs() < 1e-9 && (gaps[1].1 - 5.0).abs() < 1e-9);
        let still = Search {
            name: "b".into(),
            points: vec![(0.0, 0.0), (1.0, 0.0)],
        };
        assert!(chart("s", "by gradients", "Step", &[still]).is_none());
        let drawn = chart("s", "by gradients", "Step", &[search]).unwrap();
        assert_eq!(drawn.note, "by gradients, ends at 2.0000 mm");
        assert!(drawn.legend().next().is_none(), "one line needs no legend");
    }
}
