//! What accuracy costs: the error of each method over its time.

use super::chart::{Chart, Mark, Series};
use crate::report::figures::{Axis, Cost, FamilyCosts, pareto_front};
use crate::report::gather::{Made, ReportError, costs, each};
use crate::report::html::Page;
use crate::store::Store;

/// Colours of the kinds of methods, in the order of [`Cost::kinds`].
const COLOURS: [&str; 7] = ["vermillion", "orange", "green", "sky", "blue", "purple", "grey"];

/// Adds a section where accuracy was measured.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let measured = each(store, made, "accuracy", |source| {
        Ok((source.stage.stage.clone(), costs(source)?))
    })?;
    if measured.is_empty() {
        return Ok(());
    }
    page.section("Accuracy and time");
    page.lines(&["Error of each method over the time of one core per pattern. Ringed and named: no other method is both faster and \
                  more accurate. 2² Q1 is 2 × 2 bilinear elements per cell, Q2 are biquadratic ones; a length is the accuracy that \
                  was asked for."
        .to_owned()]);
    for (name, families) in &measured {
        page.part(name);
        let charts: String = families.iter().map(chart).collect();
        page.markup(&format!("<div class=\"charts\">\n{charts}</div>\n"));
    }
    Ok(())
}

fn chart(family: &FamilyCosts) -> String {
    let costs = family.costs.iter();
    let costs: Vec<&Cost> = costs.filter(|c| c.error > 0.0 && c.seconds > 0.0).collect();
    let points: Vec<(f64, f64)> = costs.iter().map(|c| (1e3 * c.seconds, c.error)).collect();
    let front = pareto_front(&points);
    let best: Vec<(f64, f64)> = front.iter().map(|&k| points[k]).collect();
    let mut series = vec![Series::new("", "grey", Mark::Dashed, best.clone())];
    for (kind, (name, colour)) in Cost::kinds().zip(COLOURS).enumerate() {
        let own: Vec<usize> = (0..costs.len()).filter(|k| costs[*k].kind() == kind).collect();
        if own.is_empty() {
            continue;
        }
        let words = own.iter().map(|&k| {
            let (time, error) = points[k];
            format!("{}: {time:.3} ms, {error:.2e} mm", costs[k].settings)
        });
        let words = words.collect();
        let dots = own.iter().map(|&k| points[k]).collect();
        series.push(Series::new(name, colour, Mark::Dots, dots).saying(words));
    }
    for &k in &front {
        let colour = COLOURS.get(costs[k].kind()).copied().unwrap_or("grey");
        let label = vec![costs[k].label()];
        series.push(Series::new("", colour, Mark::Labelled, vec![points[k]]).saying(label));
    }
    let (times, errors): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
    let chart = Chart {
        title: &family.family,
        note: "",
        x: Axis::logarithmic("Time per pattern [ms]", &times),
        y: Axis::logarithmic("RMS error of a component [mm]", &errors),
        series,
    };
    chart.figure()
}
