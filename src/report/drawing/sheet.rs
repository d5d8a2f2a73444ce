//! Sheets: several drawings in rows, and how they become a file.

use std::path::Path;

use maud::{Markup, html};

use super::chart::{Chart, LEFT, LETTER, LegendKey};
use super::error::FigureError;
use super::path::number;
use super::raster::png;
use deaflow_base::write_output;

/// Drawings on a sheet, in pixels of a page.
pub struct Sheet {
    /// Width and height.
    pub size: [f64; 2],
    /// The drawing, from the upper left corner.
    pub markup: Markup,
}

/// Space above a chart on a sheet: down to the base lines of title, note and lines of the legend, and between these.
const TITLE: f64 = 27.0;
const NOTE: f64 = 17.0;
const LEGEND: f64 = 18.0;

/// Space left and right of a chart on a sheet.
const MARGIN: f64 = 6.0;

impl Sheet {
    /// Places drawings one below the other.
    pub fn below(drawings: Vec<Self>) -> Self {
        Self::grid(1, drawings)
    }

    /// Places drawings in rows; columns are as wide and rows as high as their largest drawing.
    pub fn grid(columns: usize, drawings: Vec<Self>) -> Self {
        let columns = columns.max(1);
        let mut widths = vec![0.0_f64; columns.min(drawings.len())];
        let mut heights = vec![0.0_f64; drawings.len().div_ceil(columns)];
        for (k, drawing) in drawings.iter().enumerate() {
            let (column, row) = (k % columns, k / columns);
            widths[column] = widths[column].max(drawing.size[0]);
            heights[row] = heights[row].max(drawing.size[1]);
        }
        let before = |sizes: &[f64], k: usize| number(sizes[..k].iter().sum(), 1);
        let placed = drawings.iter().enumerate().map(|(k, drawing)| {
            let (x, y) = (before(&widths, k % columns), before(&heights, k / columns));
            html! { g transform={ "translate(" (x) " " (y) ")" } { (drawing.markup) } }
        });
        Self {
            markup: html! { @for drawing in placed { (drawing) } },
            size: [widths.iter().sum(), heights.iter().sum()],
        }
    }

    /// Places charts in rows, each below its title, note and legend.
    pub fn charts(columns: usize, charts: &[Chart]) -> Self {
        let head = charts.iter().map(head).fold(0.0, f64::max);
        let drawn = |chart: &Chart| {
            let [width, height] = chart.size;
            Self {
                size: [width.max(heading_width(chart)) + 2.0 * MARGIN, head + height + MARGIN],
                markup: html! {
                    g.chart transform={ "translate(" (MARGIN) " 0)" } {
                        (heading(chart))
                        g transform={ "translate(0 " (number(head, 1)) ")" } { (chart.plot()) }
                    }
                },
            }
        };
        Self::grid(columns, charts.iter().map(drawn).collect())
    }

    /// Draws it as an element of a page.
    pub fn svg(&self, description: &str) -> Markup {
        let [width, height] = self.size.map(|v| number(v, 1));
        html! {
            svg viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height)
                role="img" aria-label=(description) {
                title { (description) }
                (self.markup)
            }
        }
    }

    /// Writes it as a PNG file, atomically.
    ///
    /// # Errors
    /// If it cannot be drawn or written.
    pub fn write_png(&self, path: &Path) -> Result<(), FigureError> {
        Ok(write_output(path, &png(self.size, &self.markup)?)?)
    }
}

/// Returns the height of what is above a chart.
fn head(chart: &Chart) -> f64 {
    let note = if chart.note.is_empty() { 0.0 } else { NOTE };
    TITLE + note + LEGEND * legend(chart).len() as f64 + 2.0
}

/// Returns the width of title and note, which start at the left edge of the sheet if they are wide.
fn heading_width(chart: &Chart) -> f64 {
    let letters = |text: &str| text.chars().count() as f64;
    (1.2 * LETTER * letters(&chart.title)).max(LETTER * letters(&chart.note))
}

fn heading(chart: &Chart) -> Markup {
    let note = if chart.note.is_empty() { 0.0 } else { NOTE };
    // A heading wider than the frame starts farther left.
    let wide = heading_width(chart);
    let left = LEFT.min(chart.size[0] - wide).max(0.0);
    html! {
        text class="title" x=(number(left, 1)) y="20" { (chart.title) }
        @if note > 0.0 { text x=(LEFT.min(left)) y="37" { (chart.note) } }
        @for (line, entries) in legend(chart).iter().enumerate() {
            @let y = TITLE + note + LEGEND * line as f64 + 9.0;
            @for LegendEntry { x, key, class, name } in entries {
                (legend_key(*key, class, [*x, y - 9.0]))
                text class="ink" x=(number(x + 15.0, 1)) y=(number(y + 1.0, 1)) { (name) }
            }
        }
    }
}

/// Draws the key of an entry, 11 pixels wide and high, from its upper left corner.
fn legend_key(key: LegendKey, class: &str, [x, y]: [f64; 2]) -> Markup {
    let (left, top) = (number(x, 1), number(y, 1));
    let middle = number(y + 5.5, 1);
    html! {
        @match key {
            LegendKey::Square => { rect class={ "bars " (class) } x=(left) y=(top) width="11" height="11" rx="2" {} }
            LegendKey::Line => { path class={ "line " (class) } d={ "M" (left) " " (middle) "h11" } {} }
            LegendKey::Dashed => { path class={ "dashed " (class) } d={ "M" (left) " " (middle) "h14" } {} }
            LegendKey::Dot => { circle class=(class) cx=(number(x + 5.5, 1)) cy=(middle) r="4" {} }
        }
    }
}

/// An entry of a legend.
struct LegendEntry<'c> {
    /// Its left edge.
    x: f64,
    key: LegendKey,
    /// The class of its colour.
    class: &'static str,
    name: &'c str,
}

/// Returns the lines of the legend.
fn legend(chart: &Chart) -> Vec<Vec<LegendEntry<'_>>> {
    let mut lines: Vec<Vec<LegendEntry<'_>>> = Vec::new();
    let mut x = f64::INFINITY;
    for (key, colour, name) in chart.legend() {
        let wide = 15.0 + LETTER * name.chars().count() as f64;
        if x + wide > chart.size[0] {
            lines.push(Vec::new());
            x = LEFT;
        }
        if let Some(line) = lines.last_mut() {
            let class = colour.class();
            line.push(LegendEntry { x, key, class, name });
        }
        x += wide + 16.0;
    }
    lines
}
