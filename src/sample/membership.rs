//! Whether a family may have drawn a pattern: what a dataset says of its rows is not to be believed.
//!
//! A family's patterns are drawn at random, so no pattern is that of one family alone. What is told here is what a family
//! cannot have drawn: units that are cut, or, where every cell or unit is on its own, as few or as many edges between on and off
//! as chance gives in one sample of 1e15.

use super::family::FAMILIES;
use deaflow_pattern::{Pattern, Raster, Symmetry};

/// Standard deviations beyond which chance does not reach: odds of 1e-15 for a normal distribution.
const BEYOND_CHANCE: f64 = 8.0;

/// Whether a family of this name may have drawn a pattern, or an image of it; `None` where the table has no such family.
#[must_use]
pub fn admits(family: &str, pattern: &Pattern) -> Option<bool> {
    let entry = FAMILIES.iter().find(|entry| entry.name() == family)?;
    // Of membranes of other cells it is not known how long their sides are.
    if pattern.raster() != Raster::PAPER {
        return Some(true);
    }
    // Datasets hold images of what was drawn. Units that differ by a cell in size stand otherwise in an image.
    Some(Symmetry::ALL.into_iter().any(|g| entry.admits(&pattern.transformed(g))))
}

/// Sides between a cell that is on and one that is off.
pub(super) fn edges(pattern: &Pattern) -> usize {
    unit_edges(pattern.raster().sides(), &|x, y| pattern.is_active(x, y))
}

/// Cells along the longer side.
pub(super) fn longer_side(pattern: &Pattern) -> usize {
    let [columns, rows] = pattern.raster().sides();
    columns.max(rows)
}

/// Whether every unit of a grid of so many columns and rows is on or off as a whole, and units seem to be on or off by chance.
pub(super) fn is_grid_of(units: [usize; 2], pattern: &Pattern) -> bool {
    let sides = pattern.raster().sides();
    let first = |axis: usize, cell: usize| (cell * units[axis] / sides[axis] * sides[axis]).div_ceil(units[axis]);
    let mut cells = (0..sides[0] * sides[1]).map(|i| (i % sides[0], i / sides[0]));
    if !cells.all(|(x, y)| pattern.is_active(x, y) == pattern.is_active(first(0, x), first(1, y))) {
        return false;
    }
    let corner = |axis: usize, unit: usize| (unit * sides[axis]).div_ceil(units[axis]);
    seems_drawn(units, &|x, y| pattern.is_active(corner(0, x), corner(1, y)))
}

/// Units of a grid of so many columns and rows that are on.
pub(super) fn units_on(units: [usize; 2], pattern: &Pattern) -> usize {
    let sides = pattern.raster().sides();
    let corner = |axis: usize, unit: usize| (unit * sides[axis]).div_ceil(units[axis]);
    let all = (0..units[0] * units[1]).map(|i| (corner(0, i % units[0]), corner(1, i / units[0])));
    all.filter(|&(x, y)| pattern.is_active(x, y)).count()
}

/// Whether the edges among n × m units are as many as among units that are on or off by chance, a given number of them on.
///
/// Of N units k are on. Two neighbours differ with p = 2k(N − k)/(N(N − 1)); the number of neighbours that do has the mean
/// n(m − 1)p + m(n − 1)p, and at most the variance that it would have if each unit were drawn for itself with the share α = k/N: p(1 − p) for
/// each pair of neighbours, and twice α(1 − α)(1 − 4α(1 − α)) for each of the at most 6N pairs of these that share a unit.
fn seems_drawn([n, m]: [usize; 2], is_on: &dyn Fn(usize, usize) -> bool) -> bool {
    let total = (n * m) as f64;
    let on = (0..n * m).filter(|i| is_on(i % n, i / n)).count() as f64;
    let pairs = (n * (m - 1) + m * (n - 1)) as f64;
    let p = 2.0 * on * (total - on) / (total * (total - 1.0)).max(1.0);
    let alone = on / total * (1.0 - on / total);
    let variance = pairs * p * (1.0 - p) + 12.0 * total * alone * (1.0 - 4.0 * alone);
    let off = unit_edges([n, m], is_on) as f64 - pairs * p;
    // A bound for a normal distribution; counts of a few units are not normal, and are not told.
    off.abs() <= BEYOND_CHANCE * variance.sqrt() + BEYOND_CHANCE
}

fn unit_edges([n, m]: [usize; 2], is_on: &dyn Fn(usize, usize) -> bool) -> usize {
    let all = (0..m).flat_map(|y| (0..n).map(move |x| (x, y)));
    let differ = |(x, y): (usize, usize)| {
        usize::from(x > 0 && is_on(x, y) != is_on(x - 1, y)) + usize::from(y > 0 && is_on(x, y) != is_on(x, y - 1))
    };
    all.map(differ).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Canvas;
    use crate::{AreaSweep, Areas, Bezier, Blobs, Checker, Curves, Ends, Family, LargeGrid, SmallGrid, Stripes};
    use deaflow_pattern::CELLS;

    fn families() -> Vec<Box<dyn Family>> {
        let areas = || Areas::new(Canvas::PAPER, 0.02, 0.98).unwrap();
        let grids = (2..=CELLS)
            .step_by(3)
            .map(|units| Box::new(LargeGrid::new(Canvas::PAPER, units).unwrap()) as Box<dyn Family>);
        let others: Vec<Box<dyn Family>> = vec![
            Box::new(SmallGrid::new(Canvas::PAPER, 0.5).unwrap()),
            Box::new(SmallGrid::new(Canvas::PAPER, 0.04).unwrap()),
            Box::new(Bezier::new(Canvas::PAPER, None, Ends::Opposite).unwrap()),
            Box::new(Bezier::new(Canvas::PAPER, Some(0.3), Ends::Any).unwrap()),
            Box::new(AreaSweep::new(Canvas::PAPER, 0.05, 0.95).unwrap()),
            Box::new(Stripes::new(areas())),
            Box::new(Checker::new(areas())),
            Box::new(Blobs::new(areas())),
            Box::new(Curves::new(Canvas::PAPER, None)),
            Box::new(Curves::new(Canvas::PAPER, Some(areas()))),
        ];
        grids.chain(others).collect()
    }

    #[test]
    fn every_family_admits_what_it_draws() {
        for family in families() {
            let count = family.available().unwrap_or(u64::MAX).min(150);
            for index in 0..count {
                let pattern = family.sample(7, index).unwrap();
                let image = pattern.transformed(Symmetry::ALL[index as usize % 8]);
                assert_eq!(admits(family.name(), &image), Some(true), "{} {index}", family.name());
            }
        }
    }

    #[test]
    fn no_family_admits_what_it_cannot_draw() {
        let small = SmallGrid::new(Canvas::PAPER, 0.5).unwrap();
        let large = LargeGrid::new(Canvas::PAPER, 12).unwrap();
        let bezier = Bezier::new(Canvas::PAPER, None, Ends::Opposite).unwrap();
        for index in 0..50 {
            let of = |family: &dyn Family, names: &[&str]| {
                let pattern = family.sample(3, index).unwrap();
                for name in names {
                    assert_eq!(
                        admits(name, &pattern),
                        Some(false),
                        "{} {index} as {name}",
                        family.name()
                    );
                }
            };
            of(&small, &["bezier", "blobs", "curves"]);
            of(&large, &["small-grid", "bezier"]);
            of(&bezier, &["small-grid", "large-grid"]);
        }
        assert_eq!(admits("nobody's", &large.sample(1, 1).unwrap()), None);
    }
}
