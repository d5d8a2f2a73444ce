//! Electrodes by the share of each cell that they cover.

use super::membrane::Membrane;
use super::polygons::Polygons;
use super::raster::Raster;
use super::symmetry::Symmetry;

/// Shares are multiples of one in this number, so that those of images under symmetries are equal.
const PARTS: u32 = 1_000_000_000;

/// Shares closer to 0 or 1 than this are due to rounding and flattened curves.
const ROUNDING: f64 = 1e-6;

/// The share of each cell that an electrode group covers, `[y][x]` with the origin at the lower left.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Coverage {
    raster: Raster,
    /// The group of each cell; 0 where the share is 0.
    groups: Box<[u8]>,
    /// The share of each cell in units of 1 / [`PARTS`].
    parts: Box<[u32]>,
}

/// Why values are not a coverage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CoverageError {
    /// The wrong number of cells.
    #[error("a coverage has {} cells ({raster}), found {found}", raster.cells())]
    Shape {
        /// The expected raster.
        raster: Raster,
        /// The number of values found.
        found: usize,
    },
    /// A share that is not from 0 to 1.
    #[error("cell [y={y}][x={x}] is covered by {found}; allowed: 0 to 1")]
    Share {
        /// Row, from below.
        y: usize,
        /// Column, from the left.
        x: usize,
        /// The share found.
        found: f64,
    },
    /// A share without a group, or a group without a share.
    #[error("cell [y={y}][x={x}] has the electrode group {group}, of which it is covered by {share}")]
    Group {
        /// Row, from below.
        y: usize,
        /// Column, from the left.
        x: usize,
        /// The group found.
        group: u8,
        /// The share found.
        share: f64,
    },
    /// Two groups in one cell.
    #[error(
        "cell [y={y}][x={x}] is covered by {} of electrode group {} and by {} of group {}",
        deaflow_base::four_digits(.shares[0]), .groups[0], deaflow_base::four_digits(.shares[1]), .groups[1]
    )]
    TwoGroups {
        /// Row, from below.
        y: usize,
        /// Column, from the left.
        x: usize,
        /// The groups.
        groups: [u8; 2],
        /// The share of each.
        shares: [f64; 2],
    },
}

impl Coverage {
    /// Creates a coverage from the group of each cell and the share that it covers, row by row from below. Shares are
    /// rounded to 1e-9, and a cell without share has no group.
    ///
    /// # Errors
    /// When the numbers of values are not that of the cells, a share is not from 0 to 1, or a covered cell has no
    /// group.
    pub fn new(raster: Raster, groups: &[u8], shares: &[f64]) -> Result<Self, CoverageError> {
        for found in [groups.len(), shares.len()] {
            if found != raster.cells() {
                return Err(CoverageError::Shape { raster, found });
            }
        }
        let mut parts = Vec::with_capacity(shares.len());
        for (at, (&share, &group)) in shares.iter().zip(groups).enumerate() {
            let (y, x) = (at / raster.columns(), at % raster.columns());
            if !(0.0..=1.0).contains(&share) {
                return Err(CoverageError::Share { y, x, found: share });
            }
            if (group == 0) != (share == 0.0) {
                return Err(CoverageError::Group { y, x, group, share });
            }
            parts.push((share * f64::from(PARTS)).round() as u32);
        }
        let of_group = |(group, parts): (&u8, &u32)| if *parts == 0 { 0 } else { *group };
        Ok(Self {
            raster,
            groups: groups.iter().zip(&parts).map(of_group).collect(),
            parts: parts.into(),
        })
    }

    /// Creates the coverage of a membrane by the regions of groups in mm, which do not overlap. What lies outside is
    /// left out.
    ///
    /// # Errors
    /// When two groups cover parts of one cell.
    pub fn of_regions(groups: &[(u8, Polygons)], membrane: Membrane) -> Result<Self, CoverageError> {
        let raster = membrane.raster;
        let (mut all, mut shares) = (vec![0; raster.cells()], vec![0.0; raster.cells()]);
        for (group, region) in groups {
            let region = region.intersection(&Polygons::of_membrane(membrane));
            for (at, share) in covered(&region, membrane).into_iter().enumerate() {
                let share = match share {
                    share if share < ROUNDING => continue,
                    share if share > 1.0 - ROUNDING => 1.0,
                    share => share,
                };
                if all[at] != 0 && all[at] != *group {
                    return Err(CoverageError::TwoGroups {
                        y: at / raster.columns(),
                        x: at % raster.columns(),
                        groups: [all[at], *group],
                        shares: [shares[at], share],
                    });
                }
                all[at] = *group;
                shares[at] = f64::min(shares[at] + share, 1.0);
            }
        }
        Self::new(raster, &all, &shares)
    }

    /// Returns the raster.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// Returns the share of the cell at column `x`, row `y` that is covered.
    ///
    /// # Panics
    /// When the cell is outside the raster.
    #[must_use]
    pub fn share(&self, x: usize, y: usize) -> f64 {
        f64::from(self.parts[self.index(x, y)]) / f64::from(PARTS)
    }

    /// Returns the electrode group that covers the cell at column `x`, row `y` or a part of it; 0 for a bare cell.
    ///
    /// # Panics
    /// When the cell is outside the raster.
    #[must_use]
    pub fn group(&self, x: usize, y: usize) -> u8 {
        self.groups[self.index(x, y)]
    }

    fn index(&self, x: usize, y: usize) -> usize {
        let [columns, rows] = self.raster.sides();
        assert!(x < columns && y < rows, "cell ({x}, {y}) is outside the membrane");
        y * columns + x
    }

    /// Returns the groups of all cells, row by row from below.
    #[must_use]
    pub fn groups(&self) -> &[u8] {
        &self.groups
    }

    /// Returns the shares of all cells, row by row from below.
    #[must_use]
    pub fn shares(&self) -> Vec<f64> {
        self.parts
            .iter()
            .map(|part| f64::from(*part) / f64::from(PARTS))
            .collect()
    }

    /// Returns whether a cell is covered in part.
    #[must_use]
    pub fn has_cut_cells(&self) -> bool {
        self.parts.iter().any(|part| !(*part == 0 || *part == PARTS))
    }

    /// Returns the group of each cell that is covered by half or more, and 0 for others.
    #[must_use]
    pub fn cells(&self) -> Vec<u8> {
        let cell = |(group, part): (&u8, &u32)| if 2 * part >= PARTS { *group } else { 0 };
        self.groups.iter().zip(&self.parts).map(cell).collect()
    }

    /// Returns the covered area in cells.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.shares().iter().sum()
    }

    /// Returns the image under a symmetry.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let (mut groups, mut parts) = (self.groups.clone(), self.parts.clone());
        for (from, to) in g.permutation(self.raster.sides()).enumerate() {
            groups[to] = self.groups[from];
            parts[to] = self.parts[from];
        }
        Self {
            raster: self.raster.transformed(g),
            groups,
            parts,
        }
    }

    /// Returns all numbers as bytes, for digests: equal exactly if the coverages are.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let parts = self.parts.iter().flat_map(|part| part.to_le_bytes());
        self.groups.iter().copied().chain(parts).collect()
    }
}

/// Returns the share of each cell of a membrane that a region covers, exactly for a polygon.
///
/// A piece of a boundary within a cell adds the area between it and the right side of the cell to that cell, and its
/// height to all cells on the right, negative where it rises: outer rings run anticlockwise. What lies outside the
/// membrane must have been left out.
fn covered(region: &Polygons, membrane: Membrane) -> Vec<f64> {
    let ([width, height], [columns, rows]) = (membrane.cell_mm(), membrane.raster.sides());
    // Area of pieces within a cell, and height of pieces in cells on the left of it.
    let (mut own, mut passed) = (vec![0.0; columns * rows], vec![0.0; (columns + 1) * rows]);
    for ring in region.rings() {
        let ends = ring.iter().zip(ring.iter().cycle().skip(1));
        for (from, to) in ends {
            let [from, to] = [from, to].map(|point| {
                let [x, y] = [point[0] / width, point[1] / height];
                [x.clamp(0.0, columns as f64), y.clamp(0.0, rows as f64)]
            });
            for [a, b] in pieces(from, to) {
                let fall = a[1] - b[1];
                let middle = [0, 1].map(|axis| f64::midpoint(a[axis], b[axis]));
                let [x, y] = middle.map(|at| at.floor() as usize);
                let (y, x) = (y.min(rows - 1), x.min(columns));
                passed[y * (columns + 1) + x] += fall;
                if x < columns {
                    own[y * columns + x] += fall * (x as f64 - middle[0]);
                }
            }
        }
    }
    for y in 0..rows {
        let mut sum = 0.0;
        for x in 0..columns {
            sum += passed[y * (columns + 1) + x];
            own[y * columns + x] += sum;
        }
    }
    own
}

/// Cuts a straight line where it crosses the sides of cells.
fn pieces(from: [f64; 2], to: [f64; 2]) -> Vec<[[f64; 2]; 2]> {
    let mut cuts = vec![0.0, 1.0];
    for axis in 0..2 {
        let (low, high) = (from[axis].min(to[axis]), from[axis].max(to[axis]));
        let mut side = low.floor() + 1.0;
        while side < high {
            cuts.push((side - from[axis]) / (to[axis] - from[axis]));
            side += 1.0;
        }
    }
    cuts.sort_by(f64::total_cmp);
    let at = |t: f64| match t {
        1.0 => to,
        t => [0, 1].map(|axis| from[axis] + t * (to[axis] - from[axis])),
    };
    cuts.windows(2).map(|pair| [at(pair[0]), at(pair[1])]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    fn membrane(columns: usize, rows: usize, size_mm: [f64; 2]) -> Membrane {
        Membrane {
            raster: Raster::new(columns, rows).unwrap(),
            size_mm,
        }
    }

    fn disc([x, y]: [f64; 2], radius: f64) -> Polygons {
        let count = 40_000;
        let point = |at: i32| {
            let (sin, cos) = (TAU * f64::from(at) / f64::from(count)).sin_cos();
            [x + radius * cos, y + radius * sin]
        };
        Polygons::new(&[(0..count).map(point).collect()])
    }

    #[test]
    fn shares_are_exact_for_polygons() {
        let on = membrane(5, 4, [10.0, 4.0]);
        // A triangle, with a hole of a quarter of a cell in it.
        let triangle = Polygons::new(&[vec![[1.0, 0.5], [9.0, 0.5], [1.0, 3.5]]]);
        let hole = Polygons::new(&[vec![[2.5, 1.25], [3.5, 1.25], [3.5, 1.75], [2.5, 1.75]]]);
        let region = triangle.without(&hole);
        let coverage = Coverage::of_regions(&[(1, region.clone())], on).unwrap();
        // The side from (9, 0.5) to (1, 3.5) is y = 3.875 - 0.375 x. Cells are 2 × 1 mm.
        let near = |x: usize, y: usize, share: f64| {
            let found = coverage.share(x, y);
            assert!((found - share).abs() < 2e-9, "{x} {y}: {found} {share}");
        };
        near(0, 0, 0.25);
        near(1, 0, 0.5);
        near(0, 1, 0.5);
        near(1, 1, 0.75);
        near(4, 3, 0.0);
        // In the lower right cell a triangle from x = 8 to 9, with a height of 0.375.
        near(4, 0, 0.5 * 0.375 / 2.0);
        assert!(
            (2.0 * coverage.area() - region.area()).abs() < 1e-7,
            "{}",
            coverage.area()
        );
        assert_eq!(coverage.group(4, 3), 0);
    }

    #[test]
    fn a_disc_keeps_its_area_on_rasters_of_any_shape() {
        for (columns, rows) in [(50, 50), (20, 70), (3, 2), (1, 1)] {
            let on = membrane(columns, rows, [50.0, 50.0]);
            let coverage = Coverage::of_regions(&[(1, disc([23.3, 26.1], 10.0))], on).unwrap();
            let cell = 2500.0 / (columns * rows) as f64;
            let area = coverage.area() * cell;
            assert!((area / (100.0 * PI) - 1.0).abs() < 1e-6, "{columns} {rows} {area}");
            assert!(coverage.has_cut_cells());
        }
        // A cell that is cut in half belongs to the electrode.
        let half = Polygons::new(&[vec![[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]]]);
        let coverage = Coverage::of_regions(&[(2, half)], membrane(2, 1, [2.0, 1.0])).unwrap();
        assert_eq!((coverage.cells(), coverage.share(0, 0)), (vec![2, 0], 0.5));
    }

    #[test]
    fn symmetries_map_shares_as_they_map_cells() {
        let on = membrane(7, 3, [7.0, 3.0]);
        let region = Polygons::new(&[vec![[0.3, 0.2], [5.1, 0.9], [3.3, 2.7]]]);
        let coverage = Coverage::of_regions(&[(1, region.clone())], on).unwrap();
        for g in Symmetry::ALL {
            let image = coverage.transformed(g);
            assert_eq!(image.transformed(g.inverse()), coverage);
            assert_eq!(image.bytes() == coverage.bytes(), g == Symmetry::IDENTITY);
            // The coverage of the image of the region.
            let size = if g.exchanges_axes() { [3.0, 7.0] } else { [7.0, 3.0] };
            let moved = region.moved(|[x, y]| {
                let [x, y] = g.apply_vector([x - 3.5, y - 1.5]);
                [x + 0.5 * size[0], y + 0.5 * size[1]]
            });
            let direct = Coverage::of_regions(&[(1, moved)], membrane(size[0] as usize, size[1] as usize, size));
            for (a, b) in image.shares().iter().zip(direct.unwrap().shares()) {
                assert!((a - b).abs() < 2e-9);
            }
        }
    }

    #[test]
    fn invalid_values_are_refused() {
        let raster = Raster::new(2, 1).unwrap();
        let new = |groups: &[u8], shares: &[f64]| Coverage::new(raster, groups, shares).map_err(|e| e.to_string());
        assert!(new(&[1, 0], &[0.5, 0.0]).is_ok());
        assert_eq!(
            new(&[1], &[0.5, 0.0]).unwrap_err(),
            "a coverage has 2 cells (2 × 1), found 1"
        );
        let error = new(&[1, 1], &[0.5, 1.5]).unwrap_err();
        assert_eq!(error, "cell [y=0][x=1] is covered by 1.5; allowed: 0 to 1");
        assert!(new(&[1, 1], &[0.5, f64::NAN]).is_err());
        let error = new(&[0, 1], &[0.5, 1.0]).unwrap_err();
        assert_eq!(
            error,
            "cell [y=0][x=0] has the electrode group 0, of which it is covered by 0.5"
        );
        let bar = |low: f64, high: f64| Polygons::new(&[vec![[low, 0.0], [high, 0.0], [high, 1.0], [low, 1.0]]]);
        let groups = [(1, bar(0.0, 1.25)), (2, bar(1.5, 2.0))];
        let error = Coverage::of_regions(&groups, membrane(2, 1, [2.0, 1.0])).unwrap_err();
        assert_eq!(
            error.to_string(),
            "cell [y=0][x=1] is covered by 0.2500 of electrode group 1 and by 0.5000 of group 2"
        );
    }
}
