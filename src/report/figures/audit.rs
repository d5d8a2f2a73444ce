//! What a dataset covers, and how far its labels are from finer solutions.

use std::path::Path;

use plotters::prelude::*;

use super::axes::{Axis, Panel, panel};
use super::canvas::{Area, FigureError, draw, palette, px};

/// Counts by bins.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Edges; one more than counts.
    pub edges: Vec<f64>,
    /// Rows in each bin.
    pub counts: Vec<u64>,
}

impl Counts {
    fn are_complete(&self) -> bool {
        self.edges.len() == self.counts.len() + 1 && self.edges.windows(2).all(|pair| pair[0] < pair[1])
    }
}

/// What an audit has looked at.
#[derive(Clone, Debug, Default)]
pub struct Audited {
    /// Active part of the membrane.
    pub area: Counts,
    /// Largest displacement, mm.
    pub displacement: Counts,
    /// Largest displacement and error on a finer mesh of each row that was simulated there, mm.
    pub errors: Vec<(f64, f64)>,
    /// The error that is declared, mm, for the same rows; none where it is not.
    pub allowed: Vec<(f64, f64)>,
}

/// Draws the two histograms and, where there are such, the errors.
///
/// # Errors
/// When the counts do not fit the edges, or the file cannot be written.
pub fn draw_audit(path: &Path, data: &Audited) -> Result<(), FigureError> {
    if !data.area.are_complete() || !data.displacement.are_complete() {
        return Err(FigureError::Data(
            "an audit needs rising edges and one count per bin".into(),
        ));
    }
    let moving = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
        points.iter().copied().filter(|(_, error)| *error > 0.0).collect()
    };
    let (errors, allowed) = (moving(&data.errors), moving(&data.allowed));
    let panels = if errors.is_empty() { 2 } else { 3 };
    draw(path, (700 * panels as u32, 560), |sheet| {
        let parts = sheet.split_evenly((1, panels));
        histogram(&parts[0], "Electrode area", "Active part of the membrane", &data.area)?;
        histogram(
            &parts[1],
            "Deformation",
            "Largest displacement [mm]",
            &data.displacement,
        )?;
        match parts.get(2) {
            Some(part) => scatter(part, &errors, &allowed),
            None => Ok(()),
        }
    })
}

fn histogram(area: &Area<'_>, title: &str, label: &str, data: &Counts) -> Result<(), FigureError> {
    let most = data.counts.iter().max().copied().unwrap_or(0);
    let ends = [data.edges[0], data.edges[data.counts.len()]];
    // All values may be zero: an axis needs a length.
    let x = Axis::linear(label, ends[0], ends[1].max(ends[0] + 1e-6));
    let y = Axis::counting("Rows per bin", 0.0, (1.08 * most as f64).max(1.0));
    let mut panel = panel(area, title, &[], &x, &y)?;
    let bars = data.counts.iter().zip(data.edges.windows(2));
    let bars = bars.filter(|(count, _)| **count > 0);
    panel.draw_series(
        bars.map(|(count, edge)| Rectangle::new([(edge[0], 0.0), (edge[1], *count as f64)], palette::BLUE.filled())),
    )?;
    Ok(())
}

fn scatter(area: &Area<'_>, errors: &[(f64, f64)], allowed: &[(f64, f64)]) -> Result<(), FigureError> {
    let all = || errors.iter().chain(allowed);
    let right = all().map(|(peak, _)| *peak).fold(0.0, f64::max);
    let x = Axis::linear("Largest displacement [mm]", 0.0, 1.05 * right);
    let y = Axis::logarithmic("Error [mm]", all().map(|(_, error)| error));
    let entries = [("measured", palette::BLUE), ("allowed", palette::VERMILLION)];
    let entries = if allowed.is_empty() { &entries[..1] } else { &entries };
    let mut panel = panel(area, "Against a finer mesh", entries, &x, &y)?;
    dots(&mut panel, allowed, palette::VERMILLION)?;
    dots(&mut panel, errors, palette::BLUE)
}

fn dots(panel: &mut Panel<'_>, points: &[(f64, f64)], colour: RGBColor) -> Result<(), FigureError> {
    panel.draw_series(points.iter().map(|point| Circle::new(*point, px(4), colour.filled())))?;
    Ok(())
}
