//! Detects patterns that a family cannot have drawn, since the labels of a dataset may be wrong.
//!
//! Patterns are drawn at random, so a pattern never proves its family. It can exclude one: by units that are cut, or,
//! for independent cells or units, by a number of edges between on and off with a probability below 1e-15.

use deaflow_pattern::Pattern;

/// Standard deviations that a random sample does not exceed: a probability of 1e-15 for a normal distribution.
const BEYOND_CHANCE: f64 = 8.0;

/// Returns the number of cell sides between a cell that is on and one that is off.
pub(super) fn edges(pattern: &Pattern) -> usize {
    unit_edges(pattern.raster().sides(), &|x, y| pattern.is_active(x, y))
}

/// Returns the number of cells along the longer side.
pub(super) fn longer_side(pattern: &Pattern) -> usize {
    let [columns, rows] = pattern.raster().sides();
    columns.max(rows)
}

/// Returns whether every unit of a grid with these columns and rows is entirely on or off, and the units look random.
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

/// Returns the number of units that are on in a grid with these columns and rows.
pub(super) fn units_on(units: [usize; 2], pattern: &Pattern) -> usize {
    let sides = pattern.raster().sides();
    let corner = |axis: usize, unit: usize| (unit * sides[axis]).div_ceil(units[axis]);
    let all = (0..units[0] * units[1]).map(|i| (corner(0, i % units[0]), corner(1, i / units[0])));
    all.filter(|&(x, y)| pattern.is_active(x, y)).count()
}

/// Returns whether n × m units have a plausible number of edges if the units that are on were chosen at random.
///
/// Of N units k are on. Two neighbours differ with probability p = 2k(N − k)/(N(N − 1)). The number of such neighbours
/// has the mean n(m − 1)p + m(n − 1)p. Its variance is at most that for units drawn independently with probability α =
/// k/N: p(1 − p) for each pair of neighbours, and twice α(1 − α)(1 − 4α(1 − α)) for each of the at most 6N pairs of
/// pairs that share a unit.
fn seems_drawn([n, m]: [usize; 2], is_on: &dyn Fn(usize, usize) -> bool) -> bool {
    let total = (n * m) as f64;
    let on = (0..n * m).filter(|i| is_on(i % n, i / n)).count() as f64;
    let pairs = (n * (m - 1) + m * (n - 1)) as f64;
    let p = 2.0 * on * (total - on) / (total * (total - 1.0)).max(1.0);
    let alone = on / total * (1.0 - on / total);
    let variance = pairs * p * (1.0 - p) + 12.0 * total * alone * (1.0 - 4.0 * alone);
    let off = unit_edges([n, m], is_on) as f64 - pairs * p;
    // The bound holds for a normal distribution; counts of a few units are not normal, so a margin is added.
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
    use crate::Canvas;
    use crate::{
        AreaSweep, Areas, Bezier, Blobs, Checker, Curves, Diagonals, Dithers, Ends, Family, Glyphs, LargeGrid, Mazes,
        SmallGrid, Spirals, Stripes, admits,
    };
    use deaflow_pattern::{CELLS, Symmetry};

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
            Box::new(Dithers::new(areas())),
            Box::new(Spirals::new(areas())),
            Box::new(Mazes::new(Canvas::PAPER)),
            Box::new(Diagonals::new(Canvas::PAPER)),
            Box::new(Glyphs::new(Canvas::PAPER)),
        ];
        grids.chain(others).collect()
    }

    #[test]
    fn a_sample_depends_on_seed_and_index_only() {
        for family in families().iter().filter(|family| family.available().is_none()) {
            let [sample, again, other_index, other_seed] =
                [(1, 7), (1, 7), (1, 8), (2, 7)].map(|(seed, index)| family.sample(seed, index).unwrap());
            assert_eq!(sample, again, "{family:?}");
            assert!(sample != other_index && sample != other_seed, "{family:?}");
        }
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
