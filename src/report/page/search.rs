//! The course of each search: the displacement of the best pattern by generation, and by step of what gradients did.

use crate::content::{ContentError, Designs, DesignsView};
use crate::report::drawing::{Axis, Chart, Colour, Mark, Series};
use crate::report::evaluators::{Evaluators, evaluators};
use crate::report::format::mm;
use crate::report::gather::{Made, ReportError, each};
use crate::report::html::{Column, Page};
use crate::store::Store;

/// Targets that a legend can tell apart.
const NAMED: usize = 8;

/// A line for each target or start.
struct Course {
    name: String,
    points: Vec<(f64, f64)>,
}

/// Adds a section where something was searched.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let searched = each(store, made, "design", |source| {
        let view = source.of(Designs::open(source.artifact))?;
        let (generations, steps) = (source.of(generations(&view))?, source.of(steps(&view))?);
        Ok((source.stage.stage.clone(), generations, steps))
    })?;
    let searched: Vec<_> = searched
        .into_iter()
        .filter(|(_, a, b)| !a.is_empty() || !b.is_empty())
        .collect();
    if searched.is_empty() {
        return Ok(());
    }
    page.section("Search");
    judges(page, &evaluators(store, made)?);
    page.line("How the displacement of the best pattern grew while it was searched, as the search judged it.");
    let charts = searched.iter().flat_map(|(stage, generations, steps)| {
        let by_generation = chart(stage, "genetic algorithm", "Generation", generations);
        [by_generation, chart(stage, "by gradients", "Step", steps)]
    });
    let charts: Vec<Chart> = charts.flatten().collect();
    page.charts(&charts);
    Ok(())
}

/// What judged the patterns, a row for each stage and judge.
fn judges(page: &mut Page, evaluators: &[Evaluators]) {
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
            error.map_or_else(String::new, mm),
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
fn generations(view: &DesignsView<'_>) -> Result<Vec<Course>, ContentError> {
    let history = view.history();
    let labels = history.name().read()?;
    Ok(courses(labels, &history.generation().read()?, &history.value().read()?))
}

/// The displacement after each step along the gradient.
fn steps(view: &DesignsView<'_>) -> Result<Vec<Course>, ContentError> {
    let steps = view.steps();
    let (mut labels, members) = (steps.name().read()?, steps.member().read()?);
    // Of one design the number says nothing.
    let several = members.iter().any(|member| *member > 0);
    for (label, member) in labels.iter_mut().zip(members).filter(|_| several) {
        *label += &format!(" {}", member + 1);
    }
    Ok(courses(labels, &steps.step().read()?, &steps.value().read()?))
}

/// A line for each label.
fn courses(labels: Vec<String>, counts: &[u64], values: &[f64]) -> Vec<Course> {
    let mut courses: Vec<Course> = Vec::new();
    for ((label, count), value) in labels.into_iter().zip(counts).zip(values) {
        let point = (*count as f64, *value);
        match courses.last_mut().filter(|course| course.name == label) {
            Some(course) => course.points.push(point),
            None => courses.push(Course {
                name: label,
                points: vec![point],
            }),
        }
    }
    courses
}

/// A line for each search; none where there was none.
fn chart(stage: &str, what: &str, count: &str, courses: &[Course]) -> Option<Chart> {
    let few = courses.len() <= NAMED;
    let series = |(course, colour): (&Course, Colour)| {
        let name = if few { course.name.as_str() } else { "" };
        Series::new(name, colour, Mark::Line, course.points.clone())
    };
    let points = || courses.iter().flat_map(|course| &course.points);
    let last = points().fold(0.0, |a: f64, (n, _)| a.max(*n));
    let note = match few {
        true => what.to_owned(),
        false => format!("{what}, {} lines", courses.len()),
    };
    let axes = [
        Axis::counting(count, 0.0, last.max(1.0)),
        Axis::above("Displacement [mm]", points().map(|(_, mm)| mm)),
    ];
    let series = courses.iter().zip(Colour::ALL.into_iter().cycle()).map(series).collect();
    (!courses.is_empty()).then(|| Chart::new(stage, axes, series).with_note(note))
}
