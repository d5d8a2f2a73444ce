//! Large grid: the membrane divided into N × N units, each entirely on or off.
//!
//! The second family of the source paper (Qin et al., doi 10.1089/soro.2024.0063): fewer, larger units are less
//! fragmented and move farther. Half of the units are on; if N² is odd, half is rounded down or up with equal
//! probability. If N does not divide 50, the sizes of the units differ by a cell, so the area fraction is near ½ but
//! not exactly ½.

use super::canvas::Canvas;
use super::combination::{binomial, permuted, subset};
use super::error::{ParameterError, SampleError};
use super::family::{Family, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::membership::{is_grid_of, longer_side, units_on};
use deaflow_base::{Canonical, InputError, Node, Parameter, Schema, Stream, parameters};
use deaflow_pattern::{Pattern, Raster};

/// Several numbers of units across the membrane; the order is irrelevant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnitNumbers(Vec<u64>);

impl Parameter for UnitNumbers {
    type Limits = ();
    type Literal = Vec<u64>;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let mut numbers = Vec::new();
        for item in node.list(key)? {
            let n = item.integer(key, 2, Raster::MOST as u64)?;
            if numbers.contains(&n) {
                return Err(item.error(format!("`{key}` contains {n} twice")));
            }
            numbers.push(n);
        }
        if numbers.is_empty() {
            return Err(node.error(format!("`{key}` is empty")).help("for example [2, 3, 4]"));
        }
        numbers.sort_unstable();
        Ok(Self(numbers))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.iter().copied().map(Canonical::from).collect())
    }

    fn schema((): &()) -> Schema {
        Schema::list(Schema::integer(2, Raster::MOST as u64), 1, usize::MAX).distinct()
    }

    fn literal(literal: Vec<u64>) -> Self {
        Self(literal)
    }
}

parameters! {
    /// N × N units, each entirely on or off; on a rectangle N is the number across the shorter side.
    pub struct LargeGridParameters as "a large-grid sample" {
        /// Units across the membrane, at most as many as cells, such as [2, 3, 4].
        pub units: UnitNumbers,
        /// Patterns to draw for each number of units, or all if there are fewer.
        pub count_per_units: u64 [1..=MOST_SAMPLES],
    }
}

impl FamilyParameters for LargeGridParameters {
    const NAME: &'static str = "large-grid";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, ParameterError> {
        let group = |&n: &u64| {
            let family = LargeGrid::new(canvas.clone(), n as usize).map_err(ParameterError::of("units"))?;
            let most = family.available().unwrap_or(u64::MAX);
            Ok(SampleGroup {
                family: Box::new(family),
                count: self.count_per_units.min(most),
                parameters: vec![("units", n.into())],
            })
        };
        self.units.0.iter().map(group).collect()
    }

    /// Half of some number of units is on.
    fn admits(pattern: &Pattern) -> bool {
        let is_half = |units: usize| {
            let (on, half) = (units_on([units; 2], pattern), units * units / 2);
            on == half || units % 2 == 1 && on == half + 1
        };
        (2..=longer_side(pattern)).any(|units| is_half(units) && is_grid_of([units; 2], pattern))
    }
}

/// Patterns of N × N units, half of them on. Cell i of n lies in unit floor(i · N / n). On a rectangle, N units lie
/// across the shorter side, and across the longer one the number that makes them most nearly square.
#[derive(Clone, Debug, PartialEq)]
pub struct LargeGrid {
    canvas: Canvas,
    across: usize,
    /// Columns and rows of units.
    units: [usize; 2],
}

impl LargeGrid {
    /// Creates the family with `across` units across the membrane.
    ///
    /// # Errors
    /// When there are no units, or more units than cells.
    pub fn new(canvas: Canvas, across: usize) -> Result<Self, SampleError> {
        let units = units_of(&canvas, across);
        let cells = canvas.raster().sides();
        match across > 0 && units[0] <= cells[0] && units[1] <= cells[1] {
            true => Ok(Self { canvas, across, units }),
            false => Err(SampleError::Units {
                most: cells[0].min(cells[1]),
                found: across,
            }),
        }
    }

    fn total(&self) -> usize {
        self.units[0] * self.units[1]
    }

    fn with_lower_count(&self) -> Option<u64> {
        binomial(self.total() as u64, self.total() as u64 / 2)
    }
}

impl Family for LargeGrid {
    fn name(&self) -> &'static str {
        LargeGridParameters::NAME
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let mut count = self.total() / 2;
        if self.total() % 2 == 1 && stream.chance(0.5) {
            count += 1;
        }
        let mut on = vec![false; self.total()];
        for unit in stream.choose(self.total(), count) {
            on[unit] = true;
        }
        pattern_of_units(&self.canvas, self.units, &on)
    }

    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let purpose = format!("large-grid {}", self.across);
        let (Some(available), Some(lower)) = (self.available(), self.with_lower_count()) else {
            return Ok(self.draw(&mut Stream::new(seed, &purpose, index)));
        };
        if index >= available {
            return Err(SampleError::Exhausted { index, available });
        }
        let rank = permuted(available, seed, &purpose, index);
        let on = subset(self.total(), self.total() / 2 + (rank / lower) as usize, rank % lower);
        Ok(pattern_of_units(&self.canvas, self.units, &on))
    }

    /// `None` if there are too many to number in 64 bits (9 × 9 and more). Below that, samples are distinct and reach
    /// every pattern; above, the probability of a repetition in 10,000 samples is below 1e-14.
    fn available(&self) -> Option<u64> {
        self.with_lower_count()?.checked_mul(1 + (self.total() as u64) % 2)
    }

    fn units(&self) -> u64 {
        self.across as u64
    }
}

/// Returns the columns and rows of units, with `across` units across the shorter side.
pub(super) fn units_of(canvas: &Canvas, across: usize) -> [usize; 2] {
    let [width, height] = canvas.size();
    let along = |side: f64| (across as f64 * side / width.min(height)).round() as usize;
    [along(width), along(height)]
}

/// Returns the pattern of units, each on or off, `[y][x]`.
pub(super) fn pattern_of_units(canvas: &Canvas, units: [usize; 2], on: &[bool]) -> Pattern {
    let sides = canvas.raster().sides();
    let unit = |axis: usize, cell: usize| cell * units[axis] / sides[axis];
    Pattern::from_fn(canvas.raster(), |x, y| on[unit(1, y) * units[0] + unit(0, x)])
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use deaflow_pattern::CELLS;

    fn first(units: usize, seed: u64, count: u64) -> Vec<Pattern> {
        let family = LargeGrid::new(Canvas::PAPER, units).unwrap();
        (0..count).map(|i| family.sample(seed, i).unwrap()).collect()
    }

    #[test]
    fn small_grids_are_enumerated_completely() {
        // PAPER: 2 × 2 has C(4,2) = 6 patterns, 3 × 3 with 4 or 5 units on C(9,4) + C(9,5) = 252.
        for (units, count) in [(1, 2), (2, 6), (3, 252)] {
            let family = LargeGrid::new(Canvas::PAPER, units).unwrap();
            assert_eq!(family.available(), Some(count));
            assert_eq!(
                first(units, 2, count).into_iter().collect::<HashSet<_>>().len(),
                count as usize
            );
            assert_eq!(
                family.sample(2, count),
                Err(SampleError::Exhausted {
                    index: count,
                    available: count
                })
            );
        }
    }

    #[test]
    fn larger_grids_do_not_repeat() {
        for units in 4..=10 {
            assert_eq!(
                first(units, 2, 1000).into_iter().collect::<HashSet<_>>().len(),
                1000,
                "{units}"
            );
        }
    }

    #[test]
    fn half_the_units_are_on_and_every_cell_follows_its_unit() {
        for units in 2..=12 {
            let mut counts = HashSet::new();
            for pattern in first(units, 7, if units == 2 { 6 } else { 40 }) {
                let corner = |unit: usize| (unit * CELLS).div_ceil(units);
                let on = (0..units * units)
                    .filter(|u| pattern.is_active(corner(u % units), corner(u / units)))
                    .count();
                counts.insert(on);
                for (x, y) in (0..CELLS).flat_map(|y| (0..CELLS).map(move |x| (x, y))) {
                    let of_unit = |c: usize| corner(c * units / CELLS);
                    assert_eq!(pattern.is_active(x, y), pattern.is_active(of_unit(x), of_unit(y)));
                }
            }
            let half = units * units / 2;
            let expected: HashSet<_> = (half..=half + units * units % 2).collect();
            assert_eq!(counts, expected, "{units} units");
        }
    }

    #[test]
    fn every_unit_is_on_equally_often() {
        for units in [4, 6, 9] {
            let draws = 2000;
            let mut counts = vec![0.0; units * units];
            for pattern in first(units, 11, draws) {
                for (unit, count) in counts.iter_mut().enumerate() {
                    let corner = |u: usize| (u * CELLS).div_ceil(units);
                    *count += f64::from(u8::from(pattern.is_active(corner(unit % units), corner(unit / units))));
                }
            }
            let mean = draws as f64 / 2.0;
            let chi2: f64 = counts.iter().map(|c| (c - mean).powi(2) / (draws as f64 / 4.0)).sum();
            let freedom = (units * units) as f64;
            assert!(
                chi2 < freedom + 4.0 * (2.0 * freedom).sqrt(),
                "{units}: chi-square {chi2}"
            );
        }
    }

    #[test]
    fn a_grid_has_between_1_and_50_units() {
        for units in [0, 51] {
            assert_eq!(
                LargeGrid::new(Canvas::PAPER, units),
                Err(SampleError::Units { most: 50, found: units })
            );
        }
    }
}
