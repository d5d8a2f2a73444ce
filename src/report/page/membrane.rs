//! Membranes as SVG: a pattern at rest, and the same where its displacement takes it.
//!
//! Only the edge of the electrode is written, not its cells: hundreds of membranes fit in one page.

use std::collections::BTreeMap;

use super::svg::{number, path};
use crate::report::designs::Design;
use crate::report::html::escaped;

const CELLS: usize = 50;
const CORNERS: usize = CELLS + 1;

/// Length of the membrane's side in units of the drawing.
const SIDE: f64 = 1000.0;

/// Cells between two lines of the grid, and between two points of a line that has moved.
const GRID: usize = 5;
const STEP: usize = 2;

/// The largest displacement that is drawn, a share of the side.
const FARTHEST: f64 = 0.1;

/// What all drawings have in common: the grid at rest.
pub fn shared() -> String {
    let mut lines = String::new();
    for k in (GRID..CELLS).step_by(GRID) {
        let at = SIDE * k as f64 / CELLS as f64;
        lines += &format!("M{at} 0V{SIDE}M0 {at}H{SIDE}");
    }
    format!(
        "<svg width=\"0\" height=\"0\" style=\"position:absolute\" aria-hidden=\"true\"><defs><g id=\"rest\" class=\"membrane\">\
         <path class=\"rest\" d=\"{lines}\"/></g></defs></svg>\n"
    )
}

/// How many times too large displacements are drawn, the same for all designs so that they can be compared.
pub fn exaggeration(designs: &[Design]) -> f64 {
    let largest = |design: &Design| {
        let field = design.simulated.as_ref().unwrap_or(&design.predicted);
        let magnitudes = field.chunks_exact(2).map(|u| u[0].hypot(u[1]));
        magnitudes.filter(|m| m.is_finite()).fold(0.0, f64::max) / design.side
    };
    let largest = designs.iter().map(largest).fold(0.0, f64::max);
    let factors = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0];
    factors.into_iter().find(|f| f * largest <= FARTHEST).unwrap_or(1.0)
}

/// The electrode at rest, with the wanted points and directions.
pub fn pattern(design: &Design) -> String {
    let says = format!(
        "Electrode pattern of {}: {:.1} % active",
        design.name,
        100.0 * design.area
    );
    let rest = |(x, y): (usize, usize)| to_page([x as f64, y as f64], CELLS as f64);
    let edge: String = loops(&design.pattern)
        .iter()
        .map(|l| path(&corners(l, rest), true))
        .collect();
    let arrows = design.wanted.points().iter().map(|aim| {
        let (sin, cos) = aim.direction.to_radians().sin_cos();
        arrow(to_page(aim.point, design.side), (110.0 * cos, -110.0 * sin))
    });
    drawing(
        &says,
        &format!("<path class=\"on\" d=\"{edge}\"/>{}", arrows.collect::<String>()),
    )
}

/// The electrode where it has moved to over the grid at rest, with the displacements of the wanted points.
pub fn deformed(design: &Design, scale: f64) -> String {
    let (field, how) = match &design.simulated {
        Some(field) => (field, "simulated"),
        None => (&design.predicted, "predicted"),
    };
    let says = format!(
        "Deformed membrane of {}, {how}, displacements drawn {scale} times",
        design.name
    );
    let moved = |(x, y): (usize, usize)| {
        let at = 2 * (y * CORNERS + x);
        let cell = design.side / CELLS as f64;
        let to = [
            x as f64 * cell + scale * field[at],
            y as f64 * cell + scale * field[at + 1],
        ];
        to_page(to, design.side)
    };
    let edge = loops(&design.pattern);
    let edge: String = edge
        .iter()
        .map(|l| path(&l.iter().map(|c| moved(*c)).collect::<Vec<_>>(), true))
        .collect();
    let along = || (0..=CELLS).step_by(STEP);
    let mesh = (GRID..CELLS).step_by(GRID).map(|k| {
        let across = path(&along().map(|x| moved((x, k))).collect::<Vec<_>>(), false);
        across + &path(&along().map(|y| moved((k, y))).collect::<Vec<_>>(), false)
    });
    let arrows = design.wanted.points().iter().map(|aim| {
        let u = at(field, aim.point, design.side);
        let unit = SIDE * scale / design.side;
        arrow(to_page(aim.point, design.side), (unit * u[0], -unit * u[1]))
    });
    drawing(
        &says,
        &format!(
            "<path class=\"moved\" d=\"{edge}\"/><path class=\"mesh\" d=\"{}\"/>{}",
            mesh.collect::<String>(),
            arrows.collect::<String>()
        ),
    )
}

fn drawing(says: &str, content: &str) -> String {
    let says = escaped(says);
    format!(
        "<svg class=\"membrane\" viewBox=\"-12 -12 1024 1024\" width=\"240\" height=\"240\" role=\"img\" aria-label=\"{says}\">\
         <title>{says}</title><path class=\"frame\" d=\"M0 0h1000v1000h-1000z\"/><use href=\"#rest\"/>{content}</svg>\n"
    )
}

/// From a point with the origin at the lower left to one with the origin at the upper left.
fn to_page(point: [f64; 2], side: f64) -> (f64, f64) {
    (SIDE * point[0] / side, SIDE * (1.0 - point[1] / side))
}

/// The corners of a closed line at which it turns.
fn corners(line: &[(usize, usize)], to: impl Fn((usize, usize)) -> (f64, f64)) -> Vec<(f64, f64)> {
    let n = line.len();
    let turns = |k: usize| {
        let (a, b, c) = (line[(k + n - 1) % n], line[k], line[(k + 1) % n]);
        !(a.0 == b.0 && b.0 == c.0 || a.1 == b.1 && b.1 == c.1)
    };
    (0..n).filter(|k| turns(*k)).map(|k| to(line[k])).collect()
}

/// The edges of the electrode as closed lines from corner to corner, with the electrode on their left.
fn loops(pattern: &[u8]) -> Vec<Vec<(usize, usize)>> {
    let on = |x: i64, y: i64| {
        let inside = (0..CELLS as i64).contains(&x) && (0..CELLS as i64).contains(&y);
        inside && pattern[y as usize * CELLS + x as usize] == 1
    };
    let mut next: BTreeMap<(usize, usize), Vec<(usize, usize)>> = BTreeMap::new();
    for (x, y) in (0..CELLS * CELLS).map(|k| (k % CELLS, k / CELLS)) {
        let (i, j) = (x as i64, y as i64);
        if !on(i, j) {
            continue;
        }
        let sides = [
            (on(i, j - 1), (x, y), (x + 1, y)),
            (on(i + 1, j), (x + 1, y), (x + 1, y + 1)),
            (on(i, j + 1), (x + 1, y + 1), (x, y + 1)),
            (on(i - 1, j), (x, y + 1), (x, y)),
        ];
        for (_, from, to) in sides.into_iter().filter(|(inner, ..)| !inner) {
            next.entry(from).or_default().push(to);
        }
    }
    let mut found = Vec::new();
    while let Some((&start, _)) = next.first_key_value() {
        let mut line = Vec::new();
        let mut at = start;
        // Each corner has as many ways out as ways in: a line ends where it began.
        while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
            if next.get(&at).is_some_and(Vec::is_empty) {
                next.remove(&at);
            }
            line.push(at);
            at = to;
        }
        found.push(line);
    }
    found
}

/// The displacement at a point, bilinear between the corners of its cell.
fn at(field: &[f64], point: [f64; 2], side: f64) -> [f64; 2] {
    let split = |c: f64| {
        let c = (c / side * CELLS as f64).clamp(0.0, CELLS as f64);
        let low = (c.floor() as usize).min(CELLS - 1);
        (low, c - low as f64)
    };
    let ((i, s), (j, t)) = (split(point[0]), split(point[1]));
    let corner = |x: usize, y: usize, k: usize| field[2 * (y * CORNERS + x) + k];
    std::array::from_fn(|k| {
        let row = |y: usize| (1.0 - s) * corner(i, y, k) + s * corner(i + 1, y, k);
        (1.0 - t) * row(j) + t * row(j + 1)
    })
}

/// A point with an arrow; only the point where the arrow would be too short to be seen.
fn arrow((x, y): (f64, f64), (dx, dy): (f64, f64)) -> String {
    let length = dx.hypot(dy);
    let [x0, y0] = [x, y].map(|v| number(v, 0));
    let point = format!("<circle class=\"point\" cx=\"{x0}\" cy=\"{y0}\" r=\"13\"/>");
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
    format!(
        "<path class=\"arrow\" d=\"{}\"/><path class=\"head\" d=\"{}\"/>{point}",
        path(&[(x, y), base], false),
        path(&[tip, wing(1.0), wing(-1.0)], true)
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::designs::{Role, tests::design};
    use super::*;

    fn cells(on: &[(usize, usize)]) -> Vec<u8> {
        let mut pattern = vec![0; 2500];
        on.iter().for_each(|(x, y)| pattern[y * CELLS + x] = 1);
        pattern
    }

    /// Twice the area within a closed line, positive where it lies on the left.
    fn doubled(line: &[(usize, usize)]) -> i64 {
        let pairs = line.iter().zip(line.iter().cycle().skip(1));
        pairs
            .map(|(a, b)| a.0 as i64 * b.1 as i64 - b.0 as i64 * a.1 as i64)
            .sum()
    }

    #[test]
    fn the_edge_encloses_what_is_active_and_goes_around_holes() {
        let ring: Vec<(usize, usize)> = (0..9).filter(|k| *k != 4).map(|k| (10 + k % 3, 20 + k / 3)).collect();
        let found = loops(&cells(&ring));
        let mut areas: Vec<i64> = found.iter().map(|line| doubled(line) / 2).collect();
        areas.sort_unstable();
        assert_eq!(areas, [-1, 9]);
        let diagonal = loops(&cells(&[(0, 0), (1, 1), (49, 49)]));
        assert_eq!(diagonal.iter().map(|line| doubled(line)).sum::<i64>(), 6);
        assert_eq!(loops(&cells(&[])).len(), 0);
        assert_eq!(corners(&loops(&[1; 2500])[0], |(x, y)| (x as f64, y as f64)).len(), 4);
    }

    #[test]
    fn the_lower_edge_of_the_membrane_is_the_lower_edge_of_the_drawing() {
        let mut one = design(Role::Ga, 20, None);
        one.pattern = cells(&[(0, 0)]);
        // The cell is 20 × 20 units in the lower left corner.
        assert!(
            pattern(&one).contains("<path class=\"on\" d=\"M0 1000h20v-20h-20z\"/>"),
            "{}",
            pattern(&one)
        );
    }

    #[test]
    fn displacements_are_drawn_so_large_that_they_are_seen_and_no_larger() {
        let mut one = design(Role::Ga, 20, None);
        one.predicted = [2.1, 0.0].repeat(2601);
        assert_eq!(exaggeration(std::slice::from_ref(&one)), 2.0);
        let text = deformed(&one, 2.0);
        // 2 · 2.1 mm of 50 mm are 84 of 1000 units; the arrow begins in the middle.
        assert!(text.contains("<path class=\"arrow\" d=\"M500 500h"), "{text}");
        assert!(text.contains("M584 500l-42"), "{text}");
        one.predicted = [0.1, 0.0].repeat(2601);
        assert_eq!(exaggeration(&[one]), 50.0);
        assert_eq!(exaggeration(&[]), 100.0);
    }
}
