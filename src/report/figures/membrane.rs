//! A membrane, deformed: the electrode moved by its displacement field, and where it moves how far.

use std::path::Path;

use plotters::prelude::*;

use super::axes::{Axis, Panel, square};
use super::canvas::{Area, FigureError, draw, palette, px, text};

const CELLS: usize = 50;
const CORNERS: usize = CELLS + 1;

/// A pattern with its displacement field.
#[derive(Clone, Debug)]
pub struct Membrane {
    /// 50 × 50 cells, `[y][x]` from the lower left, 1 = electrode.
    pub pattern: Vec<u8>,
    /// Displacement in mm at the 51 × 51 cell corners, `[y][x][component]`.
    pub displacement: Vec<f64>,
    /// Side of the membrane in mm.
    pub side: f64,
    /// The points whose displacements are wanted, in mm from the lower left corner.
    pub points: Vec<[f64; 2]>,
}

impl Membrane {
    pub(super) fn validate(&self) -> Result<(), FigureError> {
        let complete = self.pattern.len() == CELLS * CELLS && self.displacement.len() == CORNERS * CORNERS * 2;
        let usable = self.displacement.iter().all(|u| u.is_finite()) && self.side.is_finite() && self.side > 0.0;
        if complete && usable {
            return Ok(());
        }
        Err(FigureError::Data(
            "a membrane needs 50 × 50 cells and a finite field at 51 × 51 corners".into(),
        ))
    }

    fn at_corner(&self, x: usize, y: usize) -> [f64; 2] {
        let at = 2 * (y * CORNERS + x);
        [self.displacement[at], self.displacement[at + 1]]
    }

    /// Largest displacement over the corners, in mm.
    pub(super) fn largest(&self) -> f64 {
        self.displacement
            .chunks_exact(2)
            .map(|u| u[0].hypot(u[1]))
            .fold(0.0, f64::max)
    }

    /// Displacement at a point, bilinear between the corners.
    fn at(&self, point: [f64; 2]) -> [f64; 2] {
        let split = |c: f64| {
            let c = (c / self.side * CELLS as f64).clamp(0.0, CELLS as f64);
            let low = (c.floor() as usize).min(CELLS - 1);
            (low, c - low as f64)
        };
        let ((i, s), (j, t)) = (split(point[0]), split(point[1]));
        std::array::from_fn(|k| {
            let row = |j| (1.0 - s) * self.at_corner(i, j)[k] + s * self.at_corner(i + 1, j)[k];
            (1.0 - t) * row(j) + t * row(j + 1)
        })
    }

    /// A corner where it has moved to, displacements drawn `scale` times.
    fn moved(&self, x: usize, y: usize, scale: f64) -> (f64, f64) {
        let (u, cell) = (self.at_corner(x, y), self.side / CELLS as f64);
        (x as f64 * cell + scale * u[0], y as f64 * cell + scale * u[1])
    }

    fn quad(&self, x: usize, y: usize, scale: f64) -> Vec<(f64, f64)> {
        [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)]
            .map(|(x, y)| self.moved(x, y, scale))
            .to_vec()
    }

    fn is_active(&self, x: usize, y: usize) -> bool {
        self.pattern[y * CELLS + x] == 1
    }

    /// Electrode area, a fraction of the membrane.
    pub(super) fn area(&self) -> f64 {
        self.pattern.iter().map(|&c| f64::from(c)).sum::<f64>() / (CELLS * CELLS) as f64
    }

    /// The edges between an electrode and bare membrane, as pairs of corners.
    fn edges(&self) -> Vec<[(usize, usize); 2]> {
        let on = |x: usize, y: usize| x < CELLS && y < CELLS && self.is_active(x, y);
        let mut edges = Vec::new();
        for a in 0..CORNERS {
            for b in 0..CELLS {
                let left = a > 0 && on(a - 1, b);
                if left != on(a, b) {
                    edges.push([(a, b), (a, b + 1)]);
                }
                let below = a > 0 && on(b, a - 1);
                if below != on(b, a) {
                    edges.push([(b, a), (b + 1, a)]);
                }
            }
        }
        edges
    }
}

/// How many times larger than true displacements are drawn, so that they are seen: 1, 2, 5, 10, …
pub(super) fn exaggeration(membranes: &[&Membrane]) -> f64 {
    let largest = membranes.iter().map(|m| m.largest() / m.side).fold(0.0, f64::max);
    let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];
    let fits = |s: &&f64| **s * largest <= 0.1;
    if largest > 0.0 {
        *steps.iter().rev().find(fits).unwrap_or(&1.0)
    } else {
        1.0
    }
}

/// Draws the electrode at rest and deformed, and the magnitude of the displacement.
///
/// # Errors
/// When the data are incomplete, or the file cannot be written.
pub fn draw_membrane(path: &Path, title: &str, data: &Membrane) -> Result<(), FigureError> {
    data.validate()?;
    let scale = exaggeration(&[data]);
    draw(path, (1580, HEIGHT), |sheet| {
        let (left, rest) = sheet.split_horizontally(px(720));
        electrode(&left, title, data, scale)?;
        let (map, bar) = rest.split_horizontally(px(720));
        magnitude(&map, data, scale)?;
        colour_bar(&bar, data.largest())
    })
}

fn frame<'a>(area: &Area<'a>, title: &str, note: &str, side: f64) -> Result<Panel<'a>, FigureError> {
    let axis = |name: &str| Axis::linear(&format!("{name} [mm]"), 0.0, side);
    square(area, title, note, [&axis("x"), &axis("y")])
}

/// The electrode where it has moved to over its outline at rest, with the arrow of the wanted point.
pub(super) fn electrode(area: &Area<'_>, title: &str, data: &Membrane, scale: f64) -> Result<(), FigureError> {
    let factor = if scale > 1.0 {
        format!("displacements ×{scale:.0}")
    } else {
        "true to scale".into()
    };
    let note = format!("area {:.1} %, {factor}, grey: at rest", 100.0 * data.area());
    let mut panel = frame(area, title, &note, data.side)?;
    active(&mut panel, data, scale)?;
    outline(&mut panel, data, 0.0, palette::GREY.stroke_width(px(1)))?;
    outline(&mut panel, data, scale, palette::BLUE.stroke_width(px(2)))?;
    arrows(&mut panel, data, scale)
}

/// The electrode where it has moved to on its outline at rest, without axes, below two lines of text.
pub(super) fn thumbnail(
    area: &Area<'_>,
    captions: &[String; 2],
    data: &Membrane,
    scale: f64,
) -> Result<(), FigureError> {
    let (upper, lower) = area.split_vertically(px(52));
    for (caption, top) in captions.iter().zip([0, 25]) {
        let place = (px(6) as i32, px(top) as i32);
        upper.draw(&Text::new(caption.clone(), place, text(21, palette::INK)))?;
    }
    let (width, height) = lower.dim_in_pixel();
    let free = height.saturating_sub(width);
    let mut panel: Panel<'_> = ChartBuilder::on(&lower)
        .margin(px(3))
        .margin_bottom(px(3) + free)
        .build_cartesian_2d(Axis::linear("", 0.0, data.side), Axis::linear("", 0.0, data.side))?;
    panel.draw_series([Rectangle::new(
        [(0.0, 0.0), (data.side, data.side)],
        palette::GREY.stroke_width(px(1)),
    )])?;
    active(&mut panel, data, scale)?;
    outline(&mut panel, data, scale, palette::BLUE.stroke_width(px(1)))?;
    arrows(&mut panel, data, scale)
}

/// The active cells where they have moved to.
fn active(panel: &mut Panel<'_>, data: &Membrane, scale: f64) -> Result<(), FigureError> {
    let cells = (0..CELLS * CELLS)
        .map(|at| (at % CELLS, at / CELLS))
        .filter(|&(x, y)| data.is_active(x, y));
    panel.draw_series(cells.map(|(x, y)| Polygon::new(data.quad(x, y, scale), palette::SKY.filled())))?;
    Ok(())
}

fn outline(panel: &mut Panel<'_>, data: &Membrane, scale: f64, style: ShapeStyle) -> Result<(), FigureError> {
    let edges = data.edges().into_iter();
    panel.draw_series(edges.map(|pair| PathElement::new(pair.map(|(x, y)| data.moved(x, y, scale)), style)))?;
    Ok(())
}

/// The displacements of the wanted points.
fn arrows(panel: &mut Panel<'_>, data: &Membrane, scale: f64) -> Result<(), FigureError> {
    data.points
        .iter()
        .try_for_each(|&point| arrow(panel, data, point, scale))
}

/// One displacement; only its point where it would be too short for an arrow.
fn arrow(panel: &mut Panel<'_>, data: &Membrane, point: [f64; 2], scale: f64) -> Result<(), FigureError> {
    let u = data.at(point);
    let tip = (point[0] + scale * u[0], point[1] + scale * u[1]);
    let length = (scale * u[0]).hypot(scale * u[1]);
    let style = palette::VERMILLION.stroke_width(px(3));
    panel.draw_series([Circle::new(
        (point[0], point[1]),
        px(6),
        palette::VERMILLION.stroke_width(px(2)),
    )])?;
    if length < 1e-3 * data.side {
        return Ok(());
    }
    let (dx, dy) = (scale * u[0] / length, scale * u[1] / length);
    let head = (0.4 * length).min(0.028 * data.side);
    let wing = |side: f64| {
        (
            tip.0 - head * (dx - 0.5 * side * dy),
            tip.1 - head * (dy + 0.5 * side * dx),
        )
    };
    let base = (tip.0 - 0.9 * head * dx, tip.1 - 0.9 * head * dy);
    panel.draw_series([PathElement::new([(point[0], point[1]), base], style)])?;
    panel.draw_series([Polygon::new([tip, wing(1.0), wing(-1.0)], palette::VERMILLION.filled())])?;
    Ok(())
}

fn magnitude(area: &Area<'_>, data: &Membrane, scale: f64) -> Result<(), FigureError> {
    let note = match data.points[..] {
        [p] => {
            let u = data.at(p);
            format!(
                "({}, {}) mm moves by ({:.3}, {:.3}) mm",
                p[0],
                p[1],
                u[0] + 0.0,
                u[1] + 0.0
            )
        }
        _ => format!("largest {:.3} mm", data.largest()),
    };
    let mut panel = frame(area, "Magnitude of the displacement", &note, data.side)?;
    let largest = data.largest().max(f64::MIN_POSITIVE);
    let mean = |x, y| {
        let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)];
        corners
            .map(|(x, y)| data.at_corner(x, y))
            .iter()
            .map(|u| u[0].hypot(u[1]))
            .sum::<f64>()
            / 4.0
    };
    let cells = (0..CELLS * CELLS).map(|at| (at % CELLS, at / CELLS));
    panel.draw_series(
        cells.map(|(x, y)| Polygon::new(data.quad(x, y, scale), viridis(mean(x, y) / largest).filled())),
    )?;
    outline(&mut panel, data, scale, WHITE.stroke_width(px(1)))?;
    arrows(&mut panel, data, scale)
}

/// Pixels from top to bottom of the sheet.
const HEIGHT: u32 = 745;

/// What is below the colour bar: the map beside it is 594 pixels high, with 76 above.
const BELOW_BAR: u32 = HEIGHT - 76 - 594;

fn colour_bar(area: &Area<'_>, largest: f64) -> Result<(), FigureError> {
    let high = if largest > 0.0 { largest } else { 1.0 };
    let mut chart = ChartBuilder::on(area)
        .margin_top(px(76))
        .margin_bottom(px(BELOW_BAR))
        .margin_right(px(10))
        .right_y_label_area_size(px(84))
        .build_cartesian_2d(0.0..1.0, Axis::linear("", 0.0, high))?;
    let steps = 200;
    chart.draw_series((0..steps).map(|k| {
        let at = |k: i32| f64::from(k) / f64::from(steps);
        Rectangle::new([(0.0, high * at(k)), (1.0, high * at(k + 1))], viridis(at(k)).filled())
    }))?;
    chart
        .configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .axis_style(palette::INK.stroke_width(px(1)))
        .y_label_style(text(20, palette::INK))
        .axis_desc_style(text(23, palette::INK))
        .y_desc("|u| [mm]")
        .set_all_tick_mark_size(px(5))
        .draw()?;
    Ok(())
}

/// The colour map viridis by S. van der Walt and N. Smith (matplotlib), between nine of its colours.
fn viridis(t: f64) -> RGBColor {
    const COLOURS: [[f64; 3]; 9] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
        [253.0, 231.0, 37.0],
    ];
    let at = t.clamp(0.0, 1.0) * 8.0;
    let low = (at.floor() as usize).min(7);
    let [r, g, b] = std::array::from_fn(|k| {
        let (a, b) = (COLOURS[low][k], COLOURS[low + 1][k]);
        (a + (b - a) * (at - low as f64)).round() as u8
    });
    RGBColor(r, g, b)
}
