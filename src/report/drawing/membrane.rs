//! Membranes: a pattern at rest, and the same where its displacement takes it.
//!
//! Everything is drawn in thousandths of the membrane's longer side, in a square at whose lower left corner it lies. Only the edge of the electrode is
//! written, not its cells: hundreds of membranes fit in one page.

use std::collections::BTreeMap;

use maud::{Markup, html};

use super::chart::THOUSAND;
use super::error::FigureError;
use super::path::{number, path};
use deaflow_field::Field;
use deaflow_pattern as pattern;
use deaflow_pattern::{Corners, Part, Pattern, PatternForm, Point, Raster, outlines};
use deaflow_scene::Scene;

/// Around a drawing, thousandths of its side.
const MARGIN: f64 = 12.0;

/// Cells between two lines of the grid, and between two points of a line that has moved.
const GRID: usize = 5;
const STEP: usize = 2;

/// The largest displacement that is drawn, a share of the side.
const FARTHEST: f64 = 0.1;

/// The rectangle that is drawn, with its frame and bodies.
#[derive(Clone, Debug, PartialEq)]
pub struct Ground {
    plane: pattern::Membrane,
    /// The cells of a frame within the rectangle.
    held: Option<Pattern>,
    /// Those of rigid bodies.
    bodies: Option<Pattern>,
}

impl Ground {
    /// That of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let parts = scene.parts();
        let cells = |is_in: fn(Part) -> bool| {
            let parts = parts.as_ref()?;
            let cells = parts.cells(is_in);
            (!cells.is_empty()).then(|| cells.pattern())
        };
        Self {
            plane: scene.membrane(),
            held: cells(|part| part == Part::Frame),
            bodies: cells(|part| part.body().is_some()),
        }
    }

    /// A rectangle without either.
    #[must_use]
    pub fn plain(plane: pattern::Membrane) -> Self {
        Self {
            plane,
            held: None,
            bodies: None,
        }
    }

    /// That of the source paper.
    #[must_use]
    pub fn paper() -> Self {
        Self::plain(pattern::Membrane::square(1.0))
    }

    /// Whether its grid is that of the source paper's.
    #[must_use]
    pub fn has_paper_grid(&self) -> bool {
        self.plane.raster == Raster::PAPER && self.plane.size_mm[0] == self.plane.size_mm[1]
    }

    /// Its cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.plane.raster
    }

    /// Its sides in mm.
    #[must_use]
    pub fn size_mm(&self) -> [f64; 2] {
        self.plane.size_mm
    }

    /// The longer side in mm.
    #[must_use]
    pub fn side(&self) -> f64 {
        self.plane.size_mm[0].max(self.plane.size_mm[1])
    }

    /// The part of a drawing that it takes, with a margin: left, top, width and height in thousandths of the longer side.
    #[must_use]
    pub fn view(&self) -> [f64; 4] {
        let [width, height] = self.plane.size_mm.map(|size| (THOUSAND * size / self.side()).round());
        [
            -MARGIN,
            THOUSAND - height - MARGIN,
            width + 2.0 * MARGIN,
            height + 2.0 * MARGIN,
        ]
    }

    /// A corner of cells in mm.
    fn in_mm(&self, corner: Point) -> Point {
        let sides = self.plane.raster.sides();
        [0, 1].map(|axis| corner[axis] * self.plane.size_mm[axis] / sides[axis] as f64)
    }

    /// Where a corner of cells is drawn.
    fn drawn(&self, corner: Point) -> (f64, f64) {
        to_drawing(self.in_mm(corner), self.side())
    }

    /// Columns and rows of cells on which a line of the grid stands.
    fn lines(&self) -> [Vec<usize>; 2] {
        self.plane
            .raster
            .sides()
            .map(|cells| (GRID..cells).step_by(GRID).collect())
    }

    /// The edge of the membrane, with the frame within the rectangle.
    #[must_use]
    pub fn frame(&self) -> Markup {
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
            path class="frame" d=(edge) {}
            @if let Some(held) = &self.held { path class="held" d=(self.cells(held)) {} }
        }
    }

    /// The lines of the grid at rest.
    #[must_use]
    pub fn grid(&self) -> Markup {
        let [across, up] = self.lines();
        let sides = self.plane.raster.sides().map(|cells| cells as f64);
        let line = |from: Point, to: Point| {
            let [(x, y), (to_x, to_y)] = [from, to].map(|corner| self.drawn(corner));
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

    /// An electrode at rest, with the bodies.
    #[must_use]
    pub fn electrode_at_rest(&self, pattern: &Pattern) -> Markup {
        html! {
            (electrodes("on", pattern, |group| self.cells(group)))
            @if let Some(bodies) = &self.bodies { path class="body" d=(self.cells(bodies)) {} }
        }
    }

    /// The edge of some cells at rest.
    fn cells(&self, pattern: &Pattern) -> String {
        let drawn = |ring: Vec<Point>| path(&ring.iter().map(|at| self.drawn(*at)).collect::<Vec<_>>(), true);
        rings(pattern).map(drawn).collect()
    }
}

/// The electrodes of each group, drawn by their edge: those of the first fully, of the others less and less.
fn electrodes(class: &str, pattern: &Pattern, edge: impl Fn(&Pattern) -> String) -> Markup {
    let groups = pattern.groups();
    html! {
        @if groups <= 1 { path class=(class) d=(edge(pattern)) {} }
        @else {
            @for group in 1..=groups {
                @let opacity = 1.0 - 0.6 * (group - 1) as f64 / (groups - 1) as f64;
                path class=(class) style=(format!("fill-opacity:{opacity:.2}")) d=(edge(&pattern.of_group(group as u8))) {}
            }
        }
    }
}

/// A pattern with its displacement field.
#[derive(Clone, Debug)]
pub struct Membrane {
    ground: Ground,
    pattern: Pattern,
    displacement: Field,
    points: Vec<[f64; 2]>,
    /// Of several states of a device, the one that is drawn.
    state: Option<String>,
}

impl Membrane {
    /// From the cells of a pattern and displacements in mm at their corners, both from the lower left corner; what they are drawn on, and the
    /// points whose displacements are wanted, in mm from the lower left corner.
    ///
    /// # Errors
    /// When a number is missing, not finite, or no cell.
    pub fn new(cells: &[u8], displacement: &[f64], ground: Ground, points: Vec<[f64; 2]>) -> Result<Self, FigureError> {
        let incomplete = |e: String| FigureError::Data(format!("a membrane needs a pattern and a finite field: {e}"));
        let (side, raster) = (ground.side(), ground.raster());
        if !(side.is_finite() && side > 0.0) {
            return Err(incomplete(format!("its side is {side} mm")));
        }
        let groups = Pattern::MOST_GROUPS;
        Ok(Self {
            pattern: Pattern::of_form(PatternForm { raster, groups }, cells).map_err(|e| incomplete(e.to_string()))?,
            displacement: Field::from_values(raster, displacement.to_vec()).map_err(|e| incomplete(e.to_string()))?,
            ground,
            points,
            state: None,
        })
    }

    /// In a state of a device, where it has several.
    #[must_use]
    pub fn in_state(self, state: Option<String>) -> Self {
        Self { state, ..self }
    }

    /// Of several states of a device, the one that is drawn.
    pub fn state(&self) -> Option<&str> {
        self.state.as_deref()
    }

    /// What it is drawn on.
    pub fn ground(&self) -> &Ground {
        &self.ground
    }

    /// The points whose displacements are wanted, in mm.
    pub fn points(&self) -> &[[f64; 2]] {
        &self.points
    }

    /// Electrode area, a fraction of the membrane.
    pub fn area(&self) -> f64 {
        self.pattern.area_fraction()
    }

    /// Largest displacement over the corners, in mm.
    pub fn largest(&self) -> f64 {
        self.displacement.max_magnitude()
    }

    /// Displacement in mm at a point given in mm.
    pub fn at(&self, point: [f64; 2]) -> [f64; 2] {
        self.displacement.at(self.ground.plane.in_cells(point))
    }

    /// The electrode where it has moved to, displacements drawn `scale` times.
    pub fn electrode(&self, scale: f64) -> Markup {
        html! {
            (electrodes("moved", &self.pattern, |group| edge(group, |at| self.moved(at, scale))))
            @if let Some(bodies) = &self.ground.bodies { path class="body" d=(edge(bodies, |at| self.moved(at, scale))) {} }
        }
    }

    /// The outline of the electrode: at rest where `scale` is zero.
    pub fn outline(&self, class: &str, scale: f64) -> Markup {
        html! { path class=(class) d=(edge(&self.pattern, |at| self.moved(at, scale))) {} }
    }

    /// The grid where it has moved to.
    pub fn mesh(&self, scale: f64) -> Markup {
        let [columns, rows] = self.ground.raster().sides();
        // The last point is at the edge, however many there are.
        let along = |cells: usize| (0..cells).step_by(STEP).chain([cells]);
        let moved = |x: usize, y: usize| self.moved([x as f64, y as f64], scale);
        let [across, up] = self.ground.lines();
        let horizontal = up
            .iter()
            .map(|&y| path(&along(columns).map(|x| moved(x, y)).collect::<Vec<_>>(), false));
        let vertical = across
            .iter()
            .map(|&x| path(&along(rows).map(|y| moved(x, y)).collect::<Vec<_>>(), false));
        html! { path class="mesh" d=(horizontal.chain(vertical).collect::<String>()) {} }
    }

    /// The displacements of the wanted points.
    pub fn arrows(&self, scale: f64) -> Markup {
        let unit = THOUSAND * scale / self.ground.side();
        html! {
            @for point in &self.points {
                @let [x, y] = self.at(*point);
                (arrow(to_drawing(*point, self.ground.side()), (unit * x, -unit * y)))
            }
        }
    }

    /// All cells where they have moved to, with the colours of the magnitudes of their displacements: those of the
    /// largest have the last colour.
    pub fn magnitudes(&self, scale: f64) -> Markup {
        let largest = self.largest().max(f64::MIN_POSITIVE);
        let mut by_colour: BTreeMap<u8, String> = BTreeMap::new();
        let (columns, cells) = (self.ground.raster().columns(), self.ground.raster().cells());
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
            // Smooth edges would show as seams between the cells.
            g stroke="none" shape-rendering="crispEdges" {
                @for (share, cells) in &by_colour { path fill=(viridis(f64::from(*share) / 255.0)) d=(cells) {} }
            }
        }
    }

    fn moved(&self, corner: [f64; 2], scale: f64) -> (f64, f64) {
        let u = self.displacement.at(corner);
        let at = self.ground.in_mm(corner);
        to_drawing([0, 1].map(|k| at[k] + scale * u[k]), self.ground.side())
    }
}

/// How many times too large displacements are drawn, the same for all membranes so that they can be compared.
pub fn exaggeration<'m>(membranes: impl IntoIterator<Item = &'m Membrane>) -> f64 {
    let largest = membranes
        .into_iter()
        .map(|m| m.largest() / m.ground.side())
        .fold(0.0, f64::max);
    let factors = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0];
    factors.into_iter().find(|f| f * largest <= FARTHEST).unwrap_or(1.0)
}

/// An arrow from a point in mm in a direction in degrees, counterclockwise from the x axis, `length` thousandths long.
pub fn direction(point: [f64; 2], side: f64, degrees: f64, length: f64) -> Markup {
    let (sin, cos) = degrees.to_radians().sin_cos();
    arrow(to_drawing(point, side), (length * cos, -length * sin))
}

fn rings(pattern: &Pattern) -> impl Iterator<Item = Vec<Point>> {
    let islands = outlines(pattern, Corners::Square).into_iter();
    islands.flat_map(|island| std::iter::once(island.outer).chain(island.holes))
}

/// The edge of an electrode, each side of a cell by itself, since it may have moved.
fn edge(pattern: &Pattern, to: impl Fn(Point) -> (f64, f64)) -> String {
    let drawn = |ring: Vec<Point>| {
        let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
        let sides = pairs.flat_map(|(a, b)| {
            let cells = (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
            let at = move |k: usize, c: usize| a[c] + (b[c] - a[c]) * k as f64 / cells;
            (0..cells.round() as usize).map(move |k| [at(k, 0), at(k, 1)])
        });
        path(&sides.map(&to).collect::<Vec<_>>(), true)
    };
    rings(pattern).map(drawn).collect()
}

/// From a point with the origin at the lower left to one with the origin at the upper left.
fn to_drawing(point: Point, side: f64) -> (f64, f64) {
    (THOUSAND * point[0] / side, THOUSAND * (1.0 - point[1] / side))
}

/// A point with an arrow; only the point where the arrow would be too short to be seen.
fn arrow((x, y): (f64, f64), (dx, dy): (f64, f64)) -> Markup {
    let length = dx.hypot(dy);
    let point = html! { circle class="point" cx=(number(x, 0)) cy=(number(y, 0)) r="13" {} };
    if !length.is_finite() || length < 12.0 {
        return point;
    }
    let (ux, uy) = (dx / length, dy / length);
    let head = (0.5 * length).min(42.0);
    let tip = (x + dx, y + dy);
    let wing = |side: f64| {
        (
            tip.0 - head * (ux - 0.5 * side * uy),
            tip.1 - head * (uy + 0.5 * side * ux),
        )
    };
    let base = (tip.0 - 0.8 * head * ux, tip.1 - 0.8 * head * uy);
    html! {
        path class="arrow" d=(path(&[(x, y), base], false)) {}
        path class="head" d=(path(&[tip, wing(1.0), wing(-1.0)], true)) {}
        (point)
    }
}

/// The colour map viridis by S. van der Walt and N. Smith (matplotlib), between nine of its colours; `#rrggbb`.
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

    fn square(side: f64) -> Ground {
        Ground::plain(pattern::Membrane::square(side))
    }

    fn membrane(u: [f64; 2]) -> Membrane {
        Membrane::new(&[1; 2500], &u.repeat(2601), square(50.0), vec![[25.0, 25.0]]).unwrap()
    }

    #[test]
    fn the_lower_edge_of_the_membrane_is_the_lower_edge_of_the_drawing() {
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
        let membrane = Membrane::new(ring.cells(), &[0.0; 5202], square(50.0), Vec::new()).unwrap();
        let text = membrane.electrode(1.0).into_string();
        let sides = text.split('"').find(|part| part.starts_with('M')).unwrap();
        // The last side of each ring is that which closes it.
        assert_eq!(sides.matches(['h', 'v']).count(), 11 + 3, "{text}");
    }

    #[test]
    fn displacements_are_drawn_so_large_that_they_are_seen_and_no_larger() {
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
    fn what_is_no_membrane_is_refused() {
        let new = |cells: &[u8], u: f64, side| Membrane::new(cells, &[u; 5202], square(side), Vec::new());
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
