//! Displacement against voltage, from rest past the loss of stability.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{Axis, Entry, Panel, panel};
use super::canvas::{FigureError, draw, palette, px, text};

/// The path of one pattern. The curves have one value per point, from rest on.
#[derive(Clone, Debug)]
pub struct Branch {
    /// Its name.
    pub name: String,
    /// Voltage in V.
    pub voltage: Vec<f64>,
    /// Displacement of one point of the membrane, in mm.
    pub displacement: Vec<f64>,
    /// Whether a membrane can be found in that state.
    pub stable: Vec<bool>,
    /// What ends the stable part that begins at rest.
    pub limit: Option<Limit>,
}

/// Where a stable part ends.
#[derive(Clone, Debug)]
pub struct Limit {
    /// What happens there.
    pub name: String,
    /// Voltage in V.
    pub voltage: f64,
    /// Displacement in mm.
    pub displacement: f64,
}

const COLOURS: [RGBColor; 5] = [
    palette::BLUE,
    palette::VERMILLION,
    palette::GREEN,
    palette::ORANGE,
    palette::SKY,
];

/// Draws displacement against voltage, solid where stable and dashed where not, with the limits marked.
///
/// # Errors
/// When there are no branches or their data are incomplete, or the file cannot be written.
pub fn draw_paths(path: &Path, branches: &[Branch]) -> Result<(), FigureError> {
    let incomplete = |b: &Branch| {
        let n = b.voltage.len();
        let numbers = b.voltage.iter().chain(&b.displacement);
        n == 0 || [b.displacement.len(), b.stable.len()] != [n; 2] || numbers.into_iter().any(|v| !v.is_finite())
    };
    if branches.is_empty() || branches.iter().any(incomplete) {
        return Err(FigureError::Data(
            "a path needs finite values at each of its points".into(),
        ));
    }
    let kilovolts: Vec<f64> = branches.iter().flat_map(|b| &b.voltage).map(|v| 1e-3 * v).collect();
    let millimetres: Vec<f64> = branches.iter().flat_map(|b| &b.displacement).copied().collect();
    let (x, y) = (
        Axis::above("Voltage [kV]", &kilovolts),
        Axis::above("Displacement of the point that moves most [mm]", &millimetres),
    );
    draw(path, (1200, 760), |sheet| {
        let title = match branches {
            [one] => one
                .limit
                .as_ref()
                .map_or("Load path without a limit".to_owned(), |limit| {
                    format!("Load path: {} at {:.3} kV", limit.name, 1e-3 * limit.voltage)
                }),
            _ => "Load paths: stable solid, unstable dashed".to_owned(),
        };
        let entries: Vec<Entry<'_>> = match branches {
            [_] => Vec::new(),
            _ if branches.len() > COLOURS.len() => Vec::new(),
            _ => branches.iter().map(|b| b.name.as_str()).zip(COLOURS).collect(),
        };
        let mut panel = panel(sheet, &title, &entries, &x, &y)?;
        for (branch, colour) in branches.iter().zip(COLOURS.into_iter().cycle()) {
            curve(&mut panel, branch, colour)?;
            mark(&mut panel, branch, colour, branches.len() == 1)?;
        }
        Ok(())
    })
}

/// Runs of stable and of unstable points.
fn curve(panel: &mut Panel<'_>, branch: &Branch, colour: RGBColor) -> Result<(), FigureError> {
    let point = |k: usize| (1e-3 * branch.voltage[k], branch.displacement[k]);
    let n = branch.stable.len();
    let mut first = 0;
    while first < n {
        let same = branch.stable[first..]
            .iter()
            .take_while(|s| **s == branch.stable[first])
            .count();
        // A run begins where the last one ends, so that no gap shows.
        let run: Vec<(f64, f64)> = (first.saturating_sub(1)..first + same).map(point).collect();
        if branch.stable[first] {
            panel.draw_series(LineSeries::new(run, colour.stroke_width(px(2))))?;
        } else {
            let style = colour.stroke_width(px(2));
            panel.draw_series(DashedLineSeries::new(run, px(9), px(6), style))?;
        }
        first += same;
    }
    Ok(())
}

/// The limit, with its name where there is room.
fn mark(panel: &mut Panel<'_>, branch: &Branch, colour: RGBColor, named: bool) -> Result<(), FigureError> {
    let Some(limit) = &branch.limit else {
        return Ok(());
    };
    let at = (1e-3 * limit.voltage, limit.displacement);
    panel.draw_series([Circle::new(at, px(6), colour.filled())])?;
    if named {
        let style = text(20, palette::INK).pos(Pos::new(HPos::Right, VPos::Center));
        let place = |dx: i32| EmptyElement::at(at) + Text::new(limit.name.clone(), (-dx, 0), style);
        panel.draw_series([place(px(14) as i32)])?;
    }
    Ok(())
}
