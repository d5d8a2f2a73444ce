//! The area of a region of the membrane.

use std::f64::consts::PI;
use std::sync::Arc;

use super::error::GoalError;
use deaflow_field::Field;
use deaflow_pattern::{Membrane, Region};

/// The cells of a region, whose deformed corners are joined by straight lines.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionCells {
    /// Column and row of each cell.
    cells: Arc<[[usize; 2]]>,
    /// Columns and rows of the membrane.
    sides: [usize; 2],
    /// Sides of a cell in mm.
    cell_mm: [f64; 2],
}

impl RegionCells {
    /// The cells of a membrane whose centres lie in a region.
    ///
    /// # Errors
    /// If there are none, or the region is a mask with other cells.
    pub fn of(region: &Region, membrane: Membrane) -> Result<Self, GoalError> {
        let raster = membrane.raster;
        if let Some(found) = region.other_raster(raster) {
            return Err(GoalError::RegionMask { found, raster });
        }
        let (inside, [columns, rows]) = (region.cells(membrane), raster.sides());
        let all = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        let cells: Arc<[[usize; 2]]> = all.filter(|[x, y]| inside.has(*x, *y)).collect();
        match cells.is_empty() {
            true => Err(GoalError::Region {
                size: membrane.size_text(),
            }),
            false => Ok(Self {
                cells,
                sides: [columns, rows],
                cell_mm: membrane.cell_mm(),
            }),
        }
    }

    /// The centroid in mm.
    #[must_use]
    pub fn centroid_mm(&self) -> [f64; 2] {
        [0, 1].map(|axis| {
            let sum: f64 = self.cells.iter().map(|cell| cell[axis] as f64 + 0.5).sum();
            self.cell_mm[axis] * sum / self.cells.len() as f64
        })
    }

    /// The radius in mm of the disc of the same area.
    #[must_use]
    pub fn radius_mm(&self) -> f64 {
        (self.area_mm2() / PI).sqrt()
    }

    /// Whether it contains a cell.
    #[must_use]
    pub fn has(&self, cell: [usize; 2]) -> bool {
        self.cells
            .binary_search_by_key(&[cell[1], cell[0]], |[x, y]| [*y, *x])
            .is_ok()
    }

    /// The growth in mm of the radius of the disc of the same area.
    #[must_use]
    pub fn growth_mm(&self, field: &Field) -> f64 {
        self.deformed_radius_mm(field) - self.radius_mm()
    }

    /// The largest growth of the radius for each mm by which every corner is displaced.
    #[must_use]
    pub fn growth_per_displacement(&self) -> f64 {
        let [columns, rows] = self.sides;
        let is_outside = |[x, y]: [usize; 2]| x >= columns || y >= rows || !self.has([x, y]);
        let [width, height] = self.cell_mm;
        let edges = self.cells.iter().map(|&[x, y]| {
            let beside = [[x.wrapping_sub(1), y], [x + 1, y]].into_iter();
            let above = [[x, y.wrapping_sub(1)], [x, y + 1]].into_iter();
            let count = |cells: std::array::IntoIter<[usize; 2], 2>| cells.filter(|cell| is_outside(*cell)).count();
            count(beside) as f64 * height + count(above) as f64 * width
        });
        edges.sum::<f64>() / (2.0 * PI * self.radius_mm())
    }

    /// The derivative of the growth with respect to the displacements of corners, times a factor: pairs of a corner
    /// index in `[y][x]` and the derivatives with respect to both components.
    pub(super) fn slope(&self, field: &Field, factor: f64) -> Vec<(usize, [f64; 2])> {
        // dr/dA of the deformed disc.
        let by_area = factor / (2.0 * PI * self.deformed_radius_mm(field).max(f64::MIN_POSITIVE));
        let above = self.sides[0] + 1;
        let mut slopes = Vec::with_capacity(4 * self.cells.len());
        for &[x, y] in self.cells.iter() {
            let ([a, b], [c, d]) = self.diagonals(field, [x, y]);
            let first = y * above + x;
            let [along, across] = [[d, -c], [-b, a]].map(|slope| slope.map(|g| 0.5 * by_area * g));
            slopes.push((first + above + 1, along));
            slopes.push((first, along.map(|g| -g)));
            slopes.push((first + above, across));
            slopes.push((first + 1, across.map(|g| -g)));
        }
        slopes
    }

    fn area_mm2(&self) -> f64 {
        self.cells.len() as f64 * self.cell_mm[0] * self.cell_mm[1]
    }

    fn deformed_radius_mm(&self, field: &Field) -> f64 {
        let areas = self.cells.iter().map(|cell| {
            let ([a, b], [c, d]) = self.diagonals(field, *cell);
            0.5 * (a * d - b * c)
        });
        // A region that is turned inside out, as by a network that extrapolates, has no area.
        (areas.sum::<f64>().max(0.0) / PI).sqrt()
    }

    /// The deformed diagonals of a cell in mm: from the lower left to the upper right corner, and from the lower right
    /// to the upper left one.
    fn diagonals(&self, field: &Field, [x, y]: [usize; 2]) -> ([f64; 2], [f64; 2]) {
        let between = |from: [usize; 2], to: [usize; 2]| {
            let (u, v) = (field.at_corner(from[0], from[1]), field.at_corner(to[0], to[1]));
            [0, 1].map(|axis| (to[axis] as f64 - from[axis] as f64) * self.cell_mm[axis] + v[axis] - u[axis])
        };
        (between([x, y], [x + 1, y + 1]), between([x + 1, y], [x, y + 1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn membrane() -> Membrane {
        Membrane {
            raster: Raster::new(20, 10).unwrap(),
            size_mm: [40.0, 30.0],
        }
    }

    fn region() -> RegionCells {
        RegionCells::of(&Region::Rectangle([[10.0, 6.0], [22.0, 18.0]]), membrane()).unwrap()
    }

    fn field(u: impl Fn(f64, f64) -> [f64; 2]) -> Field {
        let values = (0..11).flat_map(|j| (0..21).map(move |i| (2.0 * f64::from(i), 3.0 * f64::from(j))));
        Field::from_values(membrane().raster, values.flat_map(|(x, y)| u(x, y)).collect()).unwrap()
    }

    #[test]
    fn it_has_the_area_of_its_cells_and_grows_with_them() {
        let region = region();
        assert!((region.radius_mm() - (144.0 / PI).sqrt()).abs() < 1e-12);
        assert_eq!(region.centroid_mm(), [16.0, 12.0]);
        assert!(region.has([5, 2]) && !region.has([11, 2]) && !region.has([5, 6]));
        // An affine motion multiplies all areas by its determinant; the rotation changes none.
        let stretched = field(|x, y| [0.2 * x + 0.1 * y + 3.0, 0.05 * x - 0.1 * y - 1.0]);
        let factor: f64 = 1.2 * 0.9 - 0.1 * 0.05;
        assert!((region.growth_mm(&stretched) - region.radius_mm() * (factor.sqrt() - 1.0)).abs() < 1e-12);
        let (sine, cosine) = 0.7_f64.sin_cos();
        let turned = field(|x, y| [cosine * x - sine * y - x, sine * x + cosine * y - y]);
        assert!(region.growth_mm(&turned).abs() < 1e-12);
        // 12 mm x 12 mm: the edge is 48 mm long.
        assert!((region.growth_per_displacement() - 48.0 / (2.0 * PI * region.radius_mm())).abs() < 1e-12);
    }

    #[test]
    fn its_slope_agrees_with_finite_differences() {
        let region = region();
        let base = field(|x, y| [0.05 * x * (0.3 * y).sin(), 0.02 * y * (0.2 * x).cos()]);
        let mut slopes = vec![0.0; base.values().len()];
        for (corner, slope) in region.slope(&base, 2.0) {
            slopes[2 * corner] += slope[0];
            slopes[2 * corner + 1] += slope[1];
        }
        for at in [
            2 * (2 * 21 + 5),
            2 * (2 * 21 + 5) + 1,
            2 * (4 * 21 + 8),
            2 * (6 * 21 + 11) + 1,
            2 * (3 * 21 + 5),
        ] {
            let moved = |by: f64| {
                let mut values = base.values().to_vec();
                values[at] += by;
                2.0 * region.growth_mm(&Field::from_values(membrane().raster, values).unwrap())
            };
            let difference = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!(
                (difference - slopes[at]).abs() < 1e-9,
                "{at}: {difference} {}",
                slopes[at]
            );
        }
        // Inside, the areas that a corner adds to some cells it takes from others.
        assert!(slopes[2 * (4 * 21 + 8)].abs() < 1e-15 && slopes[2 * (2 * 21 + 5)].abs() > 1e-3);
    }

    #[test]
    fn a_region_without_a_cell_is_refused() {
        let outside = Region::Rectangle([[100.0, 0.0], [110.0, 5.0]]);
        assert!(matches!(
            RegionCells::of(&outside, membrane()),
            Err(GoalError::Region { .. })
        ));
    }
}
