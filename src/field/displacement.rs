//! A displacement field sampled at the cell corners, whatever mesh it was computed on.

use crate::pattern::{CELLS, Symmetry};

/// Corners along one side: one more than cells.
pub const CORNERS: usize = CELLS + 1;

/// Displacements in mm at the 51 × 51 cell corners, `[y][x][component]`, origin at the lower left.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    values: Vec<f64>,
}

/// Numbers that are not a field.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    /// The wrong number of values.
    #[error("a field has {} values (51 × 51 × 2), found {found}", CORNERS * CORNERS * 2)]
    Shape {
        /// How many there were.
        found: usize,
    },
    /// An infinity or NaN.
    #[error("value {at} of the field is not finite")]
    NotFinite {
        /// Position in the array.
        at: usize,
    },
}

impl Field {
    /// The field that is zero everywhere.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            values: vec![0.0; CORNERS * CORNERS * 2],
        }
    }

    /// A field from its 51 · 51 · 2 values in mm.
    ///
    /// # Errors
    /// When the count is wrong or a value is not finite.
    pub fn from_values(values: Vec<f64>) -> Result<Self, FieldError> {
        if values.len() != CORNERS * CORNERS * 2 {
            return Err(FieldError::Shape { found: values.len() });
        }
        match values.iter().position(|v| !v.is_finite()) {
            Some(at) => Err(FieldError::NotFinite { at }),
            None => Ok(Self { values }),
        }
    }

    /// All values in mm, `[y][x][component]`.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The displacement in mm at corner (column `x`, row `y`).
    ///
    /// # Panics
    /// When `x` or `y` is not below 51.
    #[must_use]
    pub fn at_corner(&self, x: usize, y: usize) -> [f64; 2] {
        assert!(x < CORNERS && y < CORNERS, "corner ({x}, {y}) is outside the membrane");
        let at = 2 * (y * CORNERS + x);
        [self.values[at], self.values[at + 1]]
    }

    /// The displacement in mm at a point given in cells from the lower left corner (0 to 50 in both directions),
    /// bilinear between corners; points outside are moved to the frame, where the displacement is zero.
    #[must_use]
    pub fn at(&self, point_cells: [f64; 2]) -> [f64; 2] {
        let shares = Self::shares(point_cells);
        std::array::from_fn(|k| {
            shares
                .iter()
                .map(|&(corner, share)| self.values[2 * corner + k] * share)
                .sum()
        })
    }

    /// The four corners around a point in cells, by their place in `[y][x]`, with the share that each has in the value there.
    #[must_use]
    pub fn shares(point_cells: [f64; 2]) -> [(usize, f64); 4] {
        let split = |c: f64| {
            let c = c.clamp(0.0, CELLS as f64);
            let low = (c.floor() as usize).min(CELLS - 1);
            (low, c - low as f64)
        };
        let ((i, s), (j, t)) = (split(point_cells[0]), split(point_cells[1]));
        let first = j * CORNERS + i;
        [
            (first, (1.0 - s) * (1.0 - t)),
            (first + 1, s * (1.0 - t)),
            (first + CORNERS, (1.0 - s) * t),
            (first + CORNERS + 1, s * t),
        ]
    }

    /// The largest displacement magnitude in mm over all corners.
    #[must_use]
    pub fn max_magnitude(&self) -> f64 {
        self.values
            .chunks_exact(2)
            .map(|u| u[0].hypot(u[1]))
            .fold(0.0, f64::max)
    }

    /// The largest magnitude in mm, over all corners, of the difference from `other`.
    #[must_use]
    pub fn max_difference(&self, other: &Self) -> f64 {
        let pairs = self.values.chunks_exact(2).zip(other.values.chunks_exact(2));
        pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
    }

    /// The image under a symmetry: `(gu)(gX) = g·u(X)`, vector components rotate too.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let mut values = vec![0.0; self.values.len()];
        for (u, to) in self.values.chunks_exact(2).zip(g.permutation(CORNERS)) {
            values[2 * to..][..2].copy_from_slice(&g.apply_vector([u[0], u[1]]));
        }
        Self { values }
    }

    /// Root mean square over all components of the difference from `other`, in mm.
    #[must_use]
    pub fn rms_difference(&self, other: &Self) -> f64 {
        let sum: f64 = self
            .values
            .iter()
            .zip(&other.values)
            .map(|(a, b)| (a - b).powi(2))
            .sum();
        (sum / self.values.len() as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wavy() -> Field {
        let value = |i: usize| ((i * 37 % 101) as f64 - 50.0) / 40.0;
        Field::from_values((0..CORNERS * CORNERS * 2).map(value).collect()).unwrap()
    }

    #[test]
    fn symmetries_move_the_place_and_rotate_the_vector() {
        let mut values = vec![0.0; CORNERS * CORNERS * 2];
        values[0] = 1.0;
        let rotated = Field::from_values(values).unwrap().transformed(Symmetry::ALL[1]);
        assert_eq!(rotated.at_corner(CORNERS - 1, 0), [0.0, 1.0]);
        for g in Symmetry::ALL {
            assert_eq!(wavy().transformed(g).transformed(g.inverse()), wavy());
            assert_eq!(wavy().transformed(g).max_magnitude(), wavy().max_magnitude());
        }
    }

    #[test]
    fn interpolation_is_exact_for_bilinear_fields() {
        let f = |x: f64, y: f64| [1.0 + 2.0 * x - y + 0.5 * x * y, x * y];
        let values = (0..CORNERS * CORNERS)
            .flat_map(|i| f((i % CORNERS) as f64, (i / CORNERS) as f64))
            .collect();
        let field = Field::from_values(values).unwrap();
        for point in [[0.0, 0.0], [12.25, 33.5], [50.0, 50.0], [49.999, 0.3]] {
            let (u, exact) = (field.at(point), f(point[0], point[1]));
            assert!((u[0] - exact[0]).abs() < 1e-11 && (u[1] - exact[1]).abs() < 1e-11);
        }
    }

    #[test]
    fn refuses_wrong_shapes_and_values_that_are_not_numbers() {
        assert!(Field::from_values(vec![0.0; 3]).is_err());
        let mut values = vec![0.0; CORNERS * CORNERS * 2];
        values[5] = f64::NAN;
        assert_eq!(Field::from_values(values).unwrap_err(), FieldError::NotFinite { at: 5 });
    }
}
