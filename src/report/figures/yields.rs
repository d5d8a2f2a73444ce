//! Devices as they are made: which share of them reaches a displacement, and which tolerance decides it.

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet, extent};
use crate::format::three;

/// The devices of a design.
#[derive(Clone, Debug)]
pub struct DesignYields {
    /// Its name.
    pub name: String,
    /// Number of devices.
    pub devices: usize,
    /// Displacements in mm of those that do not fail.
    pub displacements: Vec<f64>,
    /// The displacement in mm that they have to reach.
    pub wanted_mm: Option<f64>,
    /// Shares of the variance by the name of the tolerance.
    pub shares: Vec<(&'static str, f64)>,
}

/// Size of a chart.
const SIZE: [f64; 2] = [708.0, 260.0];
/// Shares of the variance below this are not drawn.
const LISTED: f64 = 0.005;
/// Width of the bars of a tolerance.
const WIDTH: f64 = 0.7;

/// Draws the share of devices that reach each displacement, and below it the shares of the variance.
///
/// # Errors
/// If there is no device that does not fail, or a displacement is not finite.
pub fn yields_sheet(designs: &[DesignYields]) -> Result<Sheet, FigureError> {
    let charts = [Some(reached_chart(designs)?), shares(designs)];
    let charts = charts.into_iter().flatten().map(|chart| chart.with_size(SIZE));
    Ok(Sheet::below(charts.map(|chart| Sheet::charts(1, &[chart])).collect()))
}

/// Draws the share of devices that reach each displacement.
///
/// # Errors
/// As [`yields_sheet`].
pub(crate) fn reached_chart(designs: &[DesignYields]) -> Result<Chart, FigureError> {
    let all = || designs.iter().flat_map(|design| &design.displacements);
    if all().next().is_none() || !all().all(|mm| mm.is_finite()) {
        return Err(FigureError::Data(
            "a figure of yields needs devices with finite displacements".into(),
        ));
    }
    let (low, high) = extent(all(), (f64::INFINITY, f64::NEG_INFINITY));
    let margin = (0.02 * (high - low)).max(1e-6);
    // A displacement that is far from all devices would leave no room for these.
    let is_near = |mm: &f64| (low - (high - low)..=high + (high - low)).contains(mm);
    let mut wanted: Vec<(f64, &str, Colour)> = Vec::new();
    for (design, colour) in Series::coloured(designs) {
        let mm = design.wanted_mm.filter(is_near);
        let mm = mm.filter(|mm| wanted.iter().all(|(other, ..)| other != mm));
        wanted.extend(mm.map(|mm| (mm, design.name.as_str(), colour)));
    }
    let ends = [low, high].into_iter().chain(wanted.iter().map(|(mm, ..)| *mm));
    let (low, high) = ends.fold((low, high), |(low, high), mm| (low.min(mm), high.max(mm)));
    let curve = |(design, colour): (&DesignYields, Colour)| {
        let mut sorted = design.displacements.clone();
        sorted.sort_by(f64::total_cmp);
        let percent = |number: usize| 100.0 * number as f64 / design.devices as f64;
        // All that do not fail reach a displacement below the least.
        let first = (low - margin, percent(sorted.len()));
        let steps = sorted
            .iter()
            .enumerate()
            .map(|(below, mm)| (*mm, percent(sorted.len() - below)));
        let last = sorted.last().map(|mm| (*mm, 0.0));
        let points = std::iter::once(first).chain(steps).chain(last).collect();
        Series::new(&design.name, colour, Mark::Line, points)
    };
    let mut series: Vec<Series> = Series::coloured(designs).map(curve).collect();
    let is_common = wanted.len() == 1;
    series.extend(wanted.into_iter().map(|(mm, design, own)| {
        let (name, colour) = match is_common {
            true => ("wanted".to_owned(), Colour::Grey),
            false => (format!("wanted of {design}"), own),
        };
        Series::new(&name, colour, Mark::Dashed, vec![(mm, 0.0), (mm, 100.0)])
    }));
    let axes = [
        Axis::linear("Displacement [mm]", low - margin, high + margin),
        Axis::linear("Devices that reach it [%]", 0.0, 100.0),
    ];
    Ok(Chart::new("Devices that reach a displacement", axes, series))
}

/// Draws the shares of the variance, the largest of the first design first; `None` if there are none.
fn shares(designs: &[DesignYields]) -> Option<Chart> {
    let known: Vec<&DesignYields> = designs.iter().filter(|design| !design.shares.is_empty()).collect();
    let share = |design: &DesignYields, name: &str| {
        let own = design.shares.iter().find(|(own, _)| *own == name);
        own.map_or(0.0, |(_, share)| *share)
    };
    let first = known.first()?;
    let is_listed = |name: &str| known.iter().any(|design| share(design, name) >= LISTED);
    let mut names: Vec<&'static str> = first
        .shares
        .iter()
        .map(|(name, _)| *name)
        .filter(|name| is_listed(name))
        .collect();
    names.sort_by(|one, other| share(first, other).total_cmp(&share(first, one)));
    let width = WIDTH / known.len() as f64;
    let bars = |((at, design), colour): ((usize, &&DesignYields), Colour)| {
        let left = |place: usize| place as f64 - 0.5 * WIDTH + at as f64 * width;
        let corners = names.iter().enumerate().flat_map(|(place, name)| {
            [
                (left(place), 0.0),
                (left(place) + width, 100.0 * share(design, name).max(0.0)),
            ]
        });
        let texts = names.iter().map(|name| three(100.0 * share(design, name)));
        Series::new(&design.name, colour, Mark::Bars, corners.collect()).with_texts(match known.len() {
            1 => texts.collect(),
            _ => Vec::new(),
        })
    };
    let series = Series::coloured(known.iter().enumerate()).map(bars).collect();
    let axes = [
        Axis::names(names.iter().map(|name| (*name).to_owned()).collect()),
        Axis::linear("Share of the variance [%]", 0.0, 100.0),
    ];
    (!names.is_empty()).then(|| Chart::new("Which tolerance decides the displacement", axes, series))
}
