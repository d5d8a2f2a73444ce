//! The normals of the edges of electrodes, from the covered shares of the cells around.
//!
//! Columns of three cells give the slope of an edge that is rather along x, and rows that of one along y, exactly where
//! a straight edge crosses all three; of differences of shares that count the nearest cells twice (Youngs 1984) the
//! slope is taken where it is larger, as columns end before a steep edge (Aulisa, Manservisi, Scardovelli and Zaleski,
//! J. Comput. Phys. 225 (2007) 2301).

use std::sync::OnceLock;

use deaflow_pattern::{Coverage, Raster};

use crate::grid::Grid;

/// The normals of cells, each estimated when it is first needed: a simulation needs those of cut cells alone.
#[derive(Clone, Debug)]
pub(super) struct Normals {
    columns: usize,
    /// The normal of each cell, in the coordinates of gradients, if there is an edge.
    all: Vec<OnceLock<Option<[f64; 2]>>>,
}

/// Which estimate of a normal is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Estimate {
    /// The share of cells along y determines the position of the edge: the slope along x, and the sign along y.
    AlongX(i8),
    /// The slope along y, and the sign along x.
    AlongY(i8),
    /// Differences along both axes.
    Differences,
}

impl Normals {
    /// Prepares the normals of the cells of a raster.
    pub(super) fn new(raster: Raster) -> Self {
        Self {
            columns: raster.columns(),
            all: vec![OnceLock::new(); raster.cells()],
        }
    }

    /// Returns the normal of a cell.
    pub(super) fn at(&self, grid: &Grid, coverage: &Coverage, [x, y]: [usize; 2]) -> Option<[f64; 2]> {
        *self.all[y * self.columns + x].get_or_init(|| normal(grid, coverage, [x, y]))
    }

    /// Returns the derivatives of the angle of a normal with respect to the shares of cells (column, row).
    pub(super) fn slopes(&self, grid: &Grid, coverage: &Coverage, [x, y]: [usize; 2]) -> Vec<([usize; 2], f64)> {
        if self.at(grid, coverage, [x, y]).is_none() {
            return Vec::new();
        }
        let around = Around::of(grid, coverage, [x, y]);
        let estimates = around.estimates();
        // Along a cell the slope is zero, and grows with any change.
        let is_level = around.direction(estimates[0]).contains(&0.0);
        let own = coverage.group(x, y);
        let mut slopes = Vec::new();
        for (place, cells) in around.places() {
            let growth = estimates.map(|estimate| around.growth(estimate, place));
            let of_group = |[x, y]: [usize; 2]| [0, own].contains(&coverage.group(x, y));
            for ([x, y], weight) in cells.iter().filter(|(cell, _)| of_group(*cell)) {
                // Where two estimates are equal, a change of a share takes that with the larger slope.
                let turn = |change: f64| {
                    let is_first = match is_level {
                        true => growth[0].abs() >= growth[1].abs(),
                        false => change * (growth[0] - growth[1]) >= 0.0,
                    };
                    around.turn(grid, estimates[usize::from(!is_first)], place)
                };
                let share = coverage.share(*x, *y);
                let [more, less] = [share < 1.0, share > 0.0].map(|can| f64::from(u8::from(can)));
                let turn = (more * turn(1.0) + less * turn(-1.0)) / (more + less);
                if turn != 0.0 {
                    slopes.push(([*x, *y], turn * weight));
                }
            }
        }
        slopes
    }
}

/// Returns the normal of a cell (column, row).
fn normal(grid: &Grid, coverage: &Coverage, cell: [usize; 2]) -> Option<[f64; 2]> {
    let around = Around::of(grid, coverage, cell);
    // Far from edges the normal of a cell at a border is that of a small change of its share.
    let changed = || around.changed(cell).normal(grid);
    around.normal(grid).or_else(changed)
}

/// Length of a difference of shares below which it is rounding.
const SMALLEST: f64 = 1e-8;

/// Slopes of edges that differ by less are equal: differences of shares have rounding.
const EQUAL: f64 = 1e-12;

/// Converts a normal from cells to the coordinates of gradients, in which cells have other sides.
fn in_gradients(grid: &Grid, [x, y]: [f64; 2]) -> [f64; 2] {
    let ([width, height], [along, across]) = (grid.sides([0, 0]), grid.per_cell());
    [x / (width * along as f64), y / (height * across as f64)]
}

/// A place around a cell: −1, 0 or 1 along each axis.
type Place = [i8; 2];

/// Cells with weights.
type Weighted = Vec<([usize; 2], f64)>;

/// The shares around a cell, each a mean over cells: a cell that is no membrane has the mean of those next to it that
/// are, so that an edge continues beyond the border.
struct Around {
    /// Cells with weights at each place, row by row.
    cells: [Weighted; 9],
    shares: [f64; 9],
}

impl Around {
    fn of(grid: &Grid, coverage: &Coverage, [x, y]: [usize; 2]) -> Self {
        let [columns, rows] = coverage.raster().sides();
        let at = |[along, across]: Place| -> Option<[usize; 2]> {
            let x = x.checked_add_signed(along.into()).filter(|x| *x < columns)?;
            let y = y.checked_add_signed(across.into()).filter(|y| *y < rows)?;
            (grid.is_membrane(x, y) || [along, across] == [0, 0]).then_some([x, y])
        };
        let cells: [Weighted; 9] = std::array::from_fn(|place| {
            let [along, across] = place_of(place);
            if let Some(cell) = at([along, across]) {
                return vec![(cell, 1.0)];
            }
            let beside: Vec<_> = [[along, 0], [0, across]]
                .into_iter()
                .filter(|_| along != 0 && across != 0)
                .filter_map(at)
                .collect();
            match beside.len() {
                0 => vec![([x, y], 1.0)],
                count => beside.into_iter().map(|cell| (cell, 1.0 / count as f64)).collect(),
            }
        });
        // Another group is bare for this one. A bare cell belongs to the group that could cover it.
        let own = coverage.group(x, y);
        let share = |[x, y]: [usize; 2]| match coverage.group(x, y) == own || own == 0 {
            true => coverage.share(x, y),
            false => 0.0,
        };
        let mean = |cells: &Weighted| -> f64 { cells.iter().map(|(cell, weight)| weight * share(*cell)).sum() };
        Self {
            shares: std::array::from_fn(|place| mean(&cells[place])),
            cells,
        }
    }

    /// Returns the shares of a change of the share of a cell alone.
    fn changed(&self, cell: [usize; 2]) -> Self {
        let own = |cells: &Weighted| -> f64 {
            cells
                .iter()
                .filter(|(at, _)| *at == cell)
                .map(|(_, weight)| weight)
                .sum()
        };
        Self {
            shares: std::array::from_fn(|place| own(&self.cells[place])),
            cells: self.cells.clone(),
        }
    }

    fn normal(&self, grid: &Grid) -> Option<[f64; 2]> {
        let [x, y] = in_gradients(grid, self.direction(self.estimate()));
        let length = x.hypot(y);
        (length > SMALLEST).then(|| [x / length, y / length])
    }

    fn places(&self) -> impl Iterator<Item = (Place, &Weighted)> {
        self.cells
            .iter()
            .enumerate()
            .map(|(place, cells)| (place_of(place), cells))
    }

    /// Returns the direction of an estimate, towards larger shares.
    fn direction(&self, estimate: Estimate) -> [f64; 2] {
        let mut sum = match estimate {
            Estimate::AlongX(sign) => [0.0, f64::from(sign)],
            Estimate::AlongY(sign) => [f64::from(sign), 0.0],
            Estimate::Differences => [0.0; 2],
        };
        for (place, share) in self.shares.iter().enumerate() {
            let weights = estimate.weights(place_of(place));
            sum = [0, 1].map(|axis| sum[axis] + weights[axis] * share);
        }
        sum
    }

    fn estimate(&self) -> Estimate {
        self.estimates()[0]
    }

    /// Returns the estimate that is taken, and the other one if both have the same slope, else it again.
    fn estimates(&self) -> [Estimate; 2] {
        let along_x = self.direction(Estimate::AlongX(0))[0];
        let along_y = self.direction(Estimate::AlongY(0))[1];
        let sign = |slope: f64| if slope > 0.0 { 1 } else { -1 };
        let is_flat = along_x.abs() <= along_y.abs();
        let estimate = match is_flat {
            true => Estimate::AlongX(sign(along_y)),
            false => Estimate::AlongY(sign(along_x)),
        };
        let slope = |estimate: Estimate| {
            let [x, y] = self.direction(estimate).map(f64::abs);
            if is_flat { x / y } else { y / x }
        };
        let [own, other] = [estimate, Estimate::Differences].map(slope);
        match (own - other).abs() <= EQUAL {
            true => [estimate, Estimate::Differences],
            // Not a number without any difference.
            false if other < own => [estimate; 2],
            false => [Estimate::Differences; 2],
        }
    }

    /// Returns by how much a change of the share at a place changes the slope of an estimate, along the axis of the
    /// smaller component.
    fn growth(&self, estimate: Estimate, place: Place) -> f64 {
        let ([x, y], [dx, dy]) = (self.direction(estimate), estimate.weights(place));
        let is_flat = x.abs() <= y.abs();
        let ([a, b], [da, db]) = if is_flat {
            ([x, y], [dx, dy])
        } else {
            ([y, x], [dy, dx])
        };
        (da * a.signum() - db * b.signum() * (a / b).abs()) / b.abs()
    }

    /// Returns the angle by which a change of the share at a place turns the direction of an estimate.
    fn turn(&self, grid: &Grid, estimate: Estimate, place: Place) -> f64 {
        let [a, b] = in_gradients(grid, self.direction(estimate));
        let [c, d] = in_gradients(grid, estimate.weights(place));
        (a * d - b * c) / (a * a + b * b)
    }
}

impl Estimate {
    /// Returns the weights of the share at a place in both components of a direction.
    fn weights(self, [x, y]: Place) -> [f64; 2] {
        let (along, across) = (f64::from(x), f64::from(y));
        match self {
            Self::AlongX(_) => [0.5 * along, 0.0],
            Self::AlongY(_) => [0.0, 0.5 * across],
            Self::Differences => [along * f64::from(2 - y.abs()), across * f64::from(2 - x.abs())],
        }
    }
}

/// Returns a place by its number.
fn place_of(number: usize) -> Place {
    [(number % 3) as i8 - 1, (number / 3) as i8 - 1]
}
