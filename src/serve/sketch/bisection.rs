//! The search for a target value between two patterns: the cells in which they differ are changed one after the other,
//! in the order of their estimated effect, and the number of changed cells is bisected. The rest of the difference is
//! made up by single cells.

use deaflow_field::PredictError;
use deaflow_pattern::Pattern;

/// A target value is reached within this fraction of it,
const TOLERANCE: f64 = 0.005;

/// or within this difference, mm.
const TOLERANCE_MM: f64 = 0.001;

/// Whether a value in mm is close enough to the target.
#[must_use]
pub fn is_reached(value: f64, target: f64) -> bool {
    (value - target).abs() <= (TOLERANCE * target.abs()).max(TOLERANCE_MM)
}

/// Single cells that are tried.
const MAX_SINGLE_CELLS: usize = 24;

/// Two patterns whose values lie on either side of the target.
pub struct PatternBracket {
    /// The pattern below the target.
    pub below: Pattern,
    /// The pattern at the target or above.
    pub above: Pattern,
    /// Derivatives of the value with respect to the activity of each cell at the lower pattern, `[group][y][x]`.
    pub gradient: Vec<f64>,
}

/// Returns the pattern nearest to the target, among those that satisfy `is_allowed`. A pattern without a value, because
/// it has no field, counts as above the target.
///
/// # Errors
/// If `value` fails.
pub fn between(
    bracket: &PatternBracket,
    target: f64,
    is_allowed: &dyn Fn(&Pattern) -> bool,
    value: &dyn Fn(&Pattern) -> Result<Option<f64>, PredictError>,
) -> Result<Pattern, PredictError> {
    let order = order(bracket);
    let with_changes = |count: usize| changed(bracket, &order[..count]);
    let mut nearest: Option<(f64, Pattern)> = None;
    let is_below = |pattern: Pattern, nearest: &mut Option<(f64, Pattern)>| -> Result<bool, PredictError> {
        let found = value(&pattern)?;
        if let Some(found) = found
            && nearest
                .as_ref()
                .is_none_or(|(best, _)| (found - target).abs() < (best - target).abs())
        {
            *nearest = Some((found, pattern));
        }
        Ok(found.is_some_and(|found| found < target))
    };
    is_below(bracket.below.clone(), &mut nearest)?;
    is_below(bracket.above.clone(), &mut nearest)?;
    // The value is below the target with `low` changes, and not with `high`.
    let (mut low, mut high) = (0, order.len());
    while high - low > 1 {
        let middle = usize::midpoint(low, high);
        // If the middle is not allowed, the nearest allowed count is tried.
        let tried = (0..high - low).find_map(|step| {
            let counts = [middle.checked_add(step), middle.checked_sub(step)];
            let inside = |at: &usize| (low + 1..high).contains(at);
            counts
                .into_iter()
                .flatten()
                .filter(inside)
                .find(|at| is_allowed(&with_changes(*at)))
        });
        let Some(count) = tried else { break };
        match is_below(with_changes(count), &mut nearest)? {
            true => low = count,
            false => high = count,
        }
    }
    let mut tried = Vec::new();
    while let Some((found, pattern)) = &nearest
        && !is_reached(*found, target)
        && tried.len() < MAX_SINGLE_CELLS
    {
        let next = one_cell(bracket, pattern, target - found, &tried, is_allowed);
        let Some((cell, pattern)) = next else { break };
        tried.push(cell);
        is_below(pattern, &mut nearest)?;
    }
    Ok(nearest.map_or_else(|| bracket.below.clone(), |(_, pattern)| pattern))
}

/// Changes the cell whose estimated effect is nearest to the missing difference: one in which the two patterns differ,
/// or one at an edge, which takes the value of a neighbour.
fn one_cell(
    bracket: &PatternBracket,
    pattern: &Pattern,
    missing: f64,
    tried: &[usize],
    is_allowed: &dyn Fn(&Pattern) -> bool,
) -> Option<(usize, Pattern)> {
    let (below, above) = (bracket.below.cells(), bracket.above.cells());
    let [columns, rows] = bracket.below.raster().sides();
    let cells = pattern.cells();
    let other = |at: usize| -> Option<u8> {
        if below[at] != above[at] {
            return Some(if cells[at] == above[at] { below[at] } else { above[at] });
        }
        let (x, y) = (at % columns, at / columns);
        let neighbours = [
            (x > 0).then(|| at - 1),
            (x + 1 < columns).then(|| at + 1),
            (y > 0).then(|| at - columns),
            (y + 1 < rows).then(|| at + columns),
        ];
        let values = neighbours.into_iter().flatten().map(|neighbour| cells[neighbour]);
        values.into_iter().find(|value| *value != cells[at])
    };
    let left = |(at, group): &(usize, u8)| (missing - effect(bracket, *at, cells[*at], *group)).abs();
    let mut changes: Vec<(usize, u8)> = (0..cells.len())
        .filter(|at| !tried.contains(at))
        .filter_map(|at| Some((at, other(at)?)))
        .filter(|change| left(change) < missing.abs())
        .collect();
    changes.sort_by(|a, b| left(a).total_cmp(&left(b)));
    let with = |(cell, group): (usize, u8)| {
        let changed = Pattern::from_groups(bracket.below.raster(), |x, y| match y * columns + x {
            at if at == cell => group,
            at => cells[at],
        });
        (cell, changed)
    };
    changes.into_iter().map(with).find(|(_, pattern)| is_allowed(pattern))
}

/// Estimates the effect of changing a cell from one group to another, by the gradient at the lower pattern.
fn effect(bracket: &PatternBracket, at: usize, from: u8, to: u8) -> f64 {
    let count = bracket.below.cells().len();
    let of = |group: u8| match usize::from(group) {
        0 => 0.0,
        group => bracket.gradient.get((group - 1) * count + at).copied().unwrap_or(0.0),
    };
    of(to) - of(from)
}

/// Sorts the cells in which the two patterns differ by their estimated effect. Cells that are switched on and off
/// alternate, so that the area changes evenly.
fn order(bracket: &PatternBracket) -> Vec<usize> {
    let (below, above) = (bracket.below.cells(), bracket.above.cells());
    let sorted = |is_included: &dyn Fn(usize) -> bool| {
        let mut found: Vec<usize> = (0..below.len())
            .filter(|&at| above[at] != below[at] && is_included(at))
            .collect();
        let effect = |at: usize| effect(bracket, at, below[at], above[at]);
        found.sort_by(|&a, &b| effect(b).total_cmp(&effect(a)));
        found
    };
    let off = sorted(&|at| above[at] == 0);
    let on = sorted(&|at| above[at] != 0);
    let all = on.len() + off.len();
    // After each step, the same fraction of both lists is used.
    let place = |list: &[usize], at: usize| (2 * at + 1) as f64 / (2 * list.len()) as f64;
    let mut found: Vec<(f64, usize)> = Vec::with_capacity(all);
    for list in [&on, &off] {
        found.extend(list.iter().enumerate().map(|(at, cell)| (place(list, at), *cell)));
    }
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    found.into_iter().map(|(_, cell)| cell).collect()
}

/// Returns the lower pattern with some cells of the upper one.
fn changed(bracket: &PatternBracket, cells: &[usize]) -> Pattern {
    let columns = bracket.below.raster().columns();
    let mut values = bracket.below.cells().to_vec();
    cells.iter().for_each(|&at| values[at] = bracket.above.cells()[at]);
    Pattern::from_groups(bracket.below.raster(), |x, y| values[y * columns + x])
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn bracket(below: impl Fn(usize, usize) -> bool, above: impl Fn(usize, usize) -> bool) -> PatternBracket {
        let raster = Raster::new(10, 10).unwrap();
        PatternBracket {
            below: Pattern::from_fn(raster, below),
            above: Pattern::from_fn(raster, above),
            gradient: (0..100).map(f64::from).collect(),
        }
    }

    #[test]
    fn the_nearest_is_found_by_bisection_to_one_cell() {
        let between_them = bracket(|x, _| x < 2, |x, _| x < 8);
        let simulated = std::cell::Cell::new(0);
        let value = |pattern: &Pattern| {
            simulated.set(simulated.get() + 1);
            Ok(Some(pattern.active_cells() as f64))
        };
        for wanted in [20.2, 33.4, 50.0, 79.6] {
            simulated.set(0);
            let found = between(&between_them, wanted, &|_| true, &value).unwrap();
            assert!((found.active_cells() as f64 - wanted).abs() <= 0.5, "{wanted}");
            assert!(simulated.get() <= 9, "{} solutions", simulated.get());
        }
    }

    #[test]
    fn the_rest_of_the_difference_is_made_up_by_single_cells() {
        let between_them = bracket(|x, _| x < 2, |x, _| x < 8);
        // Cells are worth their gradient, so that no number of the best ones gives the target.
        let worth = |pattern: &Pattern| {
            let cells = pattern.cells().iter().enumerate();
            cells.map(|(at, cell)| f64::from(*cell) * at as f64).sum::<f64>()
        };
        let wanted = worth(&between_them.below) + 333.0;
        let value = |pattern: &Pattern| Ok(Some(worth(pattern)));
        let found = between(&between_them, wanted, &|_| true, &value).unwrap();
        assert!(is_reached(worth(&found), wanted), "{} for {wanted}", worth(&found));
    }

    #[test]
    fn cells_switched_on_and_off_alternate_and_forbidden_patterns_are_skipped() {
        // Between two patterns of equal area, the area is the same to one cell.
        let exchange = bracket(|x, _| x < 5, |x, _| x >= 5);
        let way = order(&exchange);
        assert_eq!(way.len(), 100);
        for count in 0..=100 {
            let cells = changed(&exchange, &way[..count]).active_cells();
            assert!(cells.abs_diff(50) <= 1, "{count}: {cells}");
        }
        // The cell with the largest effect comes first.
        assert_eq!((way[0] == 99 || way[1] == 99, way.contains(&0)), (true, true));
        let even = |pattern: &Pattern| pattern.active_cells().is_multiple_of(7);
        let more = bracket(|x, _| x < 2, |x, _| x < 8);
        let found = between(&more, 50.2, &even, &|pattern| Ok(Some(pattern.active_cells() as f64))).unwrap();
        assert_eq!(found.active_cells(), 49);
    }

    #[test]
    fn a_pattern_without_a_field_counts_as_above() {
        let between_them = bracket(|x, _| x < 2, |x, _| x < 8);
        let value = |pattern: &Pattern| {
            let cells = pattern.active_cells();
            Ok((cells <= 45).then_some(cells as f64))
        };
        let found = between(&between_them, 60.0, &|_| true, &value).unwrap();
        assert_eq!(found.active_cells(), 45);
        assert!(is_reached(1.5049, 1.5) && !is_reached(1.51, 1.5) && is_reached(-0.0009, 0.0));
    }
}
