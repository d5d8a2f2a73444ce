//! A wanted value between two patterns: the cells in which they differ are changed one after the other, by what each promises, and the
//! number of them is bisected. What is missing then is looked for in single cells.

use deaflow_field::PredictError;
use deaflow_pattern::Pattern;

/// A wanted value counts as reached within this share of it,
const SHARE: f64 = 0.005;

/// and within this, mm.
const LEAST_MM: f64 = 0.001;

/// Whether a value in mm is the wanted one.
#[must_use]
pub fn is_reached(value: f64, wanted: f64) -> bool {
    (value - wanted).abs() <= (SHARE * wanted.abs()).max(LEAST_MM)
}

/// Single cells that are tried.
const SINGLE: usize = 24;

/// Two patterns on either side of a wanted value.
pub struct Passed {
    /// Below it.
    pub below: Pattern,
    /// At it or above.
    pub above: Pattern,
    /// How the value changes with the activity of each cell of the lower one, `[group][y][x]`.
    pub gradient: Vec<f64>,
}

/// The pattern nearest to a wanted value on the way from the one to the other, of those that `may_be`; `value` is none where a pattern has no
/// field, which then counts as beyond.
///
/// # Errors
/// When `value` fails.
pub fn between(
    passed: &Passed,
    wanted: f64,
    may_be: &dyn Fn(&Pattern) -> bool,
    value: &dyn Fn(&Pattern) -> Result<Option<f64>, PredictError>,
) -> Result<Pattern, PredictError> {
    let order = order(passed);
    let reached = |count: usize| changed(passed, &order[..count]);
    let mut nearest: Option<(f64, Pattern)> = None;
    let judge = |pattern: Pattern, nearest: &mut Option<(f64, Pattern)>| -> Result<bool, PredictError> {
        let found = value(&pattern)?;
        if let Some(found) = found
            && nearest
                .as_ref()
                .is_none_or(|(best, _)| (found - wanted).abs() < (best - wanted).abs())
        {
            *nearest = Some((found, pattern));
        }
        Ok(found.is_some_and(|found| found < wanted))
    };
    judge(passed.below.clone(), &mut nearest)?;
    judge(passed.above.clone(), &mut nearest)?;
    // Below the wanted value with so many changes, and not with so many.
    let (mut low, mut high) = (0, order.len());
    while high - low > 1 {
        let middle = usize::midpoint(low, high);
        // Where the middle is none that may be, the nearest to it is tried that is.
        let tried = (0..high - low).find_map(|step| {
            let places = [middle.checked_add(step), middle.checked_sub(step)];
            let inside = |at: &usize| (low + 1..high).contains(at);
            places
                .into_iter()
                .flatten()
                .filter(inside)
                .find(|at| may_be(&reached(*at)))
        });
        let Some(count) = tried else { break };
        match judge(reached(count), &mut nearest)? {
            true => low = count,
            false => high = count,
        }
    }
    let mut tried = Vec::new();
    while let Some((found, pattern)) = &nearest
        && !is_reached(*found, wanted)
        && tried.len() < SINGLE
    {
        let next = one_cell(passed, pattern, wanted - found, &tried, may_be);
        let Some((cell, pattern)) = next else { break };
        tried.push(cell);
        judge(pattern, &mut nearest)?;
    }
    Ok(nearest.map_or_else(|| passed.below.clone(), |(_, pattern)| pattern))
}

/// The pattern with that cell changed which promises most nearly what is missing: of those in which the two patterns differ, and of those at
/// an edge, which become as a neighbour is.
fn one_cell(
    passed: &Passed,
    pattern: &Pattern,
    missing: f64,
    tried: &[usize],
    may_be: &dyn Fn(&Pattern) -> bool,
) -> Option<(usize, Pattern)> {
    let (below, above) = (passed.below.cells(), passed.above.cells());
    let [columns, rows] = passed.below.raster().sides();
    let cells = pattern.cells();
    let other = |at: usize| -> Option<u8> {
        if below[at] != above[at] {
            return Some(if cells[at] == above[at] { below[at] } else { above[at] });
        }
        let (x, y) = (at % columns, at / columns);
        let beside = [
            (x > 0).then(|| at - 1),
            (x + 1 < columns).then(|| at + 1),
            (y > 0).then(|| at - columns),
            (y + 1 < rows).then(|| at + columns),
        ];
        let values = beside.into_iter().flatten().map(|beside| cells[beside]);
        values.into_iter().find(|value| *value != cells[at])
    };
    let left = |(at, group): &(usize, u8)| (missing - gain(passed, *at, cells[*at], *group)).abs();
    let mut changes: Vec<(usize, u8)> = (0..cells.len())
        .filter(|at| !tried.contains(at))
        .filter_map(|at| Some((at, other(at)?)))
        .filter(|change| left(change) < missing.abs())
        .collect();
    changes.sort_by(|a, b| left(a).total_cmp(&left(b)));
    let with = |(cell, group): (usize, u8)| {
        let changed = Pattern::from_groups(passed.below.raster(), |x, y| match y * columns + x {
            at if at == cell => group,
            at => cells[at],
        });
        (cell, changed)
    };
    changes.into_iter().map(with).find(|(_, pattern)| may_be(pattern))
}

/// What it promises that a cell changes from one group to another, by the gradient at the lower pattern.
fn gain(passed: &Passed, at: usize, from: u8, to: u8) -> f64 {
    let count = passed.below.cells().len();
    let of = |group: u8| match usize::from(group) {
        0 => 0.0,
        group => passed.gradient.get((group - 1) * count + at).copied().unwrap_or(0.0),
    };
    of(to) - of(from)
}

/// The cells in which the two differ, by what their change promises; those that become electrodes and those that become none take turns, so
/// that the area changes evenly.
fn order(passed: &Passed) -> Vec<usize> {
    let (below, above) = (passed.below.cells(), passed.above.cells());
    let sorted = |wanted: &dyn Fn(usize) -> bool| {
        let mut found: Vec<usize> = (0..below.len())
            .filter(|&at| above[at] != below[at] && wanted(at))
            .collect();
        let promised = |at: usize| gain(passed, at, below[at], above[at]);
        found.sort_by(|&a, &b| promised(b).total_cmp(&promised(a)));
        found
    };
    let off = sorted(&|at| above[at] == 0);
    let on = sorted(&|at| above[at] != 0);
    let all = on.len() + off.len();
    // After each step so large a share of either as of all.
    let place = |list: &[usize], at: usize| (2 * at + 1) as f64 / (2 * list.len()) as f64;
    let mut found: Vec<(f64, usize)> = Vec::with_capacity(all);
    for list in [&on, &off] {
        found.extend(list.iter().enumerate().map(|(at, cell)| (place(list, at), *cell)));
    }
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    found.into_iter().map(|(_, cell)| cell).collect()
}

/// The lower pattern with some cells as the upper one has them.
fn changed(passed: &Passed, cells: &[usize]) -> Pattern {
    let columns = passed.below.raster().columns();
    let mut values = passed.below.cells().to_vec();
    cells.iter().for_each(|&at| values[at] = passed.above.cells()[at]);
    Pattern::from_groups(passed.below.raster(), |x, y| values[y * columns + x])
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn passed(below: impl Fn(usize, usize) -> bool, above: impl Fn(usize, usize) -> bool) -> Passed {
        let raster = Raster::new(10, 10).unwrap();
        Passed {
            below: Pattern::from_fn(raster, below),
            above: Pattern::from_fn(raster, above),
            gradient: (0..100).map(f64::from).collect(),
        }
    }

    #[test]
    fn the_nearest_is_found_by_bisection_to_one_cell() {
        let between_them = passed(|x, _| x < 2, |x, _| x < 8);
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
    fn what_is_missing_is_looked_for_in_single_cells() {
        let between_them = passed(|x, _| x < 2, |x, _| x < 8);
        // Cells are worth as much as they promise, by which no number of the best alone comes to what is wanted.
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
    fn cells_that_are_turned_on_and_off_take_turns_and_what_must_not_be_is_left_out() {
        // Of equal areas all between have the same, to one cell.
        let exchange = passed(|x, _| x < 5, |x, _| x >= 5);
        let way = order(&exchange);
        assert_eq!(way.len(), 100);
        for count in 0..=100 {
            let cells = changed(&exchange, &way[..count]).active_cells();
            assert!(cells.abs_diff(50) <= 1, "{count}: {cells}");
        }
        // The most promising first.
        assert_eq!((way[0] == 99 || way[1] == 99, way.contains(&0)), (true, true));
        let even = |pattern: &Pattern| pattern.active_cells().is_multiple_of(7);
        let more = passed(|x, _| x < 2, |x, _| x < 8);
        let found = between(&more, 50.2, &even, &|pattern| Ok(Some(pattern.active_cells() as f64))).unwrap();
        assert_eq!(found.active_cells(), 49);
    }

    #[test]
    fn a_pattern_without_a_field_lies_beyond() {
        let between_them = passed(|x, _| x < 2, |x, _| x < 8);
        let value = |pattern: &Pattern| {
            let cells = pattern.active_cells();
            Ok((cells <= 45).then_some(cells as f64))
        };
        let found = between(&between_them, 60.0, &|_| true, &value).unwrap();
        assert_eq!(found.active_cells(), 45);
        assert!(is_reached(1.5049, 1.5) && !is_reached(1.51, 1.5) && is_reached(-0.0009, 0.0));
    }
}
