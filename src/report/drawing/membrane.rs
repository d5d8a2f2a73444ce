//! Membranes: a pattern at rest, and the same deformed by its displacement.
//!
//! Everything is drawn in thousandths of the longer side of the membrane, in a square with the membrane at its lower
//! left. Only the edges of electrodes are written, not their cells: hundreds of membranes fit in one page.

use std::collections::BTreeMap;

use maud::{Markup, html};

use super::chart::THOUSAND;
use super::error::FigureError;
use super::path::{head, number, path, steady_path};
use super::sides;
use deaflow_field::Field;
use deaflow_pattern as pattern;
use deaflow_pattern::{Bits, Corners, Island, Part, Pattern, PatternForm, Point, Polygons, Raster, outlines};
use deaflow_scene::{Scene, Sides};

/// Margin of a drawing, thousandths of its side.
const MARGIN: f64 = 12.0;

/// Cells between two lines of the grid, and between two points of a deformed line.
const GRID: usize = 5;
const STEP: usize = 2;

/// The largest displacement in a drawing, as a fraction of the side.
const FARTHEST: f64 = 0.1;

/// Heights are drawn at most so high from the side, as a share of the longer side, and lengths along y so short.
const HIGHEST: f64 = 0.3;
const TILT: f64 = 0.4;

/// The rectangle of a membrane, with its frame and bodies.
#[derive(Clone, Debug, PartialEq)]
pub struct Background {
    plane: pattern::Membrane,
    /// The edges of the frame within the rectangle, and of rigid bodies, in cells.
    frame: Polygons,
    bodies: Vec<Vec<Point>>,
    /// The cells that may carry electrodes; `None` if all can.
    free: Option<Bits>,
    /// What supports the sides, if not all are held.
    sides: Option<Sides>,
}

impl Background {
    /// Creates the background of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let (parts, borders, plane) = (scene.parts(), scene.borders(), scene.membrane());
        let cells = |is_in: fn(Part) -> bool| {
            let cells = parts.as_ref().map(|parts| parts.cells(is_in).pattern());
            cells.iter().flat_map(rings).collect()
        };
        let (frame, bodies) = match &borders {
            None => (cells(|part| part == Part::Frame), cells(|part| part.body().is_some())),
            Some(borders) => {
                let whole = Polygons::of_membrane(plane);
                let opening = borders.opening.as_ref();
                let frame = opening.map_or_else(Polygons::default, |opening| whole.without(opening));
                let bodies = borders.bodies.iter().flat_map(|body| curves(body, plane));
                (curves(&frame, plane), bodies.collect())
            }
        };
        Self {
            plane,
            frame: Polygons::of_rings(frame),
            bodies,
            free: parts.as_ref().map(|parts| parts.free_cells()),
            sides: scene.geometry.sides.clone(),
        }
    }

    /// Creates a rectangle without frame and bodies.
    #[must_use]
    pub fn plain(plane: pattern::Membrane) -> Self {
        Self {
            plane,
            frame: Polygons::default(),
            bodies: Vec::new(),
            free: None,
            sides: None,
        }
    }

    /// Creates the square of the source paper.
    #[must_use]
    pub fn paper() -> Self {
        Self::plain(pattern::Membrane::square(1.0))
    }

    /// Whether its grid is that of the source paper.
    #[must_use]
    pub fn has_paper_grid(&self) -> bool {
        self.plane.raster == Raster::PAPER && self.plane.size_mm[0] == self.plane.size_mm[1]
    }

    /// Whether a place in cells is in the frame.
    fn is_in_frame(&self, at: Point) -> bool {
        let [columns, rows] = self.raster().sides();
        let cell = |axis: usize, cells: usize| (at[axis].max(0.0) as usize).min(cells.saturating_sub(1));
        // Curves are only followed where the cell carries no electrode, as hundreds of membranes are drawn.
        let is_free = |free: &Bits| free.has(cell(0, columns), cell(1, rows));
        !self.free.as_ref().is_none_or(is_free) && self.frame.contains(at)
    }

    /// Returns its cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.plane.raster
    }

    /// Returns its sides in mm.
    #[must_use]
    pub fn size_mm(&self) -> [f64; 2] {
        self.plane.size_mm
    }

    /// Returns the longer side in mm.
    #[must_use]
    pub fn side(&self) -> f64 {
        self.plane.size_mm[0].max(self.plane.size_mm[1])
    }

    /// Returns its part of the drawing, with a margin: left, top, width and height in thousandths of the longer side.
    ///
    /// Sides that are not held may move by a part of the size.
    #[must_use]
    pub fn view(&self) -> [f64; 4] {
        let margin = match self.sides {
            None => MARGIN,
            Some(_) => MARGIN + THOUSAND * FARTHEST,
        };
        let [width, height] = self.plane.size_mm.map(|size| (THOUSAND * size / self.side()).round());
        [
            -margin,
            THOUSAND - height - margin,
            width + 2.0 * margin,
            height + 2.0 * margin,
        ]
    }

    /// Returns what supports the sides, if not all are held.
    #[must_use]
    pub fn sides(&self) -> Option<&Sides> {
        self.sides.as_ref()
    }

    /// Draws the sides at rest, if not all are held.
    #[must_use]
    pub fn draw_sides(&self) -> Markup {
        let side = self.side();
        html! {
            @if let Some(sides) = &self.sides { (sides::draw(sides, self.plane.size_mm, |at| to_drawing(at, side))) }
        }
    }

    /// Converts a corner of cells to mm.
    fn in_mm(&self, corner: Point) -> Point {
        let sides = self.plane.raster.sides();
        [0, 1].map(|axis| corner[axis] * self.plane.size_mm[axis] / sides[axis] as f64)
    }

    /// Returns the position of a corner of cells in the drawing.
    fn to_drawing(&self, corner: Point) -> (f64, f64) {
        to_drawing(self.in_mm(corner), self.side())
    }

    /// Returns the columns and rows of cells at which the lines of the grid are.
    fn lines(&self) -> [Vec<usize>; 2] {
        self.plane
            .raster
            .sides()
            .map(|cells| (GRID..cells).step_by(GRID).collect())
    }

    /// Draws the edge of the membrane and the frame.
    #[must_use]
    pub fn draw_frame(&self) -> Markup {
        let [width, height] = self.plane.size_mm;
        let edge = match width == height {
            true => "M0 0h1000v1000h-1000z".to_owned(),
            false => {
                let ([x, y], side) = ([width, height], self.side());
                let corners = [[0.0, y], [x, y], [x, 0.0], [0.0, 0.0]];
                path(&corners.map(|corner| to_drawing(corner, side)), true)
            }
        };
        html! {
            path class=(if self.sides.is_some() { "mount" } else { "frame" }) d=(edge) {}
            @if !self.frame.is_empty() { path class="held" d=(self.edge(self.frame.rings())) {} }
        }
    }

    /// Draws the grid at rest.
    #[must_use]
    pub fn grid(&self) -> Markup {
        let [across, up] = self.lines();
        let sides = self.plane.raster.sides().map(|cells| cells as f64);
        let line = |from: Point, to: Point| {
            let [(x, y), (to_x, to_y)] = [from, to].map(|corner| self.to_drawing(corner));
            let mark = |at: f64| number(at, 1);
            match x == to_x {
                true => format!("M{} {}V{}", mark(x), mark(to_y), mark(y)),
                false => format!("M{} {}H{}", mark(x), mark(y), mark(to_x)),
            }
        };
        let vertical = across.iter().map(|&k| line([k as f64, 0.0], [k as f64, sides[1]]));
        let horizontal = up.iter().map(|&k| line([0.0, k as f64], [sides[0], k as f64]));
        html! { path class="rest" d=(vertical.chain(horizontal).collect::<String>()) {} }
    }

    /// Draws an electrode at rest, with the bodies.
    #[must_use]
    pub fn electrode_at_rest(&self, pattern: &Pattern) -> Markup {
        html! {
            (electrodes("on", pattern, |group| self.edge(&rings(group).collect::<Vec<_>>())))
            @if !self.bodies.is_empty() { path class="body" d=(self.edge(&self.bodies)) {} }
        }
    }

    /// Returns the edge of something at rest.
    fn edge(&self, rings: &[Vec<Point>]) -> String {
        let drawn = |ring: &Vec<Point>| path(&ring.iter().map(|at| self.to_drawing(*at)).collect::<Vec<_>>(), true);
        rings.iter().map(drawn).collect()
    }
}

/// Draws the electrodes of each group by their edges: the first one opaque, the others more and more transparent.
fn electrodes(class: &str, pattern: &Pattern, edge: impl Fn(&Pattern) -> String) -> Markup {
    let groups = pattern.groups();
    html! {
        @if groups <= 1 { path class=(class) d=(edge(pattern)) {} }
        @else {
            @for group in 1..=groups {
                @let style = format!("fill-opacity:{:.2}", opacity(group, groups));
                path class=(class) style=(style) d=(edge(&pattern.of_group(group as u8))) {}
            }
        }
    }
}

/// Returns the opacity of a group among several: the first one is opaque.
fn opacity(group: usize, groups: usize) -> f64 {
    1.0 - 0.6 * group.saturating_sub(1) as f64 / groups.saturating_sub(1).max(1) as f64
}

/// A pattern with its displacement field.
#[derive(Clone, Debug)]
pub struct DeformedMembrane {
    background: Background,
    pattern: Pattern,
    displacement: Field,
    /// Those of the cell corners in mm; none in the plane.
    heights: Vec<f64>,
    points: Vec<[f64; 2]>,
    /// The state that is drawn, if the device has several.
    state: Option<String>,
}

impl DeformedMembrane {
    /// Creates it from the cells of a pattern and the displacements in mm at their corners, both from the lower left
    /// corner, and the points of the objective in mm.
    ///
    /// # Errors
    /// If a number is missing, not finite, or not a cell.
    pub fn new(
        cells: &[u8],
        displacement: &[f64],
        background: Background,
        points: Vec<[f64; 2]>,
    ) -> Result<Self, FigureError> {
        let incomplete =
            |e: String| FigureError::Data(format!("a membrane needs a pattern and a finite field, but {e}"));
        let (side, raster) = (background.side(), background.raster());
        if !(side.is_finite() && side > 0.0) {
            return Err(incomplete(format!("its side is {side} mm")));
        }
        let groups = Pattern::MOST_GROUPS;
        Ok(Self {
            pattern: Pattern::of_form(PatternForm::of_square_cells(raster, groups), cells)
                .map_err(|e| incomplete(e.to_string()))?,
            displacement: Field::from_values(raster, displacement.to_vec()).map_err(|e| incomplete(e.to_string()))?,
            heights: Vec::new(),
            background,
            points,
            state: None,
        })
    }

    /// Sets the state, if the device has several.
    #[must_use]
    pub fn in_state(self, state: Option<String>) -> Self {
        Self { state, ..self }
    }

    /// Returns the state, if the device has several.
    pub fn state(&self) -> Option<&str> {
        self.state.as_deref()
    }

    /// Returns the background.
    pub fn background(&self) -> &Background {
        &self.background
    }

    /// Returns the points of the objective, in mm.
    pub fn points(&self) -> &[[f64; 2]] {
        &self.points
    }

    /// Returns the area fraction of the electrode.
    pub fn area(&self) -> f64 {
        self.pattern.area_fraction(self.background.free.as_ref())
    }

    /// Returns the largest displacement of the cell corners in mm.
    pub fn largest(&self) -> f64 {
        self.displacement.max_magnitude()
    }

    /// Returns the displacement in mm at a point in mm.
    pub fn at(&self, point: [f64; 2]) -> [f64; 2] {
        self.displacement.at(self.background.plane.in_cells(point))
    }

    /// Draws the deformed electrode, with displacements times `scale`.
    pub fn electrode(&self, scale: f64) -> Markup {
        html! {
            (electrodes("moved", &self.pattern, |group| edge(rings(group), |at| self.moved(at, scale))))
            @if !self.background.bodies.is_empty() {
                path class="body" d=(edge(self.background.bodies.iter().cloned(), |at| self.moved(at, scale))) {}
            }
        }
    }

    /// Returns the edges of the electrodes and the bodies and the grid, deformed: the class and the data of each path.
    /// These have the same commands whatever the displacements are, so that they can change in an animation.
    pub fn steady_paths(&self, scale: f64) -> Vec<(&'static str, String)> {
        let closed = |rings: &mut dyn Iterator<Item = Vec<Point>>| -> String {
            let along = rings.map(|ring| {
                sides_of_cells(&ring)
                    .map(|at| self.moved(at, scale))
                    .collect::<Vec<_>>()
            });
            along.map(|points| steady_path(&points, true)).collect()
        };
        let mut paths = vec![("moved", closed(&mut rings(&self.pattern)))];
        if !self.background.bodies.is_empty() {
            paths.push(("body", closed(&mut self.background.bodies.iter().cloned())));
        }
        let lines = self.grid_lines(scale);
        paths.push(("mesh", lines.map(|line| steady_path(&line, false)).collect()));
        paths
    }

    /// Draws the outline of the electrode; at rest if `scale` is zero.
    pub fn outline(&self, class: &str, scale: f64) -> Markup {
        html! { path class=(class) d=(edge(rings(&self.pattern), |at| self.moved(at, scale))) {} }
    }

    /// Draws the deformed grid.
    pub fn mesh(&self, scale: f64) -> Markup {
        let lines = self.grid_lines(scale);
        html! { path class="mesh" d=(lines.map(|line| path(&line, false)).collect::<String>()) {} }
    }

    /// Returns the lines of the deformed grid.
    fn grid_lines(&self, scale: f64) -> impl Iterator<Item = Vec<(f64, f64)>> {
        self.lines_of_grid(move |x, y| self.moved([x as f64, y as f64], scale))
    }

    /// Returns the lines of the grid, with each corner of cells at a place.
    fn lines_of_grid(
        &self,
        place: impl Fn(usize, usize) -> (f64, f64) + Copy,
    ) -> impl Iterator<Item = Vec<(f64, f64)>> {
        let [columns, rows] = self.background.raster().sides();
        // The last point is always at the edge.
        let along = |cells: usize| (0..cells).step_by(STEP).chain([cells]);
        let [across, up] = self.background.lines();
        let horizontal = up
            .into_iter()
            .map(move |y| along(columns).map(|x| place(x, y)).collect());
        let vertical = across
            .into_iter()
            .map(move |x| along(rows).map(|y| place(x, y)).collect());
        horizontal.chain(vertical)
    }

    /// Draws the deformed sides, if not all are held.
    pub fn sides(&self, scale: f64) -> Markup {
        let plane = self.background.plane;
        let moved = |at| self.moved(plane.in_cells(at), scale);
        html! { @if let Some(sides) = &self.background.sides { (sides::draw(sides, plane.size_mm, moved)) } }
    }

    /// Returns where the points of the objective are in the deformed drawing.
    pub fn moved_points(&self, scale: f64) -> Vec<(f64, f64)> {
        let moved = |point: &Point| self.moved(self.background.plane.in_cells(*point), scale);
        self.points.iter().map(moved).collect()
    }

    /// Draws the displacements of the points of the objective.
    pub fn arrows(&self, scale: f64) -> Markup {
        let unit = THOUSAND * scale / self.background.side();
        html! {
            @for point in &self.points {
                @let [x, y] = self.at(*point);
                (arrow(to_drawing(*point, self.background.side()), (unit * x, -unit * y)))
            }
        }
    }

    /// Draws all deformed cells in the colours of the magnitudes of their displacements, up to the largest one.
    pub fn magnitudes(&self, scale: f64) -> Markup {
        let largest = self.largest().max(f64::MIN_POSITIVE);
        let mut by_colour: BTreeMap<u8, String> = BTreeMap::new();
        let (columns, cells) = (self.background.raster().columns(), self.background.raster().cells());
        for (x, y) in (0..cells).map(|at| (at % columns, at / columns)) {
            let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)];
            let magnitudes = corners
                .map(|(x, y)| self.displacement.at_corner(x, y))
                .map(|u| u[0].hypot(u[1]));
            let share = magnitudes.iter().sum::<f64>() / 4.0 / largest;
            let cell = corners.map(|(x, y)| self.moved([x as f64, y as f64], scale));
            *by_colour.entry((share * f64::from(u8::MAX)).round() as u8).or_default() += &path(&cell, true);
        }
        html! {
            // Anti-aliased edges would show as seams between the cells.
            g stroke="none" shape-rendering="crispEdges" {
                @for (share, cells) in &by_colour { path fill=(viridis(f64::from(*share) / 255.0)) d=(cells) {} }
            }
        }
    }

    /// Sets the heights of the cell corners in mm, `[y][x]`; without them if their number is another.
    #[must_use]
    pub fn with_heights(self, heights: Option<&[f64]>) -> Self {
        let corners = self.background.raster().corners();
        let heights = heights.filter(|heights| heights.len() == corners);
        Self {
            heights: heights.unwrap_or_default().to_vec(),
            ..self
        }
    }

    /// Returns the height with the largest magnitude in mm; 0 of a membrane in its plane.
    pub fn highest(&self) -> f64 {
        let heights = self.heights.iter().copied();
        heights.fold(0.0, |highest, height| match height.abs() > f64::abs(highest) {
            true => height,
            false => highest,
        })
    }

    /// Returns the factor of the heights in [`Self::from_the_side`]; `None` of a membrane in its plane.
    pub fn height_scale(&self) -> Option<f64> {
        let highest = self.highest().abs();
        (highest > 0.0).then(|| enlargement(highest / self.background.side(), HIGHEST))
    }

    /// Draws the electrode and the grid from the side and above, true to scale but for heights, and returns the view.
    pub fn from_the_side(&self, height_scale: f64) -> (Markup, [f64; 4]) {
        let side = self.background.side();
        let seen = |x: usize, y: usize| {
            let columns = self.background.raster().columns() + 1;
            let height = height_scale * self.heights.get(y * columns + x).copied().unwrap_or(0.0);
            let (place, u) = (
                self.background.in_mm([x as f64, y as f64]),
                self.displacement.at_corner(x, y),
            );
            to_drawing([place[0] + u[0], TILT * (place[1] + u[1]) + height], side)
        };
        let lines: Vec<Vec<(f64, f64)>> = self.lines_of_grid(seen).collect();
        let heights = || lines.iter().flatten().map(|(_, y)| *y);
        let (top, bottom) = heights().fold((f64::MAX, f64::MIN), |(top, bottom), y| (top.min(y), bottom.max(y)));
        let [left, _, width, _] = self.background.view();
        let grid = lines.iter().map(|line| path(line, false)).collect::<String>();
        let drawn = html! {
            // What is in front covers what is behind.
            g stroke="none" shape-rendering="crispEdges" {
                @for (group, cells) in self.rows_from_behind(seen) {
                    @let opacity = opacity(usize::from(group), self.pattern.groups());
                    path class="moved" style=(format!("stroke:none;fill-opacity:{opacity:.2}")) d=(cells) {}
                }
            }
            path class="mesh" d=(grid) {}
        };
        (drawn, [left, top - MARGIN, width, bottom - top + 2.0 * MARGIN])
    }

    /// Returns the outlines of neighbouring cells of a group in each row, the last row first, with corners at places.
    fn rows_from_behind(&self, place: impl Fn(usize, usize) -> (f64, f64)) -> Vec<(u8, String)> {
        let [columns, rows] = self.background.raster().sides();
        let mut found = Vec::new();
        for y in (0..rows).rev() {
            let mut x = 0;
            while x < columns {
                let (group, first) = (self.pattern.group(x, y), x);
                while x < columns && self.pattern.group(x, y) == group {
                    x += 1;
                }
                if group > 0 {
                    let below = (first..=x).map(|x| place(x, y));
                    let above = (first..=x).rev().map(|x| place(x, y + 1));
                    found.push((group, path(&below.chain(above).collect::<Vec<_>>(), true)));
                }
            }
        }
        found
    }

    /// Whether no corner of cells is drawn over the frame or out of the rectangle at this factor; sides that are not
    /// held have room around it.
    fn stays_inside(&self, scale: f64) -> bool {
        let (background, raster) = (&self.background, self.background.raster());
        let (columns, sides) = (raster.columns(), raster.sides());
        let corners = (0..raster.corners()).map(|at| [at % (columns + 1), at / (columns + 1)]);
        corners.into_iter().all(|[x, y]| {
            let rest = [x as f64, y as f64];
            let [across, up] = background.in_mm(rest);
            let u = self.displacement.at_corner(x, y);
            let moved = background.plane.in_cells([across + scale * u[0], up + scale * u[1]]);
            let by = [moved[0] - rest[0], moved[1] - rest[1]];
            let length = by[0].hypot(by[1]);
            if length <= OVER {
                return true;
            }
            let nearer = [0, 1].map(|axis| moved[axis] - OVER / length * by[axis]);
            let is_in_picture = (0..2).all(|axis| (0.0..=sides[axis] as f64).contains(&nearer[axis]));
            match background.sides {
                None => is_in_picture && (!background.is_in_frame(nearer) || background.is_in_frame(rest)),
                Some(_) => true,
            }
        })
    }

    fn moved(&self, corner: [f64; 2], scale: f64) -> (f64, f64) {
        let u = self.displacement.at(corner);
        let at = self.background.in_mm(corner);
        to_drawing([0, 1].map(|k| at[k] + scale * u[k]), self.background.side())
    }
}

/// Returns the factor by which displacements are drawn larger, the same for all membranes, so that they can be
/// compared.
///
/// No membrane is drawn over its frame or out of its picture, which real ones never reach.
pub fn exaggeration<'m>(membranes: impl IntoIterator<Item = &'m DeformedMembrane>) -> f64 {
    let membranes: Vec<&DeformedMembrane> = membranes.into_iter().collect();
    let sizes = membranes.iter().map(|m| m.largest() / m.background.side());
    let largest = sizes.fold(0.0, f64::max);
    let fits = |factor: f64| factor * largest <= FARTHEST && membranes.iter().all(|m| m.stays_inside(factor));
    FACTORS.into_iter().find(|factor| fits(*factor)).unwrap_or(1.0)
}

/// The factors by which displacements and heights are drawn larger.
const FACTORS: [f64; 6] = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0];

/// Returns the largest of the factors that keeps a share of the side below another one; 1 if none does.
fn enlargement(largest: f64, room: f64) -> f64 {
    let mut factors = FACTORS.into_iter();
    factors.find(|factor| factor * largest <= room).unwrap_or(1.0)
}

/// How far a drawing may reach over its frame, cells: less than a line is wide.
const OVER: f64 = 0.25;

/// Draws an arrow from a point in mm in a direction in degrees, counterclockwise from the x axis, `length` thousandths
/// long.
pub fn direction(point: [f64; 2], side: f64, degrees: f64, length: f64) -> Markup {
    let (sin, cos) = degrees.to_radians().sin_cos();
    arrow(to_drawing(point, side), (length * cos, -length * sin))
}

fn rings(pattern: &Pattern) -> impl Iterator<Item = Vec<Point>> {
    let islands = outlines(pattern, Corners::Square).into_iter();
    islands.flat_map(Island::into_rings)
}

/// Returns the borders of a region in cells, without details that no drawing shows.
fn curves(region: &Polygons, plane: pattern::Membrane) -> Vec<Vec<Point>> {
    let apart = plane.size_mm[0].max(plane.size_mm[1]) / THOUSAND;
    let thinned = |ring: &Vec<Point>| {
        let mut kept: Vec<Point> = Vec::new();
        for (at, point) in ring.iter().enumerate() {
            let next = ring[(at + 1) % ring.len()];
            let far = |other: &Point| (other[0] - point[0]).hypot(other[1] - point[1]) >= apart;
            if kept.last().is_none_or(far) || far(&next) {
                kept.push(*point);
            }
        }
        kept.into_iter().map(|point| plane.in_cells(point)).collect()
    };
    region.rings().iter().map(thinned).collect()
}

/// Returns an edge, divided into the sides of cells, since it may be deformed.
fn edge(rings: impl Iterator<Item = Vec<Point>>, to: impl Fn(Point) -> (f64, f64)) -> String {
    let drawn = |ring: Vec<Point>| path(&sides_of_cells(&ring).map(&to).collect::<Vec<_>>(), true);
    rings.map(drawn).collect()
}

/// Returns the points at which a ring is divided into the sides of cells.
fn sides_of_cells(ring: &[Point]) -> impl Iterator<Item = Point> {
    let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
    pairs.flat_map(|(a, b)| {
        let cells = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).round().max(1.0);
        let at = move |k: usize, c: usize| a[c] + (b[c] - a[c]) * k as f64 / cells;
        (0..cells as usize).map(move |k| [at(k, 0), at(k, 1)])
    })
}

/// Converts a point with the origin at the lower left to one with the origin at the upper left.
fn to_drawing(point: Point, side: f64) -> (f64, f64) {
    (THOUSAND * point[0] / side, THOUSAND * (1.0 - point[1] / side))
}

/// Draws a point with an arrow, or only the point if the arrow is too short.
fn arrow((x, y): (f64, f64), (dx, dy): (f64, f64)) -> Markup {
    let length = dx.hypot(dy);
    let point = html! { circle class="point" cx=(number(x, 0)) cy=(number(y, 0)) r="13" {} };
    if !length.is_finite() || length < 12.0 {
        return point;
    }
    let (base, head) = head((x, y), (x + dx, y + dy));
    html! {
        path class="arrow" d=(path(&[(x, y), base], false)) {}
        path class="head" d=(head) {}
        (point)
    }
}

/// Returns a colour of the map viridis by S. van der Walt and N. Smith (matplotlib), interpolated between nine:
/// `#rrggbb`.
pub fn viridis(t: f64) -> String {
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
    let [r, g, b]: [u8; 3] = std::array::from_fn(|k| {
        let (a, b) = (COLOURS[low][k], COLOURS[low + 1][k]);
        (a + (b - a) * (at - low as f64)).round() as u8
    });
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(side: f64) -> Background {
        Background::plain(pattern::Membrane::square(side))
    }

    fn membrane(u: [f64; 2]) -> DeformedMembrane {
        // The border is held.
        let inner = |at: usize| [at % 51, at / 51].iter().all(|one| (5..46).contains(one));
        let field: Vec<f64> = (0..2601).flat_map(|at| if inner(at) { u } else { [0.0; 2] }).collect();
        DeformedMembrane::new(&[1; 2500], &field, square(50.0), vec![[25.0, 25.0]]).unwrap()
    }

    #[test]
    fn the_lower_edge_of_the_membrane_is_at_the_bottom_of_the_drawing() {
        let corner = Pattern::from_fn(Raster::PAPER, |x, y| x == 0 && y == 0);
        // The cell is 20 × 20 units in the lower left corner.
        let text = square(50.0).electrode_at_rest(&corner).into_string();
        assert!(text.contains("<path class=\"on\" d=\"M0 1000h20v-20h-20z\">"), "{text}");
    }

    #[test]
    fn an_edge_goes_around_holes_and_bends_from_cell_to_cell() {
        let ring = Pattern::from_fn(Raster::PAPER, |x, y| {
            (10..13).contains(&x) && (20..23).contains(&y) && (x, y) != (11, 21)
        });
        assert_eq!(
            square(50.0).electrode_at_rest(&ring).into_string().matches('z').count(),
            2
        );
        let membrane = DeformedMembrane::new(ring.cells(), &[0.0; 5202], square(50.0), Vec::new()).unwrap();
        let text = membrane.electrode(1.0).into_string();
        let sides = text.split('"').find(|part| part.starts_with('M')).unwrap();
        // The last side of each ring closes it.
        assert_eq!(sides.matches(['h', 'v']).count(), 11 + 3, "{text}");
    }

    #[test]
    fn displacements_are_exaggerated_up_to_a_limit() {
        let far = membrane([2.1, 0.0]);
        assert_eq!(exaggeration([&far]), 2.0);
        let text = far.arrows(2.0).into_string();
        // 2 · 2.1 mm of 50 mm are 84 of 1000 units; the arrow begins in the middle.
        assert!(text.contains("<path class=\"arrow\" d=\"M500 500h"), "{text}");
        assert!(text.contains("M584 500l-42"), "{text}");
        assert_eq!(exaggeration([&membrane([0.1, 0.0])]), 50.0);
        assert_eq!(exaggeration([]), 100.0);
    }

    #[test]
    fn no_membrane_is_drawn_over_its_frame_or_out_of_its_picture() {
        // Corners move away from the centre by a share of their distance from it, and none on the border.
        let growing = |share: f64, radius: f64, background: &Background| {
            let corners = (0..2601).map(|at| [(at % 51) as f64 - 25.0, (at / 51) as f64 - 25.0]);
            let size = |[x, y]: [f64; 2]| match background.free {
                Some(_) => x.hypot(y),
                None => x.abs().max(y.abs()),
            };
            let field: Vec<f64> = corners
                .flat_map(|at| at.map(|one| if size(at) < radius - 0.01 { share * one } else { 0.0 }))
                .collect();
            DeformedMembrane::new(&[1; 2500], &field, background.clone(), Vec::new()).unwrap()
        };
        let free = Pattern::from_fn(Raster::PAPER, |x, y| (x as f64 - 24.5).hypot(y as f64 - 24.5) < 20.0);
        let framed = Background {
            frame: Polygons::of_rings(rings(&Pattern::from_fn(Raster::PAPER, |x, y| free.group(x, y) == 0)).collect()),
            free: Some(Bits::of(&free)),
            ..square(50.0)
        };
        let plain = square(50.0);
        // Of the corners at 24 from the centre, 20 · 0.004 · 24 is over the border, and 10 · 0.004 · 24 is not.
        assert_eq!(exaggeration([&growing(0.004, 25.0, &plain)]), 10.0);
        assert_eq!(exaggeration([&growing(0.0009, 25.0, &plain)]), 50.0);
        // A field that stays within the square is drawn over a frame.
        assert_eq!(exaggeration([&growing(0.003, 19.0, &plain)]), 50.0);
        let with_frame = exaggeration([&growing(0.003, 19.0, &framed)]);
        assert!([5.0, 10.0, 20.0].contains(&with_frame), "{with_frame}");
    }

    #[test]
    fn invalid_membranes_are_refused() {
        let new = |cells: &[u8], u: f64, side| DeformedMembrane::new(cells, &[u; 5202], square(side), Vec::new());
        assert!(new(&[1; 2500], 0.0, 50.0).is_ok());
        for bad in [
            new(&[1; 10], 0.0, 50.0),
            new(&[17; 2500], 0.0, 50.0),
            new(&[1; 2500], f64::NAN, 50.0),
            new(&[1; 2500], 0.0, 0.0),
        ] {
            assert!(matches!(bad, Err(FigureError::Data(_))));
        }
    }
}
